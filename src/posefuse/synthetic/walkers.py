"""Walkers: people who walk along paths on the floor, in each other's way but never through each other.

Paths are made on a time grid of their own, so that a scene is the same at every frame rate. People who stroll are
particles with a goal across the room, pushed apart by a social force (Helbing & Molnar 1995, Social force model for
pedestrian dynamics) and to the right of each other, with a least distance on top.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator, make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from posefuse.synthetic.figures import Figure
from posefuse.synthetic.motions import FEET, joint_rotations, small_movements, smooth_step, soft_minimum, walk_pose

GRID_HZ = 50.0
_LEAST_GAP_M = 0.62
_ARRIVED_M = 0.35
_RELAXATION_S = 0.4
_TURN_S = 0.25
_STRIDE_M = 1.3
_THIGH_M = -0.43


@dataclass(frozen=True)
class Plan:
    """When a person is in the room.

    Attributes:
        enter_s: when they come in; 0 is being there from the start.
        leave_s: when they make for the door; infinity is never.
        away_s: how long after going out they come in again, to stay; infinity is never.
    """

    enter_s: float = 0.0
    leave_s: float = np.inf
    away_s: float = np.inf


@dataclass(frozen=True)
class Walk:
    """One person's way through a scene, on a grid of ``GRID_HZ``.

    Attributes:
        floor_m: shape (step, 2): where the hips are above the floor.
        heading: shape (step,), radians from x, without jumps.
        embrace: shape (step,), 0 to 1: how far the arms are around somebody.
        spans_s: when the person is there: from and to, to not included.
        phase: of the gait at the start, radians.
    """

    floor_m: np.ndarray
    heading: np.ndarray
    embrace: np.ndarray
    spans_s: tuple[tuple[float, float], ...]
    phase: float = 0.0

    def present(self, time_s: np.ndarray) -> np.ndarray:
        """Shape (time,), bool: whether the person is there."""
        there = [(time_s >= start) & (time_s < stop) for start, stop in self.spans_s]
        return np.any(there, axis=0) if there else np.zeros(time_s.shape, dtype=bool)

    def positions(self, figure: Figure, time_s: np.ndarray) -> np.ndarray:
        """Shape (time, node, 3): where every node of a human figure is, in metres; NaN while away."""
        grid = np.arange(len(self.heading)) / GRID_HZ
        step_m = np.linalg.norm(np.diff(self.floor_m, axis=0, prepend=self.floor_m[:1]), axis=1)
        size = figure.offsets_m[figure.names.index("left_knee"), 2] / _THIGH_M
        # Slow steps are shorter ones: the gait runs at the square root of the speed, as it does in people.
        pace = np.sqrt(step_m * GRID_HZ / size) / _STRIDE_M
        gait = np.interp(time_s, grid, self.phase + 2.0 * np.pi * np.cumsum(pace) / GRID_HZ)
        swing = np.interp(time_s, grid, gaussian_filter1d(smooth_step(step_m * GRID_HZ / 1.2), 0.1 * GRID_HZ))
        angles = walk_pose(gait, swing) | small_movements(time_s, self.phase)
        embrace = np.interp(time_s, grid, self.embrace)
        mixed = _mix(angles, _embracing(embrace), embrace)
        rotations = np.stack([joint_rotations(mixed, joint, len(time_s)) for joint in figure.joints], axis=1)
        facing = Rotation.from_euler("z", np.interp(time_s, grid, self.heading)[:, None]).as_matrix()
        root_joint = figure.joints.index("mid_hip")
        rotations[:, root_joint] = facing @ rotations[:, root_joint]
        root = np.zeros((len(time_s), 3))
        root[:, :2] = make_interp_spline(grid, self.floor_m)(np.minimum(time_s, grid[-1]))
        positions = figure.positions(root, rotations)
        feet = positions[:, [figure.names.index(foot) for foot in FEET], 2]
        positions[..., 2] -= soft_minimum(feet)[:, None]
        positions[~self.present(time_s)] = np.nan
        return positions


def stroll(plans: tuple[Plan, ...], half_room_m: float, duration_s: float, rng: np.random.Generator) -> list[Walk]:
    """People who walk to and fro across a room, in by a door somewhere around it and out by one.

    Args:
        plans: one for each person.
        half_room_m: goals lie within so far of the middle, doors 0.8 m beyond.
        duration_s: how long.
        rng: where their whims come from.
    """
    crowd = _Strollers(plans, half_room_m, rng)
    n_steps = _steps(duration_s)
    floor = np.empty((n_steps, len(plans), 2))
    there = np.empty((n_steps, len(plans)), dtype=bool)
    for step in range(n_steps):
        there[step], floor[step] = crowd.inside, crowd.place_m
        crowd.advance(step / GRID_HZ)
    floor = gaussian_filter1d(floor, 0.12 * GRID_HZ, axis=0, mode="nearest")
    return [
        Walk(
            floor[:, p], follow(floor[:, p]), np.zeros(n_steps), _spans(there[:, p]), float(rng.uniform(-np.pi, np.pi))
        )
        for p in range(len(plans))
    ]


class _Strollers:
    """The state of people who stroll: one step after the other."""

    def __init__(self, plans: tuple[Plan, ...], half_room_m: float, rng: np.random.Generator) -> None:
        n = len(plans)
        self.plans, self.room_m, self.rng = plans, half_room_m, rng
        angle = 2.0 * np.pi * (np.arange(n) + rng.uniform(-0.2, 0.2, n)) / n + rng.uniform(-np.pi, np.pi)
        self.inside = np.array([plan.enter_s <= 0.0 for plan in plans])
        self.place_m = np.where(self.inside, 0.8 * half_room_m, half_room_m + 0.8)[:, None] * _around(angle)
        self.velocity = np.zeros((n, 2))
        self.speed = rng.uniform(1.0, 1.4, n)
        self.goal_m = np.stack([self._across(p) for p in range(n)])
        self.pause_until_s = np.zeros(n)
        self.leaving = np.zeros(n, dtype=bool)
        self.enter_s = np.array([plan.enter_s for plan in plans])
        self.leave_s = np.array([plan.leave_s for plan in plans])

    def advance(self, time_s: float) -> None:
        """From this time to the next on the grid."""
        for p in range(len(self.plans)):
            self._decide(p, time_s)
        self._walk(time_s)
        self._keep_apart()

    def _decide(self, p: int, time_s: float) -> None:
        """Come in, go on, make for the door, go out."""
        near = np.linalg.norm(self.goal_m[p] - self.place_m[p]) < _ARRIVED_M
        if not self.inside[p]:
            if time_s >= self.enter_s[p] and self._is_free(self.place_m[p]):
                self.inside[p], self.goal_m[p] = True, self._across(p)
        elif self.leaving[p]:
            if near:
                self.inside[p] = self.leaving[p] = False
                self.enter_s[p], self.leave_s[p] = time_s + self.plans[p].away_s, np.inf
                self.goal_m[p] = self._door(p, 1.0)
        elif time_s >= self.leave_s[p]:
            self.leaving[p], self.goal_m[p], self.pause_until_s[p] = True, self._door(p, 0.7), 0.0
        elif near and time_s >= self.pause_until_s[p]:
            self.goal_m[p] = self._across(p)
            self.pause_until_s[p] = time_s + (self.rng.uniform(0.5, 2.0) if self.rng.random() < 0.3 else 0.0)

    def _is_free(self, place_m: np.ndarray) -> bool:
        """Whether nobody stands in the door."""
        return not (np.linalg.norm(self.place_m[self.inside] - place_m, axis=1) < 1.0).any()

    def _across(self, p: int) -> np.ndarray:
        """A place on the other side of the room."""
        angle = np.arctan2(self.place_m[p, 1], self.place_m[p, 0]) + np.pi + self.rng.uniform(-0.9, 0.9)
        return self.rng.uniform(0.5, 1.0) * self.room_m * _around(angle)

    def _door(self, p: int, spread: float) -> np.ndarray:
        """A place outside, not far from here."""
        angle = np.arctan2(self.place_m[p, 1], self.place_m[p, 0]) + self.rng.uniform(-spread, spread)
        return (self.room_m + 0.8 + _ARRIVED_M) * _around(angle)

    def _walk(self, time_s: float) -> None:
        way = self.goal_m - self.place_m
        far = np.linalg.norm(way, axis=1)
        # Those who go out do not slow down for the door.
        eager = np.where(self.leaving, 1.0, np.minimum(1.0, far / 0.6)) * (time_s >= self.pause_until_s)
        wanted = way / np.maximum(far, 1e-9)[:, None] * (self.speed * eager)[:, None]
        force = (wanted - self.velocity) / _RELAXATION_S + self._push()
        self.velocity += force / GRID_HZ
        pace = np.linalg.norm(self.velocity, axis=1)
        self.velocity *= (np.minimum(pace, 1.7) / np.maximum(pace, 1e-9))[:, None]
        self.place_m = self.place_m + self.velocity / GRID_HZ

    def _push(self) -> np.ndarray:
        """Shape (person, 2): away from the others and to the right of them, m/s^2."""
        apart = self.place_m[:, None] - self.place_m[None]
        gap = np.linalg.norm(apart, axis=-1)
        both = self.inside[:, None] & self.inside[None] & ~np.eye(len(gap), dtype=bool)
        strength = np.where(both, np.minimum(8.0, 3.0 * np.exp((0.7 - gap) / 0.25)), 0.0)
        away = apart / np.maximum(gap, 1e-9)[..., None]
        sideways = np.stack([-away[..., 1], away[..., 0]], axis=-1)
        return (strength[..., None] * (away + 0.6 * sideways)).sum(axis=1)

    def _keep_apart(self) -> None:
        here = np.flatnonzero(self.inside)
        for _ in range(8):
            apart = self.place_m[here, None] - self.place_m[None, here]
            gap = np.linalg.norm(apart, axis=-1) + np.eye(len(here)) * 9.0
            lack = np.maximum(0.0, _LEAST_GAP_M - gap)
            if not lack.any():
                return
            away = apart / np.maximum(gap, 1e-9)[..., None]
            self.place_m[here] += (0.5 * lack[..., None] * away).sum(axis=1)


def meet(
    distance_m: tuple[np.ndarray, np.ndarray],
    bearing: tuple[np.ndarray, np.ndarray],
    embrace_s: tuple[float, float],
    facing_s: tuple[float, float],
    duration_s: float,
) -> list[Walk]:
    """Two people about one place, each half the distance from it on either side.

    Args:
        distance_m: times, s, and how far they are apart then, joined smoothly.
        bearing: times, s, and the direction from the second to the first then, radians.
        embrace_s: from and to when they hold each other.
        facing_s: from and to when they look at each other, wherever they step.
        duration_s: how long.
    """
    time_s = np.arange(_steps(duration_s)) / GRID_HZ
    apart, angle = (PchipInterpolator(*keys)(np.clip(time_s, 0.0, keys[0][-1])) for keys in (distance_m, bearing))
    offset = gaussian_filter1d(0.5 * apart[:, None] * _around(angle), 0.1 * GRID_HZ, axis=0, mode="nearest")
    hold = smooth_step((time_s - embrace_s[0] + 0.5) / 0.5) * (1.0 - smooth_step((time_s - embrace_s[1]) / 0.5))
    face = (time_s >= facing_s[0]) & (time_s < facing_s[1])
    return [
        Walk(sign * offset, follow(sign * offset, -sign * offset, face), hold, ((0.0, np.inf),), phase)
        for sign, phase in ((1.0, 0.0), (-1.0, 1.0))
    ]


def follow(floor_m: np.ndarray, towards_m: np.ndarray | None = None, facing: np.ndarray | None = None) -> np.ndarray:
    """Shape (step,): the heading of someone who looks where they go, or at something.

    Args:
        floor_m: shape (step, 2): where they are.
        towards_m: shape (step, 2): what they look at.
        facing: shape (step,), bool: when.
    """
    velocity = np.gradient(floor_m, axis=0) * GRID_HZ
    will = np.minimum(1.0, np.linalg.norm(velocity, axis=1) / 0.4)
    if towards_m is not None and facing is not None:
        velocity = np.where(facing[:, None], towards_m - floor_m, velocity)
        will = np.where(facing, 1.0, will)
    wanted = np.arctan2(velocity[:, 1], velocity[:, 0])
    moving = np.flatnonzero(will > 0.3)
    heading = np.empty(len(floor_m))
    now = wanted[moving[0]] if len(moving) else 0.0
    for step, (to, hard) in enumerate(zip(wanted, will, strict=True)):
        now += (np.mod(to - now + np.pi, 2.0 * np.pi) - np.pi) * hard / (_TURN_S * GRID_HZ)
        heading[step] = now
    return heading


def _embracing(embrace: np.ndarray) -> dict[str, tuple[np.ndarray, ...]]:
    zero = np.zeros_like(embrace)
    pose = {"spine": (6.0 + zero, zero, zero), "upper_neck": (4.0 + zero, 6.0 + zero, zero)}
    for side, sign, lift in (("left", 1.0, 55.0), ("right", -1.0, 70.0)):
        pose[f"{side}_shoulder"] = (-lift + zero, zero, -12.0 * sign + zero)
        pose[f"{side}_elbow"] = (-50.0 + zero, zero, zero)
    return pose


def _mix(
    one: dict[str, tuple[np.ndarray, ...]], other: dict[str, tuple[np.ndarray, ...]], share: np.ndarray
) -> dict[str, np.ndarray]:
    """Bends between two poses, shape (time, 3) each."""
    mixed = {}
    for joint in one.keys() | other.keys():
        nothing = (np.zeros_like(share),) * 3
        a, b = (np.stack(np.broadcast_arrays(*pose.get(joint, nothing)), axis=-1) for pose in (one, other))
        mixed[joint] = (1.0 - share)[:, None] * a + share[:, None] * b
    return mixed


def _around(angle: np.ndarray) -> np.ndarray:
    """Shape (..., 2): unit vectors."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _steps(duration_s: float) -> int:
    return int(np.ceil(duration_s * GRID_HZ)) + 5


def _spans(there: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Times from and to of the runs of true values; the last has no end."""
    edges = np.flatnonzero(np.diff(there.astype(int), prepend=0, append=0)) / GRID_HZ
    spans = [(float(start), float(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]
    if spans and there[-1]:
        spans[-1] = (spans[-1][0], np.inf)
    return tuple(spans)
