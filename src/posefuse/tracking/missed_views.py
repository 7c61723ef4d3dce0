"""Views that should show somebody and do not: those with nobody before them, whose silence is thus evidence."""

import numpy as np

from posefuse.model.frames import Frame
from posefuse.tracking.settings import Settings

_HALF = 0.5


def boxes_px(frame: Frame) -> np.ndarray:
    """Least and greatest pixel of each detection, shape (row, 4); of one without keypoints nothing is within."""
    there = np.isfinite(frame.keypoints_px)
    low = np.where(there, frame.keypoints_px, np.inf).min(axis=1, initial=np.inf)
    high = np.where(there, frame.keypoints_px, -np.inf).max(axis=1, initial=-np.inf)
    return np.concatenate([low, high], axis=1)


def is_covered(pixels: np.ndarray, rows: np.ndarray, frame: Frame) -> np.ndarray:
    """Shape (view,), bool: where somebody may be hidden behind whom a view shows instead.

    Args:
        pixels: shape (view, core, 2): where views should see the core of somebody, NaN where they cannot.
        rows: shape (view,), int64: their own detections, -1 for none: nobody hides behind those.
        frame: what the views show.
    """
    boxes, at = boxes_px(frame), pixels[frame.view]
    within = (at >= boxes[:, None, :2]) & (at <= boxes[:, None, 2:])
    covers = within.all(axis=-1).mean(axis=1) >= _HALF
    covers[rows[rows >= 0]] = False
    return np.bincount(frame.view[covers], minlength=len(pixels)) > 0


def silent_views(
    points_m: np.ndarray, rows: np.ndarray, frame: Frame, refused: np.ndarray, settings: Settings
) -> np.ndarray:
    """Shape (view,), bool: views that should show a proposed person, and show nothing where they would be.

    Args:
        points_m: shape (keypoint, 3): of the person, NaN where unknown.
        rows: shape (view,), int64: their detections, -1 for none.
        frame: what the views show.
        refused: shape (view,), bool: cameras that have moved.
        settings: of the tracker.
    """
    pixels = settings.rig.project(points_m[settings.core])
    inside = ((pixels >= 0.0) & (pixels < settings.sizes_px[:, None])).all(axis=-1).mean(axis=-1) >= _HALF
    return inside & frame.recorded & ~refused & (rows < 0) & ~is_covered(pixels, rows, frame)
