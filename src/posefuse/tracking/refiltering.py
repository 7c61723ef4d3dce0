"""Filter runs of a history again with the tempering that the smoother needs."""

from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import select_states
from posefuse.tracking.runs import Run
from posefuse.tracking.settings import TrackerSettings, filter_memory_s, tempering_factor
from posefuse.tracking.tempering import refilter, temper_first_state


@dataclass(frozen=True, eq=False)
class Window:
    """One person, filtered again in consecutive frames.

    Attributes:
        root_m: shape (frame, 3): roots as first filtered, which identify the frames.
        state: State with one entry per frame, as filtered again.
        information: shape (frame, pose + shape, pose + shape): untempered information of each frame, in the axes of
            ``state``.
    """

    root_m: np.ndarray
    state: State
    information: np.ndarray

    def after(self, start: int) -> "Window":
        """Return the frames from ``start`` on."""
        return Window(self.root_m[start:], State(*(each[start:] for each in self.state)), self.information[start:])

    def copy(self) -> "Window":
        """Return a copy."""
        return Window(self.root_m.copy(), State(*(each.copy() for each in self.state)), self.information.copy())


def refilter_run(run: Run, known: Window | None, settings: TrackerSettings) -> Window:
    """Filter a run again, from the first frame that a known window does not hold.

    Args:
        run: The run.
        known: Frames of the same track that were filtered again before; None if there are none.
        settings: Settings of the tracker.
    """
    applied, wanted = _tempering(run, settings)
    share = np.minimum(applied / wanted, 1.0)
    n = 0
    if known is not None and not run.fresh:
        n = min(len(run), len(known.root_m))
        other = np.flatnonzero((known.root_m[:n] != run.state.root[:n]).any(axis=1))
        n = int(other[0]) if len(other) else n
    if n == 0:
        size = settings.tree.n_pose + settings.tree.n_shape
        first = temper_first_state(select_states(run.state, [0]), share[0], settings)
        known = Window(run.state.root[:1], first, np.zeros((1, size, size)))
        n = 1
    assert known is not None
    rest = run.frames(n - 1, len(run))
    again, information = refilter(
        rest.state, rest.time_s, share[n - 1 :], applied[n - 1 :], select_states(known.state, [n - 1]), settings
    )
    information[0] = known.information[n - 1]
    if n > 1:
        again = State(*(np.concatenate([old[: n - 1], new]) for old, new in zip(known.state, again, strict=True)))
        information = np.concatenate([known.information[: n - 1], information])
    return Window(run.state.root, again, information)


def _tempering(run: Run, settings: TrackerSettings) -> tuple[np.ndarray, np.ndarray]:
    """Return the tempering that the filter applied and that the smoother needs, shape (frame,) each."""
    dt_s = np.diff(run.time_s, prepend=2.0 * run.time_s[0] - run.time_s[min(1, len(run) - 1)])
    # Before a track is confirmed, a frame shares errors with the last observation, not with the frames in between.
    tentative = run.life[:-1] == TrackState.TENTATIVE
    since_s = dt_s + np.append(0.0, np.where(tentative, run.missing_s[:-1], 0.0))
    if run.fresh:
        since_s[0] = np.inf
    # Initiation tempers by the option itself: it averages over little time, whatever the number of views.
    n_views = (run.rows >= 0).sum(axis=1)
    memory = filter_memory_s(n_views, _single_view_times(run), since_s, settings.options)
    initiated = np.append(False, tentative) | (run.life == TrackState.TENTATIVE)
    applied = tempering_factor(since_s, np.where(initiated, settings.options.error_memory_s, memory))
    return applied, tempering_factor(dt_s, settings.options.smoother_error_memory_s)


def _single_view_times(run: Run) -> np.ndarray:
    """Return the time for which a single view had shown the person, shape (frame,); inf if no frame shows otherwise."""
    single = (run.rows >= 0).sum(axis=1) == 1
    return run.time_s - np.maximum.accumulate(np.where(single, -np.inf, run.time_s))
