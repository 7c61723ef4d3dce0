"""Simulate smooth, seeded motion with constant bone lengths, defined at every time.

A human performs a list of activities (walk, turn, reach, sit, jump, stand). Each activity is a set of joint angles over
time, and angles blend smoothly between activities. The root moves along the heading while walking; its height puts the
lower foot on the floor, plus the flight height of a jump. The model is kinematic, not dynamic: realistic enough to test
cameras and filters.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from posefuse.synthetic.figures import FINGERS, Figure
from posefuse.synthetic.options import ACTIVITIES, Activity

_CROSSOVER_S = 0.5
_GRAVITY = 9.81
_AIRBORNE_S = 0.7
FEET = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("heel", "big_toe", "small_toe"))


@dataclass(frozen=True)
class HumanMotion:
    """Parameters of one person's motion.

    Attributes:
        activities: activities, each performed for ``activity_s``, repeated from the start.
        activity_s: duration of each activity.
        cadence_hz: gait cycles per second.
        stride_m: distance per gait cycle.
        path_radius_m: radius of the circular path.
        start_m: shape (2,): center of the circle on the floor.
        heading: heading at time 0, radians from x.
        phase: gait phase at time 0, radians.
    """

    activities: tuple[Activity, ...]
    activity_s: float
    cadence_hz: float
    stride_m: float
    path_radius_m: float
    start_m: tuple[float, float]
    heading: float
    phase: float

    @classmethod
    def random(cls, activities: tuple[Activity, ...], rng: np.random.Generator) -> "HumanMotion":
        """Sample the parameters of a person's motion."""
        return cls(
            activities=activities,
            activity_s=3.0,
            cadence_hz=float(rng.uniform(0.8, 1.0)),
            stride_m=float(rng.uniform(1.1, 1.4)),
            path_radius_m=float(rng.uniform(0.8, 1.3)),
            start_m=(float(rng.uniform(-0.2, 0.2)), float(rng.uniform(-0.2, 0.2))),
            heading=float(rng.uniform(-np.pi, np.pi)),
            phase=float(rng.uniform(-np.pi, np.pi)),
        )

    def positions(self, figure: Figure, time_s: np.ndarray) -> np.ndarray:
        """Return the node positions of the figure in meters, shape (time, node, 3).

        Args:
            figure: human figure.
            time_s: shape (time,), at least 0, in any order.
        """
        weights = self._weights(time_s)
        gait = self.phase + 2.0 * np.pi * self.cadence_hz * time_s
        angles = self._angles(time_s, gait, weights)
        walked, turned = self._progress(time_s)
        heading = self.heading + walked / self.path_radius_m + turned
        rotations = np.stack([joint_rotations(angles, joint, len(time_s)) for joint in figure.joints], axis=1)
        facing = Rotation.from_euler("z", heading[:, None]).as_matrix()
        root_joint = figure.joints.index("mid_hip")
        rotations[:, root_joint] = facing @ rotations[:, root_joint]
        around = self.heading + walked / self.path_radius_m - np.pi / 2
        root = np.zeros((len(time_s), 3))
        root[:, 0] = self.start_m[0] + self.path_radius_m * np.cos(around)
        root[:, 1] = self.start_m[1] + self.path_radius_m * np.sin(around)
        positions = figure.positions(root, rotations)
        feet = positions[:, [figure.names.index(foot) for foot in FEET], 2]
        positions[..., 2] += (self._flight(time_s) - soft_minimum(feet))[:, None]
        return positions

    def _slot(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the running number of the activity and the time since its start."""
        slot = np.floor(time_s / self.activity_s).astype(int)
        return slot, time_s - slot * self.activity_s

    def _weights(self, time_s: np.ndarray) -> dict[Activity, np.ndarray]:
        slot, since = self._slot(time_s)
        fresh = smooth_step(since / _CROSSOVER_S)
        names = np.array(self.activities)
        now, before = names[slot % len(names)], names[np.maximum(slot - 1, 0) % len(names)]
        return {a: np.where(now == a, fresh, 0.0) + np.where(before == a, 1.0 - fresh, 0.0) for a in ACTIVITIES}

    def _progress(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the distance walked in m and the angle turned on the spot in radians since time 0."""
        end = float(np.max(time_s, initial=0.0)) + 1e-3
        grid = np.linspace(0.0, end, int(np.ceil(end * 100)) + 2)
        step = grid[1] - grid[0]
        weights = self._weights(grid)
        walked, turned = (
            np.concatenate([[0.0], np.cumsum(0.5 * (w[1:] + w[:-1])) * step])
            for w in (weights["walk"], weights["turn"])
        )
        speed = self.cadence_hz * self.stride_m
        return speed * np.interp(time_s, grid, walked), 1.2 * np.interp(time_s, grid, turned)

    def _flight(self, time_s: np.ndarray) -> np.ndarray:
        """Return the flight height in m: one bell per jump, with the curvature of gravity at its top.

        A parabola would start with a step in velocity, which no body can produce.
        """
        slot, since = self._slot(time_s)
        jumping = np.array(self.activities)[slot % len(self.activities)] == "jump"
        t = np.clip((since - self.activity_s / 2) / _AIRBORNE_S, -0.5, 0.5)
        height = _GRAVITY * (_AIRBORNE_S / np.pi) ** 2 / 2 * np.cos(np.pi * t) ** 2
        return np.where(jumping, height, 0.0)

    def _angles(
        self, time_s: np.ndarray, gait: np.ndarray, weights: Mapping[Activity, np.ndarray]
    ) -> dict[str, np.ndarray]:
        """Return joint name -> (bend forward, lean left, turn left) in degrees, shape (time, 3)."""
        _, since = self._slot(time_s)
        poses: dict[Activity, dict[str, tuple[np.ndarray, ...]]] = {
            "walk": walk_pose(gait),
            "turn": walk_pose(gait, swing=0.35),
            "reach": _reach(since),
            "sit": _sit(since, self.activity_s),
            "jump": _crouch(since - self.activity_s / 2),
            "stand": {},
        }
        total: dict[str, np.ndarray] = {}
        for activity, pose in poses.items():
            for joint, bends in pose.items():
                bend = np.stack([np.broadcast_to(b, time_s.shape) for b in bends], axis=-1)
                total[joint] = total.get(joint, 0.0) + weights[activity][:, None] * bend
        return total | {joint: np.stack(bends, axis=-1) for joint, bends in small_movements(time_s, self.phase).items()}


@dataclass(frozen=True)
class CreatureMotion:
    """Motion of an arbitrary figure: every joint follows the sum of three sines, and the root wanders.

    Attributes:
        seed: seed of the frequencies and phases.
        reach_m: maximum excursion of the root along each axis.
        swing_deg: amplitude of the joint angles.
        height_m: mean height of the root.
    """

    seed: int
    reach_m: float
    swing_deg: float = 25.0
    height_m: float = 0.0

    def positions(self, figure: Figure, time_s: np.ndarray) -> np.ndarray:
        """Return the node positions of the figure in meters, shape (time, node, 3)."""
        rng = np.random.default_rng(self.seed)
        n = len(figure.joints)

        def waves(width: int) -> np.ndarray:
            rates, phases = rng.uniform(0.2, 1.2, (width, 3)), rng.uniform(0, 2 * np.pi, (width, 3))
            return np.sin(2 * np.pi * time_s[:, None, None] * rates + phases).sum(axis=-1) / 3.0

        swings = np.radians(self.swing_deg) * waves(3 * n).reshape(len(time_s), n, 3)
        rotations = Rotation.from_rotvec(swings.reshape(-1, 3)).as_matrix().reshape(len(time_s), n, 3, 3)
        root = self.reach_m * waves(3) + np.array([0.0, 0.0, self.height_m])
        return figure.positions(root, rotations)


def joint_rotations(angles: Mapping[str, np.ndarray], joint: str, n: int) -> np.ndarray:
    """Return the rotations of a joint, shape (n, 3, 3), from bends in degrees: forward, to the left, turned left."""
    if joint not in angles:
        return np.broadcast_to(np.eye(3), (n, 3, 3))
    bend, lean, turn = angles[joint].T
    # A forward bend rotates about the y axis (to the left), a lean about x, a turn about z.
    return Rotation.from_euler("ZXY", np.stack([turn, -lean, bend], axis=-1), degrees=True).as_matrix()


def walk_pose(gait: np.ndarray, swing: float | np.ndarray = 1.0) -> dict[str, tuple[np.ndarray, ...]]:
    """Return the joint bends of a walker in degrees by gait phase; ``swing`` 0 means standing still."""
    zero = np.zeros_like(gait)
    pose = {
        "mid_hip": (3.0 + zero, 2.0 * swing * np.sin(gait), 4.0 * swing * np.sin(gait)),
        "spine": (3.0 + zero, -2.0 * swing * np.sin(gait), -8.0 * swing * np.sin(gait)),
        "upper_neck": (2.0 * np.sin(2 * gait), zero, 4.0 * swing * np.sin(gait)),
    }
    for side, phase, sign in (("left", 0.0, 1.0), ("right", np.pi, -1.0)):
        leg = gait + phase
        pose[f"{side}_hip"] = (-25.0 * swing * np.sin(leg) - 5.0, 1.5 * sign + zero, zero)
        pose[f"{side}_knee"] = (8.0 + 26.0 * (0.4 + 0.6 * swing) * (1.0 + np.cos(leg)), zero, zero)
        pose[f"{side}_ankle"] = (-8.0 * np.sin(leg + 0.6) - 4.0, zero, zero)
        pose[f"{side}_shoulder"] = (20.0 * swing * np.sin(leg), 8.0 * sign + zero, zero)
        pose[f"{side}_elbow"] = (-22.0 + 10.0 * np.sin(leg), zero, zero)
    return pose


def small_movements(time_s: np.ndarray, phase: float) -> dict[str, tuple[np.ndarray, ...]]:
    """Return the bends of fingers that open and close one after the other, and of a talking jaw, in degrees.

    Args:
        time_s: shape (time,).
        phase: phase of the person, radians.
    """
    zero = np.zeros_like(time_s)
    pose = {"jaw": (12.0 * np.sin(2.0 * np.pi * 0.9 * time_s + phase) ** 2, zero, zero)}
    for side, sign, hand in (("left", 1.0, 0.0), ("right", -1.0, 2.0)):
        for i, finger in enumerate(FINGERS):
            closed = 0.5 - 0.5 * np.cos(2.0 * np.pi * 0.4 * time_s + phase + hand + 0.3 * i)
            most = (15.0, 25.0, 25.0) if finger == "thumb" else (65.0, 75.0, 45.0)
            for j, bend in enumerate(most):
                pose[f"{side}_{finger}_{j + 1}"] = (zero, sign * (8.0 + bend * closed), zero)
    return pose


def _reach(since: np.ndarray) -> dict[str, tuple[np.ndarray, ...]]:
    lift = smooth_step(since / 1.2) * (1.0 - smooth_step((since - 1.8) / 1.0))
    zero = np.zeros_like(since)
    pose = {
        "spine": (18.0 * lift, zero, 12.0 * lift),
        "upper_neck": (-10.0 * lift, zero, zero),
        "left_shoulder": (-60.0 * lift, 20.0 * lift, zero),
        "right_shoulder": (-125.0 * lift, -15.0 * lift, zero),
        "right_wrist": (-15.0 * lift, zero, zero),
    }
    for side in ("left", "right"):
        pose[f"{side}_elbow"] = (-25.0 + 10.0 * lift, zero, zero)
    return pose


def _sit(since: np.ndarray, length: float) -> dict[str, tuple[np.ndarray, ...]]:
    down = smooth_step(since / 1.0) * (1.0 - smooth_step((since - length + 0.9) / 0.9))
    return _squat(85.0 * down, 90.0 * down, 20.0 * down * (1.0 - 0.6 * down))


def _crouch(t: np.ndarray) -> dict[str, tuple[np.ndarray, ...]]:
    """Return a pose that crouches before take-off and after landing; the jump is centered at 0 s."""
    down = np.exp(-(((t + 0.5) / 0.2) ** 2)) + 0.8 * np.exp(-(((t - 0.45) / 0.2) ** 2))
    pose = _squat(60.0 * down, 75.0 * down, 30.0 * down)
    swing = 60.0 * np.exp(-((t / 0.3) ** 2)) - 30.0 * down
    for side, sign in (("left", 1.0), ("right", -1.0)):
        pose[f"{side}_shoulder"] = (-swing, 8.0 * sign + 0.0 * t, 0.0 * t)
    return pose


def _squat(hip: np.ndarray, knee: np.ndarray, lean: np.ndarray) -> dict[str, tuple[np.ndarray, ...]]:
    zero = np.zeros_like(hip)
    pose = {"mid_hip": (lean, zero, zero), "upper_neck": (-0.5 * lean, zero, zero)}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        pose[f"{side}_hip"] = (-hip - lean, 4.0 * sign + zero, zero)
        pose[f"{side}_knee"] = (knee, zero, zero)
        pose[f"{side}_ankle"] = (hip - knee, zero, zero)
        pose[f"{side}_elbow"] = (-20.0 + zero, zero, zero)
    return pose


def smooth_step(x: np.ndarray) -> np.ndarray:
    """Return a step from 0 to 1 over the interval 0 to 1, with two continuous derivatives."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def soft_minimum(heights: np.ndarray, softness_m: float = 0.01) -> np.ndarray:
    """Return a smooth approximation of the minimum over the last axis."""
    low = heights.min(axis=-1, keepdims=True)
    return low[..., 0] - softness_m * np.log(np.exp(-(heights - low) / softness_m).sum(axis=-1))
