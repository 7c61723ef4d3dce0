"""Figures for animation from fitted bodies: see docs/methods.md, "Figures for animation"."""

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

_ASIDE = {
    "left_elbow": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "right_elbow": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}
"""Quarter turns about forward that lift arms which hang down: figures rest with their arms out (T-pose)."""
_HANGS = 0.999
"""The least cosine between down and an arm that hangs."""
_STILL = "still"
_STEP_S = 1.0 / 30.0
"""Between frames of which nobody knows the time."""


@dataclass(frozen=True)
class _Mover:
    """What turns a joint: a segment or bone by its number among all of a skeleton, or nothing.

    Attributes:
        kind: ``segment``, ``bone`` or ``still``.
        number: of the segment or bone.
        rest: shape (3, 3): from the axes of the tree at rest to those of the figure at rest.
    """

    kind: str
    number: int
    rest: np.ndarray


@dataclass(frozen=True)
class Body:
    """A figure and what turns its joints.

    Attributes:
        figure: of a person.
        movers: of each joint.
        skeleton: whose poses they are.
    """

    figure: Figure
    movers: tuple[_Mover, ...]
    skeleton: Skeleton


def body_of(result: Reconstruction, person: str) -> Body:
    """The figure of a person, of their own lengths.

    Raises:
        ResultError: if no bodies were fitted, or there is no such person.
    """
    poses, tree = result.poses, result.skeleton.tree
    if poses is None or tree is None or "model" not in result.layers:
        raise ResultError(
            "An animated figure needs articulated bodies, and none were fitted in this result. Reconstruct with "
            "--bodies fit (one subject), or --people many; a skeleton without a tree needs [tree] in its file."
        )
    if (poses.segments, poses.bones, poses.shape_names) != result.skeleton.body_names:
        raise ResultError(
            f"The poses of this result are of another body than its skeleton {result.skeleton.name!r}: segments "
            f"{choices(poses.segments)}, expected {choices(result.skeleton.body_names[0])}. Reconstruct anew."
        )
    if person not in result.person_ids:
        raise ResultError(f"Nobody is called {person!r}; there are {choices(result.person_ids, 20)}.")
    shape_m = np.asarray(poses.shape_m[:])[result.person_ids.index(person)]
    return _Assembly(result.skeleton, person, shape_m).body()


class _Assembly:
    """Puts joints in order: those of the body, then those of its parts."""

    def __init__(self, skeleton: Skeleton, person: str, shape_m: np.ndarray) -> None:
        self.skeleton, self.person, self.shape_m = skeleton, person, shape_m
        self.joints: list[Joint] = []
        self.movers: list[_Mover] = []
        self.keypoint_joints = np.full(len(skeleton), -1, dtype=np.int64)
        self._names: set[str] = set()
        self._reserved = set(skeleton.body_names[0])

    def body(self) -> Body:
        """The whole figure."""
        tree = self.skeleton.tree
        assert tree is not None
        held = [int(tree.keypoint_nodes[part.at]) for part in self.skeleton.parts]
        whole = _Branch(self, tree, tree.keypoint_nodes, np.arange(len(self.skeleton)), (0, 0, 0))
        carrier_of, place_of = whole.grow(-1, np.zeros(3), held)
        first = len(tree.segments), len(tree.bones), tree.n_shape
        for part, at in zip(self.skeleton.parts, held, strict=True):
            branch = _Branch(self, part.tree, part.tree.keypoint_nodes, part.keypoints, first)
            root = len(self.joints)
            branch.grow(carrier_of[at], place_of[at], [])
            self.keypoint_joints[part.at] = root
            own = len(part.tree.segments), len(part.tree.bones), part.tree.n_shape
            first = tuple(a + b for a, b in zip(first, own, strict=True))
        figure = Figure(self.person, tuple(self.joints), frozen(self.keypoint_joints, np.int64))
        return Body(figure, tuple(self.movers), self.skeleton)

    def add(self, name: str, parent: int, place_m: np.ndarray, mover: _Mover) -> int:
        """A joint at a place in its parent's axes at rest in the tree; its number."""
        turned = self.movers[parent].rest @ place_m if parent >= 0 else place_m
        x, y, z = turned.tolist()
        self.joints.append(Joint(self._unique(name, mover), parent, (x, y, z), mover.kind != _STILL))
        self.movers.append(mover)
        return len(self.joints) - 1

    def _unique(self, name: str, mover: _Mover) -> str:
        """The name, or one like it: a joint's and a keypoint's can be the same."""
        if mover.kind == "segment":
            self._names.add(name)
            return name
        found, n = name, 1
        while found in self._names or found in self._reserved:
            found = f"{name}_point" if n == 1 else f"{name}_point_{n}"
            n += 1
        self._names.add(found)
        return found

    def taken(self, name: str) -> bool:
        """Whether a joint has that name, or will."""
        return name in self._names or name in self._reserved


class _Branch:
    """The joints of one tree of a skeleton."""

    def __init__(
        self, to: _Assembly, tree: Tree, nodes: np.ndarray, keypoints: np.ndarray, first: tuple[int, ...]
    ) -> None:
        self.to, self.tree, self.first = to, tree, first
        self.keypoint_of = {int(n): int(k) for n, k in zip(nodes, keypoints, strict=True) if n >= 0}
        shape_m = to.shape_m[first[2] : first[2] + tree.n_shape]
        self.places = node_offsets(tree, shape_m)
        self.joint_of: dict[tuple[bool, int], int] = {}
        self.carrier: dict[int, int] = {}
        self.place: dict[int, np.ndarray] = {}

    def grow(self, parent: int, place_m: np.ndarray, held: list[int]) -> tuple[dict[int, int], dict[int, np.ndarray]]:
        """Add all joints.

        Args:
            parent: the joint that carries the root, -1 for none.
            place_m: where it is there.
            held: nodes at which a part will hang, so that they need no joint of their own.

        Returns:
            The joint that carries each node, and where the node is in its axes at rest in the tree.
        """
        tree = self.tree
        rest = self.to.movers[parent].rest if parent >= 0 else np.eye(3)
        turns = _Mover("segment", self.first[0], rest) if tree.segments else _Mover(_STILL, 0, rest)
        root = self.to.add(tree.segments[0] if tree.segments else tree.nodes[0].name, parent, place_m, turns)
        self.joint_of[False, 0] = self.carrier[0] = root
        self.place[0] = np.zeros(3)
        anchors = {0: root}
        for n, node in enumerate(tree.nodes[1:], 1):
            key = (node.is_bone, node.mover)
            if key not in self.joint_of:
                self.joint_of[key] = self._joint(n)
                anchors.setdefault(node.parent, self.joint_of[key])
            self.carrier[n] = self.joint_of[key]
            self.place[n] = self._place(n)
        for n, node in enumerate(tree.nodes):
            if n not in anchors and n not in held:
                anchors[n] = self.to.add(node.name, self.carrier[n], self.place[n], self._still(n))
            if n in self.keypoint_of and n in anchors:
                self.to.keypoint_joints[self.keypoint_of[n]] = anchors[n]
        return self.carrier, self.place

    def _still(self, n: int) -> _Mover:
        return _Mover(_STILL, 0, self.to.movers[self.carrier[n]].rest)

    def _joint(self, n: int) -> int:
        """The joint of what moves a node: at the node that it hangs on."""
        node = self.tree.nodes[n]
        at = node.parent
        rest = self.to.movers[self.carrier[at]].rest
        if not node.is_bone:
            mover = _Mover("segment", self.first[0] + node.mover, rest)
            return self.to.add(self.tree.segments[node.mover], self.carrier[at], self.place[at], mover)
        if node.name in _ASIDE and self.tree.rest[node.mover][2] < -_HANGS:
            rest = _ASIDE[node.name]
        mover = _Mover("bone", self.first[1] + node.mover, rest)
        near = self.tree.nodes[at].name
        name = f"{near}_{node.name}" if self.to.taken(near) else near
        return self.to.add(name, self.carrier[at], self.place[at], mover)

    def _place(self, n: int) -> np.ndarray:
        """Where a node is in the axes of its joint at rest in the tree."""
        node = self.tree.nodes[n]
        if node.is_bone:
            return self.tree.rest[node.mover] * self.places[n, 2]
        beside = node.parent in self.carrier and self.carrier[node.parent] == self.carrier[n]
        return self.places[n] + (self.place[node.parent] if beside else 0.0)


def motion_of(body: Body, result: Reconstruction, start: int, stop: int) -> Motion:
    """How a figure stands in the frames ``start`` to ``stop``, counted from 0.

    Args:
        body: from :func:`body_of`.
        result: of which only these frames are read, and those around that tell how limbs are twisted.
        start: the first frame.
        stop: the frame after the last.
    """
    poses, person = result.poses, result.person_ids.index(body.figure.person)
    assert poses is not None
    step_s = _step_s(result)
    reach = max(reach_frames(tree, step_s) for tree in _trees(body.skeleton))
    first, last = max(start - reach, 0), min(stop + reach, result.n_frames)
    turns, directions = (np.asarray(each[first:last])[:, person] for each in (poses.turns, poses.directions))
    bones = list(_bone_turns(body.skeleton, turns, directions, step_s))
    inside = slice(start - first, stop - first)
    world = _world_turns(body, turns[inside], np.concatenate(bones, axis=1)[inside])
    points = np.asarray(result.layers["model"].points_m[start:stop])[:, person]
    root, off = _laid_on(body, _places(body.figure, world), points)
    root[~np.isfinite(world[:, 0]).all(axis=(1, 2))] = np.nan
    local = np.tile(np.eye(3), (len(world), len(body.figure.joints), 1, 1))
    for j in body.figure.turning:
        parent = body.figure.joints[j].parent
        local[:, j] = world[:, j] if parent < 0 else np.swapaxes(world[:, parent], -1, -2) @ world[:, j]
    return Motion(root, local, off)


def _step_s(result: Reconstruction) -> float:
    """Between frames, as a rule."""
    if result.rate_hz is not None:
        return 1.0 / result.rate_hz
    steps = np.diff(result.time_s[np.isfinite(result.time_s)])
    return float(np.median(steps)) if len(steps) and np.median(steps) > 0.0 else _STEP_S


def _world_turns(body: Body, turns: np.ndarray, bones: np.ndarray) -> np.ndarray:
    """Shape (frame, joint, 3, 3): world from the axes of joints."""
    out = np.tile(np.eye(3), (len(turns), len(body.movers), 1, 1))
    for j, (mover, joint) in enumerate(zip(body.movers, body.figure.joints, strict=True)):
        if mover.kind == _STILL:
            out[:, j] = out[:, joint.parent] if joint.parent >= 0 else np.eye(3)
            continue
        source = turns if mover.kind == "segment" else bones
        out[:, j] = source[:, mover.number] @ mover.rest.T
    return out


def _bone_turns(skeleton: Skeleton, turns: np.ndarray, directions: np.ndarray, step_s: float) -> Iterator[np.ndarray]:
    """Shape (frame, bone, 3, 3) of each tree: world from the axes of bones at rest."""
    s = b = 0
    for tree in _trees(skeleton):
        n, m = len(tree.segments), len(tree.bones)
        frames = smooth_rotations(tree, turns[:, s : s + n], directions[:, b : b + m], step_s)
        yield frames @ np.swapaxes(rest_frames(tree), -1, -2)
        s, b = s + n, b + m


def _trees(skeleton: Skeleton) -> list[Tree]:
    """Of the body and of its parts."""
    assert skeleton.tree is not None
    return [skeleton.tree, *(part.tree for part in skeleton.parts)]


def _places(figure: Figure, world: np.ndarray) -> np.ndarray:
    """Shape (frame, joint, 3): where joints are from the root."""
    out = np.zeros((*world.shape[:2], 3))
    for j, joint in enumerate(figure.joints[1:], 1):
        out[:, j] = out[:, joint.parent] + world[:, joint.parent] @ np.array(joint.offset_m)
    return out


def _laid_on(body: Body, places: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the root is, shape (frame, 3), by all keypoints of the body alike; and how far any keypoint then is off."""
    tree = body.skeleton.tree
    assert tree is not None
    joints = body.figure.keypoint_joints
    apart = points - np.where((joints >= 0)[:, None], places[:, joints], np.nan)
    own = apart[:, (tree.keypoint_nodes >= 0) & (joints >= 0)]
    known = np.isfinite(own).all(axis=-1, keepdims=True)
    count = known.sum(axis=1)
    root = np.where(known, own, 0.0).sum(axis=1) / np.where(count > 0, count, np.nan)
    off = np.linalg.norm(apart - root[:, None], axis=-1)
    return root, np.where(np.isfinite(off), off, 0.0).max(axis=1, initial=0.0)
