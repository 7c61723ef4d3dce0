"""The arrays kernels write into, and the layer they become."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, Source
from posefuse.model.tracks import Tracks, TrackState


@dataclass(frozen=True)
class EmptyLayer:
    """Room for the results of ``person_frame = frame * people + person``, as :class:`Layer` describes them."""

    tracks: Tracks
    points_m: np.ndarray
    covariance_m2: np.ndarray
    status: np.ndarray
    view_status: np.ndarray
    view_error_px: np.ndarray
    reprojection_error_px: np.ndarray

    @classmethod
    def of(cls, tracks: Tracks, n_keypoints: int) -> Self:
        """Room for all people of the tracks, nothing written yet."""
        frames, people, views = tracks.detection.shape
        n = frames * people
        return cls(
            tracks=tracks,
            points_m=np.empty((n, n_keypoints, 3)),
            covariance_m2=np.empty((n, n_keypoints, 6)),
            status=np.empty((n, n_keypoints), dtype=np.int8),
            view_status=np.empty((n, n_keypoints, views), dtype=np.int8),
            view_error_px=np.empty((n, n_keypoints, views), dtype=np.float32),
            reprojection_error_px=np.empty((n, n_keypoints)),
        )

    def finish(self) -> Layer:
        """The layer, once everything is written: measured points; those of absent people marked so."""
        frames, people, _ = self.tracks.detection.shape

        def by_frame(array: np.ndarray) -> np.ndarray:
            return array.reshape(frames, people, *array.shape[1:])

        status = by_frame(self.status)
        absent = np.asarray(self.tracks.state[:]) == TrackState.ABSENT
        status[absent] = PointStatus.ABSENT
        return Layer(
            points_m=by_frame(self.points_m),
            covariance_m2=by_frame(self.covariance_m2),
            status=status,
            source=np.where(status < PointStatus.NOT_SEEN, Source.MEASURED, Source.NONE).astype(np.int8),
            reprojection_error_px=by_frame(self.reprojection_error_px),
            view_status=by_frame(self.view_status),
            view_error_px=by_frame(self.view_error_px),
        )


def rows_by_person_frame(tracks: Tracks, detections: Detections) -> np.ndarray:
    """Shape (frame * person, view), int64: rows of the detections, as kernels take them."""
    rows = tracks.rows(detections)
    return np.ascontiguousarray(rows.reshape(-1, rows.shape[-1]))
