"""Lazy arrays give what NumPy arrays give, and results read from a file what fresh results give."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import posefuse
from posefuse.io.results import netcdf
from posefuse.io.results.rounding import rounded
from posefuse.lazy_array import LazyArray
from posefuse.model.status import PointStatus
from tests.scenes import body_points, ring, simulate_detections


class Stored(LazyArray):
    """An array that counts the rows that are read."""

    def __init__(self, array: np.ndarray) -> None:
        super().__init__(array.shape, array.dtype)
        self.array, self.n_read = array, 0

    def read_rows(self, start: int, stop: int) -> np.ndarray:
        assert 0 <= start < stop <= len(self.array)
        self.n_read += stop - start
        return self.array[start:stop].copy()


@pytest.fixture(scope="module")
def walking_result(tmp_path_factory):
    """A result in memory, with the precision of files, and the same read from its file."""
    rig, rng = ring(4), np.random.default_rng(3)
    start = body_points(rng, 1)
    points = start + 0.01 * np.arange(40)[:, None, None] * np.array([1.0, 0.0, 0.0])
    fresh = posefuse.reconstruct(rig, simulate_detections(rig, points, rng))
    path = tmp_path_factory.mktemp("result") / "reconstruction.nc"
    netcdf.write([fresh], path)
    return rounded(fresh), posefuse.read_reconstruction(path)


EXPRESSIONS: dict[str, Callable[[Any], Any]] = {
    "multiply": lambda x: x * 1000,
    "multiply from the left": lambda x: 2.0 * x,
    "subtract": lambda x: x - x[0],
    "divide": lambda x: x / 3.0,
    "floor divide": lambda x: x // 2,
    "remainder": lambda x: x % 2,
    "power": lambda x: x**2,
    "negate": lambda x: -x,
    "absolute value": abs,
    "equal": lambda x: x == 1,
    "not equal": lambda x: x != 1,
    "less": lambda x: x < 1,
    "mask": lambda x: x[x > 0],
    "mask of finite values": lambda x: x[np.isfinite(x)],
    "mask of rows": lambda x: x[np.arange(len(x)) % 2 == 0],
    "list of rows": lambda x: x[[0, -1]],
    "row": lambda x: x[-1],
    "NumPy integer": lambda x: x[np.int64(0)],
    "slice": lambda x: x[1:3],
    "reversed": lambda x: x[::-1],
    "reversed with stop": lambda x: x[-1:0:-2],
    "step": lambda x: x[::2],
    "empty slice": lambda x: x[2:1],
    "slice and column": lambda x: x[:, 0],
    "row and column": lambda x: x[0, -1],
    "ellipsis": lambda x: x[..., 0],
    "new axis": lambda x: x[None],
    "new axis at the end": lambda x: x[:, None],
    "index arrays": lambda x: x[np.array([0, 0]), np.array([0, -1])],
    "no index": lambda x: x[()],
    "mean": lambda x: np.mean(x, axis=0),
    "mean method": lambda x: x.mean(axis=0),
    "nanmedian": lambda x: np.nanmedian(x, axis=0),
    "sum": sum,
    "minimum": lambda x: np.nanmin(np.where(np.isnan(x), 0, x)),
    "diff": lambda x: np.diff(x, axis=0),
    "norm": lambda x: np.linalg.norm(x, axis=-1),
    "concatenate": lambda x: np.concatenate([x, x], axis=1),
    "stack": lambda x: np.stack((x, x)),
    "where": lambda x: np.where(x > 0, x, 0),
    "einsum": lambda x: np.einsum("i...->...", x),
    "reshape": lambda x: x.reshape(-1),
    "transpose": lambda x: x.T,
    "astype": lambda x: x.astype(np.float32),
    "tolist": lambda x: np.array(x.tolist()),
    "copy": lambda x: x.copy(),
    "asarray": np.asarray,
    "asarray with type": lambda x: np.asarray(x, dtype=np.float32),
    "iterate": list,
    "membership": lambda x: 1 in x,
    "any": lambda x: (x > 0).any(),
    "all": lambda x: np.all(x == x),
    "length, shape, size": lambda x: (len(x), *x.shape, x.ndim, x.size, x.nbytes),
    "deep copy": copy.deepcopy,
    "zeros like": np.zeros_like,
    "percentile": lambda x: np.nanpercentile(x, 5, axis=0),
    "argsort": lambda x: np.argsort(x, axis=0),
    "matrix product": lambda x: x.reshape(len(x), -1) @ x.reshape(len(x), -1).T,
    "ufunc with output": lambda x: np.add(x, 1, out=np.empty(x.shape)),
    "in place": lambda x: _added(x.copy()),
    "bind a new array": lambda x: _added(x) if isinstance(x, LazyArray) else _added(x.copy()),
}


def _added(x: Any) -> Any:
    x += 1
    return x


def _assert_same(a: Any, b: Any) -> None:
    assert not isinstance(a, LazyArray)
    if isinstance(b, (np.ndarray, list)):
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))
        assert np.asarray(a).dtype == np.asarray(b).dtype
    else:
        assert type(a) is type(b)
        assert a == b or (a != a and b != b)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", EXPRESSIONS)
def test_expression_gives_what_it_gives_for_a_numpy_array(name):
    rng = np.random.default_rng(0)
    array = rng.normal(size=(7, 3, 2)).round(1)
    array[2, 1] = np.nan
    array[0, 0, 0] = 1.0
    _assert_same(EXPRESSIONS[name](Stored(array)), EXPRESSIONS[name](array))
    loaded = Stored(array)
    loaded.load()
    _assert_same(EXPRESSIONS[name](loaded), EXPRESSIONS[name](array))


@pytest.mark.hypothesis
@given(st.data())
def test_every_basic_index_gives_what_it_gives_for_a_numpy_array(data):
    shape = data.draw(hnp.array_shapes(min_dims=1, max_dims=4, min_side=0, max_side=6))
    array = np.arange(np.prod(shape)).reshape(shape)
    key = data.draw(hnp.basic_indices(shape, allow_newaxis=True))
    np.testing.assert_array_equal(Stored(array)[key], array[key])


@pytest.mark.hypothesis
@given(st.data())
def test_every_integer_array_gives_what_it_gives_for_a_numpy_array(data):
    shape = data.draw(hnp.array_shapes(min_dims=1, max_dims=3, min_side=1, max_side=6))
    array = np.arange(np.prod(shape)).reshape(shape)
    key = data.draw(hnp.integer_array_indices(shape))
    np.testing.assert_array_equal(Stored(array)[key], array[key])


def test_a_slice_reads_only_its_rows_and_a_function_reads_the_array_once():
    stored = Stored(np.arange(20.0).reshape(10, 2))
    _ = stored[3:5], stored[-1], stored[[6, 8]]
    assert stored.n_read == 2 + 1 + 3
    _ = stored + 1, np.mean(stored), stored[2:7]
    assert stored.n_read == 6 + 10


def test_writing_is_refused():
    stored = Stored(np.zeros((4, 2)))
    with pytest.raises(ValueError, match="read-only. Modify a copy"):
        stored[0] = 1.0
    with pytest.raises(ValueError, match="read-only. Modify a copy"):
        np.add(stored, 1.0, out=stored)
    with pytest.raises(ValueError, match="read-only"):
        stored.load()[0] = 1.0


def test_indices_out_of_bounds_and_unknown_attributes_raise_as_for_numpy_arrays():
    stored = Stored(np.zeros((4, 2)))
    for key in (4, -5, [0, 4], [-5]):
        with pytest.raises(IndexError, match="out of bounds for axis 0 with size 4"):
            stored[key]
    with pytest.raises(AttributeError, match="no attribute 'velocity'"):
        _ = stored.velocity


def test_a_pickled_array_reads_again():
    stored = Stored(np.arange(6.0).reshape(3, 2))
    stored.load()
    again = pickle.loads(pickle.dumps(stored))
    assert again.n_read == 3
    np.testing.assert_array_equal(again * 2, stored.array * 2)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", EXPRESSIONS)
def test_expression_is_equal_for_fresh_and_reread_results(name, walking_result):
    fresh, reread = walking_result
    for layer in fresh.layers:
        expected, stored = fresh.layers[layer].points_m, reread.layers[layer].points_m
        assert isinstance(stored, LazyArray)
        _assert_same(EXPRESSIONS[name](stored), EXPRESSIONS[name](np.asarray(expected)))


def test_points_are_selected_by_status_in_reread_results(walking_result):
    for result in walking_result:
        layer = result.layers["measured"]
        ok = layer.status == PointStatus.OK
        assert ok.shape == layer.status.shape
        assert np.isfinite(layer.points_m[ok]).all()
        assert len(layer.points_m[ok]) == np.count_nonzero(ok) > 100
