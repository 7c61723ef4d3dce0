"""Single points as tables of observations: what methods need that try a point with some of its views left out."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels import status_codes
from posefuse.kernels.triangulation.all_views import triangulate_views
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel


@dataclass(frozen=True)
class Observations:
    """What each view saw of each of some points.

    Attributes:
        rig: the cameras, in the order of the view axis.
        noise: of the detections.
        pixels: shape (point, view, 2), NaN where not seen.
        confidence: shape (point, view), NaN where the detector gives none.
    """

    rig: CameraRig
    noise: NoiseModel
    pixels: np.ndarray
    confidence: np.ndarray

    @classmethod
    def gather(
        cls, rig: CameraRig, detections: Detections, rows: np.ndarray, noise: NoiseModel, chosen: np.ndarray
    ) -> Self:
        """The observations of chosen points.

        Args:
            rig: the cameras.
            detections: in memory.
            rows: shape (person_frame, view): rows of the detections, negative where none.
            noise: of the detections.
            chosen: shape (point,): ``person_frame * n_keypoints + keypoint``.
        """
        person_frame, keypoint = np.divmod(chosen, len(detections.skeleton))
        row = rows[person_frame]
        there = row >= 0
        places = np.where(there, row, 0), np.broadcast_to(keypoint[:, None], row.shape)
        pixels = np.where(there[..., None], np.asarray(detections.keypoints_px)[places], np.nan)
        confidence = np.where(there, np.asarray(detections.confidence)[places], np.nan)
        return cls(rig, noise, pixels, confidence)

    def __getitem__(self, chosen: np.ndarray) -> "Observations":
        return Observations(self.rig, self.noise, self.pixels[chosen], self.confidence[chosen])

    def solve(self, kept: np.ndarray, min_views: int = 2) -> "Solved":
        """Maximum-likelihood points from the kept views.

        Args:
            kept: shape (point, view), bool.
            min_views: points with fewer are not solved.
        """
        n, views = kept.shape
        out = Solved(
            points_m=np.empty((n, 3)),
            covariance_m2=np.empty((n, 6)),
            status=np.empty(n, dtype=np.int8),
            view_status=np.empty((n, views), dtype=np.int8),
            view_error_px=np.empty((n, views), dtype=np.float32),
            error_px=np.empty(n),
        )
        rows = np.arange(n * views).reshape(n, views)
        triangulate_views(
            *self.rig.packed,
            frozen(np.ascontiguousarray(self.pixels).reshape(n * views, 1, 2)),
            frozen(np.ascontiguousarray(self.confidence).reshape(n * views, 1)),
            np.where(kept, rows, status_codes.NO_DETECTION),
            self.noise.scale_px,
            self.noise.exponent,
            0.0,
            min_views,
            out.points_m[:, None],
            out.covariance_m2[:, None],
            out.status[:, None],
            out.view_status[:, None],
            out.view_error_px[:, None],
            out.error_px[:, None],
        )
        return out

    def errors_px(self, points_m: np.ndarray) -> np.ndarray:
        """Shape (point, view): distance of every observation from the projected point; NaN where there is none."""
        return np.linalg.norm(np.moveaxis(self.rig.project(points_m), 0, -2) - self.pixels, axis=-1)


@dataclass(frozen=True)
class Solved:
    """Points, as one call solved them.

    Attributes:
        points_m: shape (point, 3), NaN where missing.
        covariance_m2: shape (point, 6).
        status: shape (point,), int8, point codes.
        view_status: shape (point, view), int8, view codes.
        view_error_px: shape (point, view), float32, of the kept views.
        error_px: shape (point,): mean over the used views.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    status: np.ndarray
    view_status: np.ndarray
    view_error_px: np.ndarray
    error_px: np.ndarray
