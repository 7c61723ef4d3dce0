"""Build animation skeletons of constant size from fitted articulated models, and animate them. See docs/methods."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from posefuse.arrays import frozen
from posefuse.errors import ResultError, choices
from posefuse.kinematics.continuous_twist import reach_frames, smooth_rotations
from posefuse.kinematics.initial_pose import node_offsets
from posefuse.kinematics.twist import rest_frames
from posefuse.model.animation_figures import Figure, Joint, Motion
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import Tree

_ARMS_OUT = {
    "left_elbow": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "right_elbow": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}
"""Quarter turns about the forward axis that raise hanging arms: figures rest in a T-pose."""
_MIN_HANGING_COSINE = 0.999
"""Minimum cosine between the down direction and an arm that counts as hanging."""
_STILL = "still"
_DEFAULT_STEP_S = 1.0 / 30.0
"""Time between frames if it is unknown."""


@dataclass(frozen=True)
class _Driver:
    """Describe what rotates a joint: a segment or bone of the articulated model, or nothing.

    Attributes:
        kind: ``segment``, ``bone`` or ``still``.
        index: index of the segment or bone among those of the skeleton and its parts.
        rest: shape (3, 3): figure axes from tree axes, both at rest.
    """

    kind: str
    index: int
    rest: np.ndarray


@dataclass(frozen=True)
class AnimatedFigure:
    """Hold an animation skeleton and what rotates its joints.

    Attributes:
        figure: animation skeleton of a person.
        drivers: driver of each joint.
        skeleton: skeleton of the poses.
    """

    figure: Figure
    drivers: tuple[_Driver, ...]
    skeleton: Skeleton


def figure_of_person(result: Reconstruction, person: str) -> AnimatedFigure:
    """Build the animation skeleton of a person, with the person's own lengths.

    Raises:
        ResultError: if the result has no articulated model, or there is no such person.
    """
    poses, tree = result.poses, result.skeleton.tree
    if poses is None or tree is None or "model" not in result.layers:
        raise ResultError(
            "An animation skeleton needs an articulated model, and this result has none. Reconstruct with "
            "`bodies='fit'` (one subject) or `people='many'`; a skeleton without a tree needs [tree] in its file."
        )
    if (poses.segments, poses.bones, poses.shape_names) != result.skeleton.body_names:
        raise ResultError(
            f"The poses of this result do not match its skeleton {result.skeleton.name!r}: segments "
            f"{choices(poses.segments)}, expected {choices(result.skeleton.body_names[0])}. Reconstruct again."
        )
    if person not in result.person_ids:
        raise ResultError(f"There is no person {person!r}; the result has {choices(result.person_ids, 20)}.")
    shape_m = np.asarray(poses.shape_m[:])[result.person_ids.index(person)]
    return _FigureBuilder(result.skeleton, person, shape_m).build()


class _FigureBuilder:
    """Collect the joints of the body, then those of its parts."""

    def __init__(self, skeleton: Skeleton, person: str, shape_m: np.ndarray) -> None:
        self.skeleton, self.person, self.shape_m = skeleton, person, shape_m
        self.joints: list[Joint] = []
        self.drivers: list[_Driver] = []
        self.keypoint_joints = np.full(len(skeleton), -1, dtype=np.int64)
        self._names: set[str] = set()
        self._reserved = set(skeleton.body_names[0])

    def build(self) -> AnimatedFigure:
        """Return the complete figure."""
        tree = self.skeleton.tree
        assert tree is not None
        attachments = [int(tree.keypoint_nodes[part.at]) for part in self.skeleton.parts]
        whole = _TreeBuilder(self, tree, tree.keypoint_nodes, np.arange(len(self.skeleton)), (0, 0, 0))
        carriers, positions = whole.grow(-1, np.zeros(3), attachments)
        first = len(tree.segments), len(tree.bones), tree.n_shape
        for part, at in zip(self.skeleton.parts, attachments, strict=True):
            branch = _TreeBuilder(self, part.tree, part.tree.keypoint_nodes, part.keypoints, first)
            root = len(self.joints)
            branch.grow(carriers[at], positions[at], [])
            self.keypoint_joints[part.at] = root
            own = len(part.tree.segments), len(part.tree.bones), part.tree.n_shape
            first = tuple(a + b for a, b in zip(first, own, strict=True))
        figure = Figure(self.person, tuple(self.joints), frozen(self.keypoint_joints, np.int64))
        return AnimatedFigure(figure, tuple(self.drivers), self.skeleton)

    def add(self, name: str, parent: int, position_m: np.ndarray, driver: _Driver) -> int:
        """Add a joint at a position in its parent's axes (tree at rest) and return its index."""
        rotated = self.drivers[parent].rest @ position_m if parent >= 0 else position_m
        x, y, z = rotated.tolist()
        self.joints.append(Joint(self._unique(name, driver), parent, (x, y, z), driver.kind != _STILL))
        self.drivers.append(driver)
        return len(self.joints) - 1

    def _unique(self, name: str, driver: _Driver) -> str:
        """Return the name, or a variant of it: a joint and a keypoint can have the same name."""
        if driver.kind == "segment":
            self._names.add(name)
            return name
        found, n = name, 1
        while found in self._names or found in self._reserved:
            found = f"{name}_point" if n == 1 else f"{name}_point_{n}"
            n += 1
        self._names.add(found)
        return found

    def is_taken(self, name: str) -> bool:
        """Return whether a joint has, or will have, this name."""
        return name in self._names or name in self._reserved


class _TreeBuilder:
    """Add the joints of one tree of a skeleton."""

    def __init__(
        self, to: _FigureBuilder, tree: Tree, nodes: np.ndarray, keypoints: np.ndarray, first: tuple[int, ...]
    ) -> None:
        self.to, self.tree, self.first = to, tree, first
        self.keypoint_of = {int(n): int(k) for n, k in zip(nodes, keypoints, strict=True) if n >= 0}
        shape_m = to.shape_m[first[2] : first[2] + tree.n_shape]
        self.places = node_offsets(tree, shape_m)
        self.joint_of: dict[tuple[bool, int], int] = {}
        self.carrier: dict[int, int] = {}
        self.place: dict[int, np.ndarray] = {}

    def grow(
        self, parent: int, position_m: np.ndarray, attachments: list[int]
    ) -> tuple[dict[int, int], dict[int, np.ndarray]]:
        """Add all joints.

        Args:
            parent: index of the joint that carries the root, -1 for none.
            position_m: position of the root in that joint's axes.
            attachments: nodes that carry a part and need no joint of their own.

        Returns:
            The joint that carries each node, and the node's position in that joint's axes (tree at rest).
        """
        tree = self.tree
        rest = self.to.drivers[parent].rest if parent >= 0 else np.eye(3)
        turns = _Driver("segment", self.first[0], rest) if tree.segments else _Driver(_STILL, 0, rest)
        root = self.to.add(tree.segments[0] if tree.segments else tree.nodes[0].name, parent, position_m, turns)
        self.joint_of[False, 0] = self.carrier[0] = root
        self.place[0] = np.zeros(3)
        anchors = {0: root}
        for n, node in enumerate(tree.nodes[1:], 1):
            key = (node.is_bone, node.mover)
            if key not in self.joint_of:
                self.joint_of[key] = self._joint(n)
                anchors.setdefault(node.parent, self.joint_of[key])
            self.carrier[n] = self.joint_of[key]
            self.place[n] = self._position(n)
        for n, node in enumerate(tree.nodes):
            if n not in anchors and n not in attachments:
                anchors[n] = self.to.add(node.name, self.carrier[n], self.place[n], self._still(n))
            if n in self.keypoint_of and n in anchors:
                self.to.keypoint_joints[self.keypoint_of[n]] = anchors[n]
        return self.carrier, self.place

    def _still(self, n: int) -> _Driver:
        """Return a driver that follows the joint carrying a node."""
        return _Driver(_STILL, 0, self.to.drivers[self.carrier[n]].rest)

    def _joint(self, n: int) -> int:
        """Add the joint of the segment or bone that moves a node, at the node's parent."""
        node = self.tree.nodes[n]
        at = node.parent
        rest = self.to.drivers[self.carrier[at]].rest
        if not node.is_bone:
            driver = _Driver("segment", self.first[0] + node.mover, rest)
            return self.to.add(self.tree.segments[node.mover], self.carrier[at], self.place[at], driver)
        if node.name in _ARMS_OUT and self.tree.rest[node.mover][2] < -_MIN_HANGING_COSINE:
            rest = _ARMS_OUT[node.name]
        driver = _Driver("bone", self.first[1] + node.mover, rest)
        near = self.tree.nodes[at].name
        name = f"{near}_{node.name}" if self.to.is_taken(near) else near
        return self.to.add(name, self.carrier[at], self.place[at], driver)

    def _position(self, n: int) -> np.ndarray:
        """Return the position of a node in the axes of its joint (tree at rest)."""
        node = self.tree.nodes[n]
        if node.is_bone:
            return self.tree.rest[node.mover] * self.places[n, 2]
        beside = node.parent in self.carrier and self.carrier[node.parent] == self.carrier[n]
        return self.places[n] + (self.place[node.parent] if beside else 0.0)


def animate(animated: AnimatedFigure, result: Reconstruction, start: int, stop: int) -> Motion:
    """Return the motion of a figure in the frames ``start`` to ``stop``, counted from 0.

    Args:
        animated: from :func:`figure_of_person`.
        result: only these frames are read, and their neighbors, which determine the twist of limbs.
        start: first frame.
        stop: frame after the last.
    """
    poses, person = result.poses, result.person_ids.index(animated.figure.person)
    assert poses is not None
    step_s = _step_s(result)
    reach = max(reach_frames(tree, step_s) for tree in _trees(animated.skeleton))
    first, last = max(start - reach, 0), min(stop + reach, result.n_frames)
    turns, directions = (np.asarray(each[first:last])[:, person] for each in (poses.turns, poses.directions))
    bones = list(_bone_rotations(animated.skeleton, turns, directions, step_s))
    inside = slice(start - first, stop - first)
    world = _world_rotations(animated, turns[inside], np.concatenate(bones, axis=1)[inside])
    points = np.asarray(result.layers["model"].points_m[start:stop])[:, person]
    root, deviation = _fit_root(animated, _positions(animated.figure, world), points)
    root[~np.isfinite(world[:, 0]).all(axis=(1, 2))] = np.nan
    local = np.tile(np.eye(3), (len(world), len(animated.figure.joints), 1, 1))
    for j in animated.figure.turning:
        parent = animated.figure.joints[j].parent
        local[:, j] = world[:, j] if parent < 0 else np.swapaxes(world[:, parent], -1, -2) @ world[:, j]
    return Motion(root, local, deviation)


def _step_s(result: Reconstruction) -> float:
    """Return the typical time between frames."""
    if result.rate_hz is not None:
        return 1.0 / result.rate_hz
    steps = np.diff(result.time_s[np.isfinite(result.time_s)])
    return float(np.median(steps)) if len(steps) and np.median(steps) > 0.0 else _DEFAULT_STEP_S


def _world_rotations(animated: AnimatedFigure, turns: np.ndarray, bones: np.ndarray) -> np.ndarray:
    """Return world from joint rotations, shape (frame, joint, 3, 3)."""
    out = np.tile(np.eye(3), (len(turns), len(animated.drivers), 1, 1))
    for j, (driver, joint) in enumerate(zip(animated.drivers, animated.figure.joints, strict=True)):
        if driver.kind == _STILL:
            out[:, j] = out[:, joint.parent] if joint.parent >= 0 else np.eye(3)
            continue
        source = turns if driver.kind == "segment" else bones
        out[:, j] = source[:, driver.index] @ driver.rest.T
    return out


def _bone_rotations(
    skeleton: Skeleton, turns: np.ndarray, directions: np.ndarray, step_s: float
) -> Iterator[np.ndarray]:
    """Yield world from bone rotations relative to the rest pose, shape (frame, bone, 3, 3), for each tree."""
    s = b = 0
    for tree in _trees(skeleton):
        n, m = len(tree.segments), len(tree.bones)
        frames = smooth_rotations(tree, turns[:, s : s + n], directions[:, b : b + m], step_s)
        yield frames @ np.swapaxes(rest_frames(tree), -1, -2)
        s, b = s + n, b + m


def _trees(skeleton: Skeleton) -> list[Tree]:
    """Return the trees of the body and of its parts."""
    assert skeleton.tree is not None
    return [skeleton.tree, *(part.tree for part in skeleton.parts)]


def _positions(figure: Figure, world: np.ndarray) -> np.ndarray:
    """Return joint positions relative to the root, shape (frame, joint, 3)."""
    out = np.zeros((*world.shape[:2], 3))
    for j, joint in enumerate(figure.joints[1:], 1):
        out[:, j] = out[:, joint.parent] + world[:, joint.parent] @ np.array(joint.offset_m)
    return out


def _fit_root(animated: AnimatedFigure, places: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the root position that fits all body keypoints, shape (frame, 3).

    The second array is the largest deviation of a keypoint in each frame.
    """
    tree = animated.skeleton.tree
    assert tree is not None
    joints = animated.figure.keypoint_joints
    difference = points - np.where((joints >= 0)[:, None], places[:, joints], np.nan)
    body_difference = difference[:, (tree.keypoint_nodes >= 0) & (joints >= 0)]
    known = np.isfinite(body_difference).all(axis=-1, keepdims=True)
    count = known.sum(axis=1)
    root = np.where(known, body_difference, 0.0).sum(axis=1) / np.where(count > 0, count, np.nan)
    deviation = np.linalg.norm(difference - root[:, None], axis=-1)
    return root, np.where(np.isfinite(deviation), deviation, 0.0).max(axis=1, initial=0.0)
