"""Options of the detection of people in videos."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from posefuse.arguments import checked
from posefuse.errors import OptionsError, choices
from posefuse.model.options.bounds import check_fields, option

Device = Literal["auto", "cpu", "cuda"]
Rectangle = tuple[int, int, int, int]
"""Left, top, width and height in px."""

_FORM = "LEFT,TOP,WIDTH,HEIGHT or CAMERA=LEFT,TOP,WIDTH,HEIGHT in px, such as cam_1=200,0,900,1080"


@dataclass(frozen=True)
class DetectOptions:
    """Options of the detection of people in videos.

    Attributes:
        detector: Name of a detector (posefuse detector list), worker file, or TOML file that describes an ONNX model;
            by default the best one that can run now.
        detector_python: Python interpreter with the detector's packages; by default that of posefuse detector install.
        weights: Files of the detector's weights; by default those it comes with or downloads.
        device: Where the detector computes.
        every: Interval of the images that are examined.
        start_s: Start time in each video.
        end_s: End time in each video (exclusive).
        crop: Part of the images that is examined, as left,top,width,height, or camera=left,top,width,height for one
            camera; keypoints are in px of the whole image.
        max_people: Most people of an image, those with the highest mean confidence; by default all.
        jobs: Number of detectors that run side by side; by default one per core.
        overlay: Draw the detections on copies of the videos.
    """

    detector: str | None = None
    detector_python: str | None = None
    weights: tuple[str, ...] = ()
    device: Device = "auto"
    every: int = option(1, at_least=1, unit="images")
    start_s: float = option(0.0, at_least=0.0)
    end_s: float | None = option(None, above=0.0)
    crop: tuple[str, ...] = option((), example='["cam_1=200,0,900,1080"]')
    max_people: int | None = option(None, at_least=1, unit="")
    jobs: int | None = option(None, at_least=1, unit="")
    overlay: bool = False

    def __post_init__(self) -> None:
        check_fields(self, "")
        if self.end_s is not None and self.end_s <= self.start_s:
            raise OptionsError(f"end_s must be later than start_s ({self.start_s:g} s), got {self.end_s:g} s.")
        _rectangles(self.crop)

    @checked
    def rectangles(self, views: Sequence[str]) -> dict[str, Rectangle]:
        """Return the part of each view that is examined; views without one are examined whole.

        Raises:
            OptionsError: if ``crop`` names a view that does not exist.
        """
        given = _rectangles(self.crop)
        unknown = [name for name in given if name and name not in views]
        if unknown:
            raise OptionsError(f"crop names {choices(unknown)}, but the views are {choices(views, 30)}.")
        by_view = {name: given.get(name, given.get("")) for name in views}
        return {name: rectangle for name, rectangle in by_view.items() if rectangle is not None}


def _rectangles(entries: Sequence[str]) -> dict[str, Rectangle]:
    """Return the rectangle of each view, that of all others under the empty name.

    Raises:
        OptionsError: if an entry has another form, or a view has two.
    """
    found: dict[str, Rectangle] = {}
    for entry in entries:
        name, _, numbers = entry.rpartition("=")
        try:
            left, top, width, height = (int(number) for number in numbers.split(","))
        except ValueError:
            raise OptionsError(f"crop must contain {_FORM}, got {entry!r}.") from None
        if min(left, top) < 0 or min(width, height) < 1:
            raise OptionsError(f"crop must lie in the image and have a size, got {entry!r}.")
        if name in found:
            raise OptionsError(f"crop has two rectangles for {repr(name) if name else 'all cameras'}.")
        found[name] = (left, top, width, height)
    return found
