"""Place the keypoints of one camera in its image plane (FreeMoCap's "Flatten Single Camera Data").

The result is in pixels, not in the world: x to the right, y down, as the detector gave them. With
``flatten_single_view`` z is 0; without, z is the detector's own depth.
"""

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.triangulation.results import rows_by_person_frame


def solve(detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions) -> Layer:
    """Return the keypoints of one view as points in its image plane, in pixels.

    Raises:
        DetectionsError: if depth is requested and the detector gave none.
    """
    depth = detections.depth
    if not options.flatten_single_view and depth is None:
        raise DetectionsError(
            "With one camera and flatten_single_view = false, z is the detector's depth, and these keypoints have "
            "none. Set flatten_single_view = true, or read a third channel as depth."
        )
    frames, people, _ = tracks.detection.shape
    rows = rows_by_person_frame(tracks, detections)[:, 0]
    detected = rows >= 0
    shape = (len(rows), len(detections.skeleton))
    pixels = np.full((*shape, 2), np.nan)
    confidence = np.full(shape, np.nan)
    z = np.where(detected[:, None], 0.0, np.full(shape, np.nan))
    pixels[detected] = np.asarray(detections.keypoints_px)[rows[detected]]
    confidence[detected] = np.asarray(detections.confidence)[rows[detected]]
    if not options.flatten_single_view:
        z[detected] = np.asarray(depth)[rows[detected]]
    seen = np.isfinite(pixels).all(axis=-1) & np.isfinite(z)
    relative_precision = np.where(np.isfinite(confidence), confidence, 1.0) ** noise.exponent
    low = seen & ((confidence < options.min_confidence) | (relative_precision <= 0))
    solved = seen & ~low
    points = np.where(solved[..., None], np.concatenate([pixels, z[..., None]], axis=-1), np.nan)
    sigma = noise.scale_px[0] / np.where(solved, relative_precision, 1.0)
    covariance = np.zeros((*shape, 6))
    covariance[..., 0] = covariance[..., 3] = sigma**2
    covariance[..., 5] = 0.0 if options.flatten_single_view else sigma**2 + _spread(np.where(solved, z, np.nan))
    covariance[~solved] = np.nan
    status = np.where(solved, PointStatus.SINGLE_VIEW, PointStatus.NOT_SEEN)
    view_status = np.where(low, ViewStatus.LOW_CONFIDENCE, np.where(solved, ViewStatus.USED, ViewStatus.UNSEEN))

    def by_frame(array: np.ndarray, dtype: type = np.float64) -> np.ndarray:
        return array.astype(dtype).reshape(frames, people, *array.shape[1:])

    return Layer(
        points_m=by_frame(points),
        covariance_m2=by_frame(covariance),
        status=by_frame(status, np.int8),
        source=by_frame(np.where(solved, Source.MEASURED, Source.NONE), np.int8),
        reprojection_error_px=by_frame(np.full(shape, np.nan)),
        view_status=by_frame(view_status[..., None], np.int8),
        view_error_px=by_frame(np.full((*shape, 1), np.nan), np.float32),
    )


def _spread(depth: np.ndarray) -> np.ndarray:
    """Return the variance of the depths of each person in each frame, shape (person_frame, 1).

    The detector gives no accuracy of its depth, and an informative depth is more accurate than their spread.
    """
    known = np.isfinite(depth)
    count = np.maximum(known.sum(axis=-1, keepdims=True), 1)
    mean = np.where(known, depth, 0.0).sum(axis=-1, keepdims=True) / count
    return np.where(known, (depth - mean) ** 2, 0.0).sum(axis=-1, keepdims=True) / count
