"""Scenes with faults, looked at once for all tests."""

import pytest

from posefuse.association.one_subject import SingleSubject
from posefuse.diagnostics.observations import Evidence, gather
from posefuse.synthetic.faults import Scene, healthy, plant
from posefuse.synthetic.options import CLEAN, DetectorOptions


@pytest.fixture(scope="session")
def walk() -> Scene:
    """A healthy walk of 12 s in front of four cameras."""
    return healthy(3, cameras=4, duration_s=12.0, rate_hz=25.0, activities=("walk",))


def evidence_of(scene: Scene, options: DetectorOptions = CLEAN) -> Evidence:
    """What a detector makes of a scene, gathered."""
    rig, detections = scene.watch(options)
    return gather(rig, detections, SingleSubject.of(detections, None).tracks(0, detections.n_frames))


__all__ = ["evidence_of", "plant", "walk"]
