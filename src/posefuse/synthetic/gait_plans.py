"""Plans of contacts: walking and running on a path or a treadmill, stairs, jumps, squats and sliding feet."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posefuse.synthetic.gait_motions import GaitMotion, PelvisPath, Stances, stances_of
from posefuse.synthetic.motions import smooth_step

_REST_S = 1.0
"""Duration of standing before and after a motion."""
_KNOTS_HZ = 100.0
_GRAVITY = 9.81


@dataclass(frozen=True)
class WalkPlan:
    """Describe a walk or a run from rest to rest, or on a treadmill.

    Attributes:
        speed_m_s: speed on the path or the belt.
        stride_s: duration of a gait cycle.
        stance_share: share of the cycle in which a foot touches the floor; below 0.5 for running.
        strides: number of cycles.
        width_m: distance between the tracks of the feet.
        radius_m: radius of the circular path, infinite for a straight one.
        limp: asymmetry: the left stance is shorter, and the right step earlier, by this share of the cycle.
        stair_m: rise per step, negative for descent.
        treadmill: whether the person walks on a belt and stays in place; the walk then has no start and end.
        forefoot: whether the toes strike first.
        start_m: start of the path.
        heading: heading at the start in radians.
    """

    speed_m_s: float = 1.3
    stride_s: float = 1.1
    stance_share: float = 0.62
    strides: int = 6
    width_m: float = 0.16
    radius_m: float = np.inf
    limp: float = 0.0
    stair_m: float = 0.0
    treadmill: bool = False
    forefoot: bool = False
    start_m: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0

    @property
    def duration_s(self) -> float:
        """Duration of the recording."""
        return self.strides * self.stride_s + 2.0 * _REST_S

    def path(self, along_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the horizontal positions, shape (n, 2), and headings after a distance on the path."""
        heading = self.heading + along_m / self.radius_m
        ahead, aside = np.array([np.cos(self.heading), np.sin(self.heading)]), None
        if np.isinf(self.radius_m):
            return np.array(self.start_m) + along_m[:, None] * ahead, np.full(len(along_m), self.heading)
        aside = self.radius_m * np.array([-ahead[1], ahead[0]])
        around = self.radius_m * np.stack([np.sin(heading), -np.cos(heading)], axis=1)
        return np.array(self.start_m) + aside + around, heading

    def distance(self, time_s: np.ndarray) -> np.ndarray:
        """Return the distance on the path; speed rises and falls over half a cycle at both ends."""
        if self.treadmill:
            return self.speed_m_s * np.asarray(time_s, dtype=np.float64)
        grid = np.linspace(0.0, self.duration_s, int(self.duration_s * 400))
        ramp = 0.8 * self.stride_s
        first, last = _REST_S, self.duration_s - _REST_S
        speed = smooth_step((grid - first) / ramp) * smooth_step((last - grid) / ramp)
        gone = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) * (grid[1] - grid[0])])
        return self.speed_m_s * np.interp(time_s, grid, gone)


def walk(plan: WalkPlan) -> GaitMotion:
    """Return a walk or a run with known contacts."""
    feet = [_walking_foot(plan, side) for side in (0, 1)]
    time_s = np.arange(0.0, plan.duration_s + 0.5 / _KNOTS_HZ, 1.0 / _KNOTS_HZ)
    along = plan.distance(time_s)
    place, heading = plan.path(along)
    zero = np.zeros(len(time_s))
    level = zero
    if plan.stair_m:
        starts = np.concatenate([foot.start_s[1:] for foot in feet])
        heights = np.concatenate([foot.place_m[1:, 2] for foot in feet])
        order = np.argsort(starts)
        # The pelvis follows the stairs half a step behind the striking foot.
        level = np.interp(time_s, [0.0, *(starts[order] + 0.2)], [0.0, *(heights[order] - 0.5 * plan.stair_m)])
        level = level + min(plan.stair_m, 0.0) * 0.5
    drop = zero + (0.06 if plan.stance_share < 0.5 else 0.0)
    belt = place - place[0] if plan.treadmill else np.zeros_like(place)
    pelvis = PelvisPath(time_s, place, heading, level, drop, zero, zero + 2.0, belt)
    return GaitMotion(feet[0], feet[1], pelvis, 1.0 / plan.stride_s, min(1.0, plan.speed_m_s / 1.3))


def _walking_foot(plan: WalkPlan, side: int) -> Stances:
    """Return the stances of one foot; the left foot steps first, and both end beside each other."""
    share = plan.stance_share - (plan.limp if side == 0 else 0.0)
    phase = 0.0 if side == 0 else 0.5 - plan.limp
    starts = _REST_S + plan.stride_s * (np.arange(plan.strides) + (1.0 - share) + phase)
    if plan.treadmill:
        starts = plan.stride_s * (np.arange(-2, plan.strides + 6) + phase)
    else:
        starts = starts[starts + 0.3 * plan.stride_s < plan.duration_s - 0.5 * _REST_S]
    ends = starts + share * plan.stride_s
    middles = 0.5 * (starts + ends)
    along = plan.distance(middles)
    if not plan.treadmill:
        first_off = starts[0] - (1.0 - share) * plan.stride_s
        starts, ends = np.array([-1.0, *starts]), np.array([first_off, *ends])
        along = np.array([0.0, *along])
        ends[-1] = np.inf
    flat = starts + 0.12 * plan.stride_s * (share / 0.62)
    rise = np.where(np.isinf(ends), np.inf, starts + 0.6 * share * plan.stride_s)
    rise[0] = ends[0] - 0.24 * plan.stride_s
    ends = np.where(np.isinf(ends), plan.duration_s + 10.0, ends)
    rise = np.where(np.isinf(rise), plan.duration_s + 5.0, rise)
    place, heading = plan.path(along)
    lateral = (0.5 if side == 0 else -0.5) * plan.width_m
    place = place + lateral * np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    steps = 2 * np.arange(len(starts)) - (1 if side == 0 else 0)
    level = plan.stair_m * np.maximum(steps, 0)
    if plan.stair_m:
        # Both feet end on the same step.
        level = np.minimum(level, plan.stair_m * (2 * (len(starts) - 1) - 1)) if plan.stair_m > 0 else level
    toes_first = plan.forefoot or plan.stair_m != 0
    roll = {
        "strike_deg": -12.0 if toes_first else 20.0,
        "off_deg": -35.0 if plan.stair_m else -50.0,
        "clearance_m": 0.08 if plan.stance_share < 0.5 else 0.06 if plan.stair_m else 0.03,
    }
    times = np.stack([starts, flat, rise, ends], axis=1)
    return stances_of(times, np.column_stack([place, level, heading]), roll=lambda _: roll)


def stand(
    duration_s: float,
    *,
    drops: tuple[tuple[float, float, float], ...] = (),
    flights: tuple[tuple[float, float], ...] = (),
    slides: tuple[tuple[float, float, float], ...] = (),
) -> GaitMotion:
    """Return a person who stands in place, and squats, sits, jumps, or slides a foot forward and back.

    Args:
        duration_s: duration.
        drops: start, duration and depth in m of each squat.
        flights: toe-off and flight time of each jump.
        slides: start, duration and displacement in m of each slide of the left foot.
    """
    time_s = np.arange(0.0, duration_s + 0.5 / _KNOTS_HZ, 1.0 / _KNOTS_HZ)
    drop, lift = np.zeros(len(time_s)), np.zeros(len(time_s))
    for start, duration, depth in drops:
        u = (time_s - start) / duration
        drop += depth * smooth_step(u / 0.4) * smooth_step((1.0 - u) / 0.4)
    for off, flight in flights:
        u = time_s - off
        lift += np.where((u > 0) & (u < flight), 0.5 * _GRAVITY * u * (flight - u), 0.0)
        drop += 0.25 * smooth_step((u + 0.9) / 0.5) * smooth_step(-u / 0.3)
        drop += 0.2 * smooth_step((u - flight) / 0.2) * smooth_step((flight + 0.8 - u) / 0.5)
    feet = [_standing_foot(duration_s, 0.1, flights, slides), _standing_foot(duration_s, -0.1, flights, ())]
    still = np.zeros((len(time_s), 2))
    pelvis = PelvisPath(time_s, still, still[:, 0], still[:, 0], drop, lift, 90.0 * drop, still)
    return GaitMotion(feet[0], feet[1], pelvis, swing=0.0)


def _standing_foot(
    duration_s: float,
    lateral_m: float,
    flights: tuple[tuple[float, float], ...],
    slides: tuple[tuple[float, float, float], ...],
) -> Stances:
    """Return one stance from flight to flight, cut where the foot slides."""
    starts = np.array([-1.0, *(off + flight for off, flight in flights)])
    ends = np.array([*(off for off, _ in flights), duration_s + 10.0])
    times = np.stack([starts, starts + 0.06, ends - 0.12, ends], axis=1)
    rolls: list[Mapping[str, object]] = [{"strike_deg": -30.0, "off_deg": -45.0, "airborne": True} for _ in starts]
    places = np.tile([0.0, lateral_m, 0.0, 0.0], (len(starts), 1))
    if slides:
        # Rest and slides alternate.
        starts = np.array([-1.0, *(time for start, duration, _ in slides for time in (start, start + duration))])
        ends = np.array([*starts[1:], duration_s + 10.0])
        times = np.stack([starts, starts + 1e-6, ends - 1e-6, ends], axis=1)
        moves = np.array([0.0, *(move for _, _, distance in slides for move in (distance, 0.0))])
        rolls = [{"strike_deg": 0.0, "off_deg": 0.0, "slide_m": (move, 0.0, 0.0)} for move in moves]
        places = np.tile([0.0, lateral_m, 0.0, 0.0], (len(starts), 1))
        places[:, 0] = np.cumsum(moves) - moves
    return stances_of(times, places, roll=lambda i: rolls[i])
