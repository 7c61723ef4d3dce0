"""Triangulate the keypoints of tracked people, each frame from its own detections."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.errors import OptionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.model.layer_statuses import with_true_statuses
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.tracks import Tracks
from posefuse.pipeline.defaults import resolve_min_views
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.skeleton.skeletons import Skeleton
from posefuse.tracking.records import People
from posefuse.triangulation.method import Method
from posefuse.triangulation.registry import find_method


@dataclass(frozen=True, eq=False)
class MeasuredPoints:
    """Triangulated keypoints of the people in one frame.

    Attributes:
        points_m: shape (person, keypoint, 3), NaN where not measured.
        covariance_m2: shape (person, keypoint, 6): xx xy xz yy yz zz.
        status: shape (person, keypoint), :class:`posefuse.PointStatus`.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    status: np.ndarray


@dataclass(frozen=True, eq=False)
class PointTriangulator:
    """Triangulates as ``reconstruct --pairs labels`` does, with left and right labels as they are.

    Attributes:
        rig: calibrated cameras.
        skeleton: skeleton of the keypoints.
        noise: noise of the detections.
        options: options with ``min_views`` resolved.
        method: triangulation method.
    """

    rig: CameraRig
    skeleton: Skeleton
    noise: NoiseModel
    options: Options
    method: Method

    @classmethod
    def of(cls, rig: CameraRig, skeleton: Skeleton, options: Options) -> "PointTriangulator":
        """Return a triangulator for a stream.

        Raises:
            OptionsError: if the options fix the noise of other cameras, or the method needs the whole recording.
        """
        resolved, _ = resolve_min_views(options, len(rig))
        method = find_method(options.triangulation.method)
        if method.prepare is not None:
            raise OptionsError(
                f"triangulation.method {options.triangulation.method!r} needs the whole recording, which a "
                "stream does not have. Choose another method; posefuse methods lists them."
            )
        return cls(rig, skeleton, default_noise(rig, options), resolved, method)

    def points(self, frame: Frame, people: People) -> MeasuredPoints:
        """Return the points of all people in a frame, in the order of ``people``."""
        n_people, keypoints = len(people.people), len(self.skeleton)
        if not n_people:
            return MeasuredPoints(
                np.empty((0, keypoints, 3)), np.empty((0, keypoints, 6)), np.empty((0, keypoints), int)
            )
        detections = self._detections(frame)
        rows = np.stack([person.rows for person in people.people])[None]
        index = np.where(rows >= 0, rows - detections.offsets[:-1], -1).astype(np.int32)
        names = tuple(person.name for person in people.people)
        tracks = Tracks(names, index, np.array([[person.state for person in people.people]], dtype=np.int8))
        layer = self.method.solve(self.rig, detections, tracks, self.noise, self.options.triangulation)
        layer = with_true_statuses(replace(layer, covariance_m2=np.asarray(layer.covariance_m2) * self.noise.spread**2))
        return MeasuredPoints(
            np.asarray(layer.points_m)[0], np.asarray(layer.covariance_m2)[0], np.asarray(layer.status)[0]
        )

    def _detections(self, frame: Frame) -> Detections:
        counts = np.bincount(frame.view, minlength=len(self.rig))
        keypoints = len(self.skeleton)
        return Detections(
            skeleton=self.skeleton,
            view_names=self.rig.names,
            frame_numbers=np.array([frame.number]),
            time_s=frame.time_s[None],
            offsets=np.concatenate([[0], np.cumsum(counts)]),
            keypoints_px=np.reshape(frame.keypoints_px, (-1, keypoints, 2)),
            confidence=np.reshape(frame.confidence, (-1, keypoints)),
            recorded=frame.recorded[None],
            track_ids=frame.track_ids,
        )
