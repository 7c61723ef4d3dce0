"""Fixed-interval smoother over the history of a tracker.

Detection errors are correlated over several frames. A filter averages over so few frames that the correlation hardly
matters; a smoother averages over more, so it must model the correlation. So each person is filtered again with
less information per frame (:mod:`posefuse.tracking.tempering`), then smoothed from the last frame to the first: Rauch,
Tung and Striebel (1965), on the error state, in which differences of turns are logarithms, those of bones the smallest
turn from one direction to the other, and corrections are applied as the filter applies its own. See
docs/methods/smoothing.md.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.parallel import ONE_JOB, Jobs
from posefuse.tracking.backward_pass import smooth_in_place
from posefuse.tracking.body_states import join_states, select_states
from posefuse.tracking.history import History
from posefuse.tracking.path_priors import PathPriors, estimate_priors, fit_path, with_lasting_offsets
from posefuse.tracking.refiltering import Window, refilter_run
from posefuse.tracking.runs import PackedRun, Run
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.smoothed_bodies import SmoothedBodies, describe_bodies, describe_points
from posefuse.tracking.tempering import observe_pose, predict_states

_MAX_FRAMES = 1024
"""Number of frames that are smoothed at a time, which bounds the memory of their covariances."""


@dataclass(frozen=True, eq=False)
class SmoothedPerson:
    """One person in some consecutive frames of a history.

    Attributes:
        number: Number of the track, as in the history.
        places: shape (frame,), int64: indices of the frames in the history.
        body: Smoothed body.
        used: shape (frame, view, keypoint), bool: keypoints that the update used.
        missing_s: shape (frame,): time since the last support, in seconds.
    """

    number: int
    places: np.ndarray
    body: SmoothedBodies
    used: np.ndarray
    missing_s: np.ndarray


class PeopleSmoother:
    """Smoother of a history, one range of frames at a time, in order.

    Args:
        history: History of a tracker. It must hold the frames to come and the one before them, and at first also those
            of the preceding ``look_ahead_s``.
        start: Index of the first frame.
        settings: Settings whose options define the smoother; by default those of the history.
        jobs: Processes that smooth the tracks.
        wait: Waits for the priors of fitted paths, if their estimation has begun.
        only_points: Whether uncertainties are left out, which take most of the time; they are NaN then.
        reads_ahead: Whether the history is read for the next range while processes smooth one.
    """

    def __init__(
        self,
        history: History,
        start: int = 0,
        settings: TrackerSettings | None = None,
        jobs: Jobs = ONE_JOB,
        wait: Callable[[], PathPriors | None] | None = None,
        only_points: bool = False,
        reads_ahead: bool = True,
    ) -> None:
        self._jobs, self._wait, self._only_points, self._reads_ahead = jobs, wait, only_points, reads_ahead
        self.history = history
        self.settings = settings or history.settings
        self.done = start
        """Index of the first frame that was not returned yet."""
        self._from = self._first_relevant(start)
        self._windows: dict[int, Window] = {}
        self._next: _Recorded | None = None
        self._priors: PathPriors | None = None
        self._estimated = self.settings.options.smoother != "full"

    def _first_relevant(self, start: int) -> int:
        """Return the index of the first frame that influences frame ``start``."""
        if start == 0 or self.settings.options.smoother == "none":
            return start
        return self.history.place_at(self.history.time_s[start] - self._memory_s(start))

    def take(self, stop: int) -> list[SmoothedPerson]:
        """Return all people in the frames from the end of the last call up to ``stop``.

        The smoother uses the ``look_ahead_s`` of the history after these frames (and ``fix_shape_after_s`` more while
        the shape of some person is estimated), or the ``lag_s`` after each of them. Frames in which a person has been
        lost for longer than ``bridge_s`` are left out. A person has several parts where the filter was initialized
        again, and with a fixed lag.
        """
        options = self.settings.options
        if not self._estimated:
            self._priors = (
                self._wait() if self._wait else estimate_priors(self.history, self.settings, not self._only_points)
            )
            self._estimated = True
        people = []
        while self.done < stop:
            if options.smoother == "full":
                people += self._take(min(stop, self.done + _MAX_FRAMES), _MAX_FRAMES)
            elif options.smoother == "lag":
                people += self._take(self.done + 1)
            else:
                people += self._take(stop)
        return people

    @property
    def memory(self) -> "Memory":
        """State from which the next range of frames continues."""
        return Memory(self.done, self._from, self._windows)

    def resume_from(self, memory: "Memory") -> None:
        """Continue from the state of another smoother of the same history."""
        self.done, self._from, self._windows = memory.done, memory.since, memory.windows

    def _memory_s(self, place: int) -> float:
        """Return the time over which frames influence each other; longer while a shape is or will soon be estimated."""
        options, history = self.settings.options, self.history
        ahead = history.place_at(history.time_s[place] + options.look_ahead_s) - 1
        free = any(run.entries.free.any() for each in (place, ahead) for run in history.packed_runs(each, each + 1))
        return options.look_ahead_s + (options.fix_shape_after_s if free else 0.0)

    def _take(self, stop: int, following: int = 0) -> list[SmoothedPerson]:
        """Return all people in the frames up to ``stop``.

        Args:
            stop: Index after the last frame.
            following: Number of frames that will be taken next, as far as there are more; 0 if that is unknown.
        """
        recorded = self._read(self.done, self._from, stop)
        pieces = [
            _TrackPiece(
                runs, (self.done, stop, recorded.following), self._windows.get(number), self._priors, self.settings,
                self._only_points,
            )
            for number, runs in recorded.tracks.items()
        ]  # fmt: skip
        smoothed = [self._jobs.begin(_smooth_track, piece) for piece in pieces]
        if self._jobs.number > 1 and self._reads_ahead and following and stop < len(self.history):
            # The processes need no data for the next frames before those of these frames are smoothed.
            self._next = self._read(stop, recorded.following, min(stop + following, len(self.history)))
        found = [wait() for wait in smoothed]
        windows = zip(recorded.tracks, (window for _, window in found), strict=True)
        self._windows = {number: window for number, window in windows if window is not None}
        self.done, self._from = stop, recorded.following
        return [person for people, _ in found for person in people]

    def _read(self, start: int, since: int, stop: int) -> "_Recorded":
        """Return what the history holds of the frames ``start`` to ``stop``, which those from ``since`` on influence.

        It is read only once if it was read in advance.
        """
        known, self._next = self._next, None
        if known is not None and known.span == (start, since, stop):
            return known
        history, options = self.history, self.settings.options
        ahead_s = 0.0
        if options.smoother != "none":
            ahead_s = options.lag_s if options.smoother == "lag" else self._memory_s(stop - 1)
        until = max(stop, history.place_at(history.time_s[stop - 1] + ahead_s))
        following = stop - 1
        if self._priors is not None:
            # Fitted poses depend on the frames before as well as on those after them.
            following = min(history.place_at(history.time_s[stop - 1] - options.look_ahead_s), stop - 1)
        tracks: dict[int, list[PackedRun]] = {}
        for run in history.packed_runs(since, until):
            tracks.setdefault(run.number, []).extend(run.split_at_gaps(options.bridge_s))
        return _Recorded((start, since, stop), following, tracks)


@dataclass(frozen=True, eq=False)
class _Recorded:
    """What a history holds of a range of frames.

    Attributes:
        span: First frame, first frame that influences the range, and end.
        following: First frame that influences the frames after the range.
        tracks: Runs in the frames that influence the range, by number of the track.
    """

    span: tuple[int, int, int]
    following: int
    tracks: dict[int, list[PackedRun]]


@dataclass(frozen=True, eq=False)
class _TrackPiece:
    """A track in a range of frames.

    Attributes:
        runs: Runs of the track in the frames that influence the range, by time. They are packed on the way to another
            process.
        span: First frame, end, and first frame that the next range needs.
        window: Frames filtered again earlier.
        priors: Priors of fitted paths; None without.
        settings: Settings of the smoother.
        only_points: Whether uncertainties are left out.
    """

    runs: list[PackedRun]
    span: tuple[int, int, int]
    window: Window | None
    priors: PathPriors | None
    settings: TrackerSettings
    only_points: bool = False

    def describe(self, state: State, information: np.ndarray | None) -> SmoothedBodies:
        """Return poses and keypoints of smoothed states, and uncertainties unless they are left out."""
        if self.only_points:
            return describe_points(state, self.settings)
        return describe_bodies(state, information, self.settings)

    def fit(self, begin: State, run: Run) -> State | None:
        """Return the poses fitted to all detections of a run, or None."""
        if self.priors is None:
            return None
        return fit_path(begin, run, self.priors, self.settings, not self.only_points)


def _smooth_track(piece: _TrackPiece) -> tuple[list[SmoothedPerson], Window | None]:
    """Smooth a track; return its parts in the range of frames by time, and the window to continue from."""
    people, following = [], None
    later: _LaterRun | None = None
    start, stop, _ = piece.span
    for packed in reversed(piece.runs):
        run = packed.run()
        joins = later is not None and later.follows(run)
        body, window, later = _smooth_run(piece, run, later if joins else None)
        if len(body):
            keep = run.within(start, stop)
            # Copies do not keep the filter's states in memory.
            people.append(SmoothedPerson(run.number, keep.places, body, keep.used.copy(), keep.missing_s.copy()))
        following = following or window
    return people[::-1], following


def _smooth_run(
    piece: _TrackPiece, run: Run, later: "_LaterRun | None"
) -> tuple[SmoothedBodies, Window | None, "_LaterRun | None"]:
    """Return one person's frames of the span, the window to continue from, and the person's first state."""
    settings, priors = piece.settings, piece.priors
    first, last, following = (int(np.searchsorted(run.places, place)) for place in piece.span)
    if settings.options.smoother == "none":
        return piece.describe(run.within(*piece.span[:2]).state, None), None, None
    if priors is not None and last > first:
        fitted, begins = _fit_run(piece, run, later)
        if fitted is not None:
            return _describe_fitted(piece, fitted, slice(first, last)), None, begins
    window = refilter_run(run, piece.window, settings)
    rest = window.after(min(following, last - 1)).copy() if last else None
    # Of a track with several runs, the covariance of the first state of each enters the run before.
    means_only = piece.only_points and len(piece.runs) == 1
    states = _smoothed_by(window.after(first).state, run.time_s[first:], later, settings, means_only)
    begins = _LaterRun(run, select_states(states, [0])) if run.fresh and first == 0 else None
    own = State(*(each[: last - first] for each in states))
    return piece.describe(own, window.information[first:last]), rest, begins


def _fit_run(piece: _TrackPiece, run: Run, later: "_LaterRun | None") -> tuple[State | None, "_LaterRun | None"]:
    """Return the fitted poses of a run, or None, and the person's first state if the filter was initialized there.

    Both depend on the frames of the piece only, not on how earlier frames were divided into ranges.
    """
    if len(piece.runs) == 1:
        # Fitted poses depend on where the fit begins by a tenth of their uncertainty, so the states of the filter do.
        return piece.fit(run.state, run), None
    again = refilter_run(run, None, piece.settings).state
    states = _smoothed_by(again, run.time_s, later, piece.settings)
    begins = _LaterRun(run, select_states(states, [0])) if run.fresh and run.places[0] >= piece.span[0] else None
    return piece.fit(states, run), begins


def _describe_fitted(piece: _TrackPiece, fitted: State, frames: slice) -> SmoothedBodies:
    """Return some frames of fitted poses."""
    kept = State(*(each[frames] for each in fitted))
    return with_lasting_offsets(piece.describe(kept, None), piece.settings)


@dataclass(frozen=True, eq=False)
class Memory:
    """State of a smoother between two ranges of frames.

    Attributes:
        done: Index of the first frame that was not returned yet.
        since: Index of the first frame that influences it.
        windows: By track number, frames filtered again from there on.
    """

    done: int
    since: int
    windows: dict[int, Window]


@dataclass(frozen=True, eq=False)
class _LaterRun:
    """A run with which the filter was initialized again, and its smoothed first state."""

    run: Run
    state: State

    def follows(self, part: Run) -> bool:
        """Return whether another run of the same track ends where this one begins."""
        return part.number == self.run.number and part.places[-1] + 1 == self.run.places[0]


def _smoothed_by(
    state: State, time_s: np.ndarray, later: _LaterRun | None, settings: TrackerSettings, means_only: bool = False
) -> State:
    """Smooth a run's states, possibly in place, with the run with which the filter was initialized again afterward.

    That filter started without information from this run, so its first state is an independent observation. A run that
    ended before these frames has no states.
    """
    if later is None or not len(time_s):
        smooth_in_place(state, time_s, settings, means_only)
        return state
    later_s = np.append(time_s, later.run.time_s[0])
    last = predict_states(select_states(state, [len(time_s) - 1]), np.diff(later_s[-2:]), settings)
    observe_pose(last, later.state, settings)
    both = join_states(state, last)
    smooth_in_place(both, later_s, settings)
    return State(*(each[:-1] for each in both))
