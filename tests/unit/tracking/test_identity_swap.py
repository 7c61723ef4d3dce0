"""Identity swaps move names and bone lengths between tracks."""

import numpy as np

from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import join_states
from posefuse.tracking.identity_audit import Contact, drop_contacts, ordered_pair
from posefuse.tracking.lifecycle import fix_shape, swap_identities
from posefuse.tracking.settings import TrackerSettings
from tests.unit.tracking.test_lifecycle import tracked_person
from tests.unit.tracking.test_smoothing import settings

__all__ = ["settings"]


def test_bone_lengths_move_with_the_name(settings: TrackerSettings):
    """One shape is fixed and one is free; both stay so, and covariances stay valid."""
    (one, first), (other, second) = (tracked_person(settings, TrackState.ACTIVE) for _ in range(2))
    other.number, other.name = 2, "person_2"
    state = join_states(first, second)
    state.shape[1] *= 1.1
    state.root[1] += 1.0
    one.last_multiview_s = 1e3
    fix_shape(one, state, 0, 1e3, 1e3, settings)
    roots, shapes, covariance = state.root.copy(), state.shape.copy(), state.covariance.copy()
    n, h = settings.tree.n_pose, settings.tree.n_shape
    swap_identities([one, other], state, 0, 1)
    assert [(t.number, t.name, t.known_shape is not None, t.shape_observed_s) for t in (one, other)] == [
        (1, "person_2", False, 0.0),
        (2, "person_1", True, 1e3),
    ]
    np.testing.assert_array_equal(state.root, roots)
    np.testing.assert_array_equal(state.shape, shapes[::-1])
    np.testing.assert_array_equal(state.free, [1, 0])
    lengths = slice(n, n + h)
    np.testing.assert_array_equal(state.covariance[0, lengths, lengths], covariance[1, lengths, lengths])
    assert not state.covariance[1, lengths].any()
    np.testing.assert_array_equal(state.covariance[:, :n, :n], covariance[:, :n, :n])
    np.linalg.cholesky(state.covariance[0])


def test_contacts_are_stored_under_ordered_names():
    pairs = [ordered_pair("b", "a"), ordered_pair("a", "c"), ordered_pair("c", "d")]
    assert pairs == [("a", "b"), ("a", "c"), ("c", "d")]
    known = {pair: Contact(pair) for pair in pairs}
    drop_contacts(known, ("d", "b"))
    assert list(known) == [("a", "c")]
