"""Simulate people who walk along paths on the floor and avoid each other.

Paths are computed on a fixed time grid, so a scene is the same at every frame rate. Strolling people are particles with
a goal across the room. A social force (Helbing & Molnar 1995, Social force model for pedestrian dynamics) pushes them
apart and to the right of each other, and a minimum distance is enforced.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator, make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from posefuse.synthetic.figures import Figure
from posefuse.synthetic.motions import FEET, joint_rotations, small_movements, smooth_step, soft_minimum, walk_pose

GRID_HZ = 50.0
_MIN_GAP_M = 0.62
_ARRIVED_M = 0.35
_RELAXATION_S = 0.4
_TURN_S = 0.25
_STRIDE_M = 1.3
_THIGH_M = -0.43


@dataclass(frozen=True)
class Attendance:
    """Times at which a person enters and leaves the room.

    Attributes:
        enter_s: time at which the person enters; 0 if present from the start.
        leave_s: time at which the person starts walking to the door; infinity for never.
        away_s: time between leaving and returning for good; infinity for never.
    """

    enter_s: float = 0.0
    leave_s: float = np.inf
    away_s: float = np.inf


@dataclass(frozen=True)
class Walk:
    """Path of one person through a scene, sampled at ``GRID_HZ``.

    Attributes:
        floor_m: shape (step, 2): floor position below the hips.
        heading: shape (step,), radians from x, without jumps.
        embrace: shape (step,), 0 to 1: how far the arms are closed around another person.
        spans_s: intervals of presence, (start, end), end excluded.
        phase: gait phase at the start, radians.
    """

    floor_m: np.ndarray
    heading: np.ndarray
    embrace: np.ndarray
    spans_s: tuple[tuple[float, float], ...]
    phase: float = 0.0

    def present(self, time_s: np.ndarray) -> np.ndarray:
        """Return whether the person is present, shape (time,), bool."""
        present = [(time_s >= start) & (time_s < stop) for start, stop in self.spans_s]
        return np.any(present, axis=0) if present else np.zeros(time_s.shape, dtype=bool)

    def positions(self, figure: Figure, time_s: np.ndarray) -> np.ndarray:
        """Return the node positions of a human figure in meters, shape (time, node, 3); NaN during absence."""
        grid = np.arange(len(self.heading)) / GRID_HZ
        step_m = np.linalg.norm(np.diff(self.floor_m, axis=0, prepend=self.floor_m[:1]), axis=1)
        size = figure.offsets_m[figure.names.index("left_knee"), 2] / _THIGH_M
        # Slow steps are shorter: cadence grows with the square root of the speed, as in people.
        pace = np.sqrt(step_m * GRID_HZ / size) / _STRIDE_M
        gait = np.interp(time_s, grid, self.phase + 2.0 * np.pi * np.cumsum(pace) / GRID_HZ)
        swing = np.interp(time_s, grid, gaussian_filter1d(smooth_step(step_m * GRID_HZ / 1.2), 0.1 * GRID_HZ))
        angles = walk_pose(gait, swing) | small_movements(time_s, self.phase)
        embrace = np.interp(time_s, grid, self.embrace)
        mixed = _blend_poses(angles, _embrace_pose(embrace), embrace)
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


def stroll(
    attendances: tuple[Attendance, ...], half_room_m: float, duration_s: float, rng: np.random.Generator
) -> list[Walk]:
    """Simulate people who walk back and forth across a room and enter and leave through doors around it.

    Args:
        attendances: one per person.
        half_room_m: maximum distance of goals from the center; doors are 0.8 m farther out.
        duration_s: length of the scene.
        rng: random generator.
    """
    crowd = _StrollSimulation(attendances, half_room_m, rng)
    n_steps = _step_count(duration_s)
    floor = np.empty((n_steps, len(attendances), 2))
    present = np.empty((n_steps, len(attendances)), dtype=bool)
    for step in range(n_steps):
        present[step], floor[step] = crowd.inside, crowd.position_m
        crowd.advance(step / GRID_HZ)
    floor = gaussian_filter1d(floor, 0.12 * GRID_HZ, axis=0, mode="nearest")
    return [
        Walk(
            floor[:, p],
            heading_along(floor[:, p]),
            np.zeros(n_steps),
            _true_intervals(present[:, p]),
            float(rng.uniform(-np.pi, np.pi)),
        )
        for p in range(len(attendances))
    ]


class _StrollSimulation:
    """State of strolling people, advanced step by step."""

    def __init__(self, attendances: tuple[Attendance, ...], half_room_m: float, rng: np.random.Generator) -> None:
        n = len(attendances)
        self.attendances, self.room_m, self.rng = attendances, half_room_m, rng
        angle = 2.0 * np.pi * (np.arange(n) + rng.uniform(-0.2, 0.2, n)) / n + rng.uniform(-np.pi, np.pi)
        self.inside = np.array([attendance.enter_s <= 0.0 for attendance in attendances])
        self.position_m = np.where(self.inside, 0.8 * half_room_m, half_room_m + 0.8)[:, None] * _unit_vectors(angle)
        self.velocity = np.zeros((n, 2))
        self.speed = rng.uniform(1.0, 1.4, n)
        self.goal_m = np.stack([self._goal_across(p) for p in range(n)])
        self.pause_until_s = np.zeros(n)
        self.leaving = np.zeros(n, dtype=bool)
        self.enter_s = np.array([attendance.enter_s for attendance in attendances])
        self.leave_s = np.array([attendance.leave_s for attendance in attendances])

    def advance(self, time_s: float) -> None:
        """Advance the state from this grid time to the next."""
        for p in range(len(self.attendances)):
            self._update_goal(p, time_s)
        self._move(time_s)
        self._enforce_minimum_gap()

    def _update_goal(self, p: int, time_s: float) -> None:
        """Update a person's presence and goal: enter, walk on, head for the door, or leave."""
        near = np.linalg.norm(self.goal_m[p] - self.position_m[p]) < _ARRIVED_M
        if not self.inside[p]:
            if time_s >= self.enter_s[p] and self._is_door_free(self.position_m[p]):
                self.inside[p], self.goal_m[p] = True, self._goal_across(p)
        elif self.leaving[p]:
            if near:
                self.inside[p] = self.leaving[p] = False
                self.enter_s[p], self.leave_s[p] = time_s + self.attendances[p].away_s, np.inf
                self.goal_m[p] = self._door_position(p, 1.0)
        elif time_s >= self.leave_s[p]:
            self.leaving[p], self.goal_m[p], self.pause_until_s[p] = True, self._door_position(p, 0.7), 0.0
        elif near and time_s >= self.pause_until_s[p]:
            self.goal_m[p] = self._goal_across(p)
            self.pause_until_s[p] = time_s + (self.rng.uniform(0.5, 2.0) if self.rng.random() < 0.3 else 0.0)

    def _is_door_free(self, position_m: np.ndarray) -> bool:
        """Return whether no person is within 1 m of a door."""
        return not (np.linalg.norm(self.position_m[self.inside] - position_m, axis=1) < 1.0).any()

    def _goal_across(self, p: int) -> np.ndarray:
        """Return a random goal on the other side of the room."""
        angle = np.arctan2(self.position_m[p, 1], self.position_m[p, 0]) + np.pi + self.rng.uniform(-0.9, 0.9)
        return self.rng.uniform(0.5, 1.0) * self.room_m * _unit_vectors(angle)

    def _door_position(self, p: int, spread: float) -> np.ndarray:
        """Return a door position near the person, outside the room."""
        angle = np.arctan2(self.position_m[p, 1], self.position_m[p, 0]) + self.rng.uniform(-spread, spread)
        return (self.room_m + 0.8 + _ARRIVED_M) * _unit_vectors(angle)

    def _move(self, time_s: float) -> None:
        way = self.goal_m - self.position_m
        far = np.linalg.norm(way, axis=1)
        # People who leave do not slow down at the door.
        eager = np.where(self.leaving, 1.0, np.minimum(1.0, far / 0.6)) * (time_s >= self.pause_until_s)
        target = way / np.maximum(far, 1e-9)[:, None] * (self.speed * eager)[:, None]
        force = (target - self.velocity) / _RELAXATION_S + self._repulsion()
        self.velocity += force / GRID_HZ
        pace = np.linalg.norm(self.velocity, axis=1)
        self.velocity *= (np.minimum(pace, 1.7) / np.maximum(pace, 1e-9))[:, None]
        self.position_m = self.position_m + self.velocity / GRID_HZ

    def _repulsion(self) -> np.ndarray:
        """Return the acceleration away from the others and to their right, shape (person, 2), m/s^2."""
        apart = self.position_m[:, None] - self.position_m[None]
        gap = np.linalg.norm(apart, axis=-1)
        both = self.inside[:, None] & self.inside[None] & ~np.eye(len(gap), dtype=bool)
        strength = np.where(both, np.minimum(8.0, 3.0 * np.exp((0.7 - gap) / 0.25)), 0.0)
        away = apart / np.maximum(gap, 1e-9)[..., None]
        sideways = np.stack([-away[..., 1], away[..., 0]], axis=-1)
        return (strength[..., None] * (away + 0.6 * sideways)).sum(axis=1)

    def _enforce_minimum_gap(self) -> None:
        here = np.flatnonzero(self.inside)
        for _ in range(8):
            apart = self.position_m[here, None] - self.position_m[None, here]
            gap = np.linalg.norm(apart, axis=-1) + np.eye(len(here)) * 9.0
            lack = np.maximum(0.0, _MIN_GAP_M - gap)
            if not lack.any():
                return
            away = apart / np.maximum(gap, 1e-9)[..., None]
            self.position_m[here] += (0.5 * lack[..., None] * away).sum(axis=1)


def meet(
    distance_m: tuple[np.ndarray, np.ndarray],
    bearing: tuple[np.ndarray, np.ndarray],
    embrace_s: tuple[float, float],
    facing_s: tuple[float, float],
    duration_s: float,
) -> list[Walk]:
    """Simulate two people who meet: both stay at half their distance from a common point, on opposite sides.

    Args:
        distance_m: times in s and the distances between the two people, interpolated smoothly.
        bearing: times in s and the directions from the second person to the first, radians.
        embrace_s: start and end of the embrace.
        facing_s: start and end of the interval in which they face each other, whatever their direction of walking.
        duration_s: length of the scene.
    """
    time_s = np.arange(_step_count(duration_s)) / GRID_HZ
    apart, angle = (PchipInterpolator(*keys)(np.clip(time_s, 0.0, keys[0][-1])) for keys in (distance_m, bearing))
    offset = gaussian_filter1d(0.5 * apart[:, None] * _unit_vectors(angle), 0.1 * GRID_HZ, axis=0, mode="nearest")
    hold = smooth_step((time_s - embrace_s[0] + 0.5) / 0.5) * (1.0 - smooth_step((time_s - embrace_s[1]) / 0.5))
    face = (time_s >= facing_s[0]) & (time_s < facing_s[1])
    return [
        Walk(sign * offset, heading_along(sign * offset, -sign * offset, face), hold, ((0.0, np.inf),), phase)
        for sign, phase in ((1.0, 0.0), (-1.0, 1.0))
    ]


def heading_along(
    floor_m: np.ndarray, toward_m: np.ndarray | None = None, facing: np.ndarray | None = None
) -> np.ndarray:
    """Return the heading of a person who looks in the direction of walking, or at a target, shape (step,).

    Args:
        floor_m: shape (step, 2): position of the person.
        toward_m: shape (step, 2): position of the target.
        facing: shape (step,), bool: whether the person looks at the target.
    """
    velocity = np.gradient(floor_m, axis=0) * GRID_HZ
    turn_rate = np.minimum(1.0, np.linalg.norm(velocity, axis=1) / 0.4)
    if toward_m is not None and facing is not None:
        velocity = np.where(facing[:, None], toward_m - floor_m, velocity)
        turn_rate = np.where(facing, 1.0, turn_rate)
    target = np.arctan2(velocity[:, 1], velocity[:, 0])
    moving = np.flatnonzero(turn_rate > 0.3)
    heading = np.empty(len(floor_m))
    now = target[moving[0]] if len(moving) else 0.0
    for step, (to, hard) in enumerate(zip(target, turn_rate, strict=True)):
        now += (np.mod(to - now + np.pi, 2.0 * np.pi) - np.pi) * hard / (_TURN_S * GRID_HZ)
        heading[step] = now
    return heading


def _embrace_pose(embrace: np.ndarray) -> dict[str, tuple[np.ndarray, ...]]:
    zero = np.zeros_like(embrace)
    pose = {"spine": (6.0 + zero, zero, zero), "upper_neck": (4.0 + zero, 6.0 + zero, zero)}
    for side, sign, lift in (("left", 1.0, 55.0), ("right", -1.0, 70.0)):
        pose[f"{side}_shoulder"] = (-lift + zero, zero, -12.0 * sign + zero)
        pose[f"{side}_elbow"] = (-50.0 + zero, zero, zero)
    return pose


def _blend_poses(
    one: dict[str, tuple[np.ndarray, ...]], other: dict[str, tuple[np.ndarray, ...]], share: np.ndarray
) -> dict[str, np.ndarray]:
    """Interpolate between the joint bends of two poses; each result has shape (time, 3)."""
    mixed = {}
    for joint in one.keys() | other.keys():
        nothing = (np.zeros_like(share),) * 3
        a, b = (np.stack(np.broadcast_arrays(*pose.get(joint, nothing)), axis=-1) for pose in (one, other))
        mixed[joint] = (1.0 - share)[:, None] * a + share[:, None] * b
    return mixed


def _unit_vectors(angle: np.ndarray) -> np.ndarray:
    """Return unit vectors at the given angles, shape (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _step_count(duration_s: float) -> int:
    return int(np.ceil(duration_s * GRID_HZ)) + 5


def _true_intervals(present: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Return start and end times of the runs of true values; a run that reaches the end has no end time."""
    edges = np.flatnonzero(np.diff(present.astype(int), prepend=0, append=0)) / GRID_HZ
    spans = [(float(start), float(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]
    if spans and present[-1]:
        spans[-1] = (spans[-1][0], np.inf)
    return tuple(spans)
