"""Plain forward kinematics of an anatomical chain, joint by joint with 4 x 4 matrices."""

import numpy as np
from scipy.interpolate import PPoly
from scipy.spatial.transform import Rotation

from posefuse.biomechanics.anatomy.anatomy import Anatomy


def body_poses(anatomy: Anatomy, scales: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
    """Return ``world_from_body`` of every body, shape (body, 4, 4)."""
    chain = anatomy.chain
    poses = np.empty((len(anatomy.bodies), 4, 4))
    for b, parent in enumerate(chain.parent):
        world_from_parent = poses[parent] if parent >= 0 else np.eye(4)
        factors = scales[parent] if parent >= 0 else np.ones(3)
        parent_from_joint = _pose(chain.parent_rotation[b], factors * chain.parent_offset_m[b])
        body_from_joint = _pose(chain.child_rotation[b], scales[b] * chain.child_offset_m[b])
        moved = _motion_of_joint(anatomy, b, factors, coordinates)
        poses[b] = world_from_parent @ parent_from_joint @ moved @ np.linalg.inv(body_from_joint)
    return poses


def _motion_of_joint(anatomy: Anatomy, b: int, factors: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
    chain = anatomy.chain
    rotation, translation = Rotation.identity(), np.zeros(3)
    for m in range(6):
        if chain.coordinate[b, m] < 0:
            continue
        axis, x, spline = chain.axes[b, m], coordinates[chain.coordinate[b, m]], chain.spline[b, m]
        value = x if spline < 0 else _spline(chain.knots, chain.pieces[spline], x)
        if m < 3:
            rotation = rotation * Rotation.from_rotvec(value * axis)
        else:
            translation += value * axis * (np.abs(axis) @ factors if spline >= 0 else 1.0)
    return _pose(rotation.as_matrix(), translation)


def _spline(knots: np.ndarray, pieces: np.ndarray, x: float) -> float:
    if x <= knots[0] or x >= knots[-1]:
        end = 0 if x <= knots[0] else -1
        return pieces[end, 0] + pieces[end, 1] * (x - knots[end])
    return float(PPoly(pieces[:-1, ::-1].T, knots)(x))


def _pose(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose
