"""Place calibrated cameras in the world of points of known position."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from posefuse.alignment.apply import aligned_rig
from posefuse.arguments import checked
from posefuse.calibration.boards.calibration import BoardCalibration
from posefuse.calibration.people.result import PeopleCalibration
from posefuse.calibration.scene.origin import Origin, find_origin
from posefuse.io.scene_points import read_scene_points
from posefuse.model.camera_covariance import CENTER, CameraCovariance
from posefuse.model.cameras import CameraRig
from posefuse.model.scene_points import ScenePoints

_CENTER = slice(3, 6)


@checked
def place_calibration(
    calibration: BoardCalibration | PeopleCalibration, origin_points: ScenePoints | str | Path
) -> BoardCalibration | PeopleCalibration:
    """Return a calibration in the world of points of known position.

    The scale of a calibration by people alone becomes that of the points; a board or an earlier calibration keeps its
    own.

    Args:
        calibration: result of :func:`posefuse.calibrate` or :func:`posefuse.recalibrate`.
        origin_points: the points and their places in the images of two cameras at least, or a file of them.

    Raises:
        CalibrationError: if the points do not determine the world, or contradict the calibration.
        FileError: if the file cannot be read.
    """
    scene = origin_points if isinstance(origin_points, ScenePoints) else read_scene_points(origin_points)
    scale_known = isinstance(calibration, BoardCalibration) or calibration.scale_sd == 0.0
    origin = find_origin(calibration.rig, scene, scale_known=scale_known)
    note = _note(origin, scale_known=scale_known)
    rig = _placed(calibration.rig, origin, note)
    if isinstance(calibration, BoardCalibration):
        return replace(calibration, rig=rig, notes=(*calibration.notes, note))
    alignment = origin.alignment
    scale = alignment.scale
    return replace(
        calibration,
        rig=rig,
        cameras=tuple(replace(each, center_sd_m=scale * each.center_sd_m) for each in calibration.cameras),
        covariance=_turned(calibration.covariance.reshape(len(rig), -1, len(rig), 10), origin).reshape(
            calibration.covariance.shape
        ),
        lens_covariance=_turned(calibration.lens_covariance, origin),
        scale_sd=0.0 if scale_known else origin.scale_sd,
        points_m=alignment.points(calibration.points_m),
        notes=(*calibration.notes, note),
    )


def _note(origin: Origin, *, scale_known: bool) -> str:
    text = (
        f"The world is that of {origin.n_points} points of known position, which the cameras see within "
        f"{1000 * origin.rms_m:.2g} mm (root mean square)."
    )
    if scale_known:
        return f"{text} Their distances are {100 * (origin.scale - 1.0):+.2g} % longer than the cameras measure."
    return f"{text} They set the scale, within {100 * origin.scale_sd:.2g} % (sd)."


def _placed(rig: CameraRig, origin: Origin, note: str) -> CameraRig:
    """Return the cameras in the new world, with their covariances in its scale."""
    scale = origin.alignment.scale
    placed = aligned_rig(rig, origin.alignment)
    covariances = []
    for each in rig.covariances:
        factor = np.where([name in CENTER for name in each.parameters], scale, 1.0)
        matrix = each.matrix * np.outer(factor, factor)
        covariances.append(CameraCovariance(each.camera, each.parameters, matrix, each.reference))
    return replace(
        placed,
        meters_per_unit=rig.meters_per_unit,
        covariances=tuple(covariances),
        correlation=rig.correlation,
        notes=(*rig.notes, note),
    )


def _turned(covariance: np.ndarray, origin: Origin) -> np.ndarray:
    """Return a covariance, shape (view, parameter, view, parameter), with centers in the new world."""
    turn = np.eye(covariance.shape[1])
    turn[_CENTER, _CENTER] = origin.alignment.scale * origin.alignment.rotation
    return np.einsum("ij,vjwk,lk->viwl", turn, covariance, turn)
