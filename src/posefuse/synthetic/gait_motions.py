"""Simulate legs whose feet touch levels and stay there: walking, running, stairs, jumping, squatting and sliding.

A plan states when and where each foot touches a level, and the path of the pelvis. A touching foot rolls over its heel,
rests, and rolls over its toes; between contacts it swings to the next place. The pelvis is as high as its plan states,
but no higher than both legs reach; the knees follow from the lengths of the legs. Heel strikes, toe-offs and contact
are therefore known exactly, which the motions of :mod:`posefuse.synthetic.motions`, whose feet slide, do not offer.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from posefuse.synthetic.figures import Figure
from posefuse.synthetic.motions import joint_rotations, small_movements, soft_minimum, walk_pose

SIDES = ("left", "right")
_SOLE_M = 0.015
"""Height of the keypoints of a flat foot above its level."""
_REACH = 0.995
"""Largest extension of a leg as a share of its length."""
_FOOT_NODES = ("heel", "big_toe", "small_toe", "foot_index")
_STRIKE_SPEED = 0.25
"""Speed of the foot when it strikes, as a share of its mean speed during the swing."""
_SLAP = 0.4
"""Share by which the foot slows down until all of it touches; the last part does not touch at rest."""
_GRAVITY = 9.81


@dataclass(frozen=True, eq=False)
class Stances:
    """Contacts of one foot with levels, in the order of time, each with shape (stance, ...).

    Attributes:
        start_s: time at which the heel, or with a negative ``strike_deg`` the toes, touch.
        flat_s: time at which the whole foot rests.
        rise_s: time at which the heel rises.
        end_s: time at which the toes leave.
        place_m: shape (stance, 3): point of the level below the ankle of the resting foot.
        heading: heading of the foot in radians.
        strike_deg: pitch of the foot when it touches, toes up.
        off_deg: pitch of the foot when it leaves, negative.
        clearance_m: height of the lowest keypoint in the swing after the stance.
        slide_m: shape (stance, 3): displacement of the resting foot from ``flat_s`` to ``rise_s``.
        airborne: whether the swing after the stance is a flight of the whole body.
    """

    start_s: np.ndarray
    flat_s: np.ndarray
    rise_s: np.ndarray
    end_s: np.ndarray
    place_m: np.ndarray
    heading: np.ndarray
    strike_deg: np.ndarray
    off_deg: np.ndarray
    clearance_m: np.ndarray
    slide_m: np.ndarray
    airborne: np.ndarray

    def __len__(self) -> int:
        return len(self.start_s)

    def contact(self, time_s: np.ndarray) -> np.ndarray:
        """Return whether the heel and the toes touch a level, shape (time, 2), bool."""
        i = self.latest(time_s)
        heel = np.where(self.strike_deg[i] >= 0, self.start_s[i], self.flat_s[i]) <= time_s
        toe = np.where(self.strike_deg[i] <= 0, self.start_s[i], self.flat_s[i]) <= time_s
        heel &= time_s < np.where(self.off_deg[i] < 0, self.rise_s[i], self.end_s[i])
        return np.stack([heel, toe & (time_s < self.end_s[i])], axis=1)

    def sliding(self, time_s: np.ndarray) -> np.ndarray:
        """Return whether the foot slides on its level, shape (time,), bool."""
        i = self.latest(time_s)
        inside = (time_s >= self.flat_s[i]) & (time_s < self.rise_s[i])
        return inside & (np.abs(self.slide_m[i]).max(axis=1) > 0)

    def latest(self, time_s: np.ndarray) -> np.ndarray:
        """Return the index of the last stance that has begun, shape (time,)."""
        return np.clip(np.searchsorted(self.start_s, time_s, side="right") - 1, 0, len(self) - 1)


@dataclass(frozen=True, eq=False)
class PelvisPath:
    """Path of the pelvis at knots in time.

    Attributes:
        time_s: shape (knot,).
        place_m: shape (knot, 2): horizontal position on the floor, or on the belt of a treadmill.
        heading: shape (knot,): heading in radians.
        level_m: shape (knot,): height of the level below the pelvis.
        drop_m: shape (knot,): lowering by bent knees.
        lift_m: shape (knot,): height of a flight.
        lean_deg: shape (knot,): forward lean of the trunk.
        belt_m: shape (knot, 2): displacement of the belt, zero overground.
    """

    time_s: np.ndarray
    place_m: np.ndarray
    heading: np.ndarray
    level_m: np.ndarray
    drop_m: np.ndarray
    lift_m: np.ndarray
    lean_deg: np.ndarray
    belt_m: np.ndarray

    def at(self, name: str, time_s: np.ndarray) -> np.ndarray:
        """Return a quantity at any time; it is constant before the first knot and after the last one."""
        clipped = np.clip(time_s, self.time_s[0], self.time_s[-1])
        return CubicSpline(self.time_s, getattr(self, name))(clipped)


@dataclass(frozen=True, eq=False)
class GaitMotion:
    """Motion of one person whose contacts are known.

    Attributes:
        left: contacts of the left foot.
        right: contacts of the right foot.
        pelvis: path of the pelvis.
        swing_hz: frequency of the arms, 0 for arms that hang.
        swing: amplitude of the arms, 1 for normal walking.
        phase: phase of the arms at time 0 in radians.
    """

    left: Stances
    right: Stances
    pelvis: PelvisPath
    swing_hz: float = 0.0
    swing: float = 1.0
    phase: float = 0.0

    @property
    def feet(self) -> tuple[Stances, Stances]:
        """Contacts of the left and of the right foot."""
        return self.left, self.right

    def contact(self, time_s: np.ndarray) -> np.ndarray:
        """Return whether the heel and the toes of each foot touch a level, shape (time, side, 2), bool."""
        return np.stack([foot.contact(time_s) for foot in self.feet], axis=1)

    def positions(self, figure: Figure, time_s: np.ndarray) -> np.ndarray:
        """Return the node positions of the figure in meters, shape (time, node, 3).

        Args:
            figure: human figure.
            time_s: shape (time,), in any order.
        """
        facing = Rotation.from_euler("z", self.pelvis.at("heading", time_s)[:, None]).as_matrix()
        points = figure.positions(np.zeros((len(time_s), 3)), self._rotations(figure, time_s, facing))
        points[..., :2] += self.pelvis.at("place_m", time_s)[:, None]
        thigh, shank = (_length(figure, f"left_{name}") for name in ("knee", "ankle"))
        ankles, turns = zip(*(_foot_poses(figure, foot, time_s) for foot in self.feet), strict=True)
        hips = [points[:, figure.names.index(f"{side}_hip")] for side in SIDES]
        heights = [self._wanted_height(figure, time_s, thigh + shank)]
        for hip, ankle in zip(hips, ankles, strict=True):
            apart = np.square(hip[:, :2] - ankle[:, :2]).sum(axis=1)
            reach = np.square(_REACH * (thigh + shank)) - apart
            heights.append(ankle[:, 2] - hip[:, 2] + np.sqrt(np.maximum(reach, 1e-4)))
        points[..., 2] += soft_minimum(np.stack(heights, axis=1))[:, None]
        for side, hip_m, ankle, turn in zip(SIDES, hips, ankles, turns, strict=True):
            hip = points[:, figure.names.index(f"{side}_hip")]
            assert hip_m.shape == hip.shape
            points[:, figure.names.index(f"{side}_knee")] = _knees(hip, ankle, thigh, shank, facing[:, :, 0])
            points[:, figure.names.index(f"{side}_ankle")] = ankle
            for node in _FOOT_NODES:
                column = figure.names.index(f"{side}_{node}")
                points[:, column] = ankle + turn @ figure.offsets_m[column]
        points[..., :2] -= self.pelvis.at("belt_m", time_s)[:, None]
        return points

    def _wanted_height(self, figure: Figure, time_s: np.ndarray, leg_m: float) -> np.ndarray:
        standing = 0.985 * leg_m - figure.offsets_m[figure.names.index("left_heel"), 2] + _SOLE_M
        added = {name: self.pelvis.at(name, time_s) for name in ("level_m", "drop_m", "lift_m")}
        return standing + added["level_m"] - added["drop_m"] + added["lift_m"]

    def _rotations(self, figure: Figure, time_s: np.ndarray, facing: np.ndarray) -> np.ndarray:
        """Return the rotations of all joints, shape (time, joint, 3, 3); those of the legs are not used."""
        pose = walk_pose(self.phase + 2.0 * np.pi * self.swing_hz * time_s, self.swing)
        lean = self.pelvis.at("lean_deg", time_s)
        pose["mid_hip"] = (pose["mid_hip"][0] + lean, *pose["mid_hip"][1:])
        pose |= small_movements(time_s, self.phase)
        angles = {
            joint: np.stack([np.broadcast_to(bend, time_s.shape) for bend in bends], axis=-1)
            for joint, bends in pose.items()
        }
        rotations = np.stack([joint_rotations(angles, joint, len(time_s)) for joint in figure.joints], axis=1)
        root = figure.joints.index("mid_hip")
        rotations[:, root] = facing @ rotations[:, root]
        return rotations


def _length(figure: Figure, name: str) -> float:
    return float(np.linalg.norm(figure.offsets_m[figure.names.index(name)]))


def _knees(hip: np.ndarray, ankle: np.ndarray, thigh_m: float, shank_m: float, forward: np.ndarray) -> np.ndarray:
    """Return knees in front of the line from hip to ankle, from both bone lengths, shape (time, 3)."""
    along = ankle - hip
    far = np.linalg.norm(along, axis=1, keepdims=True)
    along = along / far
    down = (np.square(far) + thigh_m**2 - shank_m**2) / (2 * far)
    ahead = forward - (along * forward).sum(axis=1, keepdims=True) * along
    ahead = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    return hip + down * along + np.sqrt(np.maximum(thigh_m**2 - down**2, 0.0)) * ahead


def _foot_poses(figure: Figure, foot: Stances, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of the ankle, shape (time, 3), and the rotations of the foot, shape (time, 3, 3)."""
    i = foot.latest(time_s)
    stance = _stance_pose(figure, foot, i, time_s)
    moving = (time_s > foot.end_s[i]) & (i + 1 < len(foot))
    if not moving.any():
        return stance
    swing = _swing_pose(figure, foot, i[moving], time_s[moving])
    for whole, part in zip(stance, swing, strict=True):
        whole[moving] = part
    return stance


def _offsets(figure: Figure) -> tuple[np.ndarray, np.ndarray]:
    """Return the offsets of the heel and of the toes from the ankle in the median plane of the foot."""
    heel, toe = (figure.offsets_m[figure.names.index(f"left_{name}")].copy() for name in ("heel", "big_toe"))
    heel[1] = toe[1] = 0.0
    return heel, toe


def _turn(heading: np.ndarray, pitch_deg: np.ndarray) -> np.ndarray:
    return Rotation.from_euler("ZY", np.stack([heading, -np.radians(pitch_deg)], axis=-1)).as_matrix()


def _stance_pose(figure: Figure, foot: Stances, i: np.ndarray, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    heel, toe = _offsets(figure)
    t = np.minimum(time_s, foot.end_s[i])
    landing = 1.0 - np.clip((t - foot.start_s[i]) / (foot.flat_s[i] - foot.start_s[i]), 0.0, 1.0)
    leaving = np.clip((t - foot.rise_s[i]) / (foot.end_s[i] - foot.rise_s[i]), 0.0, 1.0)
    pitch = foot.strike_deg[i] * landing * (1.0 - _SLAP * (1.0 - landing)) + foot.off_deg[i] * leaving**2
    slid = np.clip((t - foot.flat_s[i]) / (foot.rise_s[i] - foot.flat_s[i]), 0.0, 1.0)
    place = foot.place_m[i] + (slid * slid * (3.0 - 2.0 * slid))[:, None] * foot.slide_m[i]
    flat, turn = _turn(foot.heading[i], np.zeros(len(t))), _turn(foot.heading[i], pitch)
    pivot = np.where((pitch > 0)[:, None], heel, toe)
    ankle = place + np.array([0.0, 0.0, _SOLE_M - heel[2]])
    return ankle + np.einsum("tij,tj->ti", flat - turn, pivot), turn


def _swing_pose(figure: Figure, foot: Stances, i: np.ndarray, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose after stance ``i``: the toes move to the next place, and the lowest keypoint rises and falls."""
    heel, toe = _offsets(figure)
    duration = foot.start_s[i + 1] - foot.end_s[i]
    u = (time_s - foot.end_s[i]) / duration
    ends = [_stance_pose(figure, foot, i, foot.end_s[i]), _stance_pose(figure, foot, i + 1, foot.start_s[i + 1])]
    first, last = (ankle + turn @ toe for ankle, turn in ends)
    forward = (3.0 - _STRIKE_SPEED) * u**2 + (_STRIKE_SPEED - 2.0) * u**3
    at = first + forward[:, None] * (last - first)
    leave, strike = foot.off_deg[i], foot.strike_deg[i + 1]
    rates = (
        leave / (foot.end_s[i] - foot.rise_s[i]) * duration,
        -(1.0 + _SLAP) * strike / (foot.flat_s[i + 1] - foot.start_s[i + 1]) * duration,
    )
    pitch = _hermite(u, leave, strike, *rates)
    turned = np.unwrap(np.stack([foot.heading[i], foot.heading[i + 1]]), axis=0)
    heading = turned[0] + u * u * (3.0 - 2.0 * u) * (turned[1] - turned[0])
    levels = foot.place_m[[i, i + 1], 2]
    early = np.where(levels[1] > levels[0], u / 0.6, (u - 0.4) / 0.6).clip(0.0, 1.0)
    level = levels[0] + early * early * (3.0 - 2.0 * early) * (levels[1] - levels[0])
    flight = 0.5 * _GRAVITY * np.square(duration) * u * (1.0 - u)
    raised = np.where(foot.airborne[i], flight, foot.clearance_m[i] * 6.75 * u**2 * (1.0 - u))
    # The lower of heel and toes is at this height; the softened maximum avoids a kink where the foot is level.
    tilt = (toe[0] - heel[0]) * np.sin(np.radians(pitch)) / 0.008
    at[:, 2] = level + _SOLE_M + raised + 0.008 * np.logaddexp(0.0, tilt)
    turn = _turn(heading, pitch)
    return at - turn @ toe, turn


def _hermite(u: np.ndarray, start: np.ndarray, end: np.ndarray, rate: np.ndarray, last_rate: np.ndarray) -> np.ndarray:
    """Return the cubic with these values and slopes at 0 and 1."""
    rest = 1.0 - u
    return (
        start * rest**2 * (1.0 + 2.0 * u)
        + end * u**2 * (1.0 + 2.0 * rest)
        + rate * u * rest**2
        - last_rate * u**2 * rest
    )


def stances_of(
    times_s: np.ndarray, place_m: np.ndarray, *, roll: Callable[[int], Mapping[str, object]] | None = None
) -> Stances:
    """Return stances with the pitches of walking.

    Args:
        times_s: shape (stance, 4): touch, flat, rise of the heel, and toe-off.
        place_m: shape (stance, 4): position below the ankle, and heading.
        roll: returns other values of a stance's fields, by index.
    """
    n = len(times_s)
    fields: dict[str, np.ndarray] = {
        "strike_deg": np.full(n, 20.0), "off_deg": np.full(n, -50.0), "clearance_m": np.full(n, 0.03),
        "slide_m": np.zeros((n, 3)), "airborne": np.zeros(n, dtype=bool),
    }  # fmt: skip
    for i in range(n if roll is not None else 0):
        for name, value in roll(i).items():  # type: ignore[misc]
            fields[name][i] = value
    start, flat, rise, end = np.asarray(times_s, dtype=np.float64).T
    return Stances(start, flat, rise, end, np.asarray(place_m)[:, :3], np.asarray(place_m)[:, 3], **fields)
