"""Bounds of the recording check: reached, reported, and switched off."""

from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.association.one_subject import SingleSubject
from posefuse.diagnostics import recording_check
from posefuse.diagnostics.examine import SHORT
from posefuse.model.findings import FindingKind
from posefuse.parallel import Jobs
from tests.scenes import ring, simulate_detections


def moving_body(rng: np.random.Generator) -> np.ndarray:
    """Return a moving body, shape (300, 17, 3)."""
    time = np.arange(300)[:, None, None] / 30.0
    body = rng.uniform([-0.4, -0.4, 0.0], [0.4, 0.4, 1.7], (17, 3))
    return body + 0.3 * np.sin(time * rng.uniform(0.5, 2.0, (17, 3)))


def exchanged_cameras(n_views: int):
    """Return a recording of a moving person in which the first three cameras are in another order."""
    rng, rig = np.random.default_rng(4), ring(n_views)
    detections = simulate_detections(rig, moving_body(rng), rng, rate_hz=30.0)
    order = [1, 2, 0, *range(3, n_views)]
    cameras = tuple(replace(rig.cameras[source], name=rig.names[v]) for v, source in enumerate(order))
    return replace(rig, cameras=cameras), detections


def test_bound_of_the_search_for_gross_faults_is_reported():
    rig, detections = exchanged_cameras(6)
    subject = SingleSubject.of(detections, None)
    kinds = [finding.kind for finding in recording_check.find_faults(rig, detections, subject, SHORT)]
    assert kinds[0] == FindingKind.CAMERA_ORDER
    assert FindingKind.INCOMPLETE not in kinds
    bounded = replace(SHORT, max_comparisons=100)
    findings = recording_check.find_faults(rig, detections, subject, bounded)
    assert [finding.kind for finding in findings][-1] == FindingKind.INCOMPLETE
    assert "did not examine the order of the cameras" in findings[-1].sentence


def test_bound_of_the_search_for_small_faults_is_reported():
    rng, rig = np.random.default_rng(5), ring(6)
    detections = simulate_detections(rig, moving_body(rng), rng, rate_hz=30.0)
    cameras = list(rig.cameras)
    for v in (1, 4):
        pose = cameras[v].camera_from_world.copy()
        pose[:3, 3] += 0.05
        cameras[v] = replace(cameras[v], camera_from_world=pose)
    rig, subject = replace(rig, cameras=tuple(cameras)), SingleSubject.of(detections, None)
    for most, complete in ((1, False), (5, True)):
        findings = recording_check.find_faults(rig, detections, subject, replace(SHORT, max_faults=most))
        kinds = [finding.kind for finding in findings]
        # The joint estimate judges all poses, whatever the bound.
        assert kinds.count(FindingKind.CAMERA_POSE) == 2
        assert (FindingKind.INCOMPLETE not in kinds) == complete


@pytest.mark.parametrize("health", ["on", "off"])
def test_option_disables_the_check(health):
    rig, detections = exchanged_cameras(5)
    with pytest.warns(posefuse.PosefuseWarning):
        result = posefuse.reconstruct(rig, detections, posefuse.Options(health=health, solve="frame"))
    assert bool(result.findings) == (health == "on")


def test_findings_do_not_depend_on_the_number_of_processes():
    """Two views with gross faults: one has another focal length, the other is turned."""
    rng, rig = np.random.default_rng(6), ring(5)
    detections = simulate_detections(rig, moving_body(rng), rng, rate_hz=30.0)
    cameras = list(rig.cameras)
    cameras[1] = replace(cameras[1], matrix=cameras[1].matrix * np.array([[1.6, 1.0, 1.0], [1.0, 1.6, 1.0], [1.0] * 3]))
    cameras[3] = replace(cameras[3], camera_from_world=np.diag([-1.0, -1.0, 1.0, 1.0]) @ cameras[3].camera_from_world)
    rig, subject = replace(rig, cameras=tuple(cameras)), SingleSubject.of(detections, None)
    alone = recording_check.find_faults(rig, detections, subject, SHORT)
    with Jobs(2) as jobs:
        together = recording_check.find_faults(rig, detections, subject, SHORT, jobs)
    assert {FindingKind.FOCAL_LENGTH, FindingKind.IMAGE_TRANSFORM} <= {finding.kind for finding in alone}
    assert together == alone
