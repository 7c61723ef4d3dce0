"""Joint angles after the recommendations of the International Society of Biomechanics (Wu et al. 2002, 2005).

They are successive rotations of a distal relative to a proximal body about axes that are aligned in the neutral pose: x
forward, y up, z to the right. Left bodies are mirrored, so that signs are those of the right side.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from posefuse.biomechanics.anatomy.anatomy import read_anatomy

_STEP = 1e-5
_MIRROR = np.diag([1.0, 1.0, -1.0])
_SINGULAR = 0.05
"""Sine of the distance from gimbal lock below which the first and the third angle have no meaning."""


@dataclass(frozen=True)
class IsbJoint:
    """Angles of one joint.

    Attributes:
        names: Names of the three angles; an empty name leaves an angle out.
        proximal: Name of the proximal body.
        distal: Name of the distal body.
        order: Axes of the rotations about the axes of the rotating body, such as ZXY.
        signs: Factors of the three angles.
        coordinates: Coordinates between the bodies, without their sides.
    """

    names: tuple[str, str, str]
    proximal: str
    distal: str
    order: str
    signs: tuple[float, float, float]
    coordinates: tuple[str, ...]


_TRUNK = (
    IsbJoint(("spine_extension", "spine_bending", "spine_rotation"), "pelvis", "torso", "ZXY", (1.0, 1.0, 1.0),
             ("lumbar_extension", "lumbar_bending", "lumbar_rotation")),
    IsbJoint(("neck_extension", "neck_bending", "neck_rotation"), "torso", "head", "ZXY", (1.0, 1.0, 1.0),
             ("neck_extension", "neck_bending", "neck_rotation")),
)  # fmt: skip
_LIMBS = (
    IsbJoint(("hip_flexion", "hip_adduction", "hip_internal_rotation"), "pelvis", "femur", "ZXY", (1.0, 1.0, 1.0),
             ("hip_flexion", "hip_adduction", "hip_rotation")),
    # Two keypoints per segment do not show adduction and rotation of the knee, nor more than two angles of the foot.
    IsbJoint(("knee_flexion", "", ""), "femur", "tibia", "ZXY", (-1.0, 1.0, 1.0), ("knee_angle",)),
    IsbJoint(("ankle_dorsiflexion", "ankle_inversion", ""), "tibia", "calcn", "ZXY", (1.0, 1.0, 1.0),
             ("ankle_angle", "subtalar_angle")),
    IsbJoint(("shoulder_plane", "shoulder_elevation", "shoulder_internal_rotation"), "torso", "humerus", "YXY",
             (1.0, -1.0, 1.0), ("arm_flex", "arm_add", "arm_rot")),
    IsbJoint(("elbow_flexion", "", ""), "humerus", "ulna", "ZXY", (1.0, 1.0, 1.0), ("elbow_flex",)),
    IsbJoint(("", "", "forearm_pronation"), "ulna", "radius", "ZXY", (1.0, 1.0, 1.0), ("pro_sup",)),
    IsbJoint(("wrist_flexion", "wrist_deviation", ""), "radius", "hand", "ZXY", (1.0, 1.0, 1.0),
             ("wrist_flex", "wrist_dev")),
)  # fmt: skip


@cache
def isb_joints() -> tuple[IsbJoint, ...]:
    """Return all joints, with sides in the names."""
    sided = [
        IsbJoint(
            tuple(f"{name}_{side}" if name else "" for name in joint.names),  # type: ignore[arg-type]
            joint.proximal if joint.proximal in ("pelvis", "torso") else f"{joint.proximal}_{side}",
            f"{joint.distal}_{side}",
            joint.order,
            joint.signs,
            tuple(f"{name}_{side}" for name in joint.coordinates),
        )
        for side in "rl"
        for joint in _LIMBS
    ]
    return (*_TRUNK, *sided)


def isb_names() -> tuple[str, ...]:
    """Return the names of the angles of :func:`isb_angles`."""
    return tuple(name for joint in isb_joints() for name in joint.names if name)


def isb_coordinates() -> tuple[tuple[str, ...], ...]:
    """Return, for each angle, the coordinates of the model that it depends on."""
    return tuple(_coordinates(joint, i) for joint in isb_joints() for i, name in enumerate(joint.names) if name)


def _coordinates(joint: IsbJoint, i: int) -> tuple[str, ...]:
    """Return the coordinates of an angle; a joint whose rotations are those of the model has one for each."""
    aligned = joint.order == "ZXY" and len(joint.coordinates) == 3
    return joint.coordinates[i : i + 1] if aligned else joint.coordinates


def isb_angles(rotations: np.ndarray, angular: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return angles and standard deviations, each of shape (frame, angle), in degrees.

    Args:
        rotations: shape (frame, body, 3, 3): rotations of the bodies of the anatomical model in any common axes.
        angular: shape (frame, coordinate, 3): angular velocity per coordinate in the same axes.
        covariance: shape (frame, coordinate, coordinate), rad^2.
    """
    anatomy = read_anatomy()
    angles, sds = [], []
    for joint in isb_joints():
        proximal = rotations[:, anatomy.body_index(joint.proximal)]
        distal = rotations[:, anatomy.body_index(joint.distal)]
        at = [anatomy.coordinate_index(name) for name in joint.coordinates]
        relative = np.einsum("fji,fjk->fik", proximal, distal)
        # Each column turns the distal body, in the axes of the proximal one.
        columns = np.einsum("fji,fcj->fic", proximal, angular[:, at])
        if joint.distal.endswith("_l"):
            relative, columns = _MIRROR @ relative @ _MIRROR, -_MIRROR @ columns
        value, slope = _angles_and_slopes(relative, joint)
        change = slope @ columns
        variance = np.einsum("fac,fcd,fad->fa", change, covariance[:, at][:, :, at], change)
        for i, name in enumerate(joint.names):
            if name:
                angles.append(value[:, i])
                sds.append(np.sqrt(variance[:, i]))
    return np.stack(angles, axis=1), np.stack(sds, axis=1)


def _angles_and_slopes(relative: np.ndarray, joint: IsbJoint) -> tuple[np.ndarray, np.ndarray]:
    """Return angles, shape (frame, 3), in degrees, and derivatives by small turns, shape (frame, 3, 3), degrees/rad."""
    value = _angles(relative, joint)
    slope = np.full((len(value), 3, 3), np.nan)
    for axis in range(3):
        step = Rotation.from_rotvec(_STEP * np.eye(3)[axis]).as_matrix()
        change = _angles(step @ relative, joint) - value
        slope[:, :, axis] = ((change + 180.0) % 360.0 - 180.0) / _STEP
    return value, slope


def _angles(relative: np.ndarray, joint: IsbJoint) -> np.ndarray:
    return successive_angles(relative, joint.order) * joint.signs


def successive_angles(rotations: np.ndarray, order: str) -> np.ndarray:
    """Return rotations about body axes in the given order, shape (frame, 3), in degrees; NaN where undefined.

    Args:
        rotations: shape (frame, 3, 3).
        order: ZXY, YXZ or YXY; the second angle of the last one is negative.
    """
    out = np.full((len(rotations), 3), np.nan)
    r = rotations
    first, third = {
        "ZXY": ((-r[:, 0, 1], r[:, 1, 1]), (-r[:, 2, 0], r[:, 2, 2])),
        "YXZ": ((r[:, 0, 2], r[:, 2, 2]), (r[:, 1, 0], r[:, 1, 1])),
        "YXY": ((-r[:, 0, 1], -r[:, 2, 1]), (-r[:, 1, 0], r[:, 1, 2])),
    }[order]
    if order == "YXY":
        out[:, 1] = -np.arccos(np.clip(r[:, 1, 1], -1.0, 1.0))
        distance = np.abs(np.sin(out[:, 1]))
    else:
        out[:, 1] = np.arcsin(np.clip(r[:, 2, 1] if order == "ZXY" else -r[:, 1, 2], -1.0, 1.0))
        distance = np.cos(out[:, 1])
    out[:, 0] = np.where(distance > _SINGULAR, np.arctan2(*first), np.nan)
    out[:, 2] = np.where(distance > _SINGULAR, np.arctan2(*third), np.nan)
    return np.degrees(out)
