"""Planted faults are identified with their size; fault-free recordings give no findings."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.fault_scenes import FAULTS, USUAL, Fault, healthy, plant
from benchmarks.faults import is_named, views_of

from posefuse.diagnostics.examine import examine
from posefuse.diagnostics.registry import list_findings
from posefuse.model.findings import CLOCK_FINDINGS, POSE_FINDINGS, Finding, FindingKind
from posefuse.pipeline.diagnose import inspect_health
from posefuse.synthetic.options import DetectorOptions

from .conftest import observe


def check(scene, options: DetectorOptions | None = None) -> tuple[Finding, ...]:
    """Return the findings for a scene as seen by a simulated detector."""
    return list_findings(examine(observe(scene, options or DetectorOptions())))


def test_fault_free_recording_has_no_findings(walk):
    assert check(walk) == ()


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
def test_fault_is_identified_with_camera_and_size(walk, fault: Fault, size, views, kind, measured, tolerance):
    scene, planted = plant(walk, fault, views, size)
    findings = check(scene)
    assert [f.kind for f in findings] == [kind]
    assert set(findings[0].cameras) == set(planted.cameras)
    assert findings[0].size == pytest.approx(measured, abs=tolerance + 1e-9)
    assert findings[0].certainty > 0.9


def test_copied_pose_names_the_original(walk):
    scene, _ = plant(walk, "copied pose", (3, 1))
    first = check(scene)[0]
    assert (first.kind, first.cameras) == (FindingKind.COPIED_POSE, ("cam_3",))
    assert "'cam_1'" in first.sentence


def test_wrong_calibration_is_the_only_finding(walk):
    scene, _ = plant(walk, "another rig", ())
    assert [f.kind for f in check(scene)] == [FindingKind.WRONG_CALIBRATION]


def test_two_faults_are_distinguished(walk):
    scene, _ = plant(walk, "turned", (0,), 3.0)
    scene, _ = plant(scene, "late", (2,), 4.0)
    assert {(f.kind, f.cameras) for f in check(scene)} == {
        (FindingKind.CAMERA_POSE, ("cam_0",)),
        (FindingKind.TIME_OFFSET, ("cam_2",)),
    }


def test_views_without_overlap_are_reported(walk):
    def apart(pixels, trust, _):
        for v in range(pixels.shape[1]):
            pixels[np.arange(len(pixels)) % pixels.shape[1] != v, v] = np.nan
        return pixels, trust

    findings = check(replace(walk, after=(apart,)))
    assert [f.kind for f in findings] == [FindingKind.LOW_OVERLAP]
    assert findings[0].size == 0.0


def test_few_pairs_that_share_points_are_no_wrong_calibration():
    """One keypoint, which two cameras always see and six in turns: only one pair shares many points."""
    walk = healthy(5, cameras=8, duration_s=40.0, rate_hz=25.0, activities=("walk",))

    def in_turns(pixels, trust, rng):
        seen = rng.random((len(pixels) // 10, pixels.shape[1])) < np.where(np.arange(pixels.shape[1]) < 2, 1.0, 0.35)
        pixels[~np.repeat(seen, 10, axis=0)] = np.nan
        pixels[:, :, 1:] = np.nan
        return pixels, trust

    kinds = {finding.kind for finding in check(replace(walk, after=(in_turns,)))}
    assert not kinds & {FindingKind.WRONG_CALIBRATION, *POSE_FINDINGS, *CLOCK_FINDINGS}


def test_findings_are_ranked_and_have_remedies(walk):
    scene, _ = plant(walk, "rotated image", (1,), 90.0)
    scene, _ = plant(scene, "late", (3,), 2.0)
    findings = check(scene)
    assert findings[0].kind is FindingKind.IMAGE_TRANSFORM
    assert [f.gain for f in findings] == sorted((f.gain for f in findings), reverse=True)
    assert all(f.sentence.endswith(".") and f.remedy for f in findings)


def test_findings_are_deterministic(walk):
    scene, _ = plant(walk, "turned", (1,), 2.0)
    assert check(scene) == check(scene)


_LARGER: dict[Fault, float] = {"moved across": 3.0, "moved along": 2.0, "moved along later": 3.0, "drift": 2.0}


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_the_usual_size_are_identified(fault: Fault):
    """Some faults are larger than usual: errors of detectors that last for seconds look like smaller ones."""
    size = _LARGER.get(fault, 1.0) * USUAL[fault]
    identified = 0
    for seed in range(2000, 2010):
        scene, planted = plant(healthy(seed), fault, views_of(fault, 0), size)
        rig, detections = scene.watch()
        identified += is_named(planted, inspect_health(rig, detections))
    assert identified >= 9
