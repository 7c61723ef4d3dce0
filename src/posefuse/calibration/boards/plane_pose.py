"""Initial poses of a flat board and initial focal lengths, from homographies (Zhang 2000)."""

import numpy as np

from posefuse.model.cameras import Camera

_MIN_CORNERS = 4
_MIN_AHEAD = 1e-6


def homography(board_xy: np.ndarray, image_xy: np.ndarray) -> np.ndarray | None:
    """Return the homography from a plane to an image by the normalized direct linear transform, shape (3, 3).

    Args:
        board_xy: shape (corner, 2): positions on the plane.
        image_xy: shape (corner, 2): positions in the image.

    Returns:
        The homography with ``image ~ H (x, y, 1)`` and a positive scale at the corners, or None if it is degenerate.
    """
    if len(board_xy) < _MIN_CORNERS:
        return None
    (a, to_a), (b, to_b) = _normalized(board_xy), _normalized(image_xy)
    ones, zeros = np.ones((len(a), 1)), np.zeros((len(a), 3))
    source = np.concatenate([a, ones], axis=1)
    rows = np.concatenate(
        [
            np.concatenate([source, zeros, -b[:, :1] * source], axis=1),
            np.concatenate([zeros, source, -b[:, 1:] * source], axis=1),
        ]
    )
    _, values, right = np.linalg.svd(rows)
    if values[7] < 1e-9 * values[0]:
        return None
    found = np.linalg.inv(to_b) @ right[-1].reshape(3, 3) @ to_a
    scale = np.concatenate([board_xy, ones], axis=1) @ found[2]
    if scale.min() <= 0.0 <= scale.max():
        return None
    return found * np.sign(scale[0]) / np.linalg.norm(found)


def _normalized(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points with zero mean and unit spread, and the matrix that does this."""
    center = xy.mean(axis=0)
    spread = max(float(np.sqrt(((xy - center) ** 2).sum(axis=1).mean())), 1e-12)
    matrix = np.array([[1 / spread, 0, -center[0] / spread], [0, 1 / spread, -center[1] / spread], [0, 0, 1]])
    return (xy - center) / spread, matrix


def pose_of_plane(camera: Camera, board_xy: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return rotation (3, 3) and translation (3,) of a board in camera coordinates, or None if there is no pose.

    Args:
        camera: the camera; only its lens matters.
        board_xy: shape (corner, 2): positions of corners on the board, in meters.
        pixels: shape (corner, 2): their images.
    """
    rays, codes = camera.rays(pixels)
    ahead = (codes == 0) & (rays[:, 2] > _MIN_AHEAD)
    if ahead.sum() < _MIN_CORNERS:
        return None
    found = homography(board_xy[ahead], rays[ahead, :2] / rays[ahead, 2:])
    if found is None:
        return None
    scale = 0.5 * (np.linalg.norm(found[:, 0]) + np.linalg.norm(found[:, 1]))
    if scale < 1e-12:
        return None
    first, second, translation = (found / scale).T
    left, _, right = np.linalg.svd(np.stack([first, second, np.cross(first, second)], axis=1))
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return rotation, translation


def focal_px(homographies: list[np.ndarray], center_px: tuple[float, float]) -> float | None:
    """Return the focal length from homographies of square pixels and a known principal point, or None.

    The images of the board's two axes are orthogonal and equally long in space, which gives two linear equations in
    ``1 / f^2`` for each homography.

    Args:
        homographies: from boards to pixels.
        center_px: the principal point.
    """
    shift = np.array([[1.0, 0.0, -center_px[0]], [0.0, 1.0, -center_px[1]], [0.0, 0.0, 1.0]])
    left, right = [], []
    for found in homographies:
        h = shift @ found
        h /= np.linalg.norm(h[:2, :2])
        a, b = h[:, 0], h[:, 1]
        left += [a[0] * b[0] + a[1] * b[1], a[0] ** 2 + a[1] ** 2 - b[0] ** 2 - b[1] ** 2]
        right += [-a[2] * b[2], b[2] ** 2 - a[2] ** 2]
    x, y = np.array(left), np.array(right)
    if not len(x) or not (x @ y) / max(float(x @ x), 1e-300) > 0.0:
        return None
    return float(np.sqrt((x @ x) / (x @ y)))
