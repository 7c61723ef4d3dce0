"""Convert matched views to the input of the joint estimate of poses, clocks and focal lengths."""

import numpy as np

from posefuse.calibration.joint.recording import JointRecording
from posefuse.calibration.people.views import MatchedViews, ViewTracks
from posefuse.model.cameras import Camera

NOISE_PER_WIDTH = 0.0045
"""Usual noise of detectors at full confidence, relative to the width of the image."""
_MIN_CONFIDENCE = 0.1
_MIN_DEPTH = 0.05
_MAX_COLUMNS = 100
_MIN_SHARED = 0.02


def joint_recording(matched: MatchedViews) -> tuple[JointRecording, np.ndarray]:
    """Return the recording, and the column of each keypoint of each person, shape (person, keypoint), -1 without.

    Points are estimated at the frames of the view with the most frames. The times of all views are corrected by the
    time offsets and rates found so far.
    """
    views = matched.views
    columns = _columns(matched)
    parts = [_normalized(view, columns) for view in views]
    n_frames = max(len(view.time_s) for view in views)
    xy = np.full((n_frames, len(views), len(columns), 2), np.nan)
    sigma, time_s = np.full(xy.shape[:3], np.nan), np.full(xy.shape[:2], np.nan)
    for v, (part, view) in enumerate(zip(parts, views, strict=True)):
        n = len(view.time_s)
        xy[:n, v], sigma[:n, v] = part
        time_s[:n, v] = matched.offset_s[v] + matched.rate[v] * view.time_s
    steps = [float(np.median(np.diff(view.time_s))) for view in views if len(view.time_s) > 1]
    densest = int(np.argmax([len(view.time_s) for view in views]))
    n_people, n_keypoints = views[0].keypoints_px.shape[1:3]
    place = np.full(n_people * n_keypoints, -1)
    place[columns] = np.arange(len(columns))
    recording = JointRecording(
        tuple(view.camera.name for view in views),
        xy,
        sigma,
        time_s,
        np.zeros(n_frames, dtype=int),
        max(steps, default=1.0),
        np.stack([view.camera.rotation for view in views]),
        np.stack([view.camera.center_m for view in views]),
        time_s[:, densest].copy(),
        columns // n_keypoints,
    )
    return recording, place.reshape(n_people, n_keypoints)


def _columns(matched: MatchedViews) -> np.ndarray:
    """Return the people's keypoints that several views see often enough, the most seen if there are too many."""
    shares = [np.isfinite(view.keypoints_px[..., 0]).mean(axis=0).ravel() for view in matched.views]
    second = np.sort(np.stack(shares), axis=0)[-2] if len(shares) > 1 else shares[0]
    order = np.lexsort((np.arange(len(second)), -np.sum(shares, axis=0)))
    return np.sort(np.array([c for c in order if second[c] > _MIN_SHARED][:_MAX_COLUMNS], dtype=int))


def _normalized(view: ViewTracks, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return x/z and y/z of the chosen columns, shape (frame, column, 2), and their expected noise."""
    n = len(view.time_s)
    confidence = view.confidence.reshape(n, -1)[:, columns]
    known = confidence[np.isfinite(confidence)]
    informative = bool(len(known)) and known.min() >= 0.0 and known.max() <= 1.001 and float(np.std(known)) > 1e-3
    weight = np.clip(confidence, _MIN_CONFIDENCE, 1.0) if informative else np.where(np.isnan(confidence), np.nan, 1.0)
    xy, pixel_size = _undistorted(view.camera, view.keypoints_px.reshape(n, -1, 2)[:, columns])
    return xy, NOISE_PER_WIDTH * max(view.camera.size_px) * pixel_size / weight


def _undistorted(camera: Camera, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return x/z and y/z of pixels, shape (..., 2), and the size of a pixel there, shape (...)."""
    rays = camera.rays(np.stack([pixels, pixels + np.array([1.0, 0.0]), pixels + np.array([0.0, 1.0])]))[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        xy = np.where(rays[..., 2:] > _MIN_DEPTH, rays[..., :2] / rays[..., 2:], np.nan)
    along, down = xy[1] - xy[0], xy[2] - xy[0]
    return xy[0], np.sqrt(np.abs(along[..., 0] * down[..., 1] - along[..., 1] * down[..., 0]))
