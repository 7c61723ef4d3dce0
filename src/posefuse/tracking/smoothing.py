"""What the whole recording says of each frame: a fixed-interval smoother over filtered bodies.

Detectors' errors last for some frames. A filter that looks at a few frames only need not know for how long; a smoother
averages over more of them, and does. So each person is filtered once more, with less said by each frame
(:mod:`posefuse.tracking.tempering`), then smoothed from the last frame to the first: Rauch, Tung & Striebel (1965), on
the error state, where differences of turns are logarithms, those of bones the least turn from one direction to the
other, and corrections are applied as the filter applies its own. See docs/methods.md, "Smoothing people".
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.records import State
from posefuse.kernels.tracking.smoothing import add_information, smooth_means, smoother_gains
from posefuse.kinematics.angle_sds import axes_covariance, joint_angle_sds
from posefuse.model.cameras import up_vector
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import Sight, chosen, joined, uncertain
from posefuse.tracking.history import History, Run
from posefuse.tracking.settings import Settings, memory_s, tempering
from posefuse.tracking.tempering import ahead, first_with, see_pose, tell_again

_CHUNK = 64
"""Frames whose covariances are worked on at a time: few enough for the processor's cache."""
_AT_ONCE = 512
"""Frames that are smoothed at a time, with what comes after them: of more, covariances would fill the memory."""
_LASTS = 0.1
"""What is left of a velocity in the next frame at least, so that it can be told from there."""


@dataclass(frozen=True, eq=False)
class Smoothed:
    """One person over consecutive frames.

    Attributes:
        root_m: shape (frame, 3).
        turns: shape (frame, segment, 3, 3): world from segment.
        bones: shape (frame, bone, 3, 3): the third axis is the bone's direction.
        shape_m: shape (frame, shape).
        shape_sd_m: shape (frame, shape): 0 where the shape is kept.
        velocity: shape (frame, pose).
        points_m: shape (frame, keypoint, 3), NaN where the body has no such point.
        covariance_m2: shape (frame, keypoint, 6): xx xy xz yy yz zz.
        angle_sd_deg: shape (frame, angle): of the tree's joint angles, NaN where these are not known.
        root_turn: shape (frame, 3, 3): covariance of a small turn of the root about its own axes, rad^2; 0 of a root
            that does not turn.
        holds_deg2: shape (frame, part, 3, 3): the same of the axes in which the body has each of its parts, degrees^2.
    """

    root_m: np.ndarray
    turns: np.ndarray
    bones: np.ndarray
    shape_m: np.ndarray
    shape_sd_m: np.ndarray
    velocity: np.ndarray
    points_m: np.ndarray
    covariance_m2: np.ndarray
    angle_sd_deg: np.ndarray
    root_turn: np.ndarray
    holds_deg2: np.ndarray

    def __len__(self) -> int:
        return len(self.root_m)

    @property
    def directions(self) -> np.ndarray:
        """Shape (frame, bone, 3): unit vectors from a bone's near end to its far end."""
        return self.bones[..., 2]

    def frames(self, start: int, stop: int) -> "Smoothed":
        """The frames ``start`` to ``stop``."""
        return Smoothed(**{name: each[start:stop] for name, each in vars(self).items()})


@dataclass(frozen=True, eq=False)
class SmoothedPerson:
    """One person over the consecutive frames ``places`` of a history, counted from 0.

    Attributes:
        number: of the one who was followed, as in the history.
        places: shape (frame,), int64.
        body: how they stand there.
        used: shape (frame, view, keypoint), bool: the keypoints that counted.
        missing_s: shape (frame,): for how long nothing had supported them.
    """

    number: int
    places: np.ndarray
    body: Smoothed
    used: np.ndarray
    missing_s: np.ndarray


def smooth_people(history: History, start: int, stop: int, settings: Settings) -> list[SmoothedPerson]:
    """Smooth everybody in the frames ``start`` to ``stop`` of a history, counted from 0; see :class:`PeopleSmoother`.

    What came before is gone through again for as long as it has a bearing on these frames.
    """
    return PeopleSmoother(history, start, settings).take(stop)


class PeopleSmoother:
    """Smooths a history from some frame on, a range of frames at a time, each of them once.

    Args:
        history: of a tracker. Of it are needed the frames that are still to come and the one before them, and to begin
            with those of the ``look_ahead_s`` before.
        start: the first frame, counted from 0.
        settings: whose options say how to smooth; the history's where they are left out.
    """

    def __init__(self, history: History, start: int = 0, settings: Settings | None = None) -> None:
        self.history = history
        self.settings = settings or history.settings
        self.done = start
        """The first frame, counted from 0, that has not been given."""
        self._from = self._warm(start)
        self._windows: dict[int, _Window] = {}

    def _warm(self, start: int) -> int:
        """The first frame that has a bearing on what is known in frame ``start``."""
        if start == 0 or self.settings.options.smoother == "none":
            return start
        return self.history.place_at(self.history.time_s[start] - self._memory_s(start))

    def take(self, stop: int) -> list[SmoothedPerson]:
        """Everybody in the frames up to ``stop``, counted from 0, from where the last call ended.

        What the history knows of the ``look_ahead_s`` after them is made use of (and of ``shape_settle_s`` more while
        somebody's shape is sought), or of the ``lag_s`` after each of them. Frames in which somebody has been lost for
        longer than ``bridge_s`` are left out. A person has several parts where the filter began anew, and with a fixed
        lag.
        """
        options = self.settings.options
        found = []
        while self.done < stop:
            if options.smoother == "full":
                last = min(stop, self.done + _AT_ONCE)
                found += self._take(last, self._memory_s(last - 1))
            elif options.smoother == "lag":
                found += self._take(self.done + 1, options.lag_s)
            else:
                found += self._take(stop, 0.0)
        return found

    @property
    def memory(self) -> "Memory":
        """What the next range of frames goes on from."""
        return Memory(self.done, self._from, self._windows)

    def goes_on_from(self, memory: "Memory") -> None:
        """Go on from where another smoother of the same history was."""
        self.done, self._from, self._windows = memory.done, memory.since, memory.windows

    def _memory_s(self, place: int) -> float:
        """How far other frames tell anything of one: while somebody's shape is sought, until it is kept."""
        options = self.settings.options
        sought = any(run.state.free.any() for run in self.history.runs(place, place + 1))
        return options.look_ahead_s + (options.shape_settle_s if sought else 0.0)

    def _take(self, stop: int, ahead_s: float) -> list[SmoothedPerson]:
        history, start = self.history, self.done
        until = max(stop, history.place_at(history.time_s[stop - 1] + ahead_s))
        found, windows = [], {}
        after: _Ahead | None = None
        runs = [
            part for run in history.runs(self._from, until) for part in _bridged(run, self.settings.options.bridge_s)
        ]
        for part in reversed(runs):
            joins = after is not None and after.joins(part)
            body, window, after = self._smooth(part, start, stop, after if joins else None)
            if len(body):
                keep = part.within(start, stop)
                # Copies: what the filter knew is not held by them.
                found.append(SmoothedPerson(part.number, keep.places, body, keep.used.copy(), keep.missing_s.copy()))
            if window is not None:
                windows.setdefault(part.number, window)
        self._windows, self.done, self._from = windows, stop, stop - 1
        return found[::-1]

    def _smooth(
        self, part: Run, start: int, stop: int, after: "_Ahead | None"
    ) -> tuple[Smoothed, "_Window | None", "_Ahead | None"]:
        """One person's frames from ``start`` to ``stop``, what to begin with after them, and what they say before."""
        first, last = (int(np.searchsorted(part.places, place)) for place in (start, stop))
        if self.settings.options.smoother == "none":
            return _described(part.within(start, stop).state, None, self.settings), None, None
        window = _refiltered(part, self._windows.get(part.number), self.settings)
        rest = window.after(last - 1).copy() if last else None
        states = _smoothed_before(window.after(first).state, part.time_s[first:], after, self.settings)
        kept = State(*(each[: last - first] for each in states))
        body = _described(kept, window.information[first:last], self.settings)
        begins = _Ahead(part, chosen(states, [0])) if part.fresh and first == 0 else None
        return body, rest, begins


@dataclass(frozen=True, eq=False)
class Memory:
    """What a smoother goes on from.

    Attributes:
        done: the first frame, counted from 0, that has not been given.
        since: the first frame that has a bearing on it.
        windows: by number, those followed, filtered again from there on.
    """

    done: int
    since: int
    windows: "dict[int, _Window]"


@dataclass(frozen=True, eq=False)
class _Ahead:
    """A run that began anew, and its smoothed state there."""

    run: Run
    state: State

    def joins(self, part: Run) -> bool:
        """Whether another run of the same person ends where this one begins."""
        return part.number == self.run.number and part.places[-1] + 1 == self.run.places[0]


def _smoothed_before(state: State, time_s: np.ndarray, after: _Ahead | None, settings: Settings) -> State:
    """Smooth a run's states, in place or not, also by those of a run that began anew after it.

    The filter that began anew knew nothing of the run before, so that what it says of where it began is as good as an
    observation.
    """
    if after is None:
        _smooth_in_place(state, time_s, settings)
        return state
    later_s = np.append(time_s, after.run.time_s[0])
    last = ahead(chosen(state, [len(time_s) - 1]), np.diff(later_s[-2:]), settings)
    see_pose(last, after.state, settings)
    both = joined(state, last)
    _smooth_in_place(both, later_s, settings)
    return State(*(each[:-1] for each in both))


@dataclass(frozen=True, eq=False)
class _Window:
    """One person filtered again in some consecutive frames.

    Attributes:
        root_m: shape (frame, 3): as first filtered, to know the frames by.
        state: a State with frames where people stand: as filtered again.
        information: shape (frame, pose + shape, pose + shape): what each frame says, errors taken as its own; in the
            axes of ``state``.
    """

    root_m: np.ndarray
    state: State
    information: np.ndarray

    def after(self, start: int) -> "_Window":
        """The frames from ``start`` on."""
        return _Window(self.root_m[start:], State(*(each[start:] for each in self.state)), self.information[start:])

    def copy(self) -> "_Window":
        """Another of the same."""
        return _Window(self.root_m.copy(), State(*(each.copy() for each in self.state)), self.information.copy())


def _refiltered(part: Run, known: _Window | None, settings: Settings) -> _Window:
    """A person filtered again, from frames on for which that is known."""
    told, wanted = _tempered(part, settings)
    share = np.minimum(told / wanted, 1.0)
    n = 0
    if known is not None and not part.fresh:
        n = min(len(part), len(known.root_m))
        other = np.flatnonzero((known.root_m[:n] != part.state.root[:n]).any(axis=1))
        n = int(other[0]) if len(other) else n
    if n == 0:
        size = settings.tree.n_pose + settings.tree.n_shape
        known = _Window(
            part.state.root[:1], first_with(chosen(part.state, [0]), share[0], settings), np.zeros((1, size, size))
        )
        n = 1
    assert known is not None
    rest = part.frames(n - 1, len(part))
    again, information = tell_again(
        rest.state, rest.time_s, share[n - 1 :], told[n - 1 :], chosen(known.state, [n - 1]), settings
    )
    information[0] = known.information[n - 1]
    if n > 1:
        again = State(*(np.concatenate([old[: n - 1], new]) for old, new in zip(known.state, again, strict=True)))
        information = np.concatenate([known.information[: n - 1], information])
    return _Window(part.state.root, again, information)


def _tempered(part: Run, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    """By how much frames were tempered for the filter, and are to be for the smoother, shape (frame,) both."""
    dt_s = np.diff(part.time_s, prepend=2.0 * part.time_s[0] - part.time_s[min(1, len(part) - 1)])
    # Before somebody is believed, a frame shares errors with the last that showed them, not with those in between.
    tentative = part.life[:-1] == TrackState.TENTATIVE
    since_s = dt_s + np.append(0.0, np.where(tentative, part.missing_s[:-1], 0.0))
    if part.fresh:
        since_s[0] = np.inf
    # Births temper by the memory itself: they average over little time, whatever the views.
    n_views = (part.rows >= 0).sum(axis=1)
    memory = memory_s(n_views, _alone_s(part), since_s, settings.options)
    born = np.append(False, tentative) | (part.life == TrackState.TENTATIVE)
    told = tempering(since_s, np.where(born, settings.options.error_memory_s, memory))
    return told, tempering(dt_s, settings.options.smoother_error_memory_s)


def _alone_s(part: Run) -> np.ndarray:
    """Shape (frame,): for how long one view alone had shown somebody; inf where no frame before showed otherwise."""
    alone = (part.rows >= 0).sum(axis=1) == 1
    return part.time_s - np.maximum.accumulate(np.where(alone, -np.inf, part.time_s))


def smooth_run(part: Run, settings: Settings) -> Smoothed:
    """Smooth one person over consecutive frames by all of them."""
    return _smoothed(_refiltered(part, None, settings), part.time_s, settings)


def _smoothed(window: _Window, time_s: np.ndarray, settings: Settings) -> Smoothed:
    return _described(smooth_states(window.state, time_s, settings), window.information, settings)


def smooth_states(filtered: State, time_s: np.ndarray, settings: Settings) -> State:
    """Rauch, Tung and Striebel's smoother over one person's filtered states.

    Args:
        filtered: a State with frames where people stand; it is left as it is.
        time_s: shape (frame,), ascending.
        settings: of the tracker whose states they are.

    Returns:
        A State likewise.
    """
    out = chosen(filtered, np.arange(len(time_s)))
    _smooth_in_place(out, time_s, settings)
    return out


def _smooth_in_place(state: State, time_s: np.ndarray, settings: Settings) -> None:
    for start, stop in _chunks(state.free, len(time_s) - 1):
        part = State(*(each[start : stop + 1] for each in state))
        _smooth_chunk(part, np.diff(time_s[start : stop + 1]), settings)


def _smooth_chunk(state: State, dt_s: np.ndarray, settings: Settings) -> None:
    """Smooth frames in place by the last of them, which is smoothed."""
    n, h, free = settings.tree.n_pose, settings.tree.n_shape, bool(state.free[0])
    rows = uncertain(n, h, free)
    gains, rest = np.empty((2, len(dt_s), len(rows), len(rows)))
    walk = settings.options.motion.shape_walk
    lasts = np.exp(-dt_s.max() / settings.decay_s.min()) > _LASTS
    if not lasts or smoother_gains(dt_s, settings.decay_s, settings.power, walk, state, gains, rest) < len(dt_s):
        gains, rest = _gains(state, rows, dt_s, settings)
    smooth_means(gains, rows, dt_s, settings.decay_s, state)
    late = state.covariance[-1][np.ix_(rows, rows)]
    for k in range(len(gains) - 1, -1, -1):
        rest[k] += gains[k] @ late @ gains[k].T
        late = rest[k]
    m = len(rows) - n
    state.covariance[:-1, :m, :m] = rest[:, :m, :m]
    state.covariance[:-1, n + h :, n + h :] = rest[:, m:, m:]
    state.covariance[:-1, n + h :, :m] = rest[:, m:, :m]
    state.covariance[:-1, :m, n + h :] = rest[:, :m, m:]


def _bridged(run: Run, bridge_s: float) -> list[Run]:
    """The parts of a run in which nobody is lost for longer than that."""
    near = np.append(np.append(False, run.missing_s <= bridge_s), False)
    edges = np.flatnonzero(near[1:] != near[:-1])
    return [run.frames(int(first), int(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]


def _chunks(free: np.ndarray, stop: int) -> Iterator[tuple[int, int]]:
    """Short ranges of frames before ``stop``, last first, in each of which the shape is sought all along or kept."""
    while stop > 0:
        start = max(0, stop - _CHUNK)
        other = np.flatnonzero(free[start:stop] != free[stop - 1])
        start = start + int(other[-1]) + 1 if len(other) else start
        yield start, stop
        stop = start


def _gains(state: State, rows: np.ndarray, dt_s: np.ndarray, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    """What :func:`gains_back` finds, wherever there is an inverse or nearly one.

    With C = P F^T the covariance of a state and its successor as foretold, and P' that of the latter, the gain is
    G = C P'^-1 and the rest P - G C^T.
    """
    n = settings.tree.n_pose
    predicted = chosen(state, np.arange(len(dt_s)))
    # Unclipped: that nothing is farther than its limit is knowledge of the later frame.
    nowhere = np.full(len(settings.most), np.inf)
    predict_people(dt_s, settings.decay_s, settings.power, nowhere, settings.options.motion.shape_walk, predicted)
    fade = np.exp(-dt_s[:, None] / settings.decay_s)
    reach = settings.decay_s * (1.0 - fade)
    block = state.covariance[:-1, rows[:, None], rows]
    mixed = block.copy()
    mixed[:, :n] += reach[:, :, None] * block[:, -n:]
    mixed[:, -n:] *= fade[:, :, None]
    gains = np.linalg.solve(predicted.covariance[:, rows[:, None], rows], mixed).transpose(0, 2, 1)
    rest = block - gains @ mixed
    return np.ascontiguousarray(gains), 0.5 * (rest + rest.transpose(0, 2, 1))


def _described(state: State, information: np.ndarray | None, settings: Settings) -> Smoothed:
    """Where the keypoints of states are.

    The smoother took errors for noise that is white, and as strong as they are in the long run; within the few frames
    over which it averages they are less. So a share of what a frame says at face value is known besides.

    Args:
        state: a State with frames where people stand.
        information: shape (frame, pose + shape, pose + shape): what each frame says at face value; None where nothing
            was tempered for smoothing.
        settings: of the tracker whose states they are.
    """
    frames, n, h = len(state.root), settings.tree.n_pose, settings.tree.n_shape
    sight = Sight.room(frames, 0, len(settings.skeleton))
    shape_sd_m = np.zeros((frames, h))
    pose = np.zeros((frames, n, n))
    for start in range(0, frames, _CHUNK):
        to = slice(start, min(start + _CHUNK, frames))
        covariance = state.covariance[to].copy()
        if information is not None:
            _tell_more(covariance, information[to], state.free[to], settings)
        part = State(*(each[to] for each in state))._replace(covariance=covariance)
        project_people(settings.cameras[:0], settings.body, part, *(each[to] for each in sight.arrays))
        variances = np.diagonal(covariance, axis1=1, axis2=2)[:, n : n + h]
        shape_sd_m[to] = np.sqrt(np.maximum(variances, 0.0))
        pose[to] = covariance[:, :n, :n]
    return Smoothed(
        state.root, state.turns, state.bones, state.shape, shape_sd_m, state.velocity, sight.points_m,
        sight.covariance_m2, *_known_turns(state.turns, state.bones, pose, settings),
    )  # fmt: skip


def _tell_more(covariance: np.ndarray, information: np.ndarray, free: np.ndarray, settings: Settings) -> None:
    """Tell covariances, in place, a share of what frames say at face value."""
    n, size, share = settings.tree.n_pose, information.shape[1], settings.options.smoother_own_share
    done = add_information(information, share, free, n, covariance)
    while done < len(free):
        known = covariance[done, :size, :size]
        told = known @ np.linalg.inv(np.eye(size) + share * information[done] @ known)
        if (np.diag(told) >= 0.0).all():
            covariance[done, :size, :size] = told
        done += 1
        done += add_information(information[done:], share, free[done:], n, covariance[done:])


def _known_turns(
    turns: np.ndarray, bones: np.ndarray, covariance: np.ndarray, settings: Settings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How well joint angles, the root's turn and the axes that hold parts are known.

    Args:
        turns: shape (frame, segment, 3, 3).
        bones: shape (frame, bone, 3, 3).
        covariance: shape (frame, pose, pose).
        settings: of the tracker whose states they are.
    """
    tree, frames = settings.tree, len(turns)
    sds = joint_angle_sds(tree, turns, bones, covariance, up_vector(settings.rig.up_axis or "z"))
    root = covariance[:, 3:6, 3:6].copy() if tree.segments else np.zeros((frames, 3, 3))
    holds = np.empty((frames, len(settings.skeleton.parts), 3, 3))
    for i, part in enumerate(settings.skeleton.parts):
        holds[:, i] = axes_covariance(tree, int(tree.keypoint_nodes[part.at]), turns, bones, covariance)
    return sds, root, holds
