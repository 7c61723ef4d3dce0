"""When the refined calibration is recommended."""

from dataclasses import replace

import pytest

from posefuse.calibration.outcome import CameraOutcome, Refinement, Role, with_slow_errors
from posefuse.model.findings import Finding, FindingKind
from tests.scenes import ring

NAN = float("nan")


def finding(kind: FindingKind) -> Finding:
    return Finding(kind, ("cam_1",), None, 1.0, "deg", 0.1, 0.9, 10.0, "A sentence.", "A remedy.")


def refinement(
    role: Role = "refined",
    *,
    after_px: float = 1.0,
    gain_z: float = 5.0,
    findings: tuple[Finding, ...] | None = (),
) -> Refinement:
    """Return a refinement of three cameras; the first has a role, the others are refined."""
    rig = ring(3)
    row = CameraOutcome("", "refined", "", 2.0, after_px, 1.0, 1.0, 0.5, 0.1, 0.02, 0.01, 0.0, 0.0)
    cameras = tuple(replace(row, name=name) for name in rig.names)
    cameras = (replace(cameras[0], role=role), *cameras[1:])
    return Refinement(rig, rig, cameras, "extrinsics", 100, 50, 10, 2.0, after_px, gain_z, findings)


@pytest.mark.parametrize(
    ("result", "better"),
    [
        (refinement(findings=(finding(FindingKind.CAMERA_POSE),)), True),
        (refinement(findings=(finding(FindingKind.TIME_OFFSET),)), False),
        (refinement(findings=()), False),
        (refinement(findings=(finding(FindingKind.CAMERA_POSE),), after_px=2.5), False),
        (refinement(findings=(finding(FindingKind.CAMERA_POSE),), gain_z=NAN), True),
    ],
)
def test_the_recording_check_must_find_a_wrong_calibration(result, better):
    assert result.is_better == better


@pytest.mark.parametrize(("gain_z", "better"), [(5.0, True), (2.0, False), (NAN, True)])
@pytest.mark.parametrize(("role", "findings"), [("refined", None), ("located", ()), ("left out", ())])
def test_without_a_verdict_the_decrease_must_be_significant(role, findings, gain_z, better):
    assert refinement(role, gain_z=gain_z, findings=findings).is_better == better
    assert not refinement(role, gain_z=gain_z, findings=findings, after_px=2.5).is_better


def test_what_the_recording_check_says_does_not_change_the_prediction():
    assert refinement(findings=()).predicts_better
    assert not refinement(findings=(), after_px=2.5).predicts_better


def test_fixed_cameras_do_not_replace_the_verdict():
    assert not refinement("fixed", findings=()).is_better


def test_standard_deviations_are_at_least_those_of_the_joint_estimate():
    camera = refinement().cameras[0]
    both = with_slow_errors(camera, 0.3, 0.002)
    assert (both.turn_sd_deg, both.shift_sd_m) == (0.3, camera.shift_sd_m)
    fixed = refinement("fixed").cameras[0]
    assert with_slow_errors(fixed, 0.3, 0.002) == fixed
