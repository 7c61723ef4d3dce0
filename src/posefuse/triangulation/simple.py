"""Triangulate from every valid view by maximum likelihood, without outlier rejection (FreeMoCap's standard method).

The linear solution is refined by Gauss-Newton on the reprojection error. Sources: FreeMoCap's documentation,
"Triangulation" (minimum cameras, single-camera recordings); the likelihood is that of Hartley and Zisserman 2004,
chapter 12.
"""

from posefuse.kernels.records import NoiseParameters
from posefuse.kernels.triangulation.all_views import triangulate_views
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.tracks import Tracks
from posefuse.triangulation.method import Method
from posefuse.triangulation.results import LayerBuffers, observations_of


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
) -> Layer:
    """Triangulate every keypoint; see :class:`posefuse.triangulation.method.Solve`.

    The exponent of the noise weights the views.
    """
    assert options.min_views is not None
    out = LayerBuffers.allocate(tracks, len(detections.skeleton))
    triangulate_views(
        rig.packed,
        observations_of(tracks, detections),
        NoiseParameters(noise.scale_px, noise.exponent, options.min_confidence),
        options.min_views,
        out.arrays,
    )
    return out.finish()


METHOD = Method("simple", solve, default_min_views=3)
