"""Rendered figures: reproducible bytes, special characters and empty data, independence of user settings."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import matplotlib
import numpy as np
import pytest

from posefuse.evaluation.error_profile import error_profile
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import METHODS, TriangulationOptions
from posefuse.pipeline.compare_methods import compare_methods
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.report.comparison import comparison_figure
from posefuse.report.numbers import format_three_digits
from posefuse.report.percentile_filter import percentile_filter_figure
from tests.scenes import body_points, ring, simulate_detections


@pytest.fixture(scope="module")
def detections():
    rng = np.random.default_rng(6)
    return simulate_detections(ring(5), body_points(rng, 20), rng)


@pytest.fixture(scope="module")
def compared(detections):
    return compare_methods(ring(5), detections, list(METHODS), Options(noise_scale_px=2.0), timed=False)


@pytest.fixture(scope="module")
def filtered(detections):
    chosen = TriangulationOptions(method="percentile_filter")
    return reconstruct(ring(5), detections, Options(noise_scale_px=2.0, triangulation=chosen))


def test_same_numbers_give_the_same_bytes(compared):
    one = comparison_figure(compared)
    others = [comparison_figure(compared) for _ in range(4)]  # the layout solver is not deterministic
    assert [other == one for other in others] == [True] * 4
    with matplotlib.rc_context({"font.size": 30, "axes.facecolor": "red", "svg.hashsalt": "other"}):
        two = comparison_figure(compared)
    assert one == two
    assert one.png.startswith(b"\x89PNG")
    for word in (b"<dc:date>", b"tEXtSoftware"):
        assert word not in one.png + one.svg
    assert ElementTree.fromstring(one.svg).tag.endswith("svg")


def test_drawing_does_not_change_user_settings(compared):
    before = dict(matplotlib.rcParams)
    comparison_figure(compared)
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("n", [1, 5])
def test_comparison_of_any_number_of_methods(n, compared):
    assert comparison_figure(replace(compared, methods=compared.methods[:n])).png


def test_comparison_with_a_method_without_points(compared):
    nothing = replace(compared.methods[0].used_error, median_px=np.nan, at_shares_px=(np.nan,) * 401)
    never = replace(nothing, median_px=np.inf, at_shares_px=(np.inf,) * 401)
    row = replace(compared.methods[0], used_error=nothing, all_error=never, missing_share=1.0, truth_median_mm=np.nan)
    assert comparison_figure(replace(compared, methods=(row,))).png
    assert comparison_figure(replace(compared, methods=(row, compared.methods[1]))).png


def test_percentile_filter_figure(detections, filtered):
    plain = reconstruct(
        ring(5), detections, Options(noise_scale_px=2.0, triangulation=TriangulationOptions(method="simple"))
    )
    before, after = error_profile([plain]), error_profile([filtered])
    assert percentile_filter_figure(before, after, filtered) == percentile_filter_figure(before, after, filtered)
    assert (after.view_p95_px < before.view_p95_px).all()


def test_special_characters_in_names_are_drawn_literally(filtered):
    names = ("$\\frac{1}$", "a_b^c$", "<b>&", "骨", "")
    cameras = tuple(replace(camera, name=name or "x") for camera, name in zip(filtered.rig.cameras, names, strict=True))
    hostile = replace(filtered, rig=replace(filtered.rig, cameras=cameras))
    profile = error_profile([hostile])
    assert percentile_filter_figure(profile, profile, hostile).png


def test_percentile_filter_figure_of_a_single_frame(detections):
    chosen = TriangulationOptions(method="percentile_filter")
    options = Options(noise_scale_px=2.0, triangulation=chosen)
    one = reconstruct(ring(5), detections.frames(0, 1), options)
    assert percentile_filter_figure(error_profile([one]), error_profile([one]), one).png


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.0, "0"), (0.01234, "0.012"), (0.5, "0.50"), (9.996, "10.0"), (12.34, "12.3"), (99.96, "100"), (1234.5, "1234"),
     (float("nan"), "-"), (float("inf"), "inf")],
)  # fmt: skip
def test_three_digits(value, shown):
    assert format_three_digits(value) == shown
