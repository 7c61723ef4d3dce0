"""Gaussian priors of the coordinates of the anatomical model, of people who move and of people who stand upright."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from posefuse.biomechanics.anatomy.anatomy import read_anatomy
from posefuse.kernels.biomechanics.inverse_kinematics import Prior

_MOVING_DEG: Mapping[str, tuple[float, float]] = {
    "pelvis_tilt": (0.0, 60.0), "pelvis_list": (0.0, 30.0), "pelvis_rotation": (0.0, 60.0),
    "hip_flexion": (15.0, 60.0), "hip_adduction": (-3.0, 25.0), "hip_rotation": (0.0, 14.0),
    "knee_angle": (25.0, 60.0), "ankle_angle": (0.0, 30.0), "subtalar_angle": (0.0, 10.0), "mtp_angle": (0.0, 10.0),
    "lumbar_extension": (-5.0, 40.0), "lumbar_bending": (0.0, 20.0), "lumbar_rotation": (0.0, 20.0),
    "neck_extension": (0.0, 30.0), "neck_bending": (0.0, 20.0), "neck_rotation": (0.0, 35.0),
    "arm_flex": (10.0, 80.0), "arm_add": (-15.0, 60.0), "arm_rot": (0.0, 50.0), "elbow_flex": (40.0, 60.0),
    "pro_sup": (60.0, 40.0), "wrist_flex": (0.0, 30.0), "wrist_dev": (0.0, 12.0),
}  # fmt: skip
"""Mean and standard deviation by coordinate without its side. They are wide for what keypoints show."""

_UPRIGHT_DEG: Mapping[str, tuple[float, float]] = {
    **_MOVING_DEG,
    "pelvis_tilt": (0.0, 5.0), "pelvis_list": (0.0, 3.0), "hip_flexion": (0.0, 6.0), "hip_adduction": (-2.0, 4.0),
    "hip_rotation": (0.0, 8.0), "knee_angle": (3.0, 5.0), "ankle_angle": (0.0, 5.0), "subtalar_angle": (0.0, 5.0),
    "mtp_angle": (0.0, 5.0), "lumbar_extension": (0.0, 6.0), "lumbar_bending": (0.0, 4.0),
    "lumbar_rotation": (0.0, 6.0),
}  # fmt: skip

TILT_OF_TRUNK, TILT_OF_THIGHS, _MEAN_TILT_DEG = 0.45, 0.1, -3.0
"""Change of pelvis tilt per change of the trunk's and of the thighs' mean inclination, and tilt where both are 0.

The pelvis takes about half of a forward bend of the trunk (Esola et al. 1996, Spine 21(1)). It tilts backward by 0.2
degrees and more per degree by which thighs are raised passively (Bohannon et al. 1985, Phys Ther 65(12)), but forward
in squats. In gait it is a few degrees farther forward than in standing.
"""
_TILT_SD_DEG = (5.0, 5.0)
"""Standard deviations of the pelvis tilt around this relation: within a person, and of a person's mean."""
TILT_SD_DEG = float(np.hypot(*_TILT_SD_DEG))
_MOST_HABIT_DEG = 20.0
"""Standard deviation of a prior up to which a person's habit is estimated; wider priors do not matter."""
_POSITION_SD_M = 5.0


@dataclass(frozen=True, eq=False)
class CoordinatePrior:
    """Gaussian prior of coordinates, whose means include a person's unknown habits, such as toeing out.

    Attributes:
        precision: shape (coordinate, coordinate).
        weighted_mean: shape (coordinate,): precision times mean, without habits.
        rows: shape (habit, coordinate): combinations of coordinates to which habits add.
        row_sd: shape (habit,): standard deviations of the combinations in frames of one person, rad.
        row_mean: shape (habit,): means over people, rad.
        habit_sd: shape (habit,): standard deviations of people's habits, rad.
    """

    precision: np.ndarray
    weighted_mean: np.ndarray
    rows: np.ndarray
    row_sd: np.ndarray
    row_mean: np.ndarray
    habit_sd: np.ndarray

    def with_habits(self, habits: np.ndarray) -> Prior:
        """Return the prior of a person with these habits, shape (habit,), rad."""
        right = self.weighted_mean + self.rows.T @ ((self.row_mean + habits) / self.row_sd**2)
        return Prior(self.precision, np.linalg.solve(self.precision, right))

    def add_equations(
        self, coordinates: np.ndarray, habits: np.ndarray, equations: tuple[np.ndarray, np.ndarray, np.ndarray]
    ) -> None:
        """Add a frame's Hessian, mixed derivatives and gradient in the habits, which are the last parameters.

        Args:
            coordinates: shape (coordinate,).
            habits: shape (habit,), rad.
            equations: shapes (parameter, parameter), (coordinate, parameter) and (parameter,).
        """
        hessian, mixed, gradient = equations
        last = np.arange(len(gradient) - len(habits), len(gradient))
        if len(self.rows):
            hessian[last, last] += self.row_sd**-2
            mixed[:, last] -= self.rows.T / self.row_sd**2
            gradient[last] -= (self.rows @ coordinates - self.row_mean - habits) / self.row_sd**2

    def sds(self) -> np.ndarray:
        """Return the standard deviations of the coordinates before any frame is seen, rad or m."""
        at_zero = np.linalg.inv(self.precision)
        change = at_zero @ (self.rows.T / self.row_sd**2) * self.habit_sd
        return np.sqrt(np.diag(at_zero) + (change**2).sum(axis=1))


@cache
def moving_prior() -> CoordinatePrior:
    """Return the prior of people who move.

    Hips and shoulders do not show the pelvis tilt, so a prior relates it to the inclinations of trunk and thighs.
    """
    anatomy = read_anatomy()
    at, n = anatomy.coordinate_index, len(anatomy.coordinates)
    tilt = np.zeros(n)
    tilt[at("pelvis_tilt")] = 1.0 - TILT_OF_TRUNK - TILT_OF_THIGHS
    tilt[at("lumbar_extension")] = -TILT_OF_TRUNK
    for side in "rl":
        tilt[at(f"hip_flexion_{side}")] = -0.5 * TILT_OF_THIGHS
    rows, facts = [tilt], [(_TILT_SD_DEG[0], _MEAN_TILT_DEG, _TILT_SD_DEG[1])]
    table = dict(_MOVING_DEG)
    for name in anatomy.coordinates:
        mean, sd = table.get(without_side(name), (0.0, np.inf))
        if sd <= _MOST_HABIT_DEG:
            rows.append(np.eye(n)[at(name)])
            facts.append((sd / np.sqrt(2.0), mean, sd / np.sqrt(2.0)))
    row_sd, row_mean, habit_sd = np.radians(facts).T
    mean, sd = _independent(table)
    narrow = np.array(rows[1:]).sum(axis=0) > 0
    precision = np.diag(np.where(narrow, 0.0, sd**-2))
    matrix = np.array(rows)
    full = precision + matrix.T @ (matrix / row_sd[:, None] ** 2)
    return CoordinatePrior(full, precision @ mean, matrix, row_sd, row_mean, habit_sd)


@cache
def upright_prior(factor: float = 1.0) -> CoordinatePrior:
    """Return the prior of people who stand upright with straight legs, which has no habits.

    Args:
        factor: factor of the standard deviations of what standing determines.
    """
    table = {
        name: (mean, sd if (mean, sd) == _MOVING_DEG[name] else factor * sd)
        for name, (mean, sd) in _UPRIGHT_DEG.items()
    }
    mean, sd = _independent(table)
    none = np.empty(0)
    return CoordinatePrior(np.diag(sd**-2), mean / sd**2, np.empty((0, len(sd))), none, none, none)


def without_side(coordinate: str) -> str:
    """Return the name of a coordinate without its side."""
    return coordinate[:-2] if coordinate.endswith(("_r", "_l")) else coordinate


def _independent(table: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Return means and standard deviations of independent priors, each of shape (coordinate,)."""
    anatomy = read_anatomy()
    values = [
        (0.0, _POSITION_SD_M) if is_length else tuple(np.radians(table[without_side(name)]))
        for name, is_length in zip(anatomy.coordinates, anatomy.is_translation, strict=True)
    ]
    mean, sd = np.array(values).T
    return mean, sd
