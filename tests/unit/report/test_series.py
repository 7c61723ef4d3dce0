"""Time series and gaps against hand-computed values."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.model.status import PointStatus
from posefuse.report.html import render_report
from posefuse.report.series import (
    ABSENT,
    FILLED,
    MEASURED,
    MISSING,
    TimeSeries,
    displayed_bones,
    find_gaps,
    gather_series,
    majority_per_interval,
    mean_per_interval,
    time_series_data,
)
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.people import simulate_walkers, track_perfectly


@pytest.fixture(scope="module")
def result():
    return track_perfectly(simulate_walkers(people=3, seconds=2.0))


def test_series_are_means_over_each_frame(result):
    series = gather_series(result.chunks(16), "measured", result.skeleton)
    layer = result.layers["measured"]
    errors = np.asarray(layer.reprojection_error_px)[30]
    for p, reference in enumerate(np.isfinite(errors)):
        expected = errors[p][reference].mean() if reference.any() else np.nan
        np.testing.assert_allclose(series.error_px[30, p], expected)
    a, b = (result.skeleton.index(name) for name in series.bones[0])
    points = np.asarray(layer.points_m)
    np.testing.assert_allclose(series.bones_m[5, 0, 0], np.linalg.norm(points[5, 0, a] - points[5, 0, b]), rtol=1e-6)


def test_highest_error_is_that_of_the_worst_frame(result):
    """Means over time intervals have a lower maximum, which would contradict the highlight of the worst frame."""
    long = type(result).concatenate(
        [
            replace(
                result,
                frame_numbers=result.frame_numbers + i * result.n_frames,
                time_s=result.time_s + 2.0 * i,
                events=(),
            )
            for i in range(40)
        ]
    )
    series = gather_series(long.chunks(), "model", long.skeleton)
    data = time_series_data(long, series)
    shown = [value for person in data["error"] for value in person if value is not None]
    assert data["highestError"] == round(float(np.nanmax(series.error_px)), 1)
    assert data["highestError"] > max(shown)
    assert (
        f": {data['highestError']:.1f} px."
        in render_report(long).split("The frame with the highest mean error")[1][:60]
    )


def test_edges_of_hands_and_faces_are_not_displayed():
    bones = displayed_bones(shipped_skeleton("coco_wholebody_133"))
    assert ("left_shoulder", "left_elbow") in bones
    assert not any("finger" in name or "face" in name for bone in bones for name in bone)


def test_gaps_match_a_hand_computed_example():
    point_state = np.full((10, 1, 2), MEASURED, dtype=np.int8)
    point_state[2:5, 0, 0] = MISSING
    point_state[3, 0, 0] = FILLED
    point_state[8:, 0, 1] = FILLED
    status = np.where(point_state == FILLED, PointStatus.FILLED, PointStatus.NOT_SEEN).astype(np.int8)
    nothing = np.zeros((10, 1))
    first, second = find_gaps(TimeSeries(nothing, nothing, (), np.zeros((10, 1, 0)), point_state, status))
    assert (first.keypoint, first.start, first.stop, first.filled, first.status) == (0, 2, 5, 1, PointStatus.NOT_SEEN)
    assert (second.keypoint, second.start, second.stop, second.filled, second.status) == (
        1,
        8,
        10,
        2,
        PointStatus.FILLED,
    )


def test_interval_has_most_frequent_state_or_worse_one_of_a_tie():
    point_state = np.array([MEASURED, MEASURED, FILLED, MEASURED, FILLED, MISSING])
    assert majority_per_interval(point_state, np.array([0, 3])).tolist() == [MEASURED, MISSING]
    assert mean_per_interval(np.array([1.0, np.nan, 3.0, np.nan]), np.array([0, 3])).tolist()[0] == 2.0


@pytest.mark.parametrize("n_frames", [4097, 6000, 12_345, 90_000])
def test_intervals_do_not_depend_on_the_blocks_in_which_they_are_read(n_frames):
    rng = np.random.default_rng(n_frames)
    starts = np.linspace(0, n_frames, 600, endpoint=False).astype(int)
    values = rng.normal(size=(n_frames, 3))
    values[rng.random(values.shape) < 0.1] = np.nan
    states = rng.integers(0, 4, (n_frames, 2, 3), dtype=np.int8)
    spans = list(zip(starts, [*starts[1:], n_frames], strict=True))
    np.testing.assert_allclose(mean_per_interval(values, starts), [np.nanmean(values[a:b], axis=0) for a, b in spans])
    # The state of a tie that comes first in this order is the worse one.
    order = [MISSING, FILLED, MEASURED, ABSENT]
    expected = [np.argmax([(states[a:b] == code).sum(axis=0) for code in order], axis=0) for a, b in spans]
    np.testing.assert_array_equal(majority_per_interval(states, starts), np.array(order)[np.array(expected)])
