"""Many people followed through a recording, or frame by frame: association and tracking wired together."""

import warnings
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from posefuse.association.proposals import propose
from posefuse.association.subjects import Subjects
from posefuse.errors import OptionsError, PosefuseWarning, choices
from posefuse.model.association_options import AssociationOptions
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections, with_lacking_times
from posefuse.model.frames import Frame
from posefuse.model.life import Event, Poses
from posefuse.model.noise import NoiseModel
from posefuse.model.options import Options
from posefuse.model.proposals import Proposals
from posefuse.model.reconstruction import Layer
from posefuse.model.skeletons import Skeleton
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.tracker_options import TrackerOptions
from posefuse.model.tracks import Tracks, TrackState
from posefuse.progress import Progress
from posefuse.survey import known_noise
from posefuse.tracking.angle_sds import carried_angle_sds
from posefuse.tracking.angles import angle_names, axes_at, whole_angle_names
from posefuse.tracking.history import History
from posefuse.tracking.known_lengths import with_known_lengths
from posefuse.tracking.parts import sure_directions
from posefuse.tracking.records import People
from posefuse.tracking.settings import Settings
from posefuse.tracking.smoothing import PeopleSmoother, SmoothedPerson
from posefuse.tracking.tracker import ArticulatedTracker
from posefuse.tracking.twist import full_rotations
from posefuse.tracking.unknown_bodies import measured_tree

_PX_AT_1000 = 4.5
_EXPONENT = 1.0
_SAMPLED_FRAMES = 60
_ROUNDS = 3
_EXPECTED_SIGMA = 1.22
"""The median distance, in sigmas, of detections of the assumed law from the points that most views agree on."""
_FACTORS = (0.2, 5.0)
_NEVER_S = 1e9
_SURE_LOG_ODDS = 1e9
_ANYWHERE = 1e9


def usual_noise(rig: CameraRig, options: Options) -> NoiseModel:
    """The noise that the options fix, or else what detectors usually do: 4.5 px / confidence at 1000 px width."""
    widths = np.array([camera.size_px[0] for camera in rig.cameras]) / 1000.0
    return known_noise(rig, options) or NoiseModel(_PX_AT_1000 * widths, _EXPONENT, "assumed")


def idle_options(options: Options, skeleton: Skeleton) -> tuple[str, ...]:
    """What is asked for that does nothing here, each with what would make it do something."""
    tracker, usual = options.tracker, TrackerOptions()
    said = []
    if tracker.preset != "specification" and tracker.specification != usual.specification:
        said.append(
            "tracker.specification has options of the preset 'specification', and the preset is "
            f"{tracker.preset!r}: they do nothing. Add --tracker.preset specification, or leave them out."
        )
    if tracker.preset == "specification" and tracker.smoother != "none":
        said.append(
            f"tracker.smoother = {tracker.smoother!r} does nothing with the preset 'specification', whose states "
            "forget how well they are known: nothing is smoothed. Say --smoother none, or take the preset 'posefuse'."
        )
    if tracker.parts != usual.parts and not skeleton.parts:
        said.append(
            f"tracker.parts has options of hands and faces, and skeleton {skeleton.name!r} has none that are followed: "
            "they do nothing. coco_wholebody_133 has them."
        )
    if tracker.lag_s != usual.lag_s and tracker.smoother != "lag":
        said.append(f"tracker.lag_s does nothing with the smoother {tracker.smoother!r}. Add --smoother lag.")
    if options.association.method != "rpt" and options.association.rpt != AssociationOptions().rpt:
        said.append(
            f"association.rpt has options of the method 'rpt', and the method is {options.association.method!r}: they "
            "do nothing. Add --association.method rpt, or leave them out."
        )
    return tuple(said)


def warn_of_idle(options: Options, skeleton: Skeleton) -> None:
    """Warn once of each option that does nothing here."""
    for remark in idle_options(options, skeleton):
        warnings.warn(remark, PosefuseWarning, stacklevel=3)


def tracker_of(rig: CameraRig, skeleton: Skeleton, noise: NoiseModel, options: Options) -> ArticulatedTracker:
    """A tracker that proposes people as the options say.

    Raises:
        OptionsError: if a length is known that bodies do not have.
        SkeletonError: if the skeleton has no tree.
    """
    skeleton = with_known_lengths(skeleton, options.tracker)
    settings = Settings.of(rig, skeleton, noise, options.tracker)
    return ArticulatedTracker(settings, partial(_propose, rig, noise, skeleton, options))


def _propose(
    rig: CameraRig, noise: NoiseModel, skeleton: Skeleton, options: Options, frame: Frame, free: np.ndarray
) -> Proposals:
    return propose(rig, frame, noise, skeleton, free, options.association)


def rough_noise(rig: CameraRig, detections: Detections, options: Options) -> NoiseModel:
    """The usual noise, as large as a sample of the frames says that it is here."""
    noise = usual_noise(rig, options)
    if noise.origin != "assumed":
        return noise
    frames = _sampled(detections)
    for _ in range(_ROUNDS):
        errors: list[float] = []
        for frame in frames:
            found = _proposed(rig, frame, noise, detections.skeleton, options)
            errors.extend(found.error_sigma[(found.n_views > 2) & np.isfinite(found.error_sigma)].tolist())
        if not errors:
            return noise
        factor = float(np.clip(np.median(errors) / _EXPECTED_SIGMA, *_FACTORS))
        noise = replace(noise, scale_px=noise.scale_px * factor, origin="estimated")
    return noise


def _sampled(detections: Detections) -> list[Frame]:
    sampled = np.unique(np.linspace(0, detections.n_frames - 1, _SAMPLED_FRAMES).astype(int))
    return [Frame.of(detections, int(i)) for i in sampled]


def _proposed(rig: CameraRig, frame: Frame, noise: NoiseModel, skeleton: Skeleton, options: Options) -> Proposals:
    """What all detections of a frame propose."""
    return _propose(rig, noise, skeleton, options, frame, np.ones(len(frame.view), dtype=bool))


def with_tree(rig: CameraRig, detections: Detections, noise: NoiseModel, options: Options) -> Skeleton:
    """The skeleton of the detections; one that does not say how its body moves gets the bones that a sample shows.

    Raises:
        SkeletonError: if the sample shows no bones.
    """
    skeleton = detections.skeleton
    if skeleton.tree is not None:
        return skeleton
    found = [_proposed(rig, frame, noise, skeleton, options) for frame in _sampled(detections)]
    points = np.concatenate([each.points_m for each in found])
    covariance = np.concatenate([each.covariance_m2 for each in found])
    return replace(skeleton, tree=measured_tree(skeleton, points, covariance))


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
class Followed:
    """Who was where in a recording, as the tracker has it.

    Attributes:
        tracks: whose detection was whose, of all frames.
        events: what happened.
        history: states of everybody.
        parts: states of everybody's hands and faces, one for each part of the skeleton.
        naming: who the bodies in the history are.
        nis: shape (frame, person): how surprising what the filter used was, NaN where it used nothing.
        nis_dof: shape (frame, person), int32: and how much that is on average.
        shape_m: shape (person, shape).
        shape_sd_m: shape (person, shape).
    """

    tracks: Tracks
    events: tuple[Event, ...]
    history: History
    parts: tuple[History, ...]
    naming: Naming
    nis: np.ndarray
    nis_dof: np.ndarray
    shape_m: np.ndarray
    shape_sd_m: np.ndarray

    def follow(self, start: int, stop: int) -> Tracks:
        """Whose detections are whose in a range of frames."""
        return self.tracks.frames(start, stop)

    @property
    def skeleton(self) -> Skeleton:
        """With the tree that bodies were fitted to."""
        return self.history.settings.skeleton

    def only(self, names: tuple[str, ...]) -> "Followed":
        """The same of some of the people.

        Raises:
            OptionsError: if there is nobody of a name.
        """
        there = self.tracks.person_ids
        for name in names:
            if name not in there:
                raise OptionsError(f"person: nobody is called {name!r}; there are {choices(there, 20)}.")
        keep = [there.index(name) for name in names]
        tracks = Tracks(names, np.asarray(self.tracks.detection)[:, keep], np.asarray(self.tracks.state)[:, keep])
        cameras = self.history.settings.rig.names
        events = tuple(event for event in self.events if event.person in (*names, *cameras))
        return replace(
            self, tracks=tracks, events=events, nis=self.nis[:, keep], nis_dof=self.nis_dof[:, keep],
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
        out = _Stood.room((stop - start, len(self.tracks.person_ids)), len(rig), self.skeleton)
        everywhere = np.arange(len(self.skeleton))
        for person in people.bodies:
            f, p, seen = self._cells(person, start)
            out.used[f, p] = person.run.used[seen]
            body = person.body
            known = _Known(body.directions[seen], body.angle_sd_deg[seen])
            out.put(person, (f, p), seen, everywhere, _Places(0, 0, 0), known)
            out.holds_deg2[f, p] = body.holds_deg2[seen]
        tree = self.history.settings.tree
        first = _Places(len(tree.segments), len(tree.bones), len(angle_names(tree)))
        for i, (part, found) in enumerate(zip(self.skeleton.parts, people.parts, strict=True)):
            for person in found:
                cells, seen = self._cells_with_bodies(person, start, out)
                out.put(person, cells, seen, part.keypoints, first, self._known_part(i, person, cells, seen, out))
            first = _Places(
                first.segment + len(part.tree.segments), first.bone + len(part.tree.bones),
                first.angle + len(angle_names(part.tree)),
            )  # fmt: skip
        rows = self.follow(start, stop).rows(detections)
        layer = model_layer(
            rig, detections, rows, out.points_m, out.covariance_m2, out.used, out.bridged, self._absent(start, stop)
        )
        names = self.skeleton.stood_names
        angles = whole_angle_names(self.skeleton)
        return layer, Poses(
            *names, angles, out.turns, out.directions, out.angle_sd_deg, self.nis[start:stop],
            self.nis_dof[start:stop], self.shape_m, self.shape_sd_m,
        )  # fmt: skip

    def _known_part(
        self, i: int, person: SmoothedPerson, cells: tuple[np.ndarray, np.ndarray], seen: np.ndarray, out: "_Stood"
    ) -> "_Known":
        """What is known of the directions and angles of somebody's part: that of its root by the body, too."""
        part, tree, body = self.skeleton.parts[i], self.history.settings.tree, person.body
        sure = sure_directions(part.tree, body.directions[seen], body.points_m[seen], body.covariance_m2[seen])
        s, b = len(tree.segments), len(tree.bones)
        stood = out.turns[cells][:, :s], out.directions[cells][:, :b]
        own = axes_at(tree, tree.nodes[tree.keypoint_nodes[part.at]], stood[0], full_rotations(tree, *stood)[0])
        root = carried_angle_sds(own, out.holds_deg2[cells][:, i], body.turns[seen, 0], body.root_turn[seen])
        return _Known(sure, np.concatenate([root, body.angle_sd_deg[seen, 3:]], axis=1))

    def _cells(self, person: SmoothedPerson, start: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Frames from ``start`` on and people of the frames of somebody smoothed, and which of those they are."""
        columns = self._columns(person.number, person.places)
        seen = np.flatnonzero((columns >= 0) & (person.places >= start))
        return person.places[seen] - start, columns[seen], seen

    def _cells_with_bodies(
        self, part: SmoothedPerson, start: int, out: "_Stood"
    ) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        """The same of a part, where its body is known."""
        f, p, seen = self._cells(part, start)
        there = np.isfinite(out.points_m[f, p]).any(axis=(1, 2))
        return (f[there], p[there]), seen[there]

    def _columns(self, number: int, places: np.ndarray) -> np.ndarray:
        """The person that a body in the history is in these frames.

        -1 for those who are left out, and before and after the frames that showed them.
        """
        column = self.naming.columns(number, places, self.tracks.person_ids)
        state = np.asarray(self.tracks.state)[places, column]
        return np.where((column >= 0) & (state != TrackState.ABSENT), column, -1)

    def _absent(self, start: int, stop: int) -> np.ndarray:
        return np.asarray(self.tracks.state[start:stop]) == TrackState.ABSENT


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


class _Known(NamedTuple):
    """Of somebody's body or part: directions, shape (frame, bone, 3), and sds of angles, (frame, angle), degrees."""

    directions: np.ndarray
    angle_sd_deg: np.ndarray


class _Places(NamedTuple):
    """Where the segments, bones and angles of a body or a part begin among all."""

    segment: int
    bone: int
    angle: int


@dataclass(frozen=True, eq=False)
class _Stood:
    """Where people are in a range of frames, to be filled; bodies first, then their parts.

    Attributes:
        points_m: shape (frame, person, keypoint, 3).
        covariance_m2: shape (frame, person, keypoint, 6).
        used: shape (frame, person, view, keypoint), bool.
        bridged: shape (frame, person, keypoint), bool: nothing supported what it belongs to.
        turns: shape (frame, person, segment, 3, 3).
        directions: shape (frame, person, bone, 3).
        angle_sd_deg: shape (frame, person, angle).
        holds_deg2: shape (frame, person, part, 3, 3): how well the axes in which bodies have their parts are known.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    used: np.ndarray
    bridged: np.ndarray
    turns: np.ndarray
    directions: np.ndarray
    angle_sd_deg: np.ndarray
    holds_deg2: np.ndarray

    @classmethod
    def room(cls, shape: tuple[int, int], views: int, skeleton: Skeleton) -> "_Stood":
        """Nobody anywhere, in so many frames and of so many people."""
        segments, bones, _ = skeleton.stood_names
        keypoints = len(skeleton)
        return cls(
            np.full((*shape, keypoints, 3), np.nan),
            np.full((*shape, keypoints, 6), np.nan),
            np.zeros((*shape, views, keypoints), dtype=bool),
            np.zeros((*shape, keypoints), dtype=bool),
            np.full((*shape, len(segments), 3, 3), np.nan),
            np.full((*shape, len(bones), 3), np.nan),
            np.full((*shape, len(whole_angle_names(skeleton))), np.nan),
            np.full((*shape, len(skeleton.parts), 3, 3), np.nan),
        )

    def put(
        self,
        person: SmoothedPerson,
        cells: tuple[np.ndarray, np.ndarray],
        seen: np.ndarray,
        keypoints: np.ndarray,
        first: _Places,
        known: _Known,
    ) -> None:
        """Somebody's body, or a part of it.

        Args:
            person: as smoothed.
            cells: frames and people.
            seen: which of the person's frames these are.
            keypoints: shape (point,): places of the keypoints.
            first: places of its first segment, bone and angle.
            known: of its bones and angles in those frames.
        """
        body, (f, p) = person.body, cells
        self.points_m[f[:, None], p[:, None], keypoints] = body.points_m[seen]
        self.covariance_m2[f[:, None], p[:, None], keypoints] = body.covariance_m2[seen]
        self.bridged[f[:, None], p[:, None], keypoints] = (person.run.missing_s[seen] > 0.0)[:, None]
        self.turns[f, p, first.segment : first.segment + body.turns.shape[1]] = body.turns[seen]
        self.directions[f, p, first.bone : first.bone + known.directions.shape[1]] = known.directions
        self.angle_sd_deg[f, p, first.angle : first.angle + known.angle_sd_deg.shape[1]] = known.angle_sd_deg


def model_layer(
    rig: CameraRig,
    detections: Detections,
    rows: np.ndarray,
    points_m: np.ndarray,
    covariance_m2: np.ndarray,
    used: np.ndarray,
    bridged: np.ndarray,
    absent: np.ndarray,
) -> Layer:
    """Bodies' points as a layer, with how far from them the detections lie.

    Args:
        rig: the cameras.
        detections: of the frames.
        rows: shape (frame, person, view): of the detections' arrays.
        points_m: shape (frame, person, keypoint, 3), NaN where there is none.
        covariance_m2: shape (frame, person, keypoint, 6).
        used: shape (frame, person, view, keypoint), bool.
        bridged: shape (frame, person, keypoint), bool: nothing supported them there.
        absent: shape (frame, person), bool.
    """
    frames, people, keypoints = points_m.shape[:3]
    errors = np.full((frames, people, keypoints, len(rig)), np.nan, dtype=np.float32)
    for v, camera in enumerate(rig.cameras):
        there = rows[:, :, v] >= 0
        seen = np.asarray(detections.keypoints_px)[rows[:, :, v][there]]
        errors[there, :, v] = np.linalg.norm(camera.project(points_m[there])[0] - seen, axis=-1)
    counted = np.moveaxis(used, 2, 3) & np.isfinite(errors)
    there = np.isfinite(points_m[..., 0])
    # Of a body that is there, what is missing belongs to a part that is not followed, or to nothing that is.
    missing = np.where(there.any(axis=-1, keepdims=True), PointStatus.NOT_FOLLOWED, PointStatus.NOT_SEEN)
    status = np.where(there, PointStatus.OK, missing)
    status[absent] = PointStatus.ABSENT
    views = np.where(counted, ViewStatus.USED, np.where(np.isnan(errors), ViewStatus.UNSEEN, ViewStatus.OUTLIER))
    number = counted.sum(axis=-1)
    mean = np.where(counted, errors, 0.0).sum(axis=-1) / np.maximum(number, 1)
    has = status < PointStatus.NOT_SEEN
    source = np.where(bridged, Source.FILLED, Source.MODELLED)
    return Layer(
        points_m=points_m,
        covariance_m2=covariance_m2,
        status=status.astype(np.int8),
        source=np.where(has, source, Source.NONE).astype(np.int8),
        reprojection_error_px=np.where(number > 0, mean, np.nan),
        view_status=views.astype(np.int8),
        view_error_px=errors,
    )


def follow_subject(
    rig: CameraRig, detections: Detections, subject: Subjects, options: Options, progress: Progress
) -> Followed:
    """Fit a body to the one subject of a recording: followed like many, from their detections alone.

    Raises:
        DetectionsError: if frames have no times.
        SkeletonError: if the skeleton has no tree, and none can be measured.
    """
    everything = detections.frames(0, detections.n_frames)
    theirs = subject.follow(0, detections.n_frames).rows(everything)[:, 0]
    kept = theirs >= 0
    rows = theirs[kept]
    depth = None if everything.depth is None else np.asarray(everything.depth)[rows]
    alone = replace(
        everything,
        offsets=np.concatenate([[0], np.cumsum(kept.ravel())]),
        keypoints_px=np.asarray(everything.keypoints_px)[rows],
        confidence=np.asarray(everything.confidence)[rows],
        track_ids=np.asarray(everything.track_ids)[rows],
        depth=depth,
    )
    # Whoever comes back is the subject.
    anywhere = replace(options.tracker.specification, reacquire_gate=_ANYWHERE)
    tracker = replace(
        options.tracker, max_people=1, forget_after_s=_NEVER_S, reacquire_log_odds=-_SURE_LOG_ODDS,
        specification=anywhere,
    )  # fmt: skip
    return follow(rig, alone, replace(options, tracker=tracker), progress)


def follow(rig: CameraRig, detections: Detections, options: Options, progress: Progress) -> Followed:
    """Follow everybody through a recording.

    Raises:
        DetectionsError: if frames have no times.
        SkeletonError: if the skeleton has no tree, and none can be measured.
    """
    noise = rough_noise(rig, detections, options)
    tracker = tracker_of(rig, with_tree(rig, detections, noise, options), noise, options)
    book = _Book(History(tracker.settings), tuple(History(part.settings) for part in tracker.parts))
    progress.start("following people", detections.n_frames)
    done = 0
    times_s = _times(detections)
    for chunk in detections.chunks():
        for i in range(chunk.n_frames):
            frame = Frame.of(chunk, i)
            if not frame.recorded.any():
                frame = replace(frame, time_s=np.full(len(rig), times_s[done + i]))
            book.enter(tracker, tracker.update(frame))
        done += chunk.n_frames
        progress.advance(chunk.n_frames)
    progress.finish()
    return book.close(detections)


def _times(detections: Detections) -> np.ndarray:
    """Shape (frame,): when frames were; of those that no view recorded, when they should have been; NaN if unknown."""
    known = np.asarray(detections.recorded) & np.isfinite(detections.time_s)
    last = np.where(known, detections.time_s, -np.inf).max(axis=1)
    return with_lacking_times(np.where(np.isfinite(last), last, np.nan), detections.frame_numbers)


class _Book:
    """What is kept of a tracker's run: little a frame, the states in the history.

    Args:
        history: to be written.
        parts: to be written, of hands and faces.
    """

    def __init__(self, history: History, parts: tuple[History, ...]) -> None:
        self.history, self.parts = history, parts
        self.lines = array("i")
        """Place, number, state and rows, of every person and frame one after the other; later ones count."""
        self.innovations = array("d")
        """Place, number, NIS and its degrees of freedom, likewise."""
        self.names: dict[int, list[tuple[int, str]]] = {}
        self.shapes: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.events: list[Event] = []

    def enter(self, tracker: ArticulatedTracker, people: People) -> None:
        """A frame."""
        self.history.add(tracker, people)
        for history, follower in zip(self.parts, tracker.parts, strict=True):
            history.add_parts(follower, tracker.tracks, people)
        place = len(self.history) - 1
        told = {person.name: person for person in people.people}
        for p, track in enumerate(tracker.tracks):
            self.names.setdefault(track.number, [(0, track.name)])
            shapes = [tracker.shape_of(p), *(part.shape_of(track.name) for part in tracker.parts)]
            values, sds = (np.concatenate(each) for each in zip(*shapes, strict=True))
            self.shapes[track.name] = (values, sds)
            person = told[track.name]
            self._note(place, track.number, track.state, person.rows)
            if person.nis_dof:
                self.innovations.extend((place, track.number, person.nis, person.nis_dof))
            for each in tracker.remembered.get(track.name, []):
                self._note(self.history.place(each.number), track.number, TrackState.TENTATIVE, each.rows)
        for numbers, since_s in tracker.exchanged:
            self._rename(tracker, numbers, self.history.place_at(since_s))
        self.events.extend(people.events)

    def _note(self, place: int, number: int, state: TrackState, rows: np.ndarray) -> None:
        self.lines.extend((place, number, state, *rows.tolist()))

    def _rename(self, tracker: ArticulatedTracker, numbers: tuple[int, int], place: int) -> None:
        """Bodies have been, from that frame on, who they are called now."""
        for track in tracker.tracks:
            if track.number in numbers:
                before = [each for each in self.names[track.number] if each[0] < place]
                self.names[track.number] = [*before, (place, track.name)]

    def close(self, detections: Detections) -> Followed:
        """All of it, people in the order in which they were first believed."""
        names = tuple(self.shapes)
        shape = (len(self.history), len(names))
        rows = np.full((*shape, detections.n_views), -1, dtype=np.int64)
        state = np.full(shape, TrackState.ABSENT, dtype=np.int8)
        naming = Naming({number: tuple(since) for number, since in self.names.items()})
        lines = np.asarray(self.lines, dtype=np.int64).reshape(-1, 3 + detections.n_views)
        for number in naming.since:
            mine = lines[lines[:, 1] == number]
            columns = naming.columns(number, mine[:, 0], names)
            rows[mine[:, 0], columns], state[mine[:, 0], columns] = mine[:, 3:], mine[:, 2]
        _end_with_the_last_sight(rows, state)
        nis, nis_dof = self._innovations(naming, names, state)
        starts = detections.offsets[:-1].reshape(detections.n_frames, 1, detections.n_views)
        # A frame's rows are counted through its views, a track's detections within the view.
        detection = np.where(rows >= 0, rows + starts[:, :, :1] - starts, -1).astype(np.int32)
        lengths = len(self.history.settings.skeleton.stood_names[2])
        shape_m, shape_sd_m = (
            np.stack([each[i] for each in self.shapes.values()]) if names else np.empty((0, lengths)) for i in range(2)
        )
        tracks = Tracks(names, detection, state)
        return Followed(
            tracks, tuple(self.events), self.history, self.parts, naming, nis, nis_dof, shape_m, shape_sd_m
        )  # fmt: skip

    def _innovations(self, naming: Naming, names: tuple[str, ...], state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """NIS and its degrees of freedom, shape (frame, person) each, of those who are there."""
        nis, dof = np.full(state.shape, np.nan), np.zeros(state.shape, dtype=np.int32)
        lines = np.asarray(self.innovations).reshape(-1, 4)
        for number in naming.since:
            mine = lines[lines[:, 1] == number]
            places = mine[:, 0].astype(np.int64)
            columns = naming.columns(number, places, names)
            nis[places, columns], dof[places, columns] = mine[:, 2], mine[:, 3]
        absent = state == TrackState.ABSENT
        nis[absent], dof[absent] = np.nan, 0
        return nis, dof


def _end_with_the_last_sight(rows: np.ndarray, state: np.ndarray) -> None:
    """Afterwards it is known who did not come back: they were there until they were last seen.

    Args:
        rows: shape (frame, person, view).
        state: shape (frame, person), in and out.
    """
    seen = np.asarray((rows >= 0).any(axis=2))
    for p in range(state.shape[1]):
        last = np.flatnonzero(seen[:, p])
        end = last[-1] + 1 if len(last) else 0
        state[end:, p] = TrackState.ABSENT
