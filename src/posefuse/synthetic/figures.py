"""Figures: kinematic trees of a human with all shipped human keypoints, or of an arbitrary skeleton.

Figure axes: x forward, y to the left, z up. Human lengths are those of an adult of 1.75 m, scaled by stature.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posefuse.kernels.synthetic.forward_kinematics import forward_kinematics
from posefuse.skeleton.skeletons import Skeleton

_STATURE_M = 1.75


@dataclass(frozen=True)
class Figure:
    """A kinematic tree.

    Attributes:
        names: node names; every parent precedes its children.
        parents: index of each node's parent, -1 for the root.
        offsets_m: shape (node, 3): offset from the parent in the rest pose.
        joints: names of the nodes that rotate, in the order of every joint axis.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets_m: np.ndarray
    joints: tuple[str, ...]

    @cached_property
    def _joint_of_node(self) -> np.ndarray:
        places = {name: i for i, name in enumerate(self.joints)}
        return np.array([places.get(name, -1) for name in self.names])

    def positions(self, root_m: np.ndarray, rotations: np.ndarray) -> np.ndarray:
        """Return the positions of all nodes.

        Args:
            root_m: shape (frame, 3): position of the root.
            rotations: shape (frame, joint, 3, 3): rotation of each joint.

        Returns:
            Shape (frame, node, 3), meters.
        """
        positions = np.empty((len(root_m), len(self.names), 3))
        scratch = np.empty((len(self.names), 3, 3))
        forward_kinematics(
            np.array(self.parents),
            np.ascontiguousarray(self.offsets_m),
            self._joint_of_node,
            np.ascontiguousarray(rotations),
            np.ascontiguousarray(root_m),
            positions,
            scratch,
        )
        return positions

    def columns(self, skeleton: Skeleton) -> np.ndarray:
        """Return the node index of each keypoint, shape (keypoint,)."""
        return np.array([self.names.index(name) for name in skeleton.keypoints])

    def has(self, skeleton: Skeleton) -> bool:
        """Return whether every keypoint of the skeleton is a node."""
        return set(skeleton.keypoints) <= set(self.names)


def human(stature_m: float = _STATURE_M) -> Figure:
    """Return a standing adult with hanging arms and the landmarks of all shipped human skeletons."""
    nodes: list[tuple[str, str, tuple[float, float, float]]] = [
        ("mid_hip", "", (0.0, 0.0, 0.0)),
        ("spine", "mid_hip", (0.0, 0.0, 0.25)),
        ("neck", "spine", (0.0, 0.0, 0.25)),
        ("upper_neck", "neck", (0.01, 0.0, 0.06)),
        ("head", "upper_neck", (0.0, 0.0, 0.11)),
        ("head_top", "head", (-0.01, 0.0, 0.13)),
        ("nose", "head", (0.105, 0.0, -0.01)),
    ]
    joints = ["mid_hip", "spine", "neck", "upper_neck"]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        limbs = _arm(side, sign) + _leg(side, sign) + _side_of_head(side, sign)
        nodes += limbs
        joints += [f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")]
        joints += [f"{side}_{finger}_{i}" for finger in FINGERS for i in (1, 2, 3)]
    nodes += _face()
    joints.append("jaw")
    names = tuple(name for name, _, _ in nodes)
    parents = tuple(names.index(parent) if parent else -1 for _, parent, _ in nodes)
    offsets = np.array([offset for _, _, offset in nodes]) * (stature_m / _STATURE_M)
    return Figure(names, parents, offsets, tuple(joints))


def creature(skeleton: Skeleton, size_m: float, rng: np.random.Generator) -> Figure:
    """Return a figure of an arbitrary skeleton: the tree spanned by its edges, with random constant bone lengths.

    Keypoints without an edge are attached to the root. Bones are 0.15 to 0.35 ``size_m`` long.
    """
    n = len(skeleton)
    neighbors: list[list[int]] = [[] for _ in range(n)]
    for a, b in skeleton.edge_indices:
        neighbors[a].append(int(b))
        neighbors[b].append(int(a))
    root = int(np.argmax([len(nodes) for nodes in neighbors]))
    order, parents = [root], {root: -1}
    for node in order:
        for other in neighbors[node]:
            if other not in parents:
                parents[other] = node
                order.append(other)
    for lone in range(n):
        if lone not in parents:
            parents[lone] = root
            order.append(lone)
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    bone = size_m * rng.uniform(0.15, 0.35, size=n)
    names = tuple(skeleton.keypoints[node] for node in order)
    places = {node: i for i, node in enumerate(order)}
    return Figure(
        names,
        tuple(places[parents[node]] if parents[node] >= 0 else -1 for node in order),
        (bone[:, None] * directions)[order],
        names,
    )


FINGERS = ("thumb", "index_finger", "middle_finger", "ring_finger", "pinky_finger")


def _arm(side: str, sign: float) -> list[tuple[str, str, tuple[float, float, float]]]:
    nodes = [
        (f"{side}_shoulder", "neck", (0.0, 0.18 * sign, -0.02)),
        (f"{side}_elbow", f"{side}_shoulder", (0.0, 0.0, -0.30)),
        (f"{side}_wrist", f"{side}_elbow", (0.0, 0.0, -0.26)),
        (f"{side}_hand_root", f"{side}_wrist", (0.0, 0.0, -0.005)),
        (f"{side}_pinky", f"{side}_wrist", (-0.03, 0.0, -0.085)),
        (f"{side}_index", f"{side}_wrist", (0.03, 0.0, -0.095)),
        (f"{side}_thumb", f"{side}_wrist", (0.045, -0.01 * sign, -0.06)),
    ]
    for i, finger in enumerate(FINGERS):
        forward = 0.035 - 0.018 * i
        first = (0.02, -0.01 * sign, -0.03) if finger == "thumb" else (forward, 0.0, -0.09)
        length = 0.03 if finger == "thumb" else 0.042 - 0.006 * abs(i - 2)
        parent = f"{side}_hand_root"
        for j in range(1, 5):
            offset = first if j == 1 else (0.3 * length if finger == "thumb" else 0.0, 0.0, -length * (1.1 - 0.15 * j))
            nodes.append((f"{side}_{finger}_{j}", parent, offset))
            parent = f"{side}_{finger}_{j}"
    return nodes


def _leg(side: str, sign: float) -> list[tuple[str, str, tuple[float, float, float]]]:
    return [
        (f"{side}_hip", "mid_hip", (0.0, 0.10 * sign, 0.0)),
        (f"{side}_knee", f"{side}_hip", (0.0, 0.0, -0.43)),
        (f"{side}_ankle", f"{side}_knee", (0.0, 0.0, -0.42)),
        (f"{side}_heel", f"{side}_ankle", (-0.05, 0.0, -0.07)),
        (f"{side}_big_toe", f"{side}_ankle", (0.17, -0.03 * sign, -0.07)),
        (f"{side}_small_toe", f"{side}_ankle", (0.13, 0.05 * sign, -0.07)),
        (f"{side}_foot_index", f"{side}_ankle", (0.175, 0.0, -0.07)),
    ]


def _side_of_head(side: str, sign: float) -> list[tuple[str, str, tuple[float, float, float]]]:
    return [
        (f"{side}_eye", "head", (0.085, 0.032 * sign, 0.025)),
        (f"{side}_eye_inner", "head", (0.088, 0.018 * sign, 0.025)),
        (f"{side}_eye_outer", "head", (0.078, 0.045 * sign, 0.025)),
        (f"{side}_ear", "head", (0.0, 0.075 * sign, 0.0)),
        (f"mouth_{side}", "head", (0.085, 0.025 * sign, -0.06)),
    ]


def _face() -> list[tuple[str, str, tuple[float, float, float]]]:
    """Return the 68 face keypoints, with chin and lower lip attached to the jaw, and the face mesh as a spiral."""
    curve = np.linspace(0.0, 1.0, 17)
    points = [
        (0.01 + 0.07 * np.sin(np.pi * t), -0.07 * np.cos(np.pi * t), -0.01 - 0.1 * np.sin(np.pi * t)) for t in curve
    ]
    for sign in (-1.0, 1.0):
        across = np.linspace(0.055, 0.015, 5)[:: 1 if sign < 0 else -1]
        points += [(0.085, sign * y, 0.045 - 0.3 * abs(y - 0.035)) for y in across]
    points += [(0.09 + 0.005 * i, 0.0, 0.025 - 0.012 * i) for i in range(4)]
    points += [(0.095, y, -0.022) for y in np.linspace(-0.015, 0.015, 5)]
    for sign in (-1.0, 1.0):
        angles = np.pi * (1.0 - np.arange(6) / 3.0)
        points += [(0.08, 0.032 * sign + 0.014 * np.cos(a), 0.025 + 0.006 * np.sin(a)) for a in angles]
    for n, width, height in ((12, 0.025, 0.012), (8, 0.018, 0.005)):
        angles = np.pi * (1.0 - 2.0 * np.arange(n) / n)
        points += [(0.09, width * np.cos(a), -0.06 + height * np.sin(a)) for a in angles]
    nodes: list[tuple[str, str, tuple[float, float, float]]] = [("jaw", "head", (0.0, 0.0, -0.01))]
    for i, (forward, left, up) in enumerate(points):
        on_jaw = 5 <= i <= 11 or 55 <= i <= 59 or i >= 65
        place = (float(forward), float(left), float(up) + (0.01 if on_jaw else 0.0))
        nodes.append((f"face_{i:02d}", "jaw" if on_jaw else "head", place))
    golden = np.pi * (3.0 - np.sqrt(5.0))
    for i in range(478):
        off_axis = 1.25 * np.sqrt((i + 0.5) / 478)
        spot = (
            0.1 * np.cos(off_axis),
            0.07 * np.sin(off_axis) * np.cos(i * golden),
            0.1 * np.sin(off_axis) * np.sin(i * golden) - 0.01,
        )
        forward, left, up = spot
        nodes.append((f"mesh_{i:03d}", "head", (float(forward), float(left), float(up))))
    return nodes
