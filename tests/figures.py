"""Results with known poses, and simple readers of animation files."""

from pathlib import Path

import numpy as np
import pygltflib
from scipy.spatial.transform import Rotation, Slerp

from posefuse.biomechanics.animation_figures import figure_of_person
from posefuse.io.results.axes import minimal_y_up_from_world
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.track_events import Poses
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton
from posefuse.skeleton.trees import Tree
from tests.scenes import ring

RATE_HZ = 50.0


def posed(
    name: str = "body_20", frames: int = 30, people: int = 1, seed: int = 0, away: tuple[slice, ...] = ()
) -> Reconstruction:
    """Return people with random smooth motion and bone lengths, absent in some frames."""
    rng = np.random.default_rng(seed)
    skeleton = shipped_skeleton(name)
    segments, bones, lengths = skeleton.body_names
    shape = np.concatenate([tree.shape_m for tree in trees(skeleton)]) * rng.uniform(0.8, 1.2, (people, len(lengths)))
    turns = _moving(rng, (frames, people, len(segments)))
    ways = _moving(rng, (frames, people, len(bones)))[..., 2]
    roots = np.cumsum(rng.normal(0.0, 0.02, (frames, people, 3)), axis=0) + np.array([0.5, -1.0, 0.9])
    present = np.ones(frames, dtype=bool)
    for each in away:
        present[each] = False
    turns[~present], ways[~present] = np.nan, np.nan
    points = np.stack([places(skeleton, roots[:, p], turns[:, p], ways[:, p], shape[p]) for p in range(people)], axis=1)
    points[~present] = np.nan
    return Reconstruction(
        rig=ring(3), skeleton=skeleton, person_ids=tuple(f"person_{p + 1}" for p in range(people)),
        frame_numbers=np.arange(100, 100 + frames), time_s=7.0 + np.arange(frames) / RATE_HZ,
        layers={"model": model_layer(points)}, rate_hz=RATE_HZ,
        poses=Poses(
            segments, bones, lengths, (), turns, ways, np.empty((frames, people, 0)),
            np.full((frames, people, 6), np.nan),
            np.full((frames, people), np.nan), np.zeros((frames, people), dtype=np.int32), shape, 0.01 * shape,
        ),
    )  # fmt: skip


def trees(skeleton: Skeleton) -> list[Tree]:
    return [skeleton.tree, *(part.tree for part in skeleton.parts)]


def _moving(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    frames, *rest = shape
    out = np.empty((*shape, 3, 3))
    for index in np.ndindex(*rest):
        keys = Rotation.random(2 + frames // 20, random_state=rng)
        out[(slice(None), *index)] = Slerp(np.linspace(0, 1, len(keys)), keys)(np.linspace(0, 1, frames)).as_matrix()
    return out


def places(skeleton: Skeleton, root: np.ndarray, turns: np.ndarray, ways: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Return keypoints of poses by the definition of the tree, shape (frame, keypoint, 3)."""
    out = np.full((len(root), len(skeleton), 3), np.nan)
    s = b = h = 0
    for tree, keypoints, at in [
        (skeleton.tree, np.arange(len(skeleton)), -1),
        *((part.tree, part.keypoints, part.at) for part in skeleton.parts),
    ]:
        start = root if at < 0 else out[:, at]
        actual = [start]
        for node in tree.nodes[1:]:
            place = [
                sign * shape[h + number] if number >= 0 else value
                for value, number, sign in zip(node.place_m, node.shape, node.sign, strict=True)
            ]
            carried = turns[:, s + node.mover] @ place if not node.is_bone else None
            step = place[2] * ways[:, b + node.mover] if carried is None else carried
            actual.append(actual[node.parent] + step)
        for n, k in zip(tree.keypoint_nodes, keypoints, strict=True):
            if n >= 0:
                out[:, k] = actual[n]
        s, b, h = s + len(tree.segments), b + len(tree.bones), h + len(tree.shape_m)
    return out


def model_layer(points: np.ndarray, views: int = 3) -> Layer:
    shape = points.shape[:-1]
    present = np.isfinite(points[..., 0])
    return Layer(
        points, np.full((*shape, 6), np.nan), np.where(present, PointStatus.OK, PointStatus.ABSENT).astype(np.int8),
        np.where(present, Source.MODELED, Source.NONE).astype(np.int8), np.full(shape, np.nan),
        np.full((*shape, views), ViewStatus.USED, dtype=np.int8), np.full((*shape, views), np.nan, dtype=np.float32),
    )  # fmt: skip


class Bvh:
    """A BVH file, read by what the format says: joints, seconds a frame, and where joints are, in the file's unit."""

    def __init__(self, path: Path) -> None:
        words = path.read_text("utf-8").split()
        self.names, self.parents, self.offsets, self.channels, self.ends = [], [], [], [], []
        i = self._hierarchy(words)
        assert (words[i], words[i + 1], words[i + 3 : i + 5]) == ("MOTION", "Frames:", ["Frame", "Time:"])
        self.frames, self.step_s = int(words[i + 2]), float(words[i + 5])
        self.rows = np.array(words[i + 6 :], dtype=float).reshape(self.frames, -1)
        assert self.rows.shape[1] == sum(map(len, self.channels))

    def _hierarchy(self, words: list[str]) -> int:
        assert words[0] == "HIERARCHY"
        i, open_joints, here = 1, [], -1
        while words[i] != "MOTION":
            if words[i] in ("ROOT", "JOINT"):
                self.names.append(words[i + 1])
                self.parents.append(open_joints[-1] if open_joints else -1)
                here, i = len(self.names) - 1, i + 1
            elif words[i] == "End":
                here, i = -2, i + 1
            elif words[i] == "{":
                open_joints.append(here)
            elif words[i] == "}":
                open_joints.pop()
            elif words[i] == "OFFSET":
                (self.ends if open_joints[-1] == -2 else self.offsets).append([float(w) for w in words[i + 1 : i + 4]])
                i += 3
            elif words[i] == "CHANNELS":
                n = int(words[i + 1])
                self.channels.append(words[i + 2 : i + 2 + n])
                i += 1 + n
            i += 1
        return i

    def places(self, rows: np.ndarray | None = None) -> np.ndarray:
        """Shape (frame, joint, 3)."""
        rows = self.rows if rows is None else rows
        at, actual, turns = 0, [], []
        for parent, offset, channels in zip(self.parents, self.offsets, self.channels, strict=True):
            place, turn = np.tile(offset, (len(rows), 1)), Rotation.identity(len(rows))
            for channel in channels:
                values, at = rows[:, at], at + 1
                axis = "XYZ".index(channel[0])
                if channel.endswith("position"):
                    place[:, axis] += values
                else:
                    turn = turn * Rotation.from_rotvec(np.radians(values)[:, None] * np.eye(3)[axis])
            if parent >= 0:
                place, turn = actual[parent] + turns[parent].apply(place), turns[parent] * turn
            actual.append(place)
            turns.append(turn)
        return np.stack(actual, axis=1)


class Gltf:
    """A glTF file with one skin and one animation, read by pygltflib."""

    def __init__(self, path: Path) -> None:
        self.file = pygltflib.GLTF2().load(str(path))
        if path.suffix == ".gltf":
            self.file.convert_buffers(pygltflib.BufferFormat.BINARYBLOB)
        self.blob = self.file.binary_blob()
        self.skin, self.animation = self.file.skins[0], self.file.animations[0]
        self.names = [node.name for node in self.file.nodes]
        self.parents = np.full(len(self.names), -1)
        for n, node in enumerate(self.file.nodes):
            self.parents[node.children or []] = n

    def numbers(self, accessor: int) -> np.ndarray:
        """Return the contents of an accessor."""
        entry = self.file.accessors[accessor]
        view = self.file.bufferViews[entry.bufferView]
        kind = {5126: np.float32, 5125: np.uint32, 5123: np.uint16}[entry.componentType]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[entry.type]
        assert entry.count * width * np.dtype(kind).itemsize == view.byteLength
        return np.frombuffer(self.blob, kind, entry.count * width, view.byteOffset).reshape(entry.count, width)

    def channel(self, node: int, path: str) -> tuple[np.ndarray, np.ndarray, str] | None:
        """Return times, values and interpolation of a node's animation channel."""
        for each in self.animation.channels:
            if (each.target.node, each.target.path) == (node, path):
                sampler = self.animation.samplers[each.sampler]
                return self.numbers(sampler.input)[:, 0], self.numbers(sampler.output), sampler.interpolation
        return None

    def worlds(self, seconds: np.ndarray | None) -> np.ndarray:
        """Shape (time, node, 4, 4): world from node at some of the keys; at rest without times."""
        out = np.tile(np.eye(4), (1 if seconds is None else len(seconds), len(self.names), 1, 1))
        for n, node in enumerate(self.file.nodes):
            out[:, n, :3, 3] = node.translation or 0.0
            for path in ("translation", "rotation") if seconds is not None else ():
                actual = self.channel(n, path)
                if actual is not None:
                    keys = np.searchsorted(actual[0], np.float32(seconds))
                    assert (actual[0][keys] == np.float32(seconds)).all()
                    if path == "translation":
                        out[:, n, :3, 3] = actual[1][keys]
                    else:
                        out[:, n, :3, :3] = Rotation.from_quat(actual[1][keys]).as_matrix()
        order = sorted(range(len(self.names)), key=self._depth)
        for n in order:
            if self.parents[n] >= 0:
                out[:, n] = out[:, self.parents[n]] @ out[:, n]
        return out

    def _depth(self, n: int) -> int:
        return 0 if self.parents[n] < 0 else 1 + self._depth(self.parents[n])


def points_in_file_axes(result, person: int = 0) -> np.ndarray:
    """Points of the model layer in the file's axes."""
    turn = minimal_y_up_from_world(result.rig.up_axis)
    return np.asarray(result.layers["model"].points_m)[:, person] @ turn.T


def joints_of(result, names: list[str], person: str = "person_1") -> tuple[np.ndarray, list[int]]:
    """Keypoints that have a joint, and which that is in the file."""
    figure = figure_of_person(result, person).figure
    keypoints = np.flatnonzero(figure.keypoint_joints >= 0)
    return keypoints, [names.index(figure.joints[j].name) for j in figure.keypoint_joints[keypoints]]
