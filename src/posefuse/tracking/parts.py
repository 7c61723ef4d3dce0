"""Hands and faces: parts of bodies that are followed for themselves, each given where its body has it.

A part is foretold and put right like a body, by the same filter. Beside what the views show it is told where the body
has its root, and how turned; nothing goes back to the body. A part that no view shows for some time is let go; it
begins anew from its points as two views or more show them. See docs/methods.md, "Hands and faces".
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels import status_codes
from posefuse.kernels.tracking.anchors import update_from_anchors
from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.records import USED, State
from posefuse.kernels.tracking.update import update_people
from posefuse.kernels.triangulation.all_views import triangulate_views
from posefuse.model.frames import Frame
from posefuse.model.tracks import TrackState
from posefuse.skeleton.parts import Part
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import Tree
from posefuse.tracking.body_states import Sight, chosen, joined, nobody
from posefuse.tracking.frame_clock import SAME_S, moments
from posefuse.tracking.records import Evidence, Person
from posefuse.tracking.settings import Settings, memory_s, tempering
from posefuse.tracking.state_initiation import begin

_VARIANCES = np.array([0, 3, 5])
_SURE_SHARE = 0.35
_SWAPPED_M = 0.1
"""By so much, of a human, hands must be nearer to each other's wrists than to their own to be each other's."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """What bodies say of their parts in a frame.

    Attributes:
        names: of people, in the order of the tracker.
        rows: shape (person, view), int64: of the frame, -1 for none.
        labels: shape (person, view, keypoint), int64: which of a detection's keypoints is the body's.
        points_m: shape (person, keypoint, 3).
        covariance_m2: shape (person, keypoint, 6).
        turns: shape (person, segment, 3, 3).
        turn_covariance: shape (person, segment, 3, 3): in the segments' own axes, radians^2.
    """

    names: tuple[str, ...]
    rows: np.ndarray
    labels: np.ndarray
    points_m: np.ndarray
    covariance_m2: np.ndarray
    turns: np.ndarray
    turn_covariance: np.ndarray

    @classmethod
    def of(cls, names: tuple[str, ...], rows: np.ndarray, labels: np.ndarray, sight: Sight, state: State) -> "Bodies":
        """From the tracker's states, and where they are seen."""
        segments = state.turns.shape[1]
        blocks = [state.covariance[:, c : c + 3, c : c + 3] for c in range(3, 3 + 3 * segments, 3)]
        return cls(names, rows, labels, sight.points_m, sight.covariance_m2, state.turns, np.stack(blocks, axis=1))


@dataclass
class PartTrack:
    """One person's part that is followed.

    Attributes:
        name: of the person.
        seen_s: when a view last showed it.
        sought_s: for how long its lengths have been sought while it was seen.
        fresh: whether it began in this frame.
    """

    name: str
    seen_s: float
    sought_s: float = 0.0
    fresh: bool = True


@dataclass(frozen=True, eq=False)
class KnownShape:
    """The lengths of somebody's part.

    Attributes:
        shape_m: shape (shape,).
        covariance_m2: shape (shape, shape): when they were last sought.
        sought_s: for how long they have been.
        is_kept: whether they are sought no more.
    """

    shape_m: np.ndarray
    covariance_m2: np.ndarray
    sought_s: float
    is_kept: bool


class PartFollower:
    """Follows one part of everybody.

    Args:
        part: of the skeleton.
        whole: settings of the bodies.
    """

    def __init__(self, part: Part, whole: Settings) -> None:
        self.part = part
        names = tuple(whole.skeleton.keypoints[k] for k in part.keypoints)
        own = Skeleton(f"{whole.skeleton.name}: {part.name}", names, tree=part.tree)
        # The whole's are in proportion already; a part is of its body's size.
        self.settings = Settings.of(whole.rig, own, whole.noise, whole.options.of_parts())
        self.tracks: list[PartTrack] = []
        self.state = nobody(part.tree)
        self.known: dict[str, KnownShape] = {}
        """Of who is followed or may come back."""
        self.people: tuple[Person, ...] = ()
        """Those whose part is followed, with the part's keypoints, in the order of the states."""

    def update(self, frame: Frame, time_s: float, dt_s: float, bodies: Bodies) -> None:
        """Take a frame in which everybody has been found."""
        self._drop([track.name in bodies.names for track in self.tracks])
        self.known = {name: shape for name, shape in self.known.items() if name in bodies.names}
        order = [bodies.names.index(track.name) for track in self.tracks]
        labels = np.ascontiguousarray(bodies.labels[:, :, self.part.keypoints])
        use = self._put_right(frame, time_s, dt_s, bodies, labels, order)
        seen = ((use == USED).sum(axis=2) >= self.settings.options.min_joints).any(axis=1)
        for track, now in zip(self.tracks, seen, strict=True):
            track.fresh = False
            track.seen_s = time_s if now else track.seen_s
            track.sought_s += dt_s if now else 0.0
        used = self._let_go(time_s, use == USED)
        used = self._begin(frame, time_s, bodies, labels, used)
        self._settle()
        rows = bodies.rows[[bodies.names.index(track.name) for track in self.tracks]]
        self.people = self._told(rows, used, time_s)

    def shape_of(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """The shape of somebody's part and its standard deviations, shape (shape,) each, m; NaN before it was seen."""
        known = self.known.get(name)
        if known is None:
            nothing = np.full(self.part.tree.n_shape, np.nan)
            return nothing, nothing
        return known.shape_m, np.sqrt(np.diag(known.covariance_m2))

    def exchange(self, names: set[str]) -> None:
        """Two people go on as each other: what is followed begins anew, with the lengths of the right one."""
        self._drop([track.name not in names for track in self.tracks])

    def _drop(self, keep: Sequence[bool]) -> None:
        if not all(keep):
            self.state = chosen(self.state, np.flatnonzero(keep))
            self.tracks = [track for track, stays in zip(self.tracks, keep, strict=True) if stays]

    def _put_right(
        self, frame: Frame, time_s: float, dt_s: float, bodies: Bodies, labels: np.ndarray, order: list[int]
    ) -> np.ndarray:
        """Foretell, tell where bodies have the parts, and put right; what became of keypoints (person, view, point)."""
        s, n = self.settings, len(order)
        use = np.full((n, *labels.shape[1:]), -1, dtype=np.int64)
        if not n:
            return use
        labels, rows = np.ascontiguousarray(labels[order]), bodies.rows[order]
        since_s = np.full(n, dt_s)
        temper = tempering(since_s, memory_s((rows >= 0).sum(axis=1), np.zeros(n), since_s, s.options))
        now_s, times = time_s - dt_s, moments(frame, time_s)
        for k, (moment_s, views) in enumerate(times):
            dt = np.full(n, max(moment_s - now_s, 0.0))
            predict_people(dt, s.decay_s, s.power, s.most, s.options.motion.shape_walk, self.state)
            now_s = max(now_s, moment_s)
            if k == len(times) - 1:
                self._tell_anchors(bodies, order, dt_s)
            part = np.empty_like(use)
            update_people(
                s.cameras, s.body, s.law, temper, s.options.iterations, np.where(views, rows, -1), labels,
                frame.keypoints_px, frame.confidence, self.state, part, np.empty(n), np.empty(n),
            )  # fmt: skip
            use[:, views] = part[:, views]
        return use

    def _tell_anchors(self, bodies: Bodies, order: list[int], dt_s: float) -> None:
        """Tell where bodies have the parts: as often as what they know there is new."""
        part, n, size = self.part, len(order), self.state.covariance.shape[1]
        options = self.settings.options.parts
        again = float(tempering(np.array(dt_s), options.anchor_memory_s))
        noise = bodies.covariance_m2[order, part.at].copy()
        noise[:, _VARIANCES] += options.anchor_sd_m**2
        turns, turn_noise = np.full((n, 3, 3), np.nan), np.zeros((n, 6))
        if part.like >= 0:
            turns = np.ascontiguousarray(bodies.turns[order, part.like])
            block = bodies.turn_covariance[order, part.like] + np.radians(options.anchor_sd_deg) ** 2 * np.eye(3)
            turn_noise = again * block[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
        places = np.ascontiguousarray(bodies.points_m[order, part.at])
        update_from_anchors(places, again * noise, turns, turn_noise, np.empty((6, size)), np.empty(size), self.state)

    def _let_go(self, time_s: float, used: np.ndarray) -> np.ndarray:
        """Let go what nothing has shown for long, or is broken; what counted of the others."""
        there = np.isfinite(self.state.root).all(axis=1)
        recent = [time_s - track.seen_s <= self.settings.options.lost_after_s + SAME_S for track in self.tracks]
        keep = np.array(recent, dtype=bool) & there
        self._drop(keep.tolist())
        return used[keep]

    def _begin(self, frame: Frame, time_s: float, bodies: Bodies, labels: np.ndarray, used: np.ndarray) -> np.ndarray:
        """Begin to follow the part of those whose views show it; what counted, of all."""
        there = {track.name for track in self.tracks}
        for p, name in enumerate(bodies.names):
            if name in there:
                continue
            seen = self._evidence(frame, time_s, bodies.rows[p], labels[p], bodies.points_m[p, self.part.at])
            state = None if seen is None else self._fitted(seen, name)
            if seen is None or state is None:
                continue
            known = self.known.get(name)
            self.tracks.append(PartTrack(name, time_s, known.sought_s if known else 0.0))
            self.state = joined(self.state, state)
            used = np.concatenate([used, np.isfinite(seen.keypoints_px[None, ..., 0])])
        return used

    def _evidence(
        self, frame: Frame, time_s: float, rows: np.ndarray, labels: np.ndarray, anchor_m: np.ndarray
    ) -> Evidence | None:
        """What a frame shows of one person's part, None where that is too little to begin with."""
        options, views = self.settings.options.parts, len(rows)
        pixels, trust = np.full((*labels.shape, 2), np.nan), np.full(labels.shape, np.nan)
        for v in np.flatnonzero(rows >= 0):
            pixels[v], trust[v] = frame.keypoints_px[rows[v], labels[v]], frame.confidence[rows[v], labels[v]]
        least = options.begin_share * len(self.part.keypoints)
        if (np.isfinite(pixels[..., 0]).sum(axis=0) >= 2).sum() < least:
            return None
        points, covariance = self._triangulated(pixels, trust, rows)
        away = np.linalg.norm(points - anchor_m, axis=1)
        points[~(away <= options.begin_within_m)] = np.nan
        if np.isfinite(points[:, 0]).sum() < least:
            return None
        return Evidence(
            time_s, frame.number, pixels, trust, np.where(rows >= 0, np.arange(views), -1), points, covariance,
            anchor_m, 0.0, 1.0,
        )  # fmt: skip

    def _triangulated(self, pixels: np.ndarray, trust: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points that two views or more show, shape (point, 3), and covariances (point, 6)."""
        s, (views, points) = self.settings, trust.shape
        out = (
            np.empty((1, points, 3)), np.empty((1, points, 6)), np.empty((1, points), dtype=np.int8),
            np.empty((1, points, views), dtype=np.int8), np.empty((1, points, views), dtype=np.float32),
            np.empty((1, points)),
        )  # fmt: skip
        whose = np.where(rows >= 0, np.arange(views), status_codes.NO_DETECTION)[None]
        # Frozen as a recording's are: the kernel is compiled for these already.
        seen = frozen(pixels), frozen(trust)
        triangulate_views(
            *s.rig.packed, *seen, whose, s.noise.scale_px, s.noise.exponent, s.law.min_confidence, 2, *out
        )
        return out[0][0], out[1][0]

    def _fitted(self, seen: Evidence, name: str) -> State | None:
        """The state of one part as a frame shows it, None where none fits that."""
        known, options = self.known.get(name), self.settings.options
        if known is None:
            state, _, error = begin([seen], self.settings)
        else:
            state, _, error = begin([seen], self.settings, known.shape_m, known.covariance_m2)
        away = np.linalg.norm(state.root[0] - seen.torso_m)
        return state if error <= options.births.max_error_sigma and away <= options.parts.begin_within_m else None

    def _settle(self) -> None:
        """Note lengths, and keep those that have been sought for long enough."""
        n, h = self.part.tree.n_pose, self.part.tree.n_shape
        for p, track in enumerate(self.tracks):
            if not self.state.free[p]:
                continue
            known = self.known.get(track.name)
            if known is None or not known.is_kept:
                kept = track.sought_s > self.settings.options.shape_settle_s
                block = self.state.covariance[p, n : n + h, n : n + h].copy()
                known = self.known[track.name] = KnownShape(self.state.shape[p].copy(), block, track.sought_s, kept)
            if known.is_kept:
                self.state.shape[p] = known.shape_m
                self.state.free[p] = 0
                self.state.covariance[p, n : n + h] = 0.0
                self.state.covariance[p, :, n : n + h] = 0.0

    def _told(self, rows: np.ndarray, used: np.ndarray, time_s: float) -> tuple[Person, ...]:
        s, n = self.settings, len(self.tracks)
        sight = Sight.room(n, 0, len(s.skeleton))
        project_people(s.cameras[:0], s.body, self.state, *sight.arrays)
        return tuple(
            Person(
                track.name, TrackState.ACTIVE, sight.points_m[p], sight.covariance_m2[p], rows[p], used[p], 0.0,
                time_s - track.seen_s,
            )
            for p, track in enumerate(self.tracks)
        )  # fmt: skip


def sure_directions(tree: Tree, directions: np.ndarray, points_m: np.ndarray, covariance_m2: np.ndarray) -> np.ndarray:
    """Directions of a part's bones, NaN where its end is hardly better known than the bone is long.

    A finger is as long as a detector errs: its end can be known well enough, and its direction not at all.

    Args:
        tree: of the part.
        directions: shape (frame, bone, 3).
        points_m: shape (frame, keypoint, 3).
        covariance_m2: shape (frame, keypoint, 6).
    """
    keypoint_of = {int(node): k for k, node in enumerate(tree.keypoint_nodes) if node >= 0}
    sure = directions.copy()
    for n, node in enumerate(tree.nodes):
        end, start = keypoint_of.get(n), keypoint_of.get(node.parent)
        if not node.is_bone or end is None or start is None:
            continue
        length_m = np.linalg.norm(points_m[:, end] - points_m[:, start], axis=-1)
        sd_m = np.sqrt(covariance_m2[:, end][:, _VARIANCES].mean(axis=-1))
        sure[~(sd_m < _SURE_SHARE * length_m), node.mover] = np.nan
    return sure


def sides_of(followers: Sequence[PartFollower], mirror: np.ndarray) -> tuple[tuple[Part, Part], ...]:
    """Parts that mirror each other; ``mirror`` is the skeleton's."""
    parts = [follower.part for follower in followers]
    return tuple(
        (one, other)
        for i, one in enumerate(parts)
        for other in parts[i + 1 :]
        if np.array_equal(mirror[one.keypoints], other.keypoints)
    )


def swap_sides(
    labels: np.ndarray, frame: Frame, rows: np.ndarray, sight: Sight, sides: tuple[Part, Part], scale: float
) -> None:
    """Let a view's hands be each other's where they are clearly nearer to each other's wrists than to their own.

    Args:
        labels: shape (person, view, keypoint), in and out.
        frame: what the views show.
        rows: shape (person, view).
        sight: where bodies are seen.
        sides: the two parts.
        scale: how large the bodies are next to an adult human.
    """
    there = np.nonzero(rows >= 0)
    seen, pixels = frame.keypoints_px[rows[there]], sight.pixels[there]
    roots = [pixels[:, part.at] for part in sides]
    means = [_mean_pixel(seen[:, part.keypoints]) for part in sides]
    straight = _distance(means[0], roots[0]) + _distance(means[1], roots[1])
    crossed = _distance(means[0], roots[1]) + _distance(means[1], roots[0])
    turned = crossed + _SWAPPED_M * scale * sight.size_px[there][:, sides[0].at] < straight
    if turned.any():
        one, other = (part.keypoints for part in sides)
        p, v = (each[turned, None] for each in there)
        labels[p, v, one], labels[p, v, other] = other, one


def _mean_pixel(pixels: np.ndarray) -> np.ndarray:
    """Shape (row, 2): means over the points there are, NaN where there are none."""
    known = np.isfinite(pixels)
    count = known.sum(axis=1)
    return np.where(known, pixels, 0.0).sum(axis=1) / np.where(count > 0, count, np.nan)


def _distance(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Shape (row,): 0 where one of them is not known."""
    away = np.linalg.norm(one - other, axis=1)
    return np.where(np.isfinite(away), away, 0.0)
