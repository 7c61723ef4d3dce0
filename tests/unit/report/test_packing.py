"""Round trips of the packed arrays of the report page."""

import base64

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.model.status import ViewStatus
from posefuse.report.packing import encode_view_states, fit_grid, pack_covariances, pack_marks, pack_points
from tests.people import simulate_walkers, track_perfectly
from tests.properties import examples


@pytest.fixture(scope="module")
def result():
    return track_perfectly(simulate_walkers(people=3, seconds=2.0))


def test_every_view_status_has_a_code():
    codes = encode_view_states(np.array(list(ViewStatus)))
    named = dict(zip(ViewStatus, codes.tolist(), strict=True))
    assert {status for status, code in named.items() if code == 1} == {ViewStatus.USED, ViewStatus.USED_SWAPPED}
    assert {status for status, code in named.items() if code == 0} == {ViewStatus.UNSEEN, ViewStatus.NOT_RECORDED}


@examples(30)
@given(st.integers(0, 10_000))
def test_packed_points_are_within_half_a_step(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(rng.normal(0, 100, 3), 10.0 ** rng.uniform(-2, 2), (40, 3))
    points[3] = np.nan
    grid = fit_grid(points)
    text, n_outside = pack_points(points, grid)
    steps = np.frombuffer(base64.b64decode(text), "<i2").reshape(-1, 3)
    assert n_outside == 0
    assert (steps[3] == -32768).all()
    present = np.isfinite(points[:, 0])
    back = np.array(grid.origin) + grid.step * steps
    assert np.abs(back - points)[present].max() <= 0.501 * grid.step


@examples(30)
@given(st.integers(0, 10_000))
def test_packed_covariances_are_within_a_tenth(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-3, 0)
    matrix = root @ root.T
    packed = np.array([matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 1], matrix[1, 2], matrix[2, 2]])
    code, *shares = np.frombuffer(base64.b64decode(pack_covariances(np.stack([packed, packed * np.nan]))), np.uint8)[:7]
    a, b, c, d, e, f = np.array(shares).astype(np.int8) / 127 * 1e-6 * 1e9 ** ((float(code) - 1) / 254)
    lower = np.array([[a, 0, 0], [b, d, 0], [c, e, f]])
    np.testing.assert_allclose(lower @ lower.T, matrix, atol=0.1 * np.abs(matrix).max())


def test_unknown_covariances_are_encoded_as_zeros():
    codes = np.frombuffer(base64.b64decode(pack_covariances(np.full((2, 6), np.nan))), np.uint8)
    assert codes.tolist() == [0] * 14


def test_marks_have_two_bits_each(result):
    layer = result.layers["measured"].frames(0, 4)
    marks = pack_marks(layer, layer.has_point, np.array([2]))
    views = encode_view_states(np.asarray(layer.view_status))[2]
    for v in range(views.shape[-1]):
        np.testing.assert_array_equal(marks[0, ..., (1 + v) >> 2] >> 2 * ((1 + v) & 3) & 3, views[..., v])
