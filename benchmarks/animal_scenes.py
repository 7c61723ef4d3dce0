"""Simulate several animals in an arena, or in a tank without a vertical: they run, stop, meet, follow and climb.

Bodies follow the tree of a skeleton; size and proportions differ between animals, and keypoints slide with the skin.
Motion is simulated on a fixed time grid, so that a scene does not depend on the frame rate.
"""

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from posefuse.errors import OptionsError, SkeletonError, suggestion
from posefuse.model.cameras import Camera, CameraRig
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.skeleton.trees import Tree
from posefuse.synthetic.crowd_options import CrowdFaults
from posefuse.synthetic.crowds import CrowdScene, crowd_of_points
from posefuse.synthetic.motions import smooth_step
from posefuse.synthetic.options import DetectorOptions
from posefuse.synthetic.rigs import look_at

AnimalScenario = Literal["arena", "still", "free"]
ANIMAL_SCENARIOS: tuple[AnimalScenario, ...] = get_args(AnimalScenario)

_GRID_HZ = 100.0
_SIZE_PX, _FOCAL_SHARE = (1280, 1024), 1.15
# Shares of the largest extent of a body.
_GAP, _LIFT, _OVER = 0.3, 0.28, 0.6
_CONTACT_SHARE, _CLIMB_SHARE = 0.45, 0.4


@dataclass(frozen=True)
class AnimalOptions:
    """Options of a simulated scene with several animals.

    Attributes:
        scenario: ``arena``: all run on a floor, stop, meet and climb over each other; ``still``: one of them stays in
            place; ``free``: a tank or the air, in which bodies take any orientation.
        animals: Number of animals.
        cameras: Number of cameras, evenly spaced on a circle at two heights.
        duration_s: Duration.
        rate_hz: Frames per second.
        arena_m: Width of the arena or tank.
        skeleton: Skeleton whose tree the bodies use.
        seed: Random seed; the same seed gives the same bytes.
        detector: Keypoint errors.
        faults: Detector errors specific to several animals.
    """

    scenario: AnimalScenario = "arena"
    animals: int = 2
    cameras: int = 5
    duration_s: float = 60.0
    rate_hz: float = 30.0
    arena_m: float = 0.5
    skeleton: str = "mouse_22"
    seed: int = 0
    detector: DetectorOptions = field(default_factory=lambda: DetectorOptions(miss_share=0.05))
    faults: CrowdFaults = field(default_factory=lambda: CrowdFaults(miss_share=0.03))

    def __post_init__(self) -> None:
        if self.scenario not in ANIMAL_SCENARIOS:
            raise OptionsError(f"No scenario {self.scenario!r}. {suggestion(self.scenario, ANIMAL_SCENARIOS)}")
        if not (self.animals >= 1 and self.cameras >= 2):
            raise OptionsError(
                f"A scene needs at least 1 animal and 2 cameras, got animals={self.animals}, cameras={self.cameras}."
            )
        if not (self.duration_s > 0 and self.rate_hz > 0 and self.arena_m > 0):
            raise OptionsError(
                "duration_s, rate_hz and arena_m must be positive, got "
                f"{self.duration_s}, {self.rate_hz} and {self.arena_m}."
            )


def simulate_animals(options: AnimalOptions | None = None) -> CrowdScene:
    """Simulate a recording of several animals.

    Raises:
        OptionsError: if the options are invalid.
        SkeletonError: if there is no such skeleton, or it has no tree with segments.
    """
    options = options or AnimalOptions()
    skeleton = find_skeleton(options.skeleton)
    tree = skeleton.tree
    if tree is None or not tree.segments or (tree.keypoint_nodes < 0).any():
        raise SkeletonError(
            f"Skeleton {skeleton.name!r} has no tree with segments and all keypoints, which a simulated animal needs."
        )
    motion_seed, detector_seed = np.random.SeedSequence(options.seed).spawn(2)
    rng = np.random.default_rng(motion_seed)
    points = _positions(tree, options, rng)[:, :, tree.keypoint_nodes]
    grid = np.arange(len(points)) / _GRID_HZ
    time_s = np.arange(max(1, round(options.duration_s * options.rate_hz))) / options.rate_hz
    return crowd_of_points(
        make_interp_spline(grid, points)(time_s), animal_rig(options.cameras, options.arena_m), skeleton,
        options.rate_hz, detector=options.detector, faults=options.faults,
        seed=int(np.random.default_rng(detector_seed).integers(2**31)),
    )  # fmt: skip


def animal_rig(n_cameras: int, arena_m: float) -> CameraRig:
    """Return cameras of 1280 x 1024 px around an arena that fills their images, alternately low and high."""
    width, height = _SIZE_PX
    matrix = np.array(
        [[_FOCAL_SHARE * width, 0, (width - 1) / 2], [0, _FOCAL_SHARE * width, (height - 1) / 2], [0, 0, 1]]
    )
    angle = 2.0 * np.pi * np.arange(n_cameras) / n_cameras + 0.3
    high = np.where(np.arange(n_cameras) % 2, 1.3, 0.7)
    centers = arena_m * np.stack([1.5 * np.cos(angle), 1.5 * np.sin(angle), high], axis=1)
    cameras = tuple(
        Camera(f"cam_{i}", _SIZE_PX, matrix, look_at(center, np.zeros(3))) for i, center in enumerate(centers)
    )
    return CameraRig(cameras, up_axis="z", source="simulated")


def renamed(scene: CrowdScene, skeleton: Skeleton, of: dict[str, str]) -> CrowdScene:
    """Return the scene as observed by another detector with other keypoints.

    Args:
        scene: the scene.
        skeleton: skeleton of the other detector.
        of: keypoint of the scene for each keypoint of ``skeleton``.
    """
    columns = [scene.truth.skeleton.index(of[name]) for name in skeleton.keypoints]
    seen = replace(
        scene.detections, skeleton=skeleton, keypoints_px=scene.detections.keypoints_px[:, columns],
        confidence=scene.detections.confidence[:, columns],
    )  # fmt: skip
    layer = scene.truth.layers["measured"]
    parts = {
        name: np.asarray(getattr(layer, name))[:, :, columns]
        for name in (
            "points_m", "covariance_m2", "status", "source", "reprojection_error_px", "view_status", "view_error_px",
        )
    }  # fmt: skip
    truth = replace(scene.truth, skeleton=skeleton, layers={"measured": replace(layer, **parts)})
    return replace(scene, detections=seen, truth=truth)


@dataclass(frozen=True)
class _Way:
    """Path of an animal, shape (step, ...) on the time grid.

    Attributes:
        root_m: shape (step, 3).
        turn: shape (step, 3, 3): world from body.
        speed: shape (step,), body lengths per second.
    """

    root_m: np.ndarray
    turn: np.ndarray
    speed: np.ndarray


def _positions(tree: Tree, options: AnimalOptions, rng: np.random.Generator) -> np.ndarray:
    """Return the positions of all animals, shape (step, animal, node, 3)."""
    n_steps = int(np.ceil(options.duration_s * _GRID_HZ)) + 5
    sizes = rng.uniform(0.9, 1.1, options.animals)
    make = _in_a_tank if options.scenario == "free" else _on_a_floor
    ways = make(tree, options, n_steps, rng)
    return np.stack([_body(tree, size, way, rng) for size, way in zip(sizes, ways, strict=True)], axis=1)


def _on_a_floor(tree: Tree, options: AnimalOptions, n_steps: int, rng: np.random.Generator) -> list[_Way]:
    rovers = _Rovers(options, tree.size_m, rng)
    floor, over = np.empty((n_steps, options.animals, 2)), np.empty((n_steps, options.animals))
    for step in range(n_steps):
        floor[step], over[step] = rovers.place_m, rovers.over
        rovers.advance(step / _GRID_HZ)
    floor = gaussian_filter1d(floor, 0.04 * _GRID_HZ, axis=0, mode="nearest")
    ways = []
    for a in range(options.animals):
        away = np.linalg.norm(np.delete(floor, a, axis=1) - floor[:, a : a + 1], axis=-1).min(axis=1, initial=9.0)
        near = smooth_step(1.0 - away / (_OVER * tree.size_m))
        lift = _LIFT * tree.size_m * gaussian_filter1d(over[:, a] * near, 0.06 * _GRID_HZ, mode="nearest")
        breath = 0.01 * tree.size_m * np.sin(2 * np.pi * 2.5 * np.arange(n_steps) / _GRID_HZ + rng.uniform(0, 6))
        velocity = np.gradient(floor[:, a], axis=0) * _GRID_HZ
        speed = np.linalg.norm(velocity, axis=1) / tree.size_m
        yaw = _heading(velocity, speed, float(rng.uniform(-np.pi, np.pi)))
        root = np.column_stack([floor[:, a], 0.28 * tree.size_m + lift + breath])
        ways.append(_Way(root, Rotation.from_euler("z", yaw[:, None]).as_matrix(), speed))
    return ways


def _heading(velocity: np.ndarray, speed: np.ndarray, now: float) -> np.ndarray:
    """Return the heading, shape (step,), which follows the direction of motion, within 0.1 s while running."""
    heading = np.empty(len(velocity))
    to, will = np.arctan2(velocity[:, 1], velocity[:, 0]), np.minimum(1.0, speed) ** 2 / (0.1 * _GRID_HZ)
    for step in range(len(heading)):
        now += (np.mod(to[step] - now + np.pi, 2.0 * np.pi) - np.pi) * will[step]
        heading[step] = now
    return gaussian_filter1d(heading, 0.04 * _GRID_HZ, mode="nearest")


def _in_a_tank(tree: Tree, options: AnimalOptions, n_steps: int, rng: np.random.Generator) -> list[_Way]:
    ways = []
    for _ in range(options.animals):
        root = 0.15 * options.arena_m * _whims((n_steps, 3), 0.7, rng)
        speed = np.linalg.norm(np.gradient(root, axis=0), axis=1) * _GRID_HZ / tree.size_m
        rate = 2.0 * _whims((n_steps, 3), 0.4, rng) / _GRID_HZ
        turn, turns = Rotation.from_rotvec(rng.normal(0.0, 2.0, 3)), np.empty((n_steps, 3, 3))
        for step in range(n_steps):
            turns[step] = turn.as_matrix()
            turn = turn * Rotation.from_rotvec(rate[step])
        ways.append(_Way(root, turns, speed))
    return ways


def _body(tree: Tree, size: float, way: _Way, rng: np.random.Generator) -> np.ndarray:
    """Return the nodes of a body with random proportions on its path, with sliding skin, shape (step, node, 3)."""
    n_steps = len(way.root_m)
    shape = size * tree.shape_m * np.exp(rng.normal(0.0, 0.05, tree.n_shape))
    own = np.append(shape, 0.0)
    gait = np.cumsum(2.0 * np.pi * 1.7 * np.sqrt(way.speed) / _GRID_HZ)
    swing = smooth_step(way.speed / 0.5)
    turns: list[np.ndarray | None] = [None] * len(tree.segments)
    turns[0] = way.turn
    holder = [0] * len(tree.nodes)
    points = np.empty((n_steps, len(tree.nodes), 3))
    points[:, 0] = way.root_m
    for n, node in enumerate(tree.nodes[1:], 1):
        place = np.array(
            [own[s] * g if s >= 0 else p for s, g, p in zip(node.shape, node.sign, node.place_m, strict=True)]
        )
        if node.is_bone:
            holder[n] = holder[node.parent]
            # Legs of both sides alternate; other bones sway.
            stride = 0.5 * swing * np.sin(gait + np.pi * (node.mover % 2) + 0.7 * n)
            bend = Rotation.from_rotvec(
                np.column_stack([0.15 * _whims((n_steps,), 0.2, rng), stride + 0.2 * _whims((n_steps,), 0.2, rng),
                                 0.2 * _whims((n_steps,), 0.3, rng)])
            ).as_matrix()  # fmt: skip
            held = turns[holder[n]]
            assert held is not None
            bone = bend @ (tree.rest[node.mover] * place[2])
            points[:, n] = points[:, node.parent] + (held @ bone[..., None])[..., 0]
            continue
        holder[n] = node.mover
        turn = turns[node.mover]
        if turn is None:
            base = turns[holder[node.parent]]
            assert base is not None
            turn = turns[node.mover] = base @ _bend(n_steps, way.speed, rng)
        points[:, n] = points[:, node.parent] + turn @ place
    return points + 0.012 * tree.size_m * _whims(points.shape, 0.15, rng)


def _bend(n_steps: int, speed: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the rotation of a segment relative to the previous one, sideways and upward, shape (step, 3, 3)."""
    rears = smooth_step(_whims((n_steps,), 0.5, rng) - 1.0) * (1.0 - smooth_step(speed))
    pitch = 0.15 * _whims((n_steps,), 0.2, rng) - 0.7 * gaussian_filter1d(rears, 0.1 * _GRID_HZ)
    yaw, roll = 0.35 * _whims((n_steps,), 0.25, rng), 0.1 * _whims((n_steps,), 0.25, rng)
    return Rotation.from_euler("zyx", np.column_stack([yaw, pitch, roll])).as_matrix()


def _whims(shape: tuple[int, ...], lasts_s: float, rng: np.random.Generator) -> np.ndarray:
    """Return correlated normal noise of variance 1 along the first axis."""
    noise = gaussian_filter1d(rng.standard_normal(shape), lasts_s * _GRID_HZ, axis=0, mode="wrap")
    return noise * np.sqrt(2.0 * np.sqrt(np.pi) * lasts_s * _GRID_HZ)


class _Rovers:
    """State of the animals at one time step."""

    def __init__(self, options: AnimalOptions, body_m: float, rng: np.random.Generator) -> None:
        n = options.animals
        self.options, self.body_m, self.rng = options, body_m, rng
        self.reach_m = 0.5 * options.arena_m - 0.4 * body_m
        self.place_m = np.stack([self._anywhere() for _ in range(n)])
        self.velocity, self.goal_m = np.zeros((n, 2)), self.place_m.copy()
        self.speed, self.until_s = np.zeros(n), rng.uniform(0.0, 2.0, n)
        self.runs, self.over = np.zeros(n, dtype=bool), np.zeros(n)

    def advance(self, time_s: float) -> None:
        """Advance the state from this grid time to the next."""
        for a in range(len(self.place_m)):
            if time_s < self.until_s[a] and not (self.runs[a] and self._is_there(a)):
                continue
            if self.runs[a]:
                self._stop(a, time_s)
            elif not (a == 0 and self.options.scenario == "still"):
                self._set_out(a, time_s)
        way = self.goal_m - self.place_m
        far = np.linalg.norm(way, axis=1, keepdims=True)
        eager = np.minimum(1.0, far / (0.5 * self.body_m)) * self.speed[:, None] * self.runs[:, None]
        self.velocity += (way / np.maximum(far, 1e-9) * eager - self.velocity) / (0.1 * _GRID_HZ)
        self.place_m = self.place_m + self.velocity / _GRID_HZ
        self._keep_apart()

    def _is_there(self, a: int) -> bool:
        return bool(np.linalg.norm(self.goal_m[a] - self.place_m[a]) < 0.2 * self.body_m)

    def _stop(self, a: int, time_s: float) -> None:
        self.runs[a] = False
        self.until_s[a] = time_s + self.rng.exponential(1.5) + 0.2

    def _set_out(self, a: int, time_s: float) -> None:
        """Choose a random goal: a place, or another animal to approach or to climb over."""
        self.runs[a], self.speed[a] = True, self.rng.uniform(1.0, 5.0) * self.body_m
        self.goal_m[a], self.until_s[a] = self._anywhere(), time_s + 4.0
        if len(self.place_m) > 1 and self.rng.random() < _CONTACT_SHARE:
            other = int(self.rng.choice([b for b in range(len(self.place_m)) if b != a]))
            way = self.place_m[other] - self.place_m[a]
            way = way / max(float(np.linalg.norm(way)), 1e-9)
            self.over[a] = float(self.rng.random() < _CLIMB_SHARE)
            beyond = self.body_m * (1.0 if self.over[a] else -_GAP)
            self.goal_m[a] = self._inside(self.place_m[other] + beyond * way)
            self.speed[a] = min(self.speed[a], 2.5 * self.body_m)

    def _anywhere(self) -> np.ndarray:
        angle = self.rng.uniform(-np.pi, np.pi)
        return self.reach_m * np.sqrt(self.rng.random()) * np.array([np.cos(angle), np.sin(angle)])

    def _inside(self, place_m: np.ndarray) -> np.ndarray:
        return place_m * min(1.0, self.reach_m / max(float(np.linalg.norm(place_m)), 1e-9))

    def _keep_apart(self) -> None:
        """Keep animals apart, except climbing ones; animals that stay in place are not moved."""
        apart = self.place_m[:, None] - self.place_m[None]
        gap = np.linalg.norm(apart, axis=-1) + 9.0 * np.eye(len(apart))
        # An animal on top of another stays there until it has climbed down.
        self.over[~self.runs & (gap.min(axis=1) > _OVER * self.body_m)] = 0.0
        lack = np.maximum(0.0, _GAP * self.body_m - gap)
        lack[(self.over > 0)[:, None] | (self.over > 0)[None]] = 0.0
        push = (0.5 * lack[..., None] * apart / np.maximum(gap, 1e-9)[..., None]).sum(axis=1)
        if self.options.scenario == "still":
            push[0] = 0.0
        self.place_m = np.stack([self._inside(each) for each in self.place_m + push])
