"""Reprojection errors of points that were moved after they were measured."""

from dataclasses import replace

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import Source, ViewStatus, is_used


def with_reprojection_errors(layer: Layer, rig: CameraRig, detections: Detections, part: Reconstruction) -> Layer:
    """Return a layer with the reprojection errors of its points; measured and solved points keep theirs.

    Args:
        layer: layer whose points may have moved.
        rig: calibrated cameras.
        detections: detections of the same frames.
        part: the same frames, with tracks.
    """
    assert part.tracks is not None
    rows, mirror = part.tracks.rows(detections), part.skeleton.mirror
    points, views = np.asarray(layer.points_m), np.asarray(layer.view_status)
    errors = np.full(views.shape, np.nan, dtype=np.float32)
    for v, camera in enumerate(rig.cameras):
        present = rows[:, :, v] >= 0
        pixels = np.asarray(detections.keypoints_px)[rows[:, :, v][present]]
        swapped = (views[present][:, :, v] == ViewStatus.USED_SWAPPED)[..., None]
        pixels = np.where(swapped, pixels[:, mirror], pixels)
        errors[present, :, v] = np.linalg.norm(camera.project(points[present])[0] - pixels, axis=-1)
    unmoved = np.isin(np.asarray(layer.source), (Source.MEASURED, Source.TRAJECTORY))
    errors = np.where(unmoved[..., None], np.asarray(layer.view_error_px), errors)
    counted = is_used(views) & np.isfinite(errors)
    number = counted.sum(axis=-1)
    mean = np.where(counted, errors, 0.0).sum(axis=-1, dtype=np.float64) / np.maximum(number, 1)
    mean = np.where(unmoved, np.asarray(layer.reprojection_error_px), np.where(number > 0, mean, np.nan))
    return replace(layer, view_error_px=errors, reprojection_error_px=mean)
