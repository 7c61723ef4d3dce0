"""Scenes with faults, looked at once for all tests."""

import pytest

from posefuse.association.one_subject import OneSubject
from posefuse.diagnostics.observations import TrackedObservations, gather_observations
from posefuse.synthetic.faults import Scene, healthy, plant
from posefuse.synthetic.options import CLEAN, DetectorOptions


@pytest.fixture(scope="session")
def walk() -> Scene:
    """A healthy walk of 12 s in front of four cameras."""
    return healthy(3, cameras=4, duration_s=12.0, rate_hz=25.0, activities=("walk",))


def observations_of(scene: Scene, options: DetectorOptions = CLEAN) -> TrackedObservations:
    """What a detector makes of a scene, gathered."""
    rig, detections = scene.watch(options)
    return gather_observations(rig, detections, OneSubject.of(detections, None).follow(0, detections.n_frames))


__all__ = ["observations_of", "plant", "walk"]
