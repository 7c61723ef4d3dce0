"""People tracked through a recording, and their bodies range of frames by range."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from posefuse.kinematics.angle_sds import relative_angle_sds, with_root_angle_sds
from posefuse.kinematics.joint_angles import angle_names, axes_at, skeleton_angle_names
from posefuse.kinematics.twist import full_rotations
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Layer, pack_covariance
from posefuse.model.track_events import Event, Poses
from posefuse.model.tracks import Tracks, TrackState
from posefuse.parallel import ONE_JOB, Jobs
from posefuse.pipeline.people.model_layer import model_layer
from posefuse.pipeline.people.poses import BodyArrays, DerivedStates, Offsets
from posefuse.pipeline.people.selection import select_people
from posefuse.skeleton.skeletons import Skeleton
from posefuse.tracking.history import History
from posefuse.tracking.parts import certain_directions
from posefuse.tracking.path_priors import PathPriors, begin_priors
from posefuse.tracking.smoothing import Memory, PeopleSmoother, SmoothedPerson


@dataclass(frozen=True)
class TrackNames:
    """Names of tracks, as corrected by later frames.

    Attributes:
        since: track number to (frame index, name): from that frame on the track has the name; in order.
    """

    since: Mapping[int, tuple[tuple[int, str], ...]]

    def columns(self, number: int, places: np.ndarray, people: tuple[str, ...]) -> np.ndarray:
        """Return the person of a track in these frames, shape (frame,), int64: index in ``people``, or -1."""
        starts, names = zip(*self.since[number], strict=True)
        column = np.array([people.index(name) if name in people else -1 for name in names], dtype=np.int64)
        return column[np.searchsorted(starts, places, side="right") - 1]


@dataclass(frozen=True, eq=False)
class TrackedPeople:
    """People tracked through a recording; implements :class:`posefuse.model.subjects.Subjects`.

    Attributes:
        recording_tracks: assignment of detections to people in all frames.
        events: track events.
        history: states of all bodies.
        parts: states of hands and faces, one history per part of the skeleton.
        naming: names of the tracks in the history.
        nis: shape (frame, person): normalized innovation squared, NaN where no detection was used.
        nis_dof: shape (frame, person), int32: degrees of freedom of ``nis``, its expected value.
        shape_m: shape (person, shape): lengths of the bodies.
        shape_sd_m: shape (person, shape): their standard deviations.
        priors: waits for the priors of the bodies' smoother; None if they are estimated at first use.
    """

    recording_tracks: Tracks
    events: tuple[Event, ...]
    history: History
    parts: tuple[History, ...]
    naming: TrackNames
    nis: np.ndarray
    nis_dof: np.ndarray
    shape_m: np.ndarray
    shape_sd_m: np.ndarray
    priors: Callable[[], PathPriors | None] | None = None

    def tracks(self, start: int, stop: int) -> Tracks:
        """Return the assignment of detections to people in a range of frames."""
        return self.recording_tracks.frames(start, stop)

    @property
    def n_frames(self) -> int:
        """Number of frames through which people were tracked."""
        return self.recording_tracks.state.shape[0]

    @property
    def skeleton(self) -> Skeleton:
        """Skeleton with the kinematic tree that bodies were fitted to."""
        return self.history.settings.skeleton

    def only(self, names: tuple[str, ...]) -> "TrackedPeople":
        """Return the result for some of the people.

        Raises:
            OptionsError: if a person does not exist.
        """
        tracks, keep = select_people(self.recording_tracks, names)
        cameras = self.history.settings.rig.names
        events = tuple(event for event in self.events if event.person in (*names, *cameras))
        return replace(
            self, recording_tracks=tracks, events=events, nis=self.nis[:, keep], nis_dof=self.nis_dof[:, keep],
            shape_m=self.shape_m[keep], shape_sd_m=self.shape_sd_m[keep],
        )  # fmt: skip

    def with_priors(self, jobs: Jobs) -> "TrackedPeople":
        """Begin to estimate the priors of the bodies' smoother in another process, if there is one."""
        return replace(self, priors=begin_priors(self.history, jobs))

    def smoother(self, jobs: Jobs = ONE_JOB, only_points: bool = False) -> "WholeSmoother":
        """Return a smoother that runs through the recording once, from the first frame on.

        Args:
            jobs: processes that smooth.
            only_points: whether uncertainties are left out.
        """
        body = PeopleSmoother(self.history, jobs=jobs, wait=self.priors, only_points=only_points)
        parts = tuple(
            PeopleSmoother(each, jobs=jobs, wait=_no_priors, only_points=only_points, reads_ahead=False)
            for each in self.parts
        )
        return WholeSmoother(body, parts, jobs)

    def points_m(self) -> np.ndarray:
        """Return the keypoints of all bodies with their hands and faces, shape (frame, person, keypoint, 3)."""
        people = self.smoother(only_points=True).take(self.n_frames)
        points_m = np.full((self.n_frames, len(self.recording_tracks.person_ids), len(self.skeleton), 3), np.nan)
        for person in people.bodies:
            f, p, seen = self._cells(person, 0)
            points_m[f, p] = person.body.points_m[seen]
        for part, found in zip(self.skeleton.parts, people.parts, strict=True):
            for person in found:
                (f, p), seen = self._cells_with_bodies(person, 0, points_m)
                points_m[f[:, None], p[:, None], part.keypoints] = person.body.points_m[seen]
        return points_m

    def bodies(
        self, rig: CameraRig, detections: Detections, start: int, people: "SmoothedWhole"
    ) -> tuple[Layer, Poses]:
        """Return the model layer and the poses of a range of frames.

        Args:
            rig: calibrated cameras.
            detections: detections of the frames.
            start: index of the first frame in the recording.
            people: smoothed people of the frames.
        """
        stop = start + detections.n_frames
        out = BodyArrays.empty((stop - start, len(self.recording_tracks.person_ids)), len(rig), self.skeleton)
        everywhere = np.arange(len(self.skeleton))
        for person in people.bodies:
            f, p, seen = self._cells(person, start)
            out.used[f, p] = person.used[seen]
            body = person.body
            states = DerivedStates(body.directions[seen], body.angle_sd_deg[seen])
            out.add(person, (f, p), seen, everywhere, Offsets(0, 0, 0), states)
            if self.history.settings.tree.segments:
                out.root_turn_rad2[f, p] = pack_covariance(body.root_turn[seen])
            out.holds_deg2[f, p] = body.holds_deg2[seen]
        tree = self.history.settings.tree
        first = Offsets(len(tree.segments), len(tree.bones), len(angle_names(tree)))
        for i, (part, found) in enumerate(zip(self.skeleton.parts, people.parts, strict=True)):
            for person in found:
                cells, seen = self._cells_with_bodies(person, start, out.points_m)
                f, p = (each[:, None] for each in cells)
                out.used[f, p, :, part.keypoints] = person.used[seen].transpose(0, 2, 1)
                out.add(person, cells, seen, part.keypoints, first, self._part_states(i, person, cells, seen, out))
            first = Offsets(
                first.segment + len(part.tree.segments), first.bone + len(part.tree.bones),
                first.angle + len(angle_names(part.tree)),
            )  # fmt: skip
        rows = self.tracks(start, stop).rows(detections)
        layer = model_layer(rig, detections, rows, out.points_m, out.covariance_m2, out.used, self._absent(start, stop))
        names = self.skeleton.body_names
        angles = skeleton_angle_names(self.skeleton)
        poses = Poses(
            *names, angles, out.turns, out.directions, out.angle_sd_deg, out.root_turn_rad2, self.nis[start:stop],
            self.nis_dof[start:stop], self.shape_m, self.shape_sd_m,
        )  # fmt: skip
        return layer, with_root_angle_sds(poses, rig.up)

    def _part_states(
        self, i: int, person: SmoothedPerson, cells: tuple[np.ndarray, np.ndarray], seen: np.ndarray, out: BodyArrays
    ) -> DerivedStates:
        """Return the directions and angle uncertainties of a part; those of its root include the body's."""
        part, tree, body = self.skeleton.parts[i], self.history.settings.tree, person.body
        sure = certain_directions(part.tree, body.directions[seen], body.points_m[seen], body.covariance_m2[seen])
        s, b = len(tree.segments), len(tree.bones)
        stood = out.turns[cells][:, :s], out.directions[cells][:, :b]
        own = axes_at(tree, tree.nodes[tree.keypoint_nodes[part.at]], stood[0], full_rotations(tree, *stood)[0])
        root = relative_angle_sds(own, out.holds_deg2[cells][:, i], body.turns[seen, 0], body.root_turn[seen])
        return DerivedStates(sure, np.concatenate([root, body.angle_sd_deg[seen, 3:]], axis=1))

    def _cells(self, person: SmoothedPerson, start: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return frame and person indices of a smoothed person from ``start`` on, and which of its frames these are."""
        columns = self._columns(person.number, person.places)
        seen = np.flatnonzero((columns >= 0) & (person.places >= start))
        return person.places[seen] - start, columns[seen], seen

    def _cells_with_bodies(
        self, part: SmoothedPerson, start: int, points_m: np.ndarray
    ) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Return the result of `_cells` for a part, restricted to frames in which its body has points."""
        f, p, seen = self._cells(part, start)
        there = np.isfinite(points_m[f, p]).any(axis=(1, 2))
        return (f[there], p[there]), seen[there]

    def _columns(self, number: int, places: np.ndarray) -> np.ndarray:
        """Return the person of a track in these frames; -1 for people left out and outside their tracks."""
        column = self.naming.columns(number, places, self.recording_tracks.person_ids)
        state = np.asarray(self.recording_tracks.state)[places, column]
        return np.where((column >= 0) & (state != TrackState.ABSENT), column, -1)

    def _absent(self, start: int, stop: int) -> np.ndarray:
        return np.asarray(self.recording_tracks.state[start:stop]) == TrackState.ABSENT


def _no_priors() -> None:
    """Stand for the priors of parts: their histories hold no detections to which paths could be fitted."""


@dataclass(frozen=True, eq=False)
class SmoothedWhole:
    """Smoothed people of a range of frames: their bodies, and their parts by part of the skeleton."""

    bodies: list[SmoothedPerson]
    parts: tuple[list[SmoothedPerson], ...]


def _take(smoothers: tuple[PeopleSmoother, ...], stop: int) -> list[list[SmoothedPerson]]:
    return [each.take(stop) for each in smoothers]


@dataclass(frozen=True, eq=False)
class WholeSmoother:
    """Smooths bodies and parts independently; see :class:`PeopleSmoother`."""

    body: PeopleSmoother
    parts: tuple[PeopleSmoother, ...]
    jobs: Jobs = ONE_JOB

    def take(self, stop: int) -> SmoothedWhole:
        """Return all people in the frames from the end of the last call up to ``stop``."""
        # Parts one after the other: the states of all of them together take several times the memory.
        bodies, parts = self.jobs.together(partial(_take, (self.body,), stop), partial(_take, self.parts, stop))
        return SmoothedWhole(bodies[0], tuple(parts))

    @property
    def memory(self) -> tuple[Memory, ...]:
        """State from which the next range of frames continues, of bodies and then of parts."""
        return tuple(each.memory for each in (self.body, *self.parts))

    def resume_from(self, memory: tuple[Memory, ...]) -> None:
        """Continue from the state of another smoother of the same people."""
        for each, state in zip((self.body, *self.parts), memory, strict=True):
            each.resume_from(state)
