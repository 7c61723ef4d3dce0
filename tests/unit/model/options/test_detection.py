"""Options of the detection: the parts of the images that are examined."""

import pytest

from posefuse.errors import OptionsError
from posefuse.model.options.detection import DetectOptions


def test_rectangles_of_all_and_of_single_cameras():
    options = DetectOptions(crop=("0,0,50,40", "a=b=10,20,30,40"))
    assert options.rectangles(["a=b", "c"]) == {"a=b": (10, 20, 30, 40), "c": (0, 0, 50, 40)}
    assert DetectOptions(crop=("c=1,2,3,4",)).rectangles(["b", "c"]) == {"c": (1, 2, 3, 4)}


@pytest.mark.parametrize("entry", ["1,2,3", "1,2,3,x", "cam=", "1.5,2,3,4"])
def test_another_form_is_refused(entry):
    with pytest.raises(OptionsError, match=r"crop must contain LEFT,TOP,WIDTH,HEIGHT or CAMERA="):
        DetectOptions(crop=(entry,))


def test_impossible_values_are_refused():
    with pytest.raises(OptionsError, match="must lie in the image"):
        DetectOptions(crop=("-1,0,5,5",))
    with pytest.raises(OptionsError, match="two rectangles for 'a'"):
        DetectOptions(crop=("a=0,0,5,5", "a=0,0,5,6"))
    with pytest.raises(OptionsError, match="crop names d, but the views are b, c"):
        DetectOptions(crop=("d=0,0,5,5",)).rectangles(["b", "c"])
    with pytest.raises(OptionsError, match=r"end_s must be later than start_s \(2 s\), got 1 s"):
        DetectOptions(start_s=2.0, end_s=1.0)
