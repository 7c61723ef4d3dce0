"""Arrays that kernels write into, and their conversion to a layer."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.arrays import ArraySource, kernel_array
from posefuse.kernels.records import Observations, TriangulatedPoints
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.tracks import Tracks, TrackState


@dataclass(frozen=True)
class LayerBuffers:
    """Hold the output arrays of ``person_frame = frame * people + person``, as :class:`Layer` describes them."""

    tracks: Tracks
    arrays: TriangulatedPoints

    @classmethod
    def allocate(cls, tracks: Tracks, n_keypoints: int) -> Self:
        """Allocate uninitialized arrays for all people of the tracks."""
        frames, people, views = tracks.detection.shape
        return cls(tracks, TriangulatedPoints.allocate(frames * people, n_keypoints, views))

    def finish(self) -> Layer:
        """Return the layer of measured points; points of absent people have the status absent."""
        frames, people, _ = self.tracks.detection.shape

        def by_frame(array: np.ndarray) -> np.ndarray:
            return array.reshape(frames, people, *array.shape[1:])

        arrays = self.arrays
        status = by_frame(arrays.status)
        absent = np.asarray(self.tracks.state[:]) == TrackState.ABSENT
        status[absent] = PointStatus.ABSENT
        return Layer(
            points_m=by_frame(arrays.points),
            covariance_m2=by_frame(arrays.covariance),
            status=status,
            source=np.where(status < PointStatus.NOT_SEEN, Source.MEASURED, Source.NONE).astype(np.int8),
            reprojection_error_px=by_frame(arrays.mean_errors_px),
            view_status=by_frame(arrays.view_codes),
            view_error_px=by_frame(arrays.view_errors_px),
        )


def rows_by_person_frame(tracks: Tracks, detections: Detections) -> np.ndarray:
    """Return rows of the detections for the kernels, shape (frame * person, view), int64."""
    rows = tracks.rows(detections)
    return np.ascontiguousarray(rows.reshape(-1, rows.shape[-1]))


def observations_of(tracks: Tracks, detections: Detections) -> Observations:
    """Return the detections of all people as kernels take them."""
    keypoints_px, confidence = kernel_array(detections.keypoints_px), kernel_array(detections.confidence)
    return Observations(keypoints_px, confidence, rows_by_person_frame(tracks, detections))


@dataclass(frozen=True)
class FlatLayer:
    """Hold a layer with all points in one axis, for methods that recompute some of them.

    Attributes:
        layer: the layer.
        points_m: shape (point, 3).
        covariance_m2: shape (point, 6).
        status: shape (point,).
        reprojection_error_px: shape (point,).
        view_status: shape (point, view).
        view_error_px: shape (point, view).
    """

    layer: Layer
    points_m: np.ndarray
    covariance_m2: np.ndarray
    status: np.ndarray
    reprojection_error_px: np.ndarray
    view_status: np.ndarray
    view_error_px: np.ndarray

    @classmethod
    def of(cls, layer: Layer) -> Self:
        """Copy a layer."""

        def flat(source: ArraySource) -> np.ndarray:
            array = np.array(source)
            return array.reshape(-1, *array.shape[3:])

        return cls(
            layer=layer,
            points_m=flat(layer.points_m),
            covariance_m2=flat(layer.covariance_m2),
            status=flat(layer.status),
            reprojection_error_px=flat(layer.reprojection_error_px),
            view_status=flat(layer.view_status),
            view_error_px=flat(layer.view_error_px),
        )

    def valid_views(self) -> np.ndarray:
        """Return the views with a valid detection, shape (point, view), bool, also of points that were not solved."""
        return np.isin(self.view_status, (ViewStatus.USED, ViewStatus.NOT_USED))

    def replace(
        self,
        chosen: np.ndarray,
        points_m: np.ndarray,
        covariance_m2: np.ndarray,
        status: np.ndarray,
        accepted: np.ndarray,
        error_px: np.ndarray,
    ) -> None:
        """Replace some points; those whose status has no coordinates are removed.

        Args:
            chosen: shape (some,): indices of the points.
            points_m: shape (some, 3).
            covariance_m2: shape (some, 6).
            status: shape (some,): the solver's point codes.
            accepted: shape (some, view), bool: views that the points rest on.
            error_px: shape (some, view): reprojection errors of the new points.
        """
        solved = status < PointStatus.NOT_SEEN
        self.remove(chosen[~solved], status[~solved])
        chosen, points_m, covariance_m2 = chosen[solved], points_m[solved], covariance_m2[solved]
        status, accepted, error_px = status[solved], accepted[solved], error_px[solved]
        self.points_m[chosen] = points_m
        self.covariance_m2[chosen] = covariance_m2
        self.status[chosen] = status
        self.view_error_px[chosen] = error_px
        self.reprojection_error_px[chosen] = mean_over(accepted, error_px)
        valid = np.isin(self.view_status[chosen], (ViewStatus.USED, ViewStatus.OUTLIER, ViewStatus.NOT_USED))
        judged = np.where(accepted, ViewStatus.USED, ViewStatus.OUTLIER)
        self.view_status[chosen] = np.where(valid, judged, self.view_status[chosen])

    def remove(self, chosen: np.ndarray, status: PointStatus | np.ndarray) -> None:
        """Remove the coordinates of some points.

        Args:
            chosen: shape (some,): indices of the points.
            status: point code of all, or of each, shape (some,).
        """
        for array in (self.points_m, self.covariance_m2, self.reprojection_error_px, self.view_error_px):
            array[chosen] = np.nan
        self.status[chosen] = status
        valid = np.isin(self.view_status[chosen], (ViewStatus.USED, ViewStatus.OUTLIER))
        self.view_status[chosen] = np.where(valid, ViewStatus.NOT_USED, self.view_status[chosen])

    def finish(self) -> Layer:
        """Return the modified layer."""
        shape = self.layer.points_m.shape[:3]
        status = self.status.reshape(shape)
        return Layer(
            points_m=self.points_m.reshape(*shape, 3),
            covariance_m2=self.covariance_m2.reshape(*shape, 6),
            status=status,
            source=np.where(status < PointStatus.NOT_SEEN, Source.MEASURED, Source.NONE).astype(np.int8),
            reprojection_error_px=self.reprojection_error_px.reshape(shape),
            view_status=self.view_status.reshape(*shape, self.view_status.shape[-1]),
            view_error_px=self.view_error_px.reshape(*shape, self.view_error_px.shape[-1]),
        )


def mean_over(selected: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Return the mean of errors (point, view) over selected views, shape (point,); NaN without any."""
    with np.errstate(invalid="ignore"):
        return np.where(selected, errors, 0.0).sum(axis=-1) / selected.sum(axis=-1)
