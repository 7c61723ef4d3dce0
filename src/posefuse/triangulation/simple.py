"""Triangulate from every valid view by maximum likelihood, without outlier rejection (FreeMoCap's standard method).

The linear solution is refined by Gauss-Newton on the reprojection error. Sources: FreeMoCap's documentation,
"Triangulation" (minimum cameras, single-camera recordings); the likelihood is that of Hartley and Zisserman 2004,
chapter 12.
"""

import numpy as np

from posefuse.kernels.records import NoiseParameters
from posefuse.kernels.triangulation.all_views import triangulate_views
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.triangulation.method import Method
from posefuse.triangulation.observations import Observations
from posefuse.triangulation.results import FlatLayer, LayerBuffers, observations_of, rows_by_person_frame


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
) -> Layer:
    """Triangulate every keypoint; see :class:`posefuse.triangulation.method.Solve`.

    The exponent of the noise weights the views, except those of the linear points of FreeMoCap's program.
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
    layer = out.finish()
    return linear_layer(layer, rig, detections, tracks, noise) if options.follows_program else layer


def linear_layer(layer: Layer, rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel) -> Layer:
    """Return a layer of linear points from the used views of maximum-likelihood ones, with their covariances."""
    flat = FlatLayer.of(layer)
    chosen = np.flatnonzero(flat.status < PointStatus.NOT_SEEN)
    used = flat.view_status[chosen] == ViewStatus.USED
    rows = rows_by_person_frame(tracks, detections)
    observations = Observations.gather(rig, detections, rows, noise, chosen, linear=True)
    solved = observations.solve(used)
    errors_px = observations.errors_px(solved.points_m)
    flat.replace(chosen, solved.points_m, flat.covariance_m2[chosen], solved.status, used, errors_px)
    return flat.finish()


METHOD = Method("simple", solve, default_min_views=3)
