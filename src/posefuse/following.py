"""Many people followed through a recording, or frame by frame: association and tracking wired together."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from posefuse.association.proposals import propose
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.model.life import Event, Poses
from posefuse.model.noise import NoiseModel
from posefuse.model.options import Options
from posefuse.model.proposals import Proposals
from posefuse.model.reconstruction import Layer
from posefuse.model.skeletons import Skeleton
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.tracks import Tracks, TrackState
from posefuse.progress import Progress
from posefuse.survey import known_noise
from posefuse.tracking.records import People
from posefuse.tracking.settings import Settings
from posefuse.tracking.tracker import ArticulatedTracker
from posefuse.tracking.unknown_bodies import measured_tree

_PX_AT_1000 = 4.5
_EXPONENT = 1.0
_SAMPLED_FRAMES = 60
_ROUNDS = 3
_EXPECTED_SIGMA = 1.12
"""The median distance, in sigmas, of detections of the assumed law from the points that most views agree on."""
_FACTORS = (0.2, 5.0)


def usual_noise(rig: CameraRig, options: Options) -> NoiseModel:
    """The noise that the options fix, or else what detectors usually do: 4.5 px / confidence at 1000 px width."""
    widths = np.array([camera.size_px[0] for camera in rig.cameras]) / 1000.0
    return known_noise(rig, options) or NoiseModel(_PX_AT_1000 * widths, _EXPONENT, "assumed")


def tracker_of(rig: CameraRig, skeleton: Skeleton, noise: NoiseModel, options: Options) -> ArticulatedTracker:
    """A tracker that proposes people as the options say.

    Raises:
        SkeletonError: if the skeleton has no tree.
    """
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


@dataclass(frozen=True, eq=False)
class Followed:
    """Who was where in a recording, as the tracker has it.

    Attributes:
        tracks: whose detection was whose, of all frames.
        events: what happened.
        points_m: shape (frame, person, keypoint, 3).
        covariance_m2: shape (frame, person, keypoint, 6).
        used: shape (frame, person, view, keypoint), bool.
    """

    tracks: Tracks
    events: tuple[Event, ...]
    points_m: np.ndarray
    covariance_m2: np.ndarray
    used: np.ndarray

    def follow(self, start: int, stop: int) -> Tracks:
        """Whose detections are whose in a range of frames."""
        return self.tracks.frames(start, stop)

    def poses(self, start: int, stop: int) -> Poses | None:
        """How bodies stood in a range of frames."""
        return None

    def layer(self, rig: CameraRig, detections: Detections, start: int, stop: int) -> Layer:
        """The model layer of a range of frames.

        Args:
            rig: the cameras.
            detections: of those frames.
            start, stop: counted from 0 in the recording.
        """
        points, used = self.points_m[start:stop], self.used[start:stop]
        rows = self.follow(start, stop).rows(detections)
        frames, people, keypoints = points.shape[:3]
        errors = np.full((frames, people, keypoints, len(rig)), np.nan, dtype=np.float32)
        for v, camera in enumerate(rig.cameras):
            there = rows[:, :, v] >= 0
            seen = np.asarray(detections.keypoints_px)[rows[:, :, v][there]]
            errors[..., v][there] = np.linalg.norm(camera.project(points[there])[0] - seen, axis=-1)
        counted = np.moveaxis(used, 2, 3)
        status = np.where(np.isfinite(points[..., 0]), PointStatus.OK, PointStatus.NOT_SEEN)
        status[np.asarray(self.tracks.state[start:stop]) == TrackState.ABSENT] = PointStatus.ABSENT
        views = np.where(counted, ViewStatus.USED, np.where(np.isnan(errors), ViewStatus.UNSEEN, ViewStatus.OUTLIER))
        number = counted.sum(axis=-1)
        mean = np.where(counted, errors, 0.0).sum(axis=-1) / np.maximum(number, 1)
        return Layer(
            points_m=points,
            covariance_m2=self.covariance_m2[start:stop],
            status=status.astype(np.int8),
            source=np.where(status < PointStatus.NOT_SEEN, Source.MODELLED, Source.NONE).astype(np.int8),
            reprojection_error_px=np.where(number > 0, mean, np.nan),
            view_status=views.astype(np.int8),
            view_error_px=errors,
        )


def follow(rig: CameraRig, detections: Detections, options: Options, progress: Progress) -> Followed:
    """Follow everybody through a recording.

    Raises:
        DetectionsError: if frames have no times.
        SkeletonError: if the skeleton has no tree, and none can be measured.
    """
    noise = rough_noise(rig, detections, options)
    tracker = tracker_of(rig, with_tree(rig, detections, noise, options), noise, options)
    progress.start("following people", detections.n_frames)
    snapshots = list(_snapshots(tracker, detections, progress))
    progress.finish()
    return _gathered(snapshots, detections)


def _snapshots(tracker: ArticulatedTracker, detections: Detections, progress: Progress) -> Iterator[People]:
    for chunk in detections.chunks():
        for i in range(chunk.n_frames):
            yield tracker.update(Frame.of(chunk, i))
        progress.advance(chunk.n_frames)


def _gathered(snapshots: list[People], detections: Detections) -> Followed:
    """People in columns, in the order of their first appearance."""
    seen = [[person for person in of.people if person.state != TrackState.TENTATIVE] for of in snapshots]
    names = list(dict.fromkeys(person.name for people in seen for person in people))
    shape = (len(snapshots), len(names))
    views, keypoints = detections.n_views, len(detections.skeleton)
    rows = np.full((*shape, views), -1, dtype=np.int64)
    state = np.full(shape, TrackState.ABSENT, dtype=np.int8)
    points = np.full((*shape, keypoints, 3), np.nan)
    covariance = np.full((*shape, keypoints, 6), np.nan)
    used = np.zeros((*shape, views, keypoints), dtype=bool)
    for f, people in enumerate(seen):
        for person in people:
            p = names.index(person.name)
            rows[f, p], state[f, p], used[f, p] = person.rows, person.state, person.used
            if person.state == TrackState.ACTIVE:
                points[f, p], covariance[f, p] = person.points_m, person.covariance_m2
    starts = detections.offsets[:-1].reshape(detections.n_frames, 1, views)
    # A frame's rows are counted through its views, a track's detections within the view.
    first = starts[:, :, :1]
    detection = np.where(rows >= 0, rows + first - starts, -1).astype(np.int32)
    events = tuple(event for of in snapshots for event in of.events)
    return Followed(Tracks(tuple(names), detection, state), events, points, covariance, used)
