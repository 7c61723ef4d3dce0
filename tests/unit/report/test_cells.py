"""Cells, series and packing against what can be counted by hand."""

import base64

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.model.status import PointStatus, ViewStatus
from posefuse.model.tracks import TrackState
from posefuse.report.cells import cells_of
from posefuse.report.packing import box_of, packed_marks, packed_points, packed_spreads, view_codes
from posefuse.report.series import FILLED, MEASURED, MISSING, Series, gaps_of, mostly, series_of, shown_bones, stretched
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.laws import examples
from tests.people import crowd, followed


@pytest.fixture(scope="module")
def result():
    return followed(crowd(people=3, seconds=2.0))


def test_shares_and_errors_of_a_cell_are_those_counted(result):
    cells = cells_of(result.chunks(16), "measured", result.n_frames)
    layer = result.layers["measured"]
    there = np.asarray(result.tracks.state) != TrackState.ABSENT
    status = np.asarray(layer.view_status)[there]
    error = np.asarray(layer.view_error_px)[there]
    for k, v in ((0, 0), (7, 2)):
        used = status[:, k, v] == ViewStatus.USED
        assert cells.shares[k, v, 1] == pytest.approx(used.mean())
        assert cells.error_px[k, v] == pytest.approx(np.median(error[used, k, v]), rel=1e-5)
    np.testing.assert_allclose(cells.shares.sum(axis=-1), 1.0)


def test_the_worst_frame_of_a_cell_is_the_worst(result):
    worst = cells_of(result.chunks(), "measured", result.n_frames).worst["error"]
    error = np.asarray(result.layers["measured"].view_error_px)
    for k, v in ((0, 0), (7, 2)):
        assert worst.error_px[k, v, 0] == pytest.approx(np.nanmax(error[:, :, k, v]))
        assert error[worst.place[k, v, 0], worst.person[k, v, 0], k, v] == worst.error_px[k, v, 0]
        assert (np.diff(worst.error_px[k, v]) <= 0).all()
        assert len(set(worst.place[k, v])) == 3


def test_every_status_of_a_view_is_used_lacking_or_rejected():
    codes = view_codes(np.array(list(ViewStatus)))
    named = dict(zip(ViewStatus, codes.tolist(), strict=True))
    assert {status for status, code in named.items() if code == 1} == {ViewStatus.USED, ViewStatus.USED_SWAPPED}
    assert {status for status, code in named.items() if code == 0} == {ViewStatus.UNSEEN, ViewStatus.NOT_RECORDED}


def test_series_are_means_of_each_frame(result):
    series = series_of(result.chunks(16), "measured", result.skeleton)
    layer = result.layers["measured"]
    errors = np.asarray(layer.reprojection_error_px)[30]
    for p, known in enumerate(np.isfinite(errors)):
        expected = errors[p][known].mean() if known.any() else np.nan
        np.testing.assert_allclose(series.error_px[30, p], expected)
    a, b = (result.skeleton.index(name) for name in series.bones[0])
    points = np.asarray(layer.points_m)
    np.testing.assert_allclose(series.bones_m[5, 0, 0], np.linalg.norm(points[5, 0, a] - points[5, 0, b]), rtol=1e-6)


def test_hands_and_faces_are_no_bones():
    bones = shown_bones(shipped_skeleton("coco_wholebody_133"))
    assert ("left_shoulder", "left_elbow") in bones
    assert not any("finger" in name or "face" in name for bone in bones for name in bone)


def test_gaps_by_hand():
    how = np.full((10, 1, 2), MEASURED, dtype=np.int8)
    how[2:5, 0, 0] = MISSING
    how[3, 0, 0] = FILLED
    how[8:, 0, 1] = FILLED
    status = np.where(how == FILLED, PointStatus.FILLED, PointStatus.NOT_SEEN).astype(np.int8)
    nothing = np.zeros((10, 1))
    first, second = gaps_of(Series(nothing, nothing, (), np.zeros((10, 1, 0)), how, status))
    assert (first.keypoint, first.start, first.stop, first.filled, first.status) == (0, 2, 5, 1, PointStatus.NOT_SEEN)
    assert (second.keypoint, second.start, second.stop, second.filled, second.status) == (
        1,
        8,
        10,
        2,
        PointStatus.FILLED,
    )


def test_a_stretch_is_what_most_of_it_is_and_of_equals_the_worse():
    how = np.array([MEASURED, MEASURED, FILLED, MEASURED, FILLED, MISSING])
    assert mostly(how, np.array([0, 3])).tolist() == [MEASURED, MISSING]
    assert stretched(np.array([1.0, np.nan, 3.0, np.nan]), np.array([0, 3])).tolist()[0] == 2.0


@examples(30)
@given(st.integers(0, 10_000))
def test_points_survive_packing_to_half_a_step(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(rng.normal(0, 100, 3), 10.0 ** rng.uniform(-2, 2), (40, 3))
    points[3] = np.nan
    box = box_of(points)
    text, strays = packed_points(points, box)
    steps = np.frombuffer(base64.b64decode(text), "<i2").reshape(-1, 3)
    assert strays == 0
    assert (steps[3] == -32768).all()
    there = np.isfinite(points[:, 0])
    back = np.array(box.middle) + box.step * steps
    assert np.abs(back - points)[there].max() <= 0.501 * box.step


@examples(30)
@given(st.integers(0, 10_000))
def test_covariances_survive_packing_to_a_tenth(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-3, 0)
    matrix = root @ root.T
    packed = np.array([matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 1], matrix[1, 2], matrix[2, 2]])
    code, *shares = np.frombuffer(base64.b64decode(packed_spreads(np.stack([packed, packed * np.nan]))), np.uint8)[:7]
    a, b, c, d, e, f = np.array(shares).astype(np.int8) / 127 * 1e-6 * 1e9 ** ((float(code) - 1) / 254)
    lower = np.array([[a, 0, 0], [b, d, 0], [c, e, f]])
    np.testing.assert_allclose(lower @ lower.T, matrix, atol=0.1 * np.abs(matrix).max())


def test_unknown_covariances_are_not_drawn():
    codes = np.frombuffer(base64.b64decode(packed_spreads(np.full((2, 6), np.nan))), np.uint8)
    assert codes.tolist() == [0] * 14


def test_marks_are_two_bits_each(result):
    layer = result.layers["measured"].frames(0, 4)
    marks = packed_marks(layer, layer.has_point, np.array([2]))
    views = view_codes(np.asarray(layer.view_status))[2]
    for v in range(views.shape[-1]):
        np.testing.assert_array_equal(marks[0, ..., (1 + v) >> 2] >> 2 * ((1 + v) & 3) & 3, views[..., v])
