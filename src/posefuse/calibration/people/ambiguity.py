"""Check that the people determine one calibration: no other one may explain what they do about as well."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from posefuse.calibration.people.assemble import Assembly, difference_deg, free_parameters, readjust
from posefuse.calibration.people.bearings import Bearings
from posefuse.calibration.people.bodies import BodySamples, Bones
from posefuse.calibration.people.body_bundle import BodyState
from posefuse.calibration.people.likelihood import SIGNIFICANT, advantage, body_costs, camera_costs
from posefuse.calibration.people.rigs import People, Rig, later, samples_of
from posefuse.errors import CalibrationError, choices
from posefuse.model.cameras import rotation_from_vector

FAR_DEG = 15.0
"""Difference of relative rotations from which two calibrations are different ones."""
_SCREEN = 4.0
_MOST_OTHERS = 3
_ROUNDS = 4
_TWO, _ORBIT_DEG = 2, 30.0


def most_probable(views: Sequence[Bearings], table: People, bones: Bones, focal_known: np.ndarray, rig: Rig) -> Rig:
    """Return the rig with its most probable assembly.

    Args:
        views: directions of all views.
        table: index of each person in every view, -1 where a view does not observe it.
        bones: bones of the skeleton.
        focal_known: shape (view,), bool.
        rig: assemblies from several starts, at the same samples.

    Raises:
        CalibrationError: if a very different assembly of the same views is not significantly less probable.
    """
    rivals = _rivals(rig, bones)
    if len(rig.assembly.views) == _TWO:
        rivals += [_orbited(rig.assembly, angle) for angle in np.radians([-_ORBIT_DEG, _ORBIT_DEG])]
    if not rivals:
        return rig
    samples = samples_of(views, table, rig)
    free = free_parameters(focal_known[list(rig.assembly.views)], True)
    settled = []
    costs_of = costs_function(rig.assembly)
    for assembly in (rig.assembly, *rivals):
        for _ in range(_ROUNDS):
            assembly = readjust(assembly, samples, bones, free)
        settled.append((assembly, costs_of(assembly.samples, bones, assembly.state)))
    best, costs = min(settled, key=lambda each: float(each[1].sum()))
    for other, others in settled:
        apart_deg = difference_deg(best, other)
        if apart_deg > FAR_DEG and advantage(costs, others, samples.time_s) < SIGNIFICANT:
            raise CalibrationError(
                f"The people do not determine the cameras {choices(views[v].name for v in best.views)}: two "
                f"calibrations that differ by {apart_deg:.0f} degrees explain their motion about equally well. Film a "
                "person who walks through the whole volume and turns around, or add a camera."
            )
    return replace(rig, assembly=best, offset_s=later(rig.offset_s, best), others=())


def costs_function(assembly: Assembly) -> Callable[[BodySamples, Bones, BodyState], np.ndarray]:
    """Return the costs by which assemblies are compared.

    Bodies follow most errors of two views, so that only the integral over all bodies compares them.
    """
    return camera_costs if len(assembly.views) == _TWO else body_costs


def _orbited(assembly: Assembly, angle: float) -> Assembly:
    """Return two views with the second turned around the people, in the plane of both centers and the people.

    From far away, two views do not show this angle: all are explained by people of another depth (Koenderink and van
    Doorn, "Affine structure from motion", JOSA A 8, 1991). Only perspective and bones determine it.
    """
    rotations, centers = assembly.state.rotations.copy(), assembly.state.centers.copy()
    middle = np.nanmedian(assembly.state.points.reshape(-1, 3), axis=0)
    axis = np.cross(centers[0] - middle, centers[1] - middle)
    turn = rotation_from_vector(angle * axis / max(float(np.linalg.norm(axis)), 1e-12))
    rotations[1] = rotations[1] @ turn.T
    centers[1] = middle + turn @ (centers[1] - middle)
    return replace(assembly, state=replace(assembly.state, rotations=rotations, centers=centers))


def _rivals(rig: Rig, bones: Bones) -> list[Assembly]:
    """Return assemblies of the same views that are very different and not clearly less probable."""
    costs_of = costs_function(rig.assembly)
    costs = costs_of(rig.assembly.samples, bones, rig.assembly.state)
    found: list[Assembly] = []
    for other in rig.others:
        if other.views != rig.assembly.views or len(found) == _MOST_OTHERS:
            continue
        if all(difference_deg(other, each) > FAR_DEG for each in (rig.assembly, *found)):
            theirs = costs_of(other.samples, bones, other.state)
            if advantage(costs, theirs, other.samples.time_s) < _SCREEN:
                found.append(other)
    return found
