"""Initial poses of a camera from a few points of known position, in any arrangement that is not a line."""

from dataclasses import replace
from itertools import permutations, product

import numpy as np

from posefuse.calibration.boards.plane_pose import pose_of_plane
from posefuse.model.cameras import Camera

MIN_POINTS = 4
_MIN_DIRECT = 6
_MIN_WIDTH = 1e-3
_MIN_DEPTH = 0.02


def widths(points_m: np.ndarray) -> np.ndarray:
    """Return the extents of points along their principal axes as shares of the largest, shape (3,)."""
    spread = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)
    return np.pad(spread, (0, 3 - len(spread))) / max(spread[0], 1e-300)


def lie_on_a_line(points_m: np.ndarray) -> bool:
    """Return whether points lie on one line, so that a camera may turn about it."""
    return bool(widths(points_m)[1] < _MIN_WIDTH)


def first_poses(camera: Camera, points_m: np.ndarray, pixels: np.ndarray) -> list[Camera]:
    """Return a camera at several candidates of its pose.

    They come from the homography of the plane through the points and from its mirror image, and, for six or more
    points off a plane, from the direct linear transform on viewing rays (Hartley and Zisserman 2004, chapter 7).

    Args:
        camera: its lens; its pose is ignored.
        points_m: shape (point, 3).
        pixels: shape (point, 2).
    """
    found = _from_plane(camera, points_m, pixels)
    if len(points_m) >= _MIN_DIRECT and widths(points_m)[2] > _MIN_DEPTH:
        found += _direct(camera, points_m, pixels)
    return [_placed(camera, rotation, translation) for rotation, translation in found]


def distant_poses(camera: Camera, points_m: np.ndarray) -> list[Camera]:
    """Return a camera that sees the points from afar, turned to all sides; starts of last resort."""
    center = points_m.mean(axis=0)
    distance = 4.0 * float(np.linalg.norm(points_m - center, axis=1).max())
    cameras = []
    for order in permutations(range(3)):
        for signs in product((-1.0, 1.0), repeat=3):
            rotation = np.diag(signs)[list(order)]
            if np.linalg.det(rotation) > 0.0:
                cameras.append(_placed(camera, rotation, np.array([0.0, 0.0, distance]) - rotation @ center))
    return cameras


def _from_plane(camera: Camera, points_m: np.ndarray, pixels: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the pose of the plane through the points, and the one that looks similar from afar."""
    center = points_m.mean(axis=0)
    axes = np.linalg.svd(points_m - center)[2]
    axes[2] *= np.linalg.det(axes)
    pose = pose_of_plane(camera, (points_m - center) @ axes[:2].T, pixels)
    if pose is None:
        return []
    rotation, translation = pose
    # Reflect the plane's normal at the line of sight, and turn the plane about both.
    sight = translation / np.linalg.norm(translation)
    half_turn = 2.0 * np.outer(sight, sight) - np.eye(3)
    mirrored = half_turn @ rotation @ np.diag([-1.0, -1.0, 1.0])
    return [(turn @ axes, translation - turn @ axes @ center) for turn in (rotation, mirrored)]


def _direct(camera: Camera, points_m: np.ndarray, pixels: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the pose by the direct linear transform."""
    rays, codes = camera.rays(pixels)
    if np.any(codes != 0):
        return []
    center = points_m.mean(axis=0)
    size = max(float(np.linalg.norm(points_m - center, axis=1).mean()), 1e-12)
    scaled = np.concatenate([(points_m - center) / size, np.ones((len(points_m), 1))], axis=1)
    cross = np.cross(rays[:, None], np.eye(3)[None])
    rows = np.einsum("nij,nk->nijk", cross.transpose(0, 2, 1), scaled).reshape(-1, 12)
    matrix = np.linalg.svd(rows)[2][-1].reshape(3, 4)
    matrix *= np.sign(np.einsum("ni,ij,nj->", rays, matrix, scaled))
    left, values, right = np.linalg.svd(matrix[:, :3])
    left[:, 2] *= np.linalg.det(left @ right)
    rotation = left @ right
    return [(rotation, size * matrix[:, 3] / max(float(values.mean()), 1e-300) - rotation @ center)]


def _placed(camera: Camera, rotation: np.ndarray, translation: np.ndarray) -> Camera:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return replace(camera, camera_from_world=pose)
