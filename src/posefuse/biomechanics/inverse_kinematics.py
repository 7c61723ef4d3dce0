"""Coordinates of the anatomical model from a person's points, with covariances."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.biomechanics.marker_model import MarkerModel
from posefuse.biomechanics.person_frames import about_y, headings
from posefuse.kernels.biomechanics.curvature import move_to_means
from posefuse.kernels.biomechanics.inverse_kinematics import Prior, Work, solve_frames
from posefuse.model.reconstruction import unpack_covariance

MODEL_SD_M = 0.006
"""Standard deviation of what a rigid model with fixed locations does not explain: soft tissue and detectors."""
MIN_POINTS = 6


@dataclass(frozen=True, eq=False)
class PersonPoints:
    """Points of a person in the axes of that person: y up, origin at the hips, facing x.

    Attributes:
        points_m: shape (frame, keypoint, 3), NaN where missing.
        information: shape (frame, keypoint, 3, 3): inverse covariances, m^-2.
        usable: shape (frame,), bool: whether there are enough points.
        world_from_person: shape (frame, 3, 3).
        level_from_person: shape (frame, 3, 3): to axes with y up that all frames share.
        origin_m: shape (frame, 3): origin in the world.
    """

    points_m: np.ndarray
    information: np.ndarray
    usable: np.ndarray
    world_from_person: np.ndarray
    level_from_person: np.ndarray
    origin_m: np.ndarray

    def rows(self, rows: np.ndarray) -> "PersonPoints":
        """Return some frames."""
        return PersonPoints(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Solution:
    """Coordinates of consecutive frames; NaN where a frame is not usable.

    Attributes:
        coordinates: shape (frame, coordinate), rad or m.
        covariance: shape (frame, coordinate, coordinate), with constant locations and scales.
        rotations: shape (frame, body, 3, 3): person from body.
        angular: shape (frame, coordinate, 3): angular velocities per coordinate, in the person's axes.
        cost: shape (frame,): sum of squared normalized residuals.
    """

    coordinates: np.ndarray
    covariance: np.ndarray
    rotations: np.ndarray
    angular: np.ndarray
    cost: np.ndarray


def person_points(
    model: MarkerModel, points_m: np.ndarray, covariance_m2: np.ndarray, vertical: np.ndarray
) -> PersonPoints:
    """Return a person's points in the axes of that person.

    Args:
        model: the anatomical model.
        points_m: shape (frame, keypoint, 3): all keypoints of the skeleton, in the world.
        covariance_m2: shape (frame, keypoint, 6).
        vertical: shape (3, 3): rotation from the world to axes with y up.
    """
    points = np.asarray(points_m)[:, model.columns] @ vertical.T
    covariance = unpack_covariance(np.asarray(covariance_m2)[:, model.columns])
    known = np.asarray(np.isfinite(points).all(axis=-1) & np.isfinite(covariance).all(axis=(-1, -2)))
    points = np.where(np.expand_dims(known, -1), points, np.nan)
    to_world = about_y(headings(points, model.keypoints))
    hips = [model.keypoints.index(f"{side}_hip") for side in ("left", "right")]
    both = np.asarray(known[:, hips].all(axis=1))
    origin = np.where(np.expand_dims(both, -1), points[:, hips].mean(axis=1), _middle(points, known))
    local = np.einsum("fji,fkj->fki", to_world, points - origin[:, None])
    turn = np.einsum("ij,fjk->fik", vertical.T, to_world)
    covariance = np.where(np.expand_dims(known, (-1, -2)), covariance, np.eye(3))
    inside = np.einsum("fji,fkjl,flm->fkim", turn, covariance, turn) + MODEL_SD_M**2 * np.eye(3)
    information = np.linalg.inv(inside)
    usable = (known.sum(axis=1) >= MIN_POINTS) & known[:, hips].any(axis=1)
    local, information = np.ascontiguousarray(local), np.ascontiguousarray(information)
    return PersonPoints(local, information, usable, turn, to_world, origin @ vertical)


def _middle(points: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the mean of the known points, shape (frame, 3); 0 without any."""
    number = known.sum(axis=1)[:, None]
    return np.where(known[..., None], points, 0.0).sum(axis=1) / np.maximum(number, 1)


def solve(model: MarkerModel, person: PersonPoints, prior: Prior, first: np.ndarray | None = None) -> Solution:
    """Estimate the coordinates of frames.

    Args:
        model: the model of the person.
        person: points.
        prior: prior of the coordinates.
        first: shape (coordinate,): coordinates to start from; the mean of the prior by default.
    """
    frames, n, bodies = len(person.usable), len(model.anatomy.coordinates), len(model.anatomy.bodies)
    out = tuple(
        np.full(shape, np.nan)
        for shape in ((frames, n), (frames, n, n), (frames, bodies, 3, 3), (frames, n, 3), (frames,))
    )
    start = np.array(prior.mean if first is None else first)
    arguments = (person.points_m, person.information, person.usable)
    solve_frames(model.kernel_model, arguments, prior, start, model.anatomy.new_state(), Work.allocate(n), out)
    return Solution(*out)


def posterior_means(model: MarkerModel, person: PersonPoints, solution: Solution) -> Solution:
    """Return the means of the coordinates instead of their most probable values.

    The covariance and the cost are those of the most probable values.
    """
    names = ("coordinates", "covariance", "rotations", "angular")
    moved = replace(solution, **{name: getattr(solution, name).copy() for name in names})
    frames, arrays = (person.points_m, person.information), tuple(getattr(moved, name) for name in names)
    move_to_means(model.kernel_model, frames, model.anatomy.new_state(), arrays)
    return moved
