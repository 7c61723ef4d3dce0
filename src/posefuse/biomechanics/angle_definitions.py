"""Which angles a skeleton of a human shows, and what their estimates rest on."""

from dataclasses import dataclass

import numpy as np

from posefuse.biomechanics.coordinate_priors import TILT_SD_DEG, moving_prior
from posefuse.biomechanics.inverse_kinematics import PersonPoints, Solution
from posefuse.biomechanics.isb_angles import isb_angles, isb_coordinates, isb_names, successive_angles
from posefuse.biomechanics.marker_model import MarkerModel, coordinates_of
from posefuse.model.joint_angles import ISB, OPENSIM, AngleStatus

_PELVIS = ("pelvis_tilt", "pelvis_list", "pelvis_rotation")
_FOREARMS = ("pro_sup_r", "pro_sup_l")
_RELATED = ("pelvis_tilt", "lumbar_extension", "spine_extension")
_PRIOR_SHARE, _UNKNOWN_SHARE, _UNKNOWN_DEG = 0.7, 0.9, 30.0
"""Standard deviation relative to the prior's from which on an angle rests on the prior, or has no value."""


@dataclass(frozen=True, eq=False)
class AngleSet:
    """Angles of a skeleton.

    Attributes:
        names: names of the angles, those of OpenSim first.
        conventions: convention of each.
        coordinates: shape (OpenSim angle,): indices of the coordinates.
        isb: shape (ISB angle,): indices into the table of ISB angles.
        prior_deg: shape (angle,): standard deviations before any frame is seen.
    """

    names: tuple[str, ...]
    conventions: tuple[str, ...]
    coordinates: np.ndarray
    isb: np.ndarray
    prior_deg: np.ndarray


def angle_set(model: MarkerModel) -> AngleSet:
    """Return the angles that the keypoints of a model can show."""
    anatomy = model.anatomy
    shown = {c for body in model.markers.bodies for c in coordinates_of(anatomy, int(body))}
    if not any(anatomy.bodies[body].startswith("hand") for body in model.markers.bodies):
        # The wrist lies near the axis of the forearm and does not show its rotation.
        shown -= {anatomy.coordinate_index(name) for name in _FOREARMS}
    at = [c for c in sorted(shown) if not anatomy.is_translation[c]]
    names = [anatomy.coordinates[c] for c in at]
    isb = [i for i, needed in enumerate(isb_coordinates()) if set(needed) <= set(names)]
    sds = np.degrees(moving_prior().sds())
    for name in _RELATED[:2]:
        # Their independent priors are wide, but only the relation between them separates the two.
        sds[anatomy.coordinate_index(name)] = TILT_SD_DEG
    isb_sds = [max(sds[anatomy.coordinate_index(name)] for name in isb_coordinates()[i]) for i in isb]
    return AngleSet(
        (*names, *(isb_names()[i] for i in isb)),
        (*[OPENSIM] * len(names), *[ISB] * len(isb)),
        np.array(at),
        np.array(isb),
        np.array([*sds[at], *isb_sds]),
    )


def angles_of(
    angles: AngleSet, model: MarkerModel, person: PersonPoints, solution: Solution, has_vertical: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return degrees, standard deviations and statuses of frames, each of shape (frame, angle).

    Args:
        angles: what to return.
        model: the model of the person.
        person: points of the frames.
        solution: coordinates, with the covariance of everything.
        has_vertical: whether the vertical of the world is known.
    """
    at = angles.coordinates
    covariance = np.degrees(np.degrees(solution.covariance))
    degrees = np.degrees(solution.coordinates[:, at])
    sds = np.sqrt(np.einsum("fii->fi", covariance)[:, at])
    pelvis = [model.anatomy.coordinate_index(name) for name in _PELVIS]
    degrees[:, : len(pelvis)] = pelvis_angles(person, solution)
    isb, isb_sds = isb_angles(solution.rotations, solution.angular, solution.covariance)
    degrees = np.concatenate([degrees, isb[:, angles.isb]], axis=1)
    sds = np.concatenate([sds, isb_sds[:, angles.isb]], axis=1)
    status = np.full(degrees.shape, AngleStatus.OK, dtype=np.int8)
    status[sds > _PRIOR_SHARE * angles.prior_deg] = AngleStatus.PRIOR
    unknown = np.minimum(_UNKNOWN_SHARE * angles.prior_deg, _UNKNOWN_DEG)
    # The relation of pelvis and trunk always gives a value.
    unknown[np.isin(angles.names, _RELATED)] = _UNKNOWN_DEG
    status[~(sds <= unknown) | ~np.isfinite(degrees)] = AngleStatus.NOT_OBSERVED
    if not has_vertical:
        status[:, : len(pelvis)] = AngleStatus.NO_VERTICAL
    status[~np.isfinite(solution.cost)] = AngleStatus.ABSENT
    valued = status <= AngleStatus.PRIOR
    return np.where(valued, wrapped(degrees), np.nan), np.where(valued, sds, np.nan), status


def pelvis_angles(person: PersonPoints, solution: Solution) -> np.ndarray:
    """Return tilt, list and rotation of the pelvis in the world, shape (frame, 3), in degrees.

    They are successive rotations in the order rotation, list, tilt (Baker 2001, J Biomech 34(2)).
    """
    turned = person.level_from_person @ solution.rotations[:, 0]
    return successive_angles(turned, "YXZ")[:, ::-1]


def wrapped(degrees: np.ndarray) -> np.ndarray:
    """Return angles between -180 and 180 degrees."""
    return (degrees + 180.0) % 360.0 - 180.0
