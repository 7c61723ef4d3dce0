"""Suggestions for unknown option names."""

import pytest

from posefuse.model.options.aliases import OTHER_PROGRAMS, RENAMED, matching_option, with_current_names
from posefuse.model.options.catalog import options_by_name


@pytest.mark.parametrize("table", [OTHER_PROGRAMS, RENAMED], ids=["other programs", "renamed"])
def test_every_suggestion_is_an_option(table):
    assert {option for option in table.values() if option not in options_by_name()} == set()
    assert {name for name in table if name in options_by_name()} == set()


@pytest.mark.parametrize(
    ("name", "option"),
    [
        ("--fps", "rate_hz"),
        ("--method", "triangulation.method"),
        ("--filter", "postprocess.smooth"),
        ("likelihood_threshold_triangulation", "triangulation.min_confidence"),
        ("triangulation.reproj_error_threshold", "postprocess.drop_beyond_px"),
        ("filtering.cut_off_frequency", "postprocess.butterworth.cutoff_hz"),
        ("--multi-person", "people"),
        ("min-vews", "triangulation.min_views"),
        ("trajectory.calm", "trajectory.density_prior_s"),
        ("triangulation.ransac.threshold_unit", "triangulation.ransac.threshold_px"),
        ("quaternion", None),
    ],
)
def test_meaning_of_an_unknown_name(name, option):
    assert matching_option(name) == option


def test_siblings_come_first():
    assert matching_option("align.hight_m", ["height_m", "floor"]) == "align.height_m"


def test_former_names_are_replaced_in_their_table_only():
    data = {"trajectory": {"rounds": 2, "prior": "jerk"}, "rounds": 1}
    assert with_current_names(data) == {"trajectory": {"iterations": 2, "prior": "jerk"}, "rounds": 1}


@pytest.mark.parametrize(
    ("former", "current"),
    [
        ({"threshold": 15.0}, {"threshold_px": 15.0}),
        ({"threshold": 15.0, "threshold_unit": "px", "seed": 3}, {"threshold_px": 15.0, "seed": 3}),
        ({"threshold_unit": "m", "threshold": 0.05}, {"threshold_m": 0.05}),
    ],
)
def test_former_thresholds_get_the_option_of_their_unit(former, current):
    assert with_current_names({"triangulation": {"ransac": former}}) == {"triangulation": {"ransac": current}}
