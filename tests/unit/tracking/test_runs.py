"""A packed run holds the same states as the run, in less memory."""

import pickle

import numpy as np

from tests.unit.tracking.test_history import history_of
from tests.unit.tracking.test_smoothing import close, filtered, settings

__all__ = ["settings"]
N_FRAMES, FIRST_LOST, LAST_LOST = 60, 20, 29


def test_a_run_is_packed_without_loss(settings, rng):
    history = history_of(settings, filtered(settings, N_FRAMES, rng, kept_from=18))
    (run,), (packed,) = history.runs(5, 50), history.packed_runs(5, 50)
    unpacked = pickle.loads(pickle.dumps(packed)).run()
    assert len(packed) == len(run) == 45
    close(unpacked.state, run.state, 0.0)
    np.testing.assert_array_equal(unpacked.places, run.places)
    np.testing.assert_array_equal(unpacked.time_s, run.time_s)
    (fixed,) = history.packed_runs(20, 50)
    assert 2 * len(pickle.dumps(fixed)) < len(pickle.dumps(fixed.run()))


def test_a_run_is_split_where_the_person_is_lost_for_long(settings, rng):
    lost = {k: 0.1 * (k - FIRST_LOST) for k in range(FIRST_LOST, LAST_LOST + 1)}
    (packed,) = history_of(settings, filtered(settings, N_FRAMES, rng), lost).packed_runs(0, N_FRAMES)
    before, after = (part.run() for part in packed.split_at_gaps(0.5))
    assert before.fresh
    assert not after.fresh
    run = packed.run()
    for part, (start, stop) in ((before, (0, 26)), (after, (30, N_FRAMES))):
        np.testing.assert_array_equal(part.places, np.arange(start, stop))
        close(part.state, run.frames(start, stop).state, 0.0)
