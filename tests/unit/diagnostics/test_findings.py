"""Planted faults are named, with their size, and nothing is said of healthy recordings."""

import numpy as np
import pytest
from benchmarks.faults import is_named, views_of

from posefuse.diagnostics.examine import examine, findings_of
from posefuse.diagnostics.findings import Finding, FindingKind
from posefuse.pipeline.diagnose import inspect_health
from posefuse.synthetic.faults import FAULTS, USUAL, Fault, healthy, plant
from posefuse.synthetic.options import DetectorOptions

from .conftest import observations_of


def found(scene, options: DetectorOptions | None = None) -> tuple[Finding, ...]:
    return findings_of(examine(observations_of(scene, options or DetectorOptions())))


def test_nothing_is_said_of_a_healthy_recording(walk):
    assert found(walk) == ()


@pytest.mark.parametrize(
    ("fault", "size", "views", "kind", "measured", "tolerance"),
    [
        ("turned", 3.0, (1,), FindingKind.CAMERA_POSE, 3.0, 0.5),
        ("late", 3.0, (2,), FindingKind.TIME_OFFSET, 3.0, 0.4),
        ("dropped", 4.0, (0,), FindingKind.DROPPED_FRAMES, 4.0, 0.5),
        ("rotated image", 180.0, (1,), FindingKind.IMAGE_TRANSFORM, 180.0, 0.0),
        ("resized image", 0.5, (3,), FindingKind.IMAGE_TRANSFORM, 0.5, 0.0),
        ("focal", 1.2, (2,), FindingKind.FOCAL_LENGTH, 1.2, 0.03),
        ("sides", 1.0, (0,), FindingKind.LEFT_RIGHT_SWAP, 1.0, 0.1),
        ("repeated", 0.1, (1,), FindingKind.REPEATED_FRAMES, 0.1, 0.04),
        ("order", 0.0, (0, 2), FindingKind.CAMERA_ORDER, 2.0, 0.0),
    ],
)
def test_a_fault_is_named_with_its_camera_and_its_size(walk, fault: Fault, size, views, kind, measured, tolerance):
    scene, planted = plant(walk, fault, views, size)
    findings = found(scene)
    assert [f.kind for f in findings] == [kind]
    assert set(findings[0].cameras) == set(planted.cameras)
    assert findings[0].size == pytest.approx(measured, abs=tolerance + 1e-9)
    assert findings[0].certainty > 0.9


def test_a_copied_pose_is_named_with_the_original(walk):
    scene, _ = plant(walk, "copied pose", (3, 1))
    first = found(scene)[0]
    assert (first.kind, first.cameras) == (FindingKind.COPIED_POSE, ("cam_3",))
    assert "'cam_1'" in first.sentence


def test_another_rig_is_said_once_and_nothing_else(walk):
    scene, _ = plant(walk, "another rig", ())
    assert [f.kind for f in found(scene)] == [FindingKind.WRONG_CALIBRATION]


def test_two_faults_are_told_apart(walk):
    scene, _ = plant(walk, "turned", (0,), 3.0)
    scene, _ = plant(scene, "late", (2,), 4.0)
    assert {(f.kind, f.cameras) for f in found(scene)} == {(FindingKind.CAMERA_POSE, ("cam_0",)), (FindingKind.TIME_OFFSET, ("cam_2",))}


def test_views_that_share_nothing_are_said_to(walk):
    def apart(pixels, trust, _):
        for v in range(pixels.shape[1]):
            pixels[np.arange(len(pixels)) % pixels.shape[1] != v, v] = np.nan
        return pixels, trust

    from dataclasses import replace

    findings = found(replace(walk, after=(apart,)))
    assert [f.kind for f in findings] == [FindingKind.LOW_OVERLAP]
    assert findings[0].size == 0.0


def test_the_worst_comes_first_and_every_finding_says_what_to_do(walk):
    scene, _ = plant(walk, "rotated image", (1,), 90.0)
    scene, _ = plant(scene, "late", (3,), 2.0)
    findings = found(scene)
    assert findings[0].kind is FindingKind.IMAGE_TRANSFORM
    assert [f.gain for f in findings] == sorted((f.gain for f in findings), reverse=True)
    assert all(f.sentence.endswith(".") and f.remedy for f in findings)


def test_the_same_recording_gives_the_same_findings(walk):
    scene, _ = plant(walk, "turned", (1,), 2.0)
    assert found(scene) == found(scene)


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_the_usual_size_are_named(fault: Fault):
    """Cameras moved along their axis by more: half a minute tells 5 cm of it to a quarter of that only."""
    size = {"moved along": 2.0, "moved along later": 3.0}.get(fault, 1.0) * USUAL[fault]
    named = 0
    for seed in range(2000, 2010):
        scene, planted = plant(healthy(seed), fault, views_of(fault, 0), size)
        rig, detections = scene.watch()
        named += is_named(planted, inspect_health(rig, detections))
    assert named >= 9
