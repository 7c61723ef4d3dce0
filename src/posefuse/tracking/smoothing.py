"""What the whole recording says of each frame: a fixed-interval smoother over filtered bodies.

Rauch, Tung & Striebel (1965) on the error state: differences of turns are logarithms, those of bones the least turn
from one direction to the other, and corrections are applied as the filter applies its own. See docs/methods.md,
"Smoothing people".
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from posefuse.kernels.articulated import State, foresee_people, predict_people
from posefuse.kernels.smoothing import carry_back
from posefuse.tracking.bodies import Sight, chosen, uncertain
from posefuse.tracking.history import History, Run
from posefuse.tracking.settings import Settings

_CHUNK = 64
"""Frames whose covariances are worked on at a time: few enough for the processor's cache."""


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
    """

    root_m: np.ndarray
    turns: np.ndarray
    bones: np.ndarray
    shape_m: np.ndarray
    shape_sd_m: np.ndarray
    velocity: np.ndarray
    points_m: np.ndarray
    covariance_m2: np.ndarray

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
        name: of the person.
        places: shape (frame,), int64.
        body: how they stand there.
        run: as the filter knew them there.
    """

    name: str
    places: np.ndarray
    body: Smoothed
    run: Run


def smooth_people(history: History, start: int, stop: int, settings: Settings) -> list[SmoothedPerson]:
    """Smooth everybody in the frames ``start`` to ``stop`` of a history, counted from 0, by what it knows after them.

    How far it looks ahead is ``look_ahead_s`` or ``lag_s`` of the options; with the smoother ``none`` not at all.
    Frames in which somebody has been lost for longer than ``bridge_s`` are left out.
    """
    ahead_s = {"none": 0.0, "lag": settings.options.lag_s, "full": settings.options.look_ahead_s}
    until = history.place_at(history.time_s[stop - 1] + ahead_s[settings.options.smoother]) if stop > start else stop
    found = []
    for run in history.runs(start, max(stop, until)):
        for part in _bridged(run, settings.options.bridge_s):
            keep = int(np.searchsorted(part.places, stop))
            if keep:
                filtered = settings.options.smoother == "none"
                body = as_filtered(part.state, settings) if filtered else smooth_run(part.state, part.time_s, settings)
                found.append(SmoothedPerson(run.name, part.places[:keep], body.frames(0, keep), part.frames(0, keep)))
    return found


def _bridged(run: Run, bridge_s: float) -> list[Run]:
    """The parts of a run in which nobody is lost for longer than that."""
    near = np.append(np.append(False, run.missing_s <= bridge_s), False)
    edges = np.flatnonzero(near[1:] != near[:-1])
    return [run.frames(int(first), int(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]


def as_filtered(filtered: State, settings: Settings) -> Smoothed:
    """The same of one person whom nothing later has corrected."""
    out = _room(len(filtered.root), settings)
    _tell(filtered, settings, out, 0)
    return out


def smooth_run(filtered: State, time_s: np.ndarray, settings: Settings) -> Smoothed:
    """Smooth one person over consecutive frames.

    Args:
        filtered: a State with frames where people stand; it is left as it is.
        time_s: shape (frame,), ascending.
        settings: of the tracker whose states they are.
    """
    if not len(time_s):
        return _room(0, settings)
    out = _room(len(time_s), settings)
    after = chosen(filtered, [len(time_s) - 1])
    _tell(after, settings, out, len(time_s) - 1)
    for start, stop in _chunks(filtered.free, len(time_s) - 1):
        after = _smooth_chunk(filtered, time_s, start, stop, after, settings, out)
    return out


def _room(frames: int, settings: Settings) -> Smoothed:
    tree, keypoints = settings.tree, len(settings.skeleton)
    return Smoothed(
        np.empty((frames, 3)),
        np.empty((frames, len(tree.segments), 3, 3)),
        np.empty((frames, len(tree.bones), 3, 3)),
        np.empty((frames, tree.n_shape)),
        np.empty((frames, tree.n_shape)),
        np.empty((frames, tree.n_pose)),
        np.empty((frames, keypoints, 3)),
        np.empty((frames, keypoints, 6)),
    )


def _chunks(free: np.ndarray, stop: int) -> Iterator[tuple[int, int]]:
    """Short ranges of frames before ``stop``, last first, in each of which the shape is sought all along or kept."""
    while stop > 0:
        start = max(0, stop - _CHUNK)
        other = np.flatnonzero(free[start:stop] != free[stop - 1])
        start = start + int(other[-1]) + 1 if len(other) else start
        yield start, stop
        stop = start


def _smooth_chunk(
    filtered: State, time_s: np.ndarray, start: int, stop: int, after: State, settings: Settings, out: Smoothed
) -> State:
    """Smooth the frames ``start`` to ``stop`` by the smoothed state ``after`` of frame ``stop``; that of ``start``."""
    state = chosen(filtered, np.arange(start, stop))
    dt_s = np.diff(time_s[start : stop + 1])
    predicted = chosen(state, np.arange(stop - start))
    # Unclipped: that nothing is farther than its limit is knowledge of the later frame.
    nowhere = np.full(len(settings.most), np.inf)
    predict_people(dt_s, settings.decay_s, settings.power, nowhere, settings.options.motion.shape_walk, predicted)
    rows = uncertain(settings.tree.n_pose, settings.tree.n_shape, bool(filtered.free[start]))
    gains, rest = _gains(state.covariance, predicted.covariance, rows, dt_s, settings)
    means = State(*(np.concatenate(pair) for pair in zip(state, after, strict=True)))
    room = np.empty((2, means.covariance.shape[1]))
    carry_back(gains, rows, predicted, means, room[0], room[1])
    _carry_covariance_back(gains, rest, rows, means.covariance)
    smoothed = State(*(each[:-1] for each in means))
    _tell(smoothed, settings, out, start)
    return chosen(smoothed, [0])


def _gains(
    covariance: np.ndarray, predicted: np.ndarray, rows: np.ndarray, dt_s: np.ndarray, settings: Settings
) -> tuple[np.ndarray, np.ndarray]:
    """The smoother's gains, and what later frames can never tell, each of shape (frame, row, row).

    With C = P F^T the covariance of a state and its successor as foretold, and P' that of the latter, the gain is
    G = C P'^-1 and the rest P - G C^T.
    """
    n = settings.tree.n_pose
    fade = np.exp(-dt_s[:, None] / settings.decay_s)
    reach = settings.decay_s * (1.0 - fade)
    block = covariance[:, rows[:, None], rows]
    mixed = block.copy()
    mixed[:, :n] += reach[:, :, None] * block[:, -n:]
    mixed[:, -n:] *= fade[:, :, None]
    gains = np.linalg.solve(predicted[:, rows[:, None], rows], mixed).transpose(0, 2, 1)
    rest = block - gains @ mixed
    return np.ascontiguousarray(gains), 0.5 * (rest + rest.transpose(0, 2, 1))


def _carry_covariance_back(gains: np.ndarray, rest: np.ndarray, rows: np.ndarray, covariance: np.ndarray) -> None:
    """Covariances of frames by those after them, the last of which is smoothed: shape (frame + 1, all, all)."""
    at = np.ix_(rows, rows)
    late = covariance[-1][at]
    for k in range(len(gains) - 1, -1, -1):
        late = rest[k] + gains[k] @ late @ gains[k].T
        covariance[k][at] = late


def _tell(state: State, settings: Settings, out: Smoothed, start: int) -> None:
    """Write what is known of frames from ``start`` on."""
    frames, keypoints = len(state.root), len(settings.skeleton)
    n, h = settings.tree.n_pose, settings.tree.n_shape
    sight = Sight.room(frames, 0, keypoints)
    foresee_people(settings.cameras[:0], settings.body, state, *sight.arrays)
    to = slice(start, start + frames)
    out.root_m[to], out.turns[to], out.bones[to] = state.root, state.turns, state.bones
    out.shape_m[to], out.velocity[to] = state.shape, state.velocity
    variances = np.diagonal(state.covariance, axis1=1, axis2=2)[:, n : n + h]
    out.shape_sd_m[to] = np.sqrt(np.maximum(variances, 0.0))
    out.points_m[to], out.covariance_m2[to] = sight.points_m, sight.covariance_m2
