"""Scenes with planted faults, shared by all tests of the recording check."""

import pytest
from benchmarks.fault_scenes import Scene, healthy, plant

from posefuse.association.one_subject import SingleSubject
from posefuse.diagnostics.observations import TrackedObservations, gather_observations
from posefuse.synthetic.options import CLEAN, DetectorOptions


@pytest.fixture(scope="session")
def walk() -> Scene:
    """Return a fault-free walk of 12 s in front of four cameras."""
    return healthy(3, cameras=4, duration_s=12.0, rate_hz=25.0, activities=("walk",))


def observe(scene: Scene, options: DetectorOptions = CLEAN) -> TrackedObservations:
    """Return the tracked observations of a simulated detector."""
    rig, detections = scene.watch(options)
    tracks = SingleSubject.of(detections, None).tracks(0, detections.n_frames)
    return gather_observations(rig, detections, tracks)


__all__ = ["observe", "plant", "walk"]
