"""Tracking of hands and faces: parts of bodies with a state of their own, anchored where the body has them.

The same filter predicts and updates a part and a body. In addition to the detections, a part receives the position and
orientation of its root from the body; it does not change the body. A part that no view shows for some time is dropped,
and starts again from its points once two views or more show them. See docs/methods/parts.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.arrays import kernel_array
from posefuse.kernels import status_codes
from posefuse.kernels.records import NoiseParameters, Observations, TriangulatedPoints
from posefuse.kernels.tracking.anchors import update_from_anchors
from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.records import USED, AssignedDetections, State, UpdateResults
from posefuse.kernels.tracking.update import update_people
from posefuse.kernels.triangulation.all_views import triangulate_views
from posefuse.model.frames import Frame
from posefuse.model.tracks import TrackState
from posefuse.skeleton.parts import Part
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import Tree
from posefuse.tracking.body_frames import BodyFrame
from posefuse.tracking.body_states import (
    ProjectedBodies,
    empty_state,
    fix_shape_covariance,
    join_states,
    select_states,
)
from posefuse.tracking.frame_clock import TIME_TOLERANCE_S, view_times
from posefuse.tracking.records import Observation, People, Person
from posefuse.tracking.settings import TrackerSettings, filter_memory_s, tempering_factor
from posefuse.tracking.track_initiation import fit_body

_VARIANCES = np.array([0, 3, 5])
_MAX_SD_SHARE = 0.35
"""Standard deviation of a bone's end, as a share of the bone's length, above which its direction is unknown."""


@dataclass
class PartTrack:
    """Track of one person's part.

    Attributes:
        name: Name of the person.
        last_seen_s: Time at which a view last showed the part, in seconds.
        shape_observed_s: Time for which the part was visible while its lengths were estimated, in seconds.
        fresh: Whether the track started in this frame.
    """

    name: str
    last_seen_s: float
    shape_observed_s: float = 0.0
    fresh: bool = True


@dataclass(frozen=True, eq=False)
class KnownShape:
    """Lengths of one person's part.

    Attributes:
        shape_m: shape (shape,).
        covariance_m2: shape (shape, shape): covariance when the lengths were last estimated.
        shape_observed_s: Time for which they have been estimated, in seconds.
        is_fixed: Whether the lengths are fixed.
    """

    shape_m: np.ndarray
    covariance_m2: np.ndarray
    shape_observed_s: float
    is_fixed: bool


class PartTracker:
    """Tracker of one part of all people.

    Args:
        part: Part of the skeleton.
        index: Its index among the parts.
        image: Keypoints of its mirror image, or None without one.
        whole: Settings of the bodies.
    """

    def __init__(self, part: Part, index: int, image: np.ndarray | None, whole: TrackerSettings) -> None:
        self.part, self.index, self.image = part, index, image
        names = tuple(whole.skeleton.keypoints[k] for k in part.keypoints)
        own = Skeleton(f"{whole.skeleton.name}: {part.name}", names, tree=part.tree)
        # The options of the bodies are in proportion already; a part has the size of its body.
        # Only faces share the orientation of a segment.
        options = whole.options.of_parts(face=part.like >= 0)
        self.settings = TrackerSettings.of(whole.rig, own, whole.noise, options)
        self.tracks: list[PartTrack] = []
        self.state = empty_state(part.tree)
        self.known: dict[str, KnownShape] = {}
        """Lengths by name, of people whose part is tracked or may be tracked again."""
        self.people: tuple[Person, ...] = ()
        """People whose part is tracked, with the part's keypoints, in the order of the states."""

    def update(self, frame: Frame, bodies: BodyFrame) -> None:
        """Process a frame in which the bodies were tracked."""
        time_s, dt_s = bodies.time_s, bodies.dt_s
        self._drop([track.name not in bodies.swapped for track in self.tracks])
        self._drop([track.name in bodies.names for track in self.tracks])
        self.known = {name: shape for name, shape in self.known.items() if name in bodies.names}
        order = [bodies.names.index(track.name) for track in self.tracks]
        labels = self._labels(bodies)
        use = self._predict_and_update(frame, bodies, labels, order)
        visible = ((use == USED).sum(axis=2) >= self.settings.options.min_joints).any(axis=1)
        for track, now in zip(self.tracks, visible, strict=True):
            track.fresh = False
            track.last_seen_s = time_s if now else track.last_seen_s
            track.shape_observed_s += dt_s if now else 0.0
        used = self._drop_unseen(time_s, use == USED)
        used = self._start(frame, bodies, labels, used)
        self._fix_shapes()
        rows = bodies.rows[[bodies.names.index(track.name) for track in self.tracks]]
        self.people = self._part_people(rows, used, time_s)

    def shape_of(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return lengths of a person's part and their standard deviations, shape (shape,) each, in meters.

        Both are NaN before the part was visible.
        """
        known = self.known.get(name)
        if known is None:
            nothing = np.full(self.part.tree.n_shape, np.nan)
            return nothing, nothing
        return known.shape_m, np.sqrt(np.diag(known.covariance_m2))

    def _labels(self, bodies: BodyFrame) -> np.ndarray:
        """Return which of a detection's keypoints is which point of the part, shape (person, view, point), int64."""
        labels = np.tile(self.part.keypoints, (*bodies.rows.shape, 1))
        if self.image is not None:
            labels[bodies.exchanged[:, :, self.index]] = self.image
        return labels

    def _drop(self, keep: Sequence[bool]) -> None:
        if not all(keep):
            self.state = select_states(self.state, np.flatnonzero(keep))
            self.tracks = [track for track, stays in zip(self.tracks, keep, strict=True) if stays]

    def _predict_and_update(self, frame: Frame, bodies: BodyFrame, labels: np.ndarray, order: list[int]) -> np.ndarray:
        """Predict and update all parts; return what keypoints were used for, shape (person, view, point)."""
        s, n = self.settings, len(order)
        time_s, dt_s = bodies.time_s, bodies.dt_s
        use = np.full((n, *labels.shape[1:]), -1, dtype=np.int64)
        if not n:
            return use
        labels, rows = np.ascontiguousarray(labels[order]), bodies.rows[order]
        since_s = np.full(n, dt_s)
        temper = tempering_factor(since_s, filter_memory_s((rows >= 0).sum(axis=1), np.zeros(n), since_s, s.options))
        now_s, times = time_s - dt_s, view_times(frame, time_s)
        for k, (moment_s, views) in enumerate(times):
            dt = np.full(n, max(moment_s - now_s, 0.0))
            predict_people(dt, s.motion, self.state)
            now_s = max(now_s, moment_s)
            if k == len(times) - 1:
                self._update_by_anchors(bodies, order, dt_s)
            part = np.empty_like(use)
            detections = AssignedDetections(np.where(views, rows, -1), labels, frame.keypoints_px, frame.confidence)
            out = UpdateResults(part, np.empty(n), np.empty(n))
            update_people(s.cameras, s.body, s.law, detections, temper, s.options.iterations, self.state, out)
            use[:, views] = part[:, views]
        return use

    def _update_by_anchors(self, bodies: BodyFrame, order: list[int], dt_s: float) -> None:
        """Update all parts by their anchors, tempered for the correlation of the bodies' errors in time."""
        part, n, size = self.part, len(order), self.state.covariance.shape[1]
        options = self.settings.options.parts
        temper = float(tempering_factor(np.array(dt_s), options.anchor_memory_s))
        noise = bodies.covariance_m2[order, self.index].copy()
        noise[:, _VARIANCES] += options.anchor_sd_m**2
        turns, turn_noise = np.full((n, 3, 3), np.nan), np.zeros((n, 6))
        if part.like >= 0:
            turns = np.ascontiguousarray(bodies.turns[order, part.like])
            block = bodies.turn_covariance[order, part.like] + np.radians(options.anchor_sd_deg) ** 2 * np.eye(3)
            # Such an index gives an array in Fortran order, for which the kernel would be compiled a second time.
            turn_noise = temper * np.ascontiguousarray(block[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]])
        places = np.ascontiguousarray(bodies.points_m[order, self.index])
        update_from_anchors(places, temper * noise, turns, turn_noise, np.empty((6, size)), np.empty(size), self.state)

    def _drop_unseen(self, time_s: float, used: np.ndarray) -> np.ndarray:
        """Drop parts that no view has shown for long or whose state is not finite; return the others' used points."""
        finite = np.isfinite(self.state.root).all(axis=1)
        recent = [
            time_s - track.last_seen_s <= self.settings.options.lost_after_s + TIME_TOLERANCE_S for track in self.tracks
        ]
        keep = np.array(recent, dtype=bool) & finite
        self._drop(keep.tolist())
        return used[keep]

    def _start(self, frame: Frame, bodies: BodyFrame, labels: np.ndarray, used: np.ndarray) -> np.ndarray:
        """Start tracks of parts that the views show; return the used points of all parts."""
        tracked = {track.name for track in self.tracks}
        for p, name in enumerate(bodies.names):
            if name in tracked:
                continue
            anchor_m = bodies.points_m[p, self.index]
            seen = self._observation(frame, bodies.time_s, bodies.rows[p], labels[p], anchor_m)
            state = None if seen is None else self._fit(seen, name)
            if seen is None or state is None:
                continue
            known = self.known.get(name)
            self.tracks.append(PartTrack(name, bodies.time_s, known.shape_observed_s if known else 0.0))
            self.state = join_states(self.state, state)
            used = np.concatenate([used, np.isfinite(seen.keypoints_px[None, ..., 0])])
        return used

    def _observation(
        self, frame: Frame, time_s: float, rows: np.ndarray, labels: np.ndarray, anchor_m: np.ndarray
    ) -> Observation | None:
        """Return what a frame shows of one person's part; None if that is too little to start a track."""
        options, views = self.settings.options.parts, len(rows)
        pixels, trust = np.full((*labels.shape, 2), np.nan), np.full(labels.shape, np.nan)
        for v in np.flatnonzero(rows >= 0):
            pixels[v], trust[v] = frame.keypoints_px[rows[v], labels[v]], frame.confidence[rows[v], labels[v]]
        least = options.initiate_share * len(self.part.keypoints)
        if (np.isfinite(pixels[..., 0]).sum(axis=0) >= 2).sum() < least:
            return None
        points, covariance = self._triangulated(pixels, trust, rows)
        away = np.linalg.norm(points - anchor_m, axis=1)
        points[~(away <= options.initiate_within_m)] = np.nan
        if np.isfinite(points[:, 0]).sum() < least:
            return None
        return Observation(
            time_s, frame.number, pixels, trust, np.where(rows >= 0, np.arange(views), -1), points, covariance,
            anchor_m, 0.0, 1.0,
        )  # fmt: skip

    def _triangulated(self, pixels: np.ndarray, trust: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Triangulate the points that two views or more show: points (point, 3) and covariances (point, 6)."""
        s, (views, points) = self.settings, trust.shape
        out = TriangulatedPoints.allocate(1, points, views)
        whose = np.where(rows >= 0, np.arange(views), status_codes.NO_DETECTION)[None]
        seen = Observations(kernel_array(pixels), kernel_array(trust), whose)
        noise = NoiseParameters(s.noise.scale_px, s.noise.exponent, s.law.min_confidence)
        triangulate_views(s.rig.packed, seen, noise, 2, out)
        return out.points[0], out.covariance[0]

    def _fit(self, seen: Observation, name: str) -> State | None:
        """Fit a part to one observation; None if no part fits it."""
        known, options = self.known.get(name), self.settings.options
        if known is None:
            state, _, error = fit_body([seen], self.settings)
        else:
            state, _, error = fit_body([seen], self.settings, known.shape_m, known.covariance_m2)
        away = np.linalg.norm(state.root[0] - seen.torso_m)
        return (
            state if error <= options.initiation.max_error_sigma and away <= options.parts.initiate_within_m else None
        )

    def _fix_shapes(self) -> None:
        """Store lengths, and fix those that have been observed for long enough."""
        n, h = self.part.tree.n_pose, self.part.tree.n_shape
        for p, track in enumerate(self.tracks):
            if not self.state.free[p]:
                continue
            known = self.known.get(track.name)
            if known is None or not known.is_fixed:
                is_fixed = track.shape_observed_s > self.settings.options.fix_shape_after_s
                block = self.state.covariance[p, n : n + h, n : n + h].copy()
                known = self.known[track.name] = KnownShape(
                    self.state.shape[p].copy(), block, track.shape_observed_s, is_fixed
                )
            if known.is_fixed:
                self.state.shape[p] = known.shape_m
                fix_shape_covariance(self.state, p, n, h)

    def _part_people(self, rows: np.ndarray, used: np.ndarray, time_s: float) -> tuple[Person, ...]:
        s = self.settings
        projected = ProjectedBodies.of(self.state, s.cameras[:0], s.body)
        return tuple(
            Person(
                track.name, TrackState.ACTIVE, projected.points_m[p], projected.covariance_m2[p], rows[p], used[p], 0.0,
                time_s - track.last_seen_s,
            )
            for p, track in enumerate(self.tracks)
        )  # fmt: skip


def certain_directions(
    tree: Tree, directions: np.ndarray, points_m: np.ndarray, covariance_m2: np.ndarray
) -> np.ndarray:
    """Return the directions of a part's bones, NaN where the bone's end is too uncertain relative to its length.

    A finger is about as long as detection errors: its end can be accurate enough while its direction is unknown.

    Args:
        tree: Tree of the part.
        directions: shape (frame, bone, 3).
        points_m: shape (frame, keypoint, 3).
        covariance_m2: shape (frame, keypoint, 6).
    """
    keypoint_of = {int(node): k for k, node in enumerate(tree.keypoint_nodes) if node >= 0}
    certain = directions.copy()
    for n, node in enumerate(tree.nodes):
        end, start = keypoint_of.get(n), keypoint_of.get(node.parent)
        if not node.is_bone or end is None or start is None:
            continue
        length_m = np.linalg.norm(points_m[:, end] - points_m[:, start], axis=-1)
        sd_m = np.sqrt(covariance_m2[:, end][:, _VARIANCES].mean(axis=-1))
        certain[~(sd_m < _MAX_SD_SHARE * length_m), node.mover] = np.nan
    return certain


def part_trackers(whole: TrackerSettings, images: Sequence[int | None]) -> tuple[PartTracker, ...]:
    """Return trackers of all parts of the skeleton, which do not depend on each other.

    Args:
        whole: Settings of the bodies.
        images: Index of the part that mirrors each part, or None.
    """
    parts = whole.skeleton.parts
    return tuple(
        PartTracker(part, i, None if image is None else parts[image].keypoints, whole)
        for i, (part, image) in enumerate(zip(parts, images, strict=True))
    )


def add_parts(trackers: Sequence[PartTracker], people: People) -> None:
    """Write the points and used keypoints of parts into the people of the frame in which they were tracked."""
    person_of = {person.name: person for person in people.people}
    for tracker in trackers:
        k = tracker.part.keypoints
        for own in tracker.people:
            person = person_of[own.name]
            person.points_m[k], person.covariance_m2[k] = own.points_m, own.covariance_m2
            person.used[:, k] = own.used
