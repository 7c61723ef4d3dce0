"""The default layer follows from the scores of left-out views."""

import math
from dataclasses import replace

import pytest

from posefuse.model.layer_scores import LayerScore, describe_scores, layer_of_scores


def scores(*, share: float = 1.0, **median_px: float) -> list[LayerScore]:
    return [LayerScore(name, px, 1.4 * px, share if name == "model" else 1.0) for name, px in median_px.items()]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (scores(measured=4.7, solved=4.6, model=6.3), "solved"),
        (scores(measured=4.7, model=6.3), "measured"),
        (scores(measured=6.0, solved=5.5, model=5.0), "model"),
        (scores(measured=5.0, solved=5.04, model=5.01), "solved"),
        (scores(measured=5.0, solved=5.06), "measured"),
        (scores(measured=5.0, model=4.0, share=0.98), "measured"),
        (scores(measured=math.nan, solved=math.nan), None),
        ([], None),
    ],
)
def test_best_complete_layer_is_the_default_and_solved_wins_ties(given, expected):
    assert layer_of_scores(given) == expected


def test_mean_counts_as_much_as_the_median():
    rare_errors = [LayerScore("measured", 4.7, 9.0, 1.0), LayerScore("model", 4.9, 6.0, 1.0)]
    assert layer_of_scores(rare_errors) == "model"


@pytest.mark.parametrize(
    ("geometric_px", "expected"),
    [
        ({"solved": 4.0, "model": 3.9}, "model"),
        ({"solved": 4.0, "model": 3.97}, "solved"),
        ({"solved": 3.97, "model": 4.0}, "solved"),
        ({"measured": 3.9, "model": 4.0}, "measured"),
        ({"solved": 4.0, "model": math.nan}, "solved"),
    ],
)
def test_ratios_of_errors_decide_between_equal_scores(geometric_px, expected):
    given = [LayerScore(name, 5.0, 7.0, 1.0, px) for name, px in geometric_px.items()]
    assert layer_of_scores(given) == expected
    # A layer with a score that is more than 1 % larger does not count.
    worse = LayerScore("measured" if "solved" in geometric_px else "solved", 5.2, 7.2, 1.0, 1.0)
    assert layer_of_scores([*given, worse]) == expected


def test_sentence_names_all_scores_and_the_default():
    given = scores(measured=4.66, solved=4.66, model=4.0, share=0.8)
    assert describe_scores(given) == (
        "Left-out views (median and mean): measured 4.7 and 6.5 px, solved 4.7 and 6.5 px, model 4.0 and 5.6 px (has "
        "80 % of the measured points). The default layer is solved."
    )
    assert describe_scores([]) == ""


@pytest.mark.parametrize(("model_px", "expected"), [(5.2, "model"), (5.3, "solved")])
def test_most_processed_layer_wins_wide_ties_where_two_cameras_predict_a_third(model_px, expected):
    given = [replace(each, predicted_by=2) for each in scores(measured=5.2, solved=5.0, model=model_px)]
    assert layer_of_scores(given) == expected
    assert layer_of_scores([replace(each, predicted_by=3) for each in given]) == "solved"
