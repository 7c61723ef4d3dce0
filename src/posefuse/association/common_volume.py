"""How long each tracked person stays in the volume that the cameras share."""

from dataclasses import dataclass

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.tracks import Tracks
from posefuse.triangulation.midpoint import intersect

_MAX_FRAMES = 900
_MIN_SHARE = 0.05
"""The common volume is in sight of as many cameras as a person is for this share of the time."""


@dataclass(frozen=True, eq=False)
class TimeInVolume:
    """The time of each person in the common volume.

    Attributes:
        n_views: number of cameras that the common volume is in sight of.
        share: shape (person,): share of the recording that the person spends in it.
    """

    n_views: int
    share: np.ndarray


def time_in_common_volume(rig: CameraRig, detections: Detections, tracks: Tracks) -> TimeInVolume:
    """Return how long each person is in the images of as many cameras as any person is for a while.

    A person counts as in sight of a camera if the middle of the body is inside its image, whether or not the camera
    detects the person: others may hide them.

    Args:
        rig: one camera per view.
        detections: 2D keypoints of the recording.
        tracks: assignment of detections to people in all frames.
    """
    n_frames = min(len(tracks.state), detections.n_frames)
    frames = np.unique(np.linspace(0, n_frames - 1, min(n_frames, _MAX_FRAMES)).round().astype(int))
    counts = np.stack([_views_in_sight(rig, detections, tracks, int(frame)) for frame in frames])
    # Share of the time in sight of at least 1, 2, ... cameras, shape (camera, person).
    shares = np.stack([(counts >= n).mean(axis=0) for n in range(1, len(rig) + 1)])
    reached = np.flatnonzero(shares.max(axis=1) >= _MIN_SHARE)
    n_views = int(reached[-1]) + 1 if len(reached) else 1
    return TimeInVolume(n_views, shares[n_views - 1])


def _views_in_sight(rig: CameraRig, detections: Detections, tracks: Tracks, frame: int) -> np.ndarray:
    """Return the number of cameras whose image contains each person's middle, shape (person,); 0 for the absent."""
    part = detections.frames(frame, frame + 1)
    rows = tracks.frames(frame, frame + 1).rows(part)[0]
    middles = np.full((*rows.shape, 2), np.nan)
    for person, view in np.argwhere(rows >= 0):
        keypoints = np.asarray(part.keypoints_px[rows[person, view]])
        keypoints = keypoints[np.isfinite(keypoints).all(axis=-1)]
        if len(keypoints):
            middles[person, view] = np.median(keypoints, axis=0)
    seen: np.ndarray = np.all(np.isfinite(middles), axis=-1)
    points = intersect(rig, np.nan_to_num(middles), np.asarray(seen, dtype=np.float64))
    pixels = rig.project(points)
    sizes = np.array([camera.size_px for camera in rig.cameras])
    with np.errstate(invalid="ignore"):
        inside = ((pixels > -0.5) & (pixels < sizes - 0.5)).all(axis=-1)
    return np.where(np.any(seen, axis=1), np.sum(inside | seen, axis=1), 0)
