"""Arrays that are read by ranges, and their comparison."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.arrays import ArrayRange, check_shape, column_medians, frozen, ranges, same
from posefuse.errors import DetectionsError
from posefuse.synthetic.rigs import build_rig
from tests.properties import examples


@examples(50)
@given(length=st.integers(0, 100), size=st.integers(1, 40))
def test_ranges_cover_every_index_once(length, size):
    parts = list(ranges(length, size))
    assert [i for start, stop in parts for i in range(start, stop)] == list(range(length))
    assert all(stop - start <= size for start, stop in parts)


def test_range_reads_its_source_once_and_on_demand():
    class Source:
        shape, dtype, reads = (10, 3), np.dtype(float), 0

        def __getitem__(self, key):
            self.reads += 1
            return np.arange(30.0).reshape(10, 3)[key]

    source = Source()
    part = ArrayRange(source, 2, 7)
    assert (part.shape, source.reads) == ((5, 3), 0)
    np.testing.assert_array_equal(part[1:3], np.arange(30.0).reshape(10, 3)[3:5])
    np.testing.assert_array_equal(np.asarray(part), np.arange(30.0).reshape(10, 3)[2:7])
    assert source.reads == 1


def test_frozen_array_is_a_read_only_view():
    array = np.zeros(3)
    view = frozen(array)
    assert np.shares_memory(view, array)
    with pytest.raises(ValueError, match="read-only"):
        view[0] = 1.0
    array[0] = 2.0
    assert view[0] == 2.0


def test_arrays_are_equal_by_content_and_shape():
    nan = np.array([1.0, np.nan])
    assert same({"a": nan, "b": np.nan}, {"a": nan.copy(), "b": np.nan})
    assert not same(nan, np.array([1.0, 2.0]))
    assert not same(np.zeros(2), np.zeros((2, 1)))
    assert not same({"a": nan}, {"b": nan})


def test_wrong_shape_is_an_error_that_names_the_axes():
    check_shape(DetectionsError, "D", "x", np.zeros((4, 3)), frame=None, xyz=3)
    with pytest.raises(DetectionsError, match=r"D.x: expected the axes \(frame, xyz\) = \(any, 3\), .* shape \(4, 2\)"):
        check_shape(DetectionsError, "D", "x", np.zeros((4, 2)), frame=None, xyz=3)


def test_arrays_are_read_only_after_unpickling():
    rig = pickle.loads(pickle.dumps(build_rig("ring", 2)))
    assert not rig.cameras[0].matrix.flags.writeable


def test_column_medians_ignore_missing_numbers():
    values = np.random.default_rng(0).normal(size=(7, 4, 2))
    values[3:, 1] = np.nan
    values[2, 2, 0] = np.nan
    np.testing.assert_array_equal(column_medians(values), np.nanmedian(values, axis=0))
    values[:, 0] = np.nan
    assert np.isnan(column_medians(values)[0]).all()
