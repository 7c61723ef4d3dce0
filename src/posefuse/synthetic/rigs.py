"""Simulated camera rigs: ring, room corners, aisle. World: z up, floor at z = 0, meters."""

import numpy as np

from posefuse.errors import OptionsError
from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.synthetic.options import MOST_CAMERAS, Layout, LensKind

_SIZE_PX = (1920, 1080)
_LENSES: dict[LensKind, tuple[LensModel, tuple[float, ...], float]] = {
    "pinhole": (LensModel.PINHOLE, (), 1200.0),
    "barrel": (LensModel.BROWN, (-0.28, 0.0, 0.0, 0.0, 0.0), 1200.0),
    "fisheye": (LensModel.FISHEYE, (-0.02, 0.003, -0.001, 0.0), 620.0),
}


def build_rig(
    layout: Layout = "ring",
    n_cameras: int = 5,
    lens: LensKind = "pinhole",
    *,
    radius_m: float = 5.0,
    focal_px: float | None = None,
    target_m: tuple[float, float, float] = (0.0, 0.0, 0.9),
) -> CameraRig:
    """Build a rig of equal cameras, 1920 x 1080 px, all directed at one point.

    Args:
        layout: ``ring`` (evenly spaced, heights alternating between 1.5 and 2.5 m), ``corners`` (high in the corners of
            a square room, then along its walls) or ``aisle`` (along both sides of a walkway).
        n_cameras: number of cameras, 1 to 32.
        lens: ``pinhole``, ``barrel`` (k1 = -0.28, folds over at 1.09) or ``fisheye``.
        radius_m: radius of the ring, half the room, or half the aisle.
        focal_px: focal length; default: 1200, fisheye 620.
        target_m: point that all cameras face.

    Raises:
        OptionsError: if the number of cameras is out of range.
    """
    if not 1 <= n_cameras <= MOST_CAMERAS:
        raise OptionsError(f"A simulated rig has 1 to {MOST_CAMERAS} cameras, got {n_cameras}.")
    centers = {"ring": _ring, "corners": _corners, "aisle": _aisle}[layout](n_cameras, radius_m)
    model, distortion, focal = _LENSES[lens]
    focal = focal_px or focal
    matrix = np.array([[focal, 0.0, (_SIZE_PX[0] - 1) / 2], [0.0, focal, (_SIZE_PX[1] - 1) / 2], [0.0, 0.0, 1.0]])
    cameras = tuple(
        Camera(f"cam_{i}", _SIZE_PX, matrix, look_at(center, np.array(target_m)), model, distortion)
        for i, center in enumerate(centers)
    )
    return CameraRig(cameras, up_axis="z", source="simulated")


def look_at(center_m: np.ndarray, target_m: np.ndarray) -> np.ndarray:
    """Return camera_from_world, shape (4, 4), of a level camera directed at a target; z is up."""
    forward = (target_m - center_m) / np.linalg.norm(target_m - center_m)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-9 else np.array([1.0, 0.0, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = right, np.cross(forward, right), forward
    pose[:3, 3] = -pose[:3, :3] @ center_m
    return pose


def _ring(n: int, radius: float) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(n) / n
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.where(np.arange(n) % 2, 2.5, 1.5)], axis=1)


def _corners(n: int, half: float) -> np.ndarray:
    # Corners first, then evenly along the walls; later cameras are lower.
    turn = np.array([0.125, 0.625, 0.375, 0.875])
    angle = 2.0 * np.pi * (turn[np.arange(n) % 4] + (np.arange(n) // 4) * 0.06)
    reach = half / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    height = 2.7 - 0.25 * (np.arange(n) // 4)
    return np.stack([reach * np.cos(angle), reach * np.sin(angle), np.maximum(height, 0.8)], axis=1)


def _aisle(n: int, half: float) -> np.ndarray:
    pairs = np.arange(n) // 2
    along = np.linspace(-half, half, (n + 1) // 2) if n > 2 else np.zeros(1)
    side = np.where(np.arange(n) % 2, -2.8, 2.8)
    return np.stack([along[pairs], side, np.full(n, 1.6)], axis=1)
