"""Explanations are chosen by their evidence, and those that fit equally well are named."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.clock_coverage import simulate

from posefuse.calibration.joint.estimate import JointEstimate, estimate
from posefuse.calibration.joint.evidence import CLOCK_KINDS, Comparison, choose
from posefuse.calibration.joint.recording import JointRecording


@pytest.fixture(scope="module")
def joint(walk: tuple[JointRecording, np.ndarray]) -> JointEstimate:
    """Return the estimate of a walk."""
    out = estimate(walk[0])
    assert out is not None
    return out


def with_data(joint: JointEstimate, change: np.ndarray, covariance: np.ndarray) -> JointEstimate:
    """Return an estimate whose keypoints tell a change, shape (view, parameter), with a covariance."""
    inside = joint.basis.T @ joint.projection
    information = np.linalg.inv(inside @ covariance @ inside.T)
    return replace(joint, information=information, evidence_score=information @ inside @ change.ravel())


def variances(joint: JointEstimate, sd: float) -> np.ndarray:
    """Return a covariance with small standard deviations of poses and drifts, and another of the offsets."""
    return np.diag(np.square(np.tile([1e-3] * 3 + [5e-3] * 3 + [sd, 2e-5], (joint.change.shape[0], 1)).ravel()))


def one_change(joint: JointEstimate, view: int, parameter: int, size: float) -> np.ndarray:
    """Return one change and no other, shape (view, parameter)."""
    change = np.zeros_like(joint.change)
    change[view, parameter] = size
    return change


def with_change(joint: JointEstimate, view: int, parameter: int, size: float, sd: float) -> JointEstimate:
    """Return an estimate with one change, and no other, and small standard deviations elsewhere."""
    return with_data(joint, one_change(joint, view, parameter, size), variances(joint, sd))


def test_synchronized_views_need_no_explanation(joint):
    assert choose(with_change(joint, 0, 6, 0.0, 0.003)) == ()


def test_late_view_is_named(joint):
    (choice,) = choose(with_change(joint, 2, 6, 0.05, 0.003))
    assert (choice.explanation.kind, choice.explanation.view) == ("offset", 2)
    assert choice.rivals == ()


def test_large_drift_is_a_frame_rate_error(joint):
    for error in (1.0 / 1001.0, -1.0 / 1001.0):
        (choice,) = choose(with_change(joint, 1, 7, error, 0.003))
        assert (choice.explanation.kind, choice.explanation.view) == ("rate", 1)
        assert np.sign(choice.explanation.rate_error) == np.sign(error)


def test_small_drift_is_not_reported(joint):
    assert choose(with_change(joint, 1, 7, 3e-5, 0.003)) == ()


def test_explanations_that_fit_equally_well_are_rivals(joint):
    """A walk straight ahead shifts the person as a moved camera does."""
    alike = np.zeros_like(joint.change)
    alike[1, 6], alike[1, 3:6] = 1.0, (-1.0, 0.5, 0.0)
    loose = alike.ravel()
    spread = variances(joint, 0.003) + 0.1**2 * np.outer(loose, loose)
    choices = choose(with_data(joint, one_change(joint, 1, 6, 0.12), spread))
    named = {choices[0].explanation.kind, *(rival.kind for rival in choices[0].rivals)}
    assert "offset" in named
    assert named & {"pose", "rotation", "shift"}


def test_two_cameras_have_an_offset_and_no_drift():
    """Two views of a walk, 6 s at 25 Hz, 0.1 s apart: a constant offset, not a drift of tens of thousands of ppm."""
    recording, _ = simulate("walks", 6.0, np.random.default_rng(4))
    times = recording.time_s[:, :2].copy()
    times[:, 1] -= 0.1
    two = replace(
        recording,
        names=recording.names[:2],
        xy=recording.xy[:, :2],
        sigma=recording.sigma[:, :2],
        time_s=times,
        rotation=recording.rotation[:2],
        center_m=recording.center_m[:2],
    )
    joint = estimate(two, prior=np.tile([0.02] * 3 + [0.02] * 3 + [1.0, 5e-4], (2, 1)))
    assert joint is not None
    choices = choose(joint)
    assert [choice.explanation.kind for choice in choices] == ["offset"]
    assert all(choice.explanation.kind in CLOCK_KINDS and not choice.rivals for choice in choices)
    change, _ = Comparison(joint).posterior(tuple(choice.explanation for choice in choices))
    assert not change[:, 7].any()


def test_errors_that_all_cameras_share_are_nobodys_fault(joint, rng):
    """Every camera is half a degree and 2 cm off, and every clock 10 ms: none of them stands out."""
    sd = np.tile([np.radians(0.5)] * 3 + [0.02] * 3 + [0.01, 0.0], (5, 1))
    for _ in range(20):
        assert choose(with_data(joint, sd * rng.standard_normal(sd.shape), variances(joint, 0.003))) == ()


def test_one_camera_that_stands_out_is_named(joint):
    """A shift of 5 cm of one camera among others that are exact."""
    (choice,) = choose(with_change(joint, 3, 4, 0.05, 0.003))
    assert (choice.explanation.kind, choice.explanation.view) == ("shift", 3)


def test_keypoints_that_tell_nothing_need_no_explanation(joint):
    nothing = replace(
        joint,
        information=np.zeros_like(joint.information),
        evidence_score=np.zeros_like(joint.evidence_score),
    )
    assert choose(nothing) == ()


def test_two_cameras_that_stand_out_are_both_named(joint):
    """Each hides the other: with one of them alone, the remaining errors are larger than usual."""
    change = one_change(joint, 1, 3, 0.05) + one_change(joint, 3, 4, 0.05)
    choices = choose(with_data(joint, change, 0.1 * variances(joint, 0.003)))
    assert {(choice.explanation.kind, choice.explanation.view) for choice in choices} == {("shift", 1), ("shift", 3)}
