"""Backward pass of the smoother: Rauch, Tung and Striebel (1965) on the error state of one body."""

from collections.abc import Iterator

import numpy as np

from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.records import State
from posefuse.kernels.tracking.smoothing import smooth_means, smoother_gains
from posefuse.tracking.body_states import free_columns, select_states
from posefuse.tracking.settings import TrackerSettings

CHUNK_FRAMES = 64
"""Number of frames whose covariances are processed at a time, so that they fit the processor's cache."""
_NEGLIGIBLE = 1e-12
"""Share of the largest variance below which a direction is certain."""

_MIN_RETAINED = 0.1
"""Share of a velocity that must remain in the next frame for the compiled gains to be accurate."""


def smooth_states(filtered: State, time_s: np.ndarray, settings: TrackerSettings) -> State:
    """Smooth the filtered states of one person.

    Args:
        filtered: State with one entry per frame; it is not changed.
        time_s: shape (frame,), ascending.
        settings: Settings of the tracker.

    Returns:
        State with one entry per frame.
    """
    out = select_states(filtered, np.arange(len(time_s)))
    smooth_in_place(out, time_s, settings)
    return out


def smooth_in_place(state: State, time_s: np.ndarray, settings: TrackerSettings, means_only: bool = False) -> None:
    """Smooth the filtered states of one person, in place.

    Args:
        state: State with one entry per frame.
        time_s: shape (frame,), ascending.
        settings: Settings of the tracker.
        means_only: Whether the covariances are not needed; they remain those of the filter.
    """
    for start, stop in _chunks(state.free, len(time_s) - 1):
        part = State(*(each[start : stop + 1] for each in state))
        _smooth_chunk(part, np.diff(time_s[start : stop + 1]), settings, means_only)


def _smooth_chunk(state: State, dt_s: np.ndarray, settings: TrackerSettings, means_only: bool) -> None:
    """Smooth frames in place by the last of them, which is smoothed already."""
    n, h, free = settings.tree.n_pose, settings.tree.n_shape, bool(state.free[0])
    rows = free_columns(n, h, free)
    gains, rest = np.empty((2, len(dt_s), len(rows), len(rows)))
    retained = np.exp(-dt_s.max() / settings.decay_s.min()) > _MIN_RETAINED
    if not retained or smoother_gains(dt_s, settings.motion, state, gains, rest) < len(dt_s):
        gains, rest = _gains(state, rows, dt_s, settings)
    smooth_means(gains, rows, dt_s, settings.decay_s, state)
    if means_only:
        return
    late = state.covariance[-1][np.ix_(rows, rows)]
    for k in range(len(gains) - 1, -1, -1):
        rest[k] += gains[k] @ late @ gains[k].T
        late = rest[k]
    m = len(rows) - n
    state.covariance[:-1, :m, :m] = rest[:, :m, :m]
    state.covariance[:-1, n + h :, n + h :] = rest[:, m:, m:]
    state.covariance[:-1, n + h :, :m] = rest[:, m:, :m]
    state.covariance[:-1, :m, n + h :] = rest[:, :m, m:]


def _chunks(free: np.ndarray, stop: int) -> Iterator[tuple[int, int]]:
    """Yield short ranges of frames before ``stop``, last first, in each of which the shape is always free or fixed."""
    while stop > 0:
        start = max(0, stop - CHUNK_FRAMES)
        other = np.flatnonzero(free[start:stop] != free[stop - 1])
        start = start + int(other[-1]) + 1 if len(other) else start
        yield start, stop
        stop = start


def _gains(
    state: State, rows: np.ndarray, dt_s: np.ndarray, settings: TrackerSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Return the results of the kernel ``smoother_gains`` also where a covariance is almost singular.

    With C = P F^T, the covariance of a state and its predicted successor, and P', the covariance of the latter, the
    gain is G = C P'^-1, and the remainder is P - G C^T.
    """
    n = settings.tree.n_pose
    predicted = select_states(state, np.arange(len(dt_s)))
    # Without limits: that a variance is below its limit is information of the later frame.
    unlimited = settings.motion._replace(max_variance=np.full(len(settings.most), np.inf))
    predict_people(dt_s, unlimited, predicted)
    fade = np.exp(-dt_s[:, None] / settings.decay_s)
    reach = settings.decay_s * (1.0 - fade)
    block = state.covariance[:-1, rows[:, None], rows]
    mixed = block.copy()
    mixed[:, :n] += reach[:, :, None] * block[:, -n:]
    mixed[:, -n:] *= fade[:, :, None]
    later = predicted.covariance[:, rows[:, None], rows]
    try:
        gains = np.linalg.solve(later, mixed).transpose(0, 2, 1)
    except np.linalg.LinAlgError:  # without process noise, the prediction is certain in some directions
        gains = (np.linalg.pinv(later, rcond=_NEGLIGIBLE, hermitian=True) @ mixed).transpose(0, 2, 1)
    rest = block - gains @ mixed
    return np.ascontiguousarray(gains), 0.5 * (rest + rest.transpose(0, 2, 1))
