"""Approximate rigs: assembled views and their time offsets."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.people.assemble import Assembly, free_parameters, readjust
from posefuse.calibration.people.bearings import Bearings
from posefuse.calibration.people.bodies import BodySamples, Bones, sample_bodies

N_SAMPLES = 60
"""Moments from which views are assembled; twice as many are used to adjust and to judge the result."""
_TIME_ITERATIONS, _EXACT_S = 3, 0.01

People = Sequence[Sequence[int]]


@dataclass(frozen=True, eq=False)
class Rig:
    """Hold an assembly of views and their time offsets.

    Attributes:
        assembly: poses.
        offset_s: shape (view,), of all views: true time minus timestamp, after a correction of the rates from the first
            timestamp of each view on.
        rate: shape (view,), of all views: true seconds per second of the timestamps.
        others: assemblies from other starts, the most probable first.
    """

    assembly: Assembly
    offset_s: np.ndarray
    rate: np.ndarray
    others: tuple[Assembly, ...] = ()


def later(offset_s: np.ndarray, assembly: Assembly) -> np.ndarray:
    """Return the time offsets after an adjustment, relative to the first view of the assembly."""
    moved = offset_s.copy()
    # Observations that are taken later belong to an earlier timestamp of the true time.
    moved[list(assembly.views)] -= assembly.state.shift_s
    return moved - moved[assembly.views[0]]


def samples_of(views: Sequence[Bearings], table: People, rig: Rig) -> BodySamples:
    """Return what the views of a rig observe at its time offsets."""
    chosen = list(rig.assembly.views)
    people = [[person[v] for v in chosen] for person in table]
    return sample_bodies([views[v] for v in chosen], people, rig.offset_s[chosen], np.ones(len(chosen)), 2 * N_SAMPLES)


def with_exact_times(views: Sequence[Bearings], table: People, bones: Bones, focal_known: np.ndarray, rig: Rig) -> Rig:
    """Return the rig adjusted to samples at its own time offsets: between frames, motion is only nearly linear."""
    free = free_parameters(focal_known[list(rig.assembly.views)], True)
    for _ in range(_TIME_ITERATIONS):
        moved = np.abs(rig.assembly.state.shift_s).max()
        assembly = readjust(rig.assembly, samples_of(views, table, rig), bones, free)
        rig = replace(rig, assembly=assembly, offset_s=later(rig.offset_s, assembly))
        if moved < _EXACT_S:
            break
    return rig
