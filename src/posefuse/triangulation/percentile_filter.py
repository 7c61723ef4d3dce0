"""FreeMoCap's reprojection error filtering: the worst cameras are dropped until all errors are small.

Source: FreeMoCap's documentation, "Reprojection Error Filtering" (in its program up to version 1.7). Its words are
followed where the program differs; docs/methods.md, "percentile_filter", says where.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.triangulation import simple
from posefuse.triangulation.observations import Observations
from posefuse.triangulation.results import FlatLayer, rows_by_person_frame

DEFAULT_MIN_VIEWS = 3


def runs(rig: CameraRig, options: TriangulationOptions) -> bool:
    """Whether anything is filtered: a threshold is known, and there are cameras to drop. Options must be settled."""
    assert options.min_views is not None
    return options.percentile_filter.threshold_px is not None and options.min_views < len(rig)


def settle(
    rig: CameraRig, pieces: Iterable[tuple[Detections, Tracks]], noise: NoiseModel, options: TriangulationOptions
) -> tuple[TriangulationOptions, tuple[str, ...]]:
    """Turn the percentile into an absolute error, over the whole recording.

    Returns:
        The options with ``threshold_px``, and what is worth saying.
    """
    chosen = options.percentile_filter
    assert options.min_views is not None
    if options.min_views >= len(rig):
        return options, (
            f"percentile_filter does not run: min_views is {options.min_views} and the rig has {len(rig)} cameras, so "
            "none can be dropped.",
        )
    if chosen.threshold_px is not None:
        return options, ()
    errors = []
    for detections, tracks in pieces:
        layer = simple.solve(rig, detections, tracks, noise, options)
        errors.append(np.asarray(layer.view_error_px)[np.asarray(layer.view_status) == ViewStatus.USED])
    found = np.concatenate(errors)
    if not len(found):
        return options, ()
    threshold = float(np.percentile(found, chosen.percentile))
    note = f"percentile_filter: the {chosen.percentile:g} % percentile of the errors is {threshold:.2f} px."
    return replace(options, percentile_filter=replace(chosen, threshold_px=threshold)), (note,)


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
) -> Layer:
    """Triangulate every keypoint of every person in a range of frames.

    Args:
        rig: the cameras, in the order of the detections' views.
        detections: in memory.
        tracks: whose detection is whose, of the same frames.
        noise: the standard deviation of a detection.
        options: ``min_views`` must be set; without ``threshold_px`` nothing is filtered.

    Returns:
        The measured layer; points that keep a large error are missing, as outliers.
    """
    assert options.min_views is not None
    layer = simple.solve(rig, detections, tracks, noise, options)
    threshold = options.percentile_filter.threshold_px
    if threshold is None or not runs(rig, options):
        return layer
    flat = FlatLayer.of(layer)
    used = flat.view_status == ViewStatus.USED
    off = np.flatnonzero((used & (flat.view_error_px > threshold)).any(axis=-1))
    observations = Observations.gather(rig, detections, rows_by_person_frame(tracks, detections), noise, off)
    kept, errors = used[off].copy(), np.where(used[off], flat.view_error_px[off], np.nan)
    waiting = np.arange(len(off))
    while True:
        waiting = waiting[kept[waiting].sum(axis=-1) > options.min_views]
        if not len(waiting):
            break
        worst = np.nanargmax(np.where(kept[waiting], errors[waiting], -np.inf), axis=-1)
        kept[waiting, worst] = False
        solved = observations[waiting].solve(kept[waiting])
        errors[waiting] = np.where(kept[waiting], solved.view_error_px, np.nan)
        high = ~(np.nanmax(np.where(kept[waiting], errors[waiting], -np.inf), axis=-1) <= threshold)
        good = waiting[~high]
        all_errors = observations[good].errors_px(solved.points_m[~high])
        flat.replace(off[good], solved.points_m[~high], solved.covariance_m2[~high], kept[good], all_errors)
        waiting = waiting[high]
    still = (np.where(kept, errors, -np.inf) > threshold).any(axis=-1)
    flat.remove(off[still], PointStatus.OUTLIER)
    return flat.finish()
