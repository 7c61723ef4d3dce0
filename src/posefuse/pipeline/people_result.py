"""Result of a calibration by people in its final world, with the covariance relative to the first camera."""

from dataclasses import replace
from importlib.metadata import version

import numpy as np

from posefuse.alignment.apply import aligned_rig
from posefuse.calibration.people.estimate import PeopleEstimate
from posefuse.calibration.people.lens_covariance import OtherLens, by_lens
from posefuse.calibration.people.result import PeopleCalibration, PeopleCameraReport
from posefuse.calibration.people.views import MatchedViews
from posefuse.calibration.stated_covariance import largest_sd, with_covariances
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import CameraRig
from posefuse.pipeline.people_world import PeopleWorld

_ROTATION, _CENTER, _FOCAL = slice(0, 3), slice(3, 6), 8
_SIZE, _K1 = 10, 10
_EXACT = 5e-8
"""Variance of a coefficient that was held fixed."""


def people_result(matched: MatchedViews, estimate: PeopleEstimate, world: PeopleWorld) -> PeopleCalibration:
    """Return the calibration in its final world, with its covariance relative to the first camera."""
    alignment = world.alignment
    rig = aligned_rig(CameraRig(estimate.cameras), alignment)
    change = relative_changes(rig, keeps_scale=world.scale_sd == 0.0) @ _turned(len(rig), alignment)
    covariance, other = _relative(estimate, change)
    reports = tuple(_report(matched, estimate, v, covariance[v, :, v]) for v in range(len(rig)))
    error_px = float(np.nanmedian([report.error_px for report in reports]))
    held_out_px = float(np.nanmedian(estimate.held_out_px)) if np.isfinite(estimate.held_out_px).any() else np.nan
    notes = (*matched.notes, *world.notes)
    first = (
        f"Calibrated by posefuse {version('posefuse')} from people in {len(estimate.time_s)} moments: median error "
        f"{error_px:.2f} px, {held_out_px:.2f} px held out."
    )
    size = len(rig) * covariance.shape[1]
    stated = by_lens(rig, covariance, other)
    points_m = alignment.points(estimate.points_m)
    return PeopleCalibration(
        _with_covariances(replace(rig, meters_per_unit=1.0, notes=(first, *notes)), reports, stated, other),
        reports,
        covariance.reshape(size, size),
        stated,
        world.scale_sd,
        error_px,
        held_out_px,
        matched.skeleton,
        points_m,
        _observed_px(estimate, rig, points_m),
        estimate.time_s,
        matched.left_out,
        notes,
    )


def _with_covariances(
    rig: CameraRig, reports: tuple[PeopleCameraReport, ...], stated: np.ndarray, other: OtherLens | None
) -> CameraRig:
    """Return the cameras with the covariances of the estimated parameters; the pose of the first camera is exact."""
    free = np.zeros(stated.shape[:2], dtype=bool)
    free[1:, :6] = True
    for v, report in enumerate(reports):
        free[v, 6:8] = not report.lens_given
        free[v, _K1] = not report.lens_given and stated[v, _K1, v, _K1] > _EXACT
    if other is not None:
        free[other.parameters[:, 0], other.parameters[:, 1]] = True
    return with_covariances(rig, rig, stated, free)


def _observed_px(estimate: PeopleEstimate, rig: CameraRig, points_m: np.ndarray) -> np.ndarray:
    """Return the detections at the times of the points, shape (frame, view, person, keypoint, 2)."""
    rows, n_frames = estimate.joint.rows, len(points_m)
    out = np.full((n_frames, len(rig), *points_m.shape[1:3], 2), np.nan)
    residual = (rows.residual * rows.sigma[..., None]).reshape(n_frames, -1, len(rig), 2)
    seen = rows.seen.reshape(n_frames, -1, len(rig))
    used = estimate.columns >= 0
    columns = estimate.columns[used]
    for v, camera in enumerate(rig.cameras):
        inside = points_m[:, used] @ camera.rotation.T + camera.translation_m
        xy = inside[..., :2] / inside[..., 2:] + residual[:, columns, v]
        rays = np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
        pixels = replace(camera, camera_from_world=np.eye(4)).project(rays)[0]
        out[:, v, used] = np.where(seen[:, columns, v, None], pixels, np.nan)
    return out


def _turned(n_views: int, alignment: Alignment) -> np.ndarray:
    """Return the matrix that turns and scales shifts of centers to the aligned world, shape (view * 10,) twice."""
    turn = np.eye(_SIZE)
    turn[_CENTER, _CENTER] = alignment.scale * alignment.rotation
    return np.kron(np.eye(n_views), turn)


def _relative(estimate: PeopleEstimate, change: np.ndarray) -> tuple[np.ndarray, OtherLens | None]:
    """Return the covariance after a linear map of all changes, shape (view, 10, view, 10), and the other lenses."""
    shape = estimate.covariance.shape
    covariance = (change @ estimate.covariance.reshape(change.shape) @ change.T).reshape(shape)
    other = estimate.other
    if other is not None:
        follow = (change @ other.follow.reshape(len(change), -1)).reshape(other.follow.shape)
        other = replace(other, follow=follow)
    return covariance, other


def relative_changes(rig: CameraRig, *, keeps_scale: bool = False, size: int = _SIZE) -> np.ndarray:
    """Return the matrix that makes changes relative to the first camera, shape (view * size,) twice.

    The first camera becomes exact, and distances keep the mean distance of the other centers from it, unless the scale
    is known.

    Args:
        rig: the cameras.
        keeps_scale: whether changes of the scale are kept.
        size: number of parameters of each view: rotations about the camera's own axes, shifts of centers in the world,
            time offset, drift and the lens.
    """
    n = len(rig)
    centers = np.stack([camera.center_m for camera in rig.cameras])
    own = [camera.rotation for camera in rig.cameras]
    apart = centers - centers[0]
    change = np.eye(n * size).reshape(n, size, n, size)
    for v in range(n):
        # A rotation w about the first camera's axes turns the world by R0^T w.
        turn = own[0].T
        x, y, z = apart[v]
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        change[v, _ROTATION, 0, _ROTATION] -= own[v] @ turn
        change[v, _CENTER, 0, _CENTER] -= np.eye(3)
        change[v, _CENTER, 0, _ROTATION] += -cross @ turn
        change[v, 6, 0, 6] -= 1.0
        change[v, 7, 0, 7] -= 1.0
    total = float(np.square(apart).sum())
    if total > 0.0 and not keeps_scale:
        # Remove the change of scale, the projection of the shifts onto the distances.
        along = np.einsum("vi,viwk->wk", apart, change[:, _CENTER]) / total
        change[:, _CENTER] -= apart[:, :, None, None] * along
    return change.reshape(n * size, n * size)


def _report(matched: MatchedViews, estimate: PeopleEstimate, v: int, covariance: np.ndarray) -> PeopleCameraReport:
    """Return how well a camera is calibrated."""
    rows = estimate.joint.rows
    camera, seen = estimate.cameras[v], rows.seen[:, v]
    # A residual times its noise is a distance in the normalized image plane, in which the focal length is 1.
    lengths = np.linalg.norm(rows.residual[:, v] * rows.sigma[:, v, None], axis=-1)[seen] * camera.matrix[0, 0]
    focal_sd = float(np.sqrt(max(covariance[_FOCAL, _FOCAL], 0.0)) * camera.matrix[0, 0])
    return PeopleCameraReport(
        name=camera.name,
        n_observations=int(seen.sum()),
        error_px=float(np.median(lengths)) if len(lengths) else np.nan,
        held_out_px=float(estimate.held_out_px[v]),
        rotation_sd_deg=float(np.degrees(largest_sd(covariance[_ROTATION, _ROTATION]))),
        center_sd_m=largest_sd(covariance[_CENTER, _CENTER]),
        focal_sd_px=0.0 if matched.views[v].focal_known else focal_sd,
        offset_s=float(estimate.offset_s[v]),
        offset_sd_s=float(estimate.offset_sd_s[v]),
        rate=float(estimate.rate[v]),
        lens_given=matched.views[v].focal_known,
    )
