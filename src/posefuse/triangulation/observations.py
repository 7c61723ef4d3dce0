"""Observations of single points, for methods that triangulate a point repeatedly from subsets of its views."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels import status_codes
from posefuse.kernels.records import NoiseParameters, TriangulatedPoints
from posefuse.kernels.records import Observations as KernelObservations
from posefuse.kernels.triangulation.all_views import triangulate_views
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.status import PointStatus
from posefuse.triangulation.linear_points import image_errors_px, linear_points, undistort, undistorted_errors_px


@dataclass(frozen=True)
class Observations:
    """Hold the observations of some points in all views.

    Attributes:
        rig: the cameras, in the order of the view axis.
        noise: error model of the detections.
        pixels: shape (point, view, 2), NaN where not detected.
        confidence: shape (point, view), NaN where the detector gives none.
        linear: whether points are those of :mod:`posefuse.triangulation.linear_points`, instead of maximum likelihood.
    """

    rig: CameraRig
    noise: NoiseModel
    pixels: np.ndarray
    confidence: np.ndarray
    linear: bool = False

    @classmethod
    def gather(
        cls,
        rig: CameraRig,
        detections: Detections,
        rows: np.ndarray,
        noise: NoiseModel,
        chosen: np.ndarray,
        *,
        linear: bool = False,
    ) -> Self:
        """Return the observations of selected points.

        Args:
            rig: the cameras.
            detections: in memory.
            rows: shape (person_frame, view): rows of the detections, negative where there is none.
            noise: error model of the detections.
            chosen: shape (point,): ``person_frame * n_keypoints + keypoint``.
            linear: see the attribute.
        """
        person_frame, keypoint = np.divmod(chosen, len(detections.skeleton))
        row = rows[person_frame]
        detected = row >= 0
        indices = np.where(detected, row, 0), np.broadcast_to(keypoint[:, None], row.shape)
        pixels = np.where(detected[..., None], np.asarray(detections.keypoints_px)[indices], np.nan)
        confidence = np.where(detected, np.asarray(detections.confidence)[indices], np.nan)
        return cls(rig, noise, pixels, confidence, linear)

    def __getitem__(self, chosen: np.ndarray) -> "Observations":
        return replace(self, pixels=self.pixels[chosen], confidence=self.confidence[chosen])

    def solve(self, used: np.ndarray, min_views: int = 2) -> "SolvedPoints":
        """Return maximum-likelihood points from the selected views, or linear ones with their covariance and status.

        Args:
            used: shape (point, view), bool: views to use.
            min_views: points with fewer views are missing.
        """
        n, views = used.shape
        out = TriangulatedPoints.allocate(n, 1, views)
        rows = np.arange(n * views).reshape(n, views)
        triangulate_views(
            self.rig.packed,
            KernelObservations(
                frozen(np.ascontiguousarray(self.pixels).reshape(n * views, 1, 2)),
                frozen(np.ascontiguousarray(self.confidence).reshape(n * views, 1)),
                np.where(used, rows, status_codes.NO_DETECTION),
            ),
            NoiseParameters(self.noise.scale_px, self.noise.exponent, 0.0),
            min_views,
            out,
        )
        solved = SolvedPoints(*(array[:, 0] for array in out))
        return self._linearized(solved, used) if self.linear else solved

    def _linearized(self, solved: "SolvedPoints", used: np.ndarray) -> "SolvedPoints":
        """Replace maximum-likelihood points by linear ones; those behind a used view are missing."""
        points = linear_points(self.rig, self.coordinates, used)
        errors_px = np.where(used, self.errors_px(points), np.nan)
        missing = (used & ~np.isfinite(errors_px)).any(axis=-1) & (solved.status < PointStatus.NOT_SEEN)
        status = np.where(missing, PointStatus.BEHIND_CAMERA, solved.status).astype(np.int8)
        there = status < PointStatus.NOT_SEEN
        return replace(
            solved,
            points_m=np.where(there[:, None], points, np.nan),
            covariance_m2=np.where(there[:, None], solved.covariance_m2, np.nan),
            status=status,
            view_error_px=np.where(there[:, None], errors_px, np.nan).astype(np.float32),
            error_px=np.where(there, np.nansum(errors_px, axis=-1) / np.maximum(used.sum(axis=-1), 1), np.nan),
        )

    def subset(self, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return points from the selected views, shape (point, 3), and reprojection errors (point, view) in px.

        The errors of linear points are those without distortion, and a linear point may be behind a camera.
        """
        if not self.linear:
            solved = self.solve(used)
            return solved.points_m, solved.view_error_px
        points = linear_points(self.rig, self.coordinates, used)
        return points, undistorted_errors_px(self.rig, self.coordinates, points)

    def linear_errors_px(self, used: np.ndarray) -> np.ndarray:
        """Return reprojection errors (point, view) of linear points from the selected views, also behind a camera."""
        return image_errors_px(self.rig, self.pixels, linear_points(self.rig, self.coordinates, used))

    @cached_property
    def coordinates(self) -> np.ndarray:
        """Undistorted pixels in units of the focal length, shape (point, view, 2)."""
        return undistort(self.rig, self.pixels)

    def errors_px(self, points_m: np.ndarray) -> np.ndarray:
        """Return the reprojection error of every observation, shape (point, view), NaN where there is none."""
        return np.linalg.norm(self.rig.project(points_m) - self.pixels, axis=-1)


@dataclass(frozen=True)
class SolvedPoints:
    """Hold the points of one call of the solver.

    Attributes:
        points_m: shape (point, 3), NaN where missing.
        covariance_m2: shape (point, 6): upper triangle, row by row.
        status: shape (point,), int8: point status codes.
        view_status: shape (point, view), int8: view status codes.
        view_error_px: shape (point, view), float32: reprojection errors of the selected views.
        error_px: shape (point,): mean reprojection error over the used views.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    status: np.ndarray
    view_status: np.ndarray
    view_error_px: np.ndarray
    error_px: np.ndarray
