"""Selection and combination of body states."""

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.tracking.body_states import (
    empty_state,
    fix_shape_covariance,
    free_columns,
    join_states,
    select_states,
    set_state,
)
from tests.unit.tracking.mice import TREE, standing


def two_bodies() -> State:
    return join_states(standing(np.zeros(3)), standing(np.array([0.1, 0.2, 0.0])))


def assert_equal_states(first: State, second: State) -> None:
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)


def test_selected_bodies_rejoin_to_the_same_states():
    state = two_bodies()
    assert_equal_states(join_states(select_states(state, [0]), select_states(state, [1])), state)
    assert_equal_states(select_states(state, np.array([False, True])), select_states(state, [1]))
    assert_equal_states(join_states(empty_state(TREE), state), state)


def test_selection_is_a_copy():
    state = two_bodies()
    selected = select_states(state, [1])
    selected.root[:] = 9.0
    assert not (state.root == 9.0).any()
    set_state(state, 0, selected)
    assert_equal_states(select_states(state, [0]), selected)


def test_fixed_shape_has_no_uncertainty():
    state, n, h = two_bodies(), TREE.n_pose, TREE.n_shape
    before = state.covariance.copy()
    fix_shape_covariance(state, 1, n, h)
    assert state.free.tolist() == [1, 0]
    np.testing.assert_array_equal(state.covariance[0], before[0])
    kept = free_columns(n, h, free=False)
    np.testing.assert_array_equal(state.covariance[1][np.ix_(kept, kept)], before[1][np.ix_(kept, kept)])
    fixed = np.setdiff1d(free_columns(n, h, free=True), kept)
    assert len(fixed) == h
    assert not state.covariance[1][fixed].any()
    assert not state.covariance[1][:, fixed].any()
