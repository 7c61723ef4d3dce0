"""Triangulation from every valid view, nothing rejected: FreeMoCap's standard method, done by maximum likelihood.

A linear start, then Gauss-Newton on the reprojection error in true pixels. Source: FreeMoCap's documentation,
"Triangulation" (minimum cameras, single-camera recordings); the likelihood is Hartley & Zisserman's (2004, ch. 12).
See docs/methods.md.
"""

from posefuse.arrays import frozen
from posefuse.kernels.triangulation.all_views import triangulate_views
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.tracks import Tracks
from posefuse.triangulation.results import EmptyLayer, rows_by_person_frame

DEFAULT_MIN_VIEWS = 3


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
) -> Layer:
    """Triangulate every keypoint of every person in a range of frames.

    Args:
        rig: the cameras, in the order of the detections' views.
        detections: in memory.
        tracks: whose detection is whose, of the same frames.
        noise: the standard deviation of a detection; its exponent weighs the views.
        options: ``min_views`` must be set.

    Returns:
        The measured layer: points in metres, covariance, status, and each view's part.
    """
    assert options.min_views is not None
    out = EmptyLayer.of(tracks, len(detections.skeleton))
    triangulate_views(
        *rig.packed,
        frozen(detections.keypoints_px),
        frozen(detections.confidence),
        rows_by_person_frame(tracks, detections),
        noise.scale_px,
        noise.exponent,
        options.min_confidence,
        options.min_views,
        *out.arrays,
    )
    return out.finish()
