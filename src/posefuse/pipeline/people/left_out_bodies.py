"""Fit known bodies to some views of a range of frames, to predict the views that are left out."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.arrays import frozen
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.tracking_stages import InitiationOptions
from posefuse.model.subjects import FixedSubjects, Subjects
from posefuse.model.tracks import Tracks
from posefuse.pipeline.people.track_recording import track_subject
from posefuse.pipeline.people.tracked_people import TrackedPeople
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.progress import Silent
from posefuse.skeleton.skeletons import Skeleton

_MIN_LENGTH_SD_SHARE = 0.01
"""Lower bound of the standard deviation of a length, as a share of the length."""

_EXISTING = InitiationOptions(
    min_age_s=0.05, min_age_two_views_s=0.05, two_views_log_odds=-1e9, promote_log_odds=-1e9, max_error_sigma=1e9,
    max_bone_variation=1e9,
)  # fmt: skip
"""The person is known to exist, and which detections show them."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Bodies of people tracked through a recording.

    Attributes:
        skeleton: skeleton with the kinematic tree that bodies were fitted to.
        options: options of the reconstruction.
        shape_m: shape (person, shape): lengths of the bodies.
        shape_sd_m: shape (person, shape): their standard deviations.
    """

    skeleton: Skeleton
    options: Options
    shape_m: np.ndarray
    shape_sd_m: np.ndarray

    @classmethod
    def of(cls, people: Subjects | None, options: Options) -> "Bodies | None":
        """Return the bodies of tracked people; None if no bodies were fitted."""
        if options.bodies == "none" or not isinstance(people, TrackedPeople):
            return None
        return cls(people.skeleton, options, people.shape_m, people.shape_sd_m)

    def skeleton_of(self, person: int) -> Skeleton:
        """Return the skeleton with the lengths of a person as its prior."""
        tree = self.skeleton.tree
        if tree is None:
            return self.skeleton
        # Lengths of hands and faces follow those of the body.
        length, sd = self.shape_m[person, : tree.n_shape], self.shape_sd_m[person, : tree.n_shape]
        if not (np.isfinite(length).all() and np.isfinite(sd).all()):
            return self.skeleton
        sd = np.maximum(sd, _MIN_LENGTH_SD_SHARE * length)
        tree = replace(tree, shape_m=frozen(length), shape_covariance=frozen(np.diag(np.square(sd))))
        return replace(self.skeleton, tree=tree)

    def points(self, rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel) -> np.ndarray:
        """Return the keypoints of all bodies fitted to detections, shape (frame, person, keypoint, 3), in m.

        Args:
            rig: the cameras, in the order of the views of the detections.
            detections: detections of a range of frames, in memory.
            tracks: assignment of detections to people in the same frames.
            noise: noise of the detections.
        """
        frames, people, _ = np.asarray(tracks.detection).shape
        points = np.full((frames, people, len(self.skeleton), 3), np.nan)
        for person in range(people):
            assigned = np.asarray(tracks.detection)[:, person : person + 1]
            if ((assigned >= 0).sum(axis=-1) > 1).any():
                only = Tracks(("person",), assigned, np.asarray(tracks.state)[:, person : person + 1])
                points[:, person] = self._person_points(person, rig, detections, only, noise)
        return points

    def _person_points(
        self, person: int, rig: CameraRig, detections: Detections, only: Tracks, noise: NoiseModel
    ) -> np.ndarray:
        """Return the keypoints of one body, shape (frame, keypoint, 3)."""
        tracker = replace(self.options.tracker, stature_m=None, known_m=(), initiation=_EXISTING)
        options = replace(self.options, tracker=tracker)
        found = track_subject(
            rig, detections, FixedSubjects(only), options, Silent(),
            make_tracker=lambda options: tracker_of(rig, self.skeleton_of(person), noise, options),
        )  # fmt: skip
        n_frames = detections.n_frames
        if not found.recording_tracks.person_ids:
            return np.full((n_frames, len(self.skeleton), 3), np.nan)
        points = found.points_m()
        # Where a body was lost, a later track may be the same person.
        first = np.isfinite(points).all(axis=-1).argmax(axis=1)
        return np.take_along_axis(points, first[:, None, :, None], axis=1)[:, 0]
