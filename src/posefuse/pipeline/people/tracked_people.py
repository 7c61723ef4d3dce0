"""Who was followed, and their bodies, range of frames by range."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from posefuse.kinematics.angle_sds import relative_angle_sds
from posefuse.kinematics.joint_angles import angle_names, axes_at, skeleton_angle_names
from posefuse.kinematics.twist import full_rotations
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Layer
from posefuse.model.track_events import Event, Poses
from posefuse.model.tracks import Tracks, TrackState
from posefuse.pipeline.people.model_layer import model_layer
from posefuse.pipeline.people.poses import Known, Places, Stood
from posefuse.pipeline.people.selection import kept_tracks
from posefuse.skeleton.skeletons import Skeleton
from posefuse.tracking.history import History
from posefuse.tracking.parts import certain_directions
from posefuse.tracking.smoothing import Memory, PeopleSmoother, SmoothedPerson


@dataclass(frozen=True)
class Naming:
    """Who the bodies that were followed are, now that more is known.

    Attributes:
        since: by number of the body, from which frames on, counted from 0, it has which name; in order.
    """

    since: Mapping[int, tuple[tuple[int, str], ...]]

    def columns(self, number: int, places: np.ndarray, people: tuple[str, ...]) -> np.ndarray:
        """Shape (frame,), int64: who of ``people`` a body is in these frames; -1 for none of them."""
        starts, names = zip(*self.since[number], strict=True)
        column = np.array([people.index(name) if name in people else -1 for name in names], dtype=np.int64)
        return column[np.searchsorted(starts, places, side="right") - 1]


@dataclass(frozen=True, eq=False)
class TrackedPeople:
    """Who was where in a recording, as the tracker has it.

    Attributes:
        recording_tracks: whose detection was whose, of all frames.
        events: what happened.
        history: states of everybody.
        parts: states of everybody's hands and faces, one for each part of the skeleton.
        naming: who the bodies in the history are.
        nis: shape (frame, person): how surprising what the filter used was, NaN where it used nothing.
        nis_dof: shape (frame, person), int32: and how much that is on average.
        shape_m: shape (person, shape).
        shape_sd_m: shape (person, shape).
    """

    recording_tracks: Tracks
    events: tuple[Event, ...]
    history: History
    parts: tuple[History, ...]
    naming: Naming
    nis: np.ndarray
    nis_dof: np.ndarray
    shape_m: np.ndarray
    shape_sd_m: np.ndarray

    def tracks(self, start: int, stop: int) -> Tracks:
        """Whose detections are whose in a range of frames."""
        return self.recording_tracks.frames(start, stop)

    @property
    def n_frames(self) -> int:
        """How many frames people were followed through."""
        return self.recording_tracks.state.shape[0]

    @property
    def skeleton(self) -> Skeleton:
        """With the tree that bodies were fitted to."""
        return self.history.settings.skeleton

    def only(self, names: tuple[str, ...]) -> "TrackedPeople":
        """The same of some of the people.

        Raises:
            OptionsError: if there is nobody of a name.
        """
        tracks, keep = kept_tracks(self.recording_tracks, names)
        cameras = self.history.settings.rig.names
        events = tuple(event for event in self.events if event.person in (*names, *cameras))
        return replace(
            self, recording_tracks=tracks, events=events, nis=self.nis[:, keep], nis_dof=self.nis_dof[:, keep],
            shape_m=self.shape_m[keep], shape_sd_m=self.shape_sd_m[keep],
        )  # fmt: skip

    def smoother(self) -> "WholeSmoother":
        """Goes through the recording once, from the first frame on."""
        return WholeSmoother(PeopleSmoother(self.history), tuple(PeopleSmoother(each) for each in self.parts))

    def bodies(
        self, rig: CameraRig, detections: Detections, start: int, people: "SmoothedWhole"
    ) -> tuple[Layer, Poses]:
        """The model layer of a range of frames, and how bodies stood.

        Args:
            rig: the cameras.
            detections: of those frames.
            start: the first of them, counted from 0 in the recording.
            people: of those frames, from the smoother.
        """
        stop = start + detections.n_frames
        out = Stood.room((stop - start, len(self.recording_tracks.person_ids)), len(rig), self.skeleton)
        everywhere = np.arange(len(self.skeleton))
        for person in people.bodies:
            f, p, seen = self._cells(person, start)
            out.used[f, p] = person.used[seen]
            body = person.body
            known = Known(body.directions[seen], body.angle_sd_deg[seen])
            out.put(person, (f, p), seen, everywhere, Places(0, 0, 0), known)
            out.holds_deg2[f, p] = body.holds_deg2[seen]
        tree = self.history.settings.tree
        first = Places(len(tree.segments), len(tree.bones), len(angle_names(tree)))
        for i, (part, found) in enumerate(zip(self.skeleton.parts, people.parts, strict=True)):
            for person in found:
                cells, seen = self._cells_with_bodies(person, start, out)
                out.put(person, cells, seen, part.keypoints, first, self._known_part(i, person, cells, seen, out))
            first = Places(
                first.segment + len(part.tree.segments), first.bone + len(part.tree.bones),
                first.angle + len(angle_names(part.tree)),
            )  # fmt: skip
        rows = self.tracks(start, stop).rows(detections)
        layer = model_layer(
            rig, detections, rows, out.points_m, out.covariance_m2, out.used, out.bridged, self._absent(start, stop)
        )
        names = self.skeleton.body_names
        angles = skeleton_angle_names(self.skeleton)
        return layer, Poses(
            *names, angles, out.turns, out.directions, out.angle_sd_deg, self.nis[start:stop],
            self.nis_dof[start:stop], self.shape_m, self.shape_sd_m,
        )  # fmt: skip

    def _known_part(
        self, i: int, person: SmoothedPerson, cells: tuple[np.ndarray, np.ndarray], seen: np.ndarray, out: "Stood"
    ) -> "Known":
        """What is known of the directions and angles of somebody's part: that of its root by the body, too."""
        part, tree, body = self.skeleton.parts[i], self.history.settings.tree, person.body
        sure = certain_directions(part.tree, body.directions[seen], body.points_m[seen], body.covariance_m2[seen])
        s, b = len(tree.segments), len(tree.bones)
        stood = out.turns[cells][:, :s], out.directions[cells][:, :b]
        own = axes_at(tree, tree.nodes[tree.keypoint_nodes[part.at]], stood[0], full_rotations(tree, *stood)[0])
        root = relative_angle_sds(own, out.holds_deg2[cells][:, i], body.turns[seen, 0], body.root_turn[seen])
        return Known(sure, np.concatenate([root, body.angle_sd_deg[seen, 3:]], axis=1))

    def _cells(self, person: SmoothedPerson, start: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Frames from ``start`` on and people of the frames of somebody smoothed, and which of those they are."""
        columns = self._columns(person.number, person.places)
        seen = np.flatnonzero((columns >= 0) & (person.places >= start))
        return person.places[seen] - start, columns[seen], seen

    def _cells_with_bodies(
        self, part: SmoothedPerson, start: int, out: "Stood"
    ) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        """The same of a part, where its body is known."""
        f, p, seen = self._cells(part, start)
        there = np.isfinite(out.points_m[f, p]).any(axis=(1, 2))
        return (f[there], p[there]), seen[there]

    def _columns(self, number: int, places: np.ndarray) -> np.ndarray:
        """The person that a body in the history is in these frames.

        -1 for those who are left out, and before and after the frames that showed them.
        """
        column = self.naming.columns(number, places, self.recording_tracks.person_ids)
        state = np.asarray(self.recording_tracks.state)[places, column]
        return np.where((column >= 0) & (state != TrackState.ABSENT), column, -1)

    def _absent(self, start: int, stop: int) -> np.ndarray:
        return np.asarray(self.recording_tracks.state[start:stop]) == TrackState.ABSENT


@dataclass(frozen=True, eq=False)
class SmoothedWhole:
    """Everybody in a range of frames: bodies, and by part of the skeleton their parts."""

    bodies: list[SmoothedPerson]
    parts: tuple[list[SmoothedPerson], ...]


@dataclass(frozen=True, eq=False)
class WholeSmoother:
    """Smooths bodies and their parts, each for itself; see :class:`PeopleSmoother`."""

    body: PeopleSmoother
    parts: tuple[PeopleSmoother, ...]

    def take(self, stop: int) -> SmoothedWhole:
        """Everybody in the frames up to ``stop``, counted from 0, from where the last call ended."""
        return SmoothedWhole(self.body.take(stop), tuple(each.take(stop) for each in self.parts))

    @property
    def memory(self) -> tuple[Memory, ...]:
        """What the next range of frames goes on from: of bodies, then of their parts."""
        return tuple(each.memory for each in (self.body, *self.parts))

    def resume_from(self, memory: tuple[Memory, ...]) -> None:
        """Go on from where another smoother of the same people was."""
        for each, known in zip((self.body, *self.parts), memory, strict=True):
            each.resume_from(known)
