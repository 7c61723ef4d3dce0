"""Calibrate cameras by the people that they film: read, track, match the views, estimate, find the floor."""

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from posefuse.alignment.apply import aligned_rig
from posefuse.arguments import checked
from posefuse.calibration.people.estimate import PeopleEstimate, estimate_people
from posefuse.calibration.people.match import match_views
from posefuse.calibration.people.result import PeopleCalibration, PeopleCameraReport
from posefuse.calibration.people.tracks import tracks_in_views
from posefuse.calibration.people.views import MatchedViews
from posefuse.io.calibration.read import read_cameras
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.calibration import PeopleOptions
from posefuse.pipeline.people_inputs import cameras_of, read_people
from posefuse.pipeline.people_world import PeopleWorld, people_world
from posefuse.progress import Progress, Silent

_ROTATION, _CENTER, _FOCAL = slice(0, 3), slice(3, 6), 8


@checked
def calibrate_by_people(
    recording: Detections | str | Path,
    *,
    intrinsics: CameraRig | str | Path | None = None,
    keypoints: str | Path | None = None,
    timestamps: str | Path | None = None,
    options: PeopleOptions | None = None,
    progress: Progress | None = None,
) -> PeopleCalibration:
    """Calibrate cameras by the 2D keypoints of people, or of animals with a known skeleton, without a board.

    Views may start up to 2 s apart and have different frame rates; people need no common identity across views, and
    left and right sides may be exchanged.

    Args:
        recording: folder of a recording with 2D keypoints, or keypoints in memory.
        intrinsics: cameras with known lenses, or a calibration file, whose poses are not used; focal lengths of cameras
            that it does not name are estimated.
        keypoints: file or folder of keypoints; by default those in the recording.
        timestamps: file or folder of frame times; by default those in the recording.
        options: scale and reading options.
        progress: receives the progress.

    Returns:
        The cameras with their uncertainty, in a world whose floor people stand on if they show it.

    Raises:
        CalibrationError: if people do not determine the cameras; the message states what to film.
        FileError: if a file cannot be read.
        RecordingError: if the recording has no keypoints, or several sets of them.
    """
    options, progress = options or PeopleOptions(), progress or Silent()
    folder = None if isinstance(recording, Detections) else Path(recording)
    if isinstance(recording, Detections):
        detections = recording
    else:
        paths = [None if path is None else Path(path) for path in (keypoints, timestamps)]
        detections = read_people(Path(recording), paths[0], paths[1], options, progress)
    for name in options.length_between:
        detections.skeleton.index(name)  # refuses unknown names before the work
    known = intrinsics if isinstance(intrinsics, CameraRig) or intrinsics is None else read_cameras(Path(intrinsics))
    cameras, focal_known = cameras_of(detections.view_names, known, folder, options)
    views = tracks_in_views(detections, cameras, focal_known)
    progress.start("match views", len(cameras))
    matched = match_views(views, options.seed)
    progress.finish()
    estimate = estimate_people(matched)
    rig = CameraRig(estimate.cameras)
    world = people_world(estimate.points_m, detections.skeleton, rig, _rate_hz(estimate), options)
    return _result(matched, estimate, world)


def _rate_hz(estimate: PeopleEstimate) -> float | None:
    """Return the rate of the sampled points, None for fewer than two."""
    steps = np.diff(estimate.time_s)
    return float(1.0 / np.median(steps)) if len(steps) and np.median(steps) > 0.0 else None


def _result(matched: MatchedViews, estimate: PeopleEstimate, world: PeopleWorld) -> PeopleCalibration:
    """Return the calibration in its final world, with its covariance relative to the first camera."""
    alignment = world.alignment
    rig = aligned_rig(CameraRig(estimate.cameras), alignment)
    covariance = relative_covariance(rig, _in_world(estimate.covariance, alignment))
    reports = tuple(_report(matched, estimate, v, covariance[v, :, v]) for v in range(len(rig)))
    error_px = float(np.nanmedian([report.error_px for report in reports]))
    held_out_px = float(np.nanmedian(estimate.held_out_px)) if np.isfinite(estimate.held_out_px).any() else np.nan
    notes = (*matched.notes, *world.notes)
    first = (
        f"Calibrated by posefuse {version('posefuse')} from people in {len(estimate.time_s)} moments: median error "
        f"{error_px:.2f} px, {held_out_px:.2f} px held out."
    )
    size = len(rig) * covariance.shape[1]
    points_m = alignment.points(estimate.points_m)
    return PeopleCalibration(
        replace(rig, meters_per_unit=1.0, notes=(first, *notes)),
        reports,
        covariance.reshape(size, size),
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


def _in_world(covariance: np.ndarray, alignment: Alignment) -> np.ndarray:
    """Return a covariance, shape (view, parameter, view, parameter), with centers in the aligned world."""
    turn = np.eye(covariance.shape[1])
    turn[_CENTER, _CENTER] = alignment.scale * alignment.rotation
    return np.einsum("ij,vjwk,lk->viwl", turn, covariance, turn)


def relative_covariance(rig: CameraRig, covariance: np.ndarray) -> np.ndarray:
    """Return the covariance relative to the first camera, and without the error of the scale.

    The first camera becomes exact, and distances keep the mean distance of the other centers from it.

    Args:
        rig: the cameras.
        covariance: shape (view, parameter, view, parameter): of rotations about the camera's own axes, shifts of
            centers in the world, time offset, drift and the lens, in any gauge.
    """
    n, size = len(rig), covariance.shape[1]
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
    if total > 0.0:
        # Remove the change of scale, the projection of the shifts onto the distances.
        along = np.einsum("vi,viwk->wk", apart, change[:, _CENTER]) / total
        change[:, _CENTER] -= apart[:, :, None, None] * along
    flat = change.reshape(n * size, n * size)
    return (flat @ covariance.reshape(n * size, n * size) @ flat.T).reshape(n, size, n, size)


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
        rotation_sd_deg=float(np.degrees(_largest_sd(covariance[_ROTATION, _ROTATION]))),
        center_sd_m=_largest_sd(covariance[_CENTER, _CENTER]),
        focal_sd_px=0.0 if matched.views[v].focal_known else focal_sd,
        offset_s=float(estimate.offset_s[v]),
        offset_sd_s=float(estimate.offset_sd_s[v]),
        rate=float(estimate.rate[v]),
        lens_given=matched.views[v].focal_known,
    )


def _largest_sd(covariance: np.ndarray) -> float:
    """Return the standard deviation in the least certain direction."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
