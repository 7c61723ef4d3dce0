"""Triangulate with FreeMoCap's reprojection error filtering: drop the worst cameras until all errors are small.

Source: FreeMoCap's documentation, "Reprojection Error Filtering" (in the program up to version 1.7).
``freemocap_rules`` chooses between the rules of the documentation and those of the program.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import PercentileFilterOptions, TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.triangulation import simple
from posefuse.triangulation.exact_percentile import exact_percentile
from posefuse.triangulation.method import DebugFigure, Method, Pieces
from posefuse.triangulation.observations import Observations
from posefuse.triangulation.results import FlatLayer, mean_over, rows_by_person_frame


def runs(rig: CameraRig, options: TriangulationOptions) -> bool:
    """Return whether a threshold is set and there are cameras to drop; the options must be resolved."""
    chosen = options.percentile_filter
    return chosen.threshold_px is not None and chosen.min_views_left < len(rig)


def prepare(
    rig: CameraRig, pieces: Pieces, noise: NoiseModel, options: TriangulationOptions
) -> tuple[TriangulationOptions, tuple[str, ...]]:
    """Convert the percentile to an absolute error over the whole recording.

    The recording is triangulated twice, range by range, so that its errors are never in memory together.

    Returns:
        The options with ``threshold_px``, and notes for the user.
    """
    chosen = options.percentile_filter
    if chosen.min_views_left >= len(rig):
        return options, (
            f"percentile_filter does not run: min_views_left is {chosen.min_views_left} and the rig has {len(rig)} "
            "cameras, so none can be dropped.",
        )
    if chosen.threshold_px is not None:
        return options, ()
    program = options.follows_program

    def errors_px() -> Iterator[np.ndarray]:
        for detections, tracks in pieces():
            flat = FlatLayer.of(simple.solve(rig, detections, tracks, noise, options))
            used, errors = used_views(flat, rig, detections, tracks, noise, options)
            yield mean_over(used, errors)[used.any(axis=-1)] if program else errors[used]

    threshold = exact_percentile(errors_px, chosen.percentile, weibull=program)
    if threshold is None:
        return options, ()
    note = f"percentile_filter: percentile {chosen.percentile:g} of the errors is {threshold:.2f} px."
    return replace(options, percentile_filter=replace(chosen, threshold_px=threshold)), (note,)


def used_views(
    flat: FlatLayer, rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel,
    options: TriangulationOptions,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the views that are triangulated first, and their reprojection errors in px, both (point, view).

    With the rules of FreeMoCap's program, they include those of linear points behind a camera.
    """
    assert options.min_views is not None
    if not options.follows_program:
        return flat.view_status == ViewStatus.USED, flat.view_error_px
    used, errors_px = flat.valid_views(), np.full(flat.view_error_px.shape, np.nan)
    used[used.sum(axis=-1) < options.min_views] = False
    chosen = np.flatnonzero(used.any(axis=-1))
    rows = rows_by_person_frame(tracks, detections)
    observations = Observations.gather(rig, detections, rows, noise, chosen, linear=True)
    errors_px[chosen] = observations.linear_errors_px(used[chosen])
    return used, errors_px


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
) -> Layer:
    """Triangulate every keypoint; see :class:`posefuse.triangulation.method.Solve`.

    Views are dropped down to ``min_views_left``. Points that keep a large error are missing, as outliers; FreeMoCap
    fills these gaps in its postprocessing, as the option ``postprocess.fill`` does. Without ``threshold_px`` nothing
    is filtered.
    """
    layer = simple.solve(rig, detections, tracks, noise, options)
    threshold, left = options.percentile_filter.threshold_px, options.percentile_filter.min_views_left
    if threshold is None or not runs(rig, options):
        return layer
    flat = FlatLayer.of(layer)
    used, errors_px = used_views(flat, rig, detections, tracks, noise, options)
    exceeding = np.flatnonzero((used & (errors_px > threshold)).any(axis=-1))
    rows, linear = rows_by_person_frame(tracks, detections), options.follows_program
    observations = Observations.gather(rig, detections, rows, noise, exceeding, linear=linear)
    remaining, errors = used[exceeding].copy(), np.where(used[exceeding], errors_px[exceeding], np.nan)
    pending = np.arange(len(exceeding))
    while True:
        pending = pending[remaining[pending].sum(axis=-1) > left]
        if not len(pending):
            break
        worst = np.nanargmax(np.where(remaining[pending], errors[pending], -np.inf), axis=-1)
        remaining[pending, worst] = False
        solved = observations[pending].solve(remaining[pending])
        errors_px = observations[pending].linear_errors_px(remaining[pending]) if linear else solved.view_error_px
        errors[pending] = np.where(remaining[pending], errors_px, np.nan)
        high = (np.where(remaining[pending], errors[pending], -np.inf) > threshold).any(axis=-1)
        done = pending[~high]
        all_errors = observations[done].errors_px(solved.points_m[~high])
        flat.replace(
            exceeding[done], solved.points_m[~high], solved.covariance_m2[~high], solved.status[~high],
            remaining[done], all_errors,
        )  # fmt: skip
        pending = pending[high]
    failed = (np.where(remaining, errors, -np.inf) > threshold).any(axis=-1)
    flat.remove(exceeding[failed], PointStatus.OUTLIER)
    return flat.finish()


METHOD = Method(
    "percentile_filter",
    solve,
    default_min_views=3,
    options=PercentileFilterOptions,
    prepare=prepare,
    debug_figure=DebugFigure("debug/percentile_filter.png", runs),
)
