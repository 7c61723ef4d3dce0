"""Convert the observations of an examination to the input of the joint estimate of poses and clocks."""

from collections.abc import Mapping

import numpy as np

from posefuse.calibration.joint.parameters import JointParameters
from posefuse.calibration.joint.recording import JointRecording
from posefuse.diagnostics.normalized_views import NormalizedViews, normalized_coordinates
from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.recording_model import RecordingModel
from posefuse.diagnostics.sample_points import expected_noise


def joint_recording(
    observations: TrackedObservations,
    model: RecordingModel,
    poses: np.ndarray,
    steps_s: np.ndarray,
    bumped: Mapping[int, int],
    rate_error: np.ndarray,
) -> tuple[JointRecording, JointParameters]:
    """Return the recording with lenses, image transforms and dropped frames corrected, and the parameters of a model.

    Args:
        observations: of the recording.
        model: corrections found so far.
        poses: shape (view, 4, 4): calibrated camera_from_world.
        steps_s: shape (sample, view): changes of the time offset by dropped frames; they correct the times, so that a
            constant offset and a drift remain.
        rate_error: shape (view,): gross relative errors of the frame rates; they correct the times about the middle.
        bumped: first sample after the camera of a view was bumped; later observations of the view are not used.
    """
    n, common_s = observations.n_views, observations.frame_time_s
    from_middle_s = common_s - 0.5 * (common_s[0] + common_s[-1])
    xy, pixel_size, times = [], [], observations.time_s.copy()
    nearest = np.clip(np.searchsorted(model.frames, np.arange(len(times))), 0, len(model.frames) - 1)
    confidence = np.swapaxes(observations.confidence, 0, 1).copy()
    for v in range(n):
        pixels = observations.pixels[:, v]
        if model.swapped[v]:
            pixels, confidence[v] = pixels[:, observations.mirror_column], confidence[v][:, observations.mirror_column]
        camera = observations.rig.cameras[model.cameras[v]]
        at, size = normalized_coordinates(camera, model.images[v].undo(pixels, camera.size_px))
        at, focal = at / model.focal_ratio[0, v], float(model.focal_ratio[0, v].mean())
        k1 = model.k1_correction[0, v]
        straight = at / (1.0 + k1 * np.square(at).sum(axis=-1))[..., None]
        xy.append(at / (1.0 + k1 * np.square(straight).sum(axis=-1))[..., None])
        pixel_size.append(size / focal / model.images[v].scale)
        times[:, v] += steps_s[nearest, v] + rate_error[v] * from_middle_s
        if v in bumped:
            xy[v][model.frames[bumped[v]] :] = np.nan
    views = NormalizedViews(np.stack(xy, axis=2), np.stack(pixel_size, axis=2), np.moveaxis(confidence, 0, 2))
    sigma = np.swapaxes(expected_noise(observations, views), 1, 2)
    rotation, center = _split(poses)
    recording = JointRecording(
        observations.rig.names,
        np.swapaxes(views.xy, 1, 2),
        sigma,
        times,
        observations.runs,
        observations.period_s,
        rotation,
        center,
        common_s,
    )
    first = np.tile(np.eye(4), (n, 1, 1))
    first[:, :3, :3], first[:, :3, 3] = model.rotation[0], model.translation_m[0]
    offset_s = model.offset_s - steps_s - rate_error * (from_middle_s[model.frames, None] - model.offset_s)
    drift = np.zeros(n) if len(offset_s) < 3 else np.polyfit(common_s[model.frames], offset_s, 1)[0]
    return recording, JointParameters(*_split(first), offset_s.mean(axis=0), drift)


def _split(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rotations and the centers of camera poses."""
    rotation = np.ascontiguousarray(poses[:, :3, :3])
    return rotation, -np.einsum("vji,vj->vi", rotation, poses[:, :3, 3])
