"""Cameras that nobody started together: their offsets from pairs, and from all views."""

import numpy as np
import pytest

from posefuse.diagnosis import inspect_health, measure_sync
from posefuse.health.findings import Kind
from posefuse.health.starts import joined
from posefuse.synthetic.faults import Scene, healthy, plant

RATE_HZ = 25.0


def started_apart(scene: Scene, offsets: tuple[float, ...]) -> Scene:
    """The scene with each view late by so many frames."""
    for view, offset in enumerate(offsets):
        scene = plant(scene, "late", (view,), offset)[0] if offset else scene
    return scene


def test_views_are_joined_by_the_pairs_that_agree_best(rng):
    """A pair that agrees a little at a wrong lag is not heeded while others join both views."""
    truth, lags = np.array([0.0, 0.4, -0.2, 0.9]), 0.1 * np.arange(-15, 16)
    costs = np.full((4, 4, len(lags)), np.inf)
    for b in range(4):
        for a in range(b):
            costs[a, b] = np.minimum(np.abs(lags - (truth[b] - truth[a])), 0.5) + 0.01 * rng.random(len(lags))
    costs[0, 3] = 0.3 + 0.2 * np.abs(lags + 1.0)
    assert joined(costs, lags) == pytest.approx(truth, abs=1e-9)


@pytest.mark.parametrize("offsets", [(0.0, -0.9, 1.4, 0.6, -1.5), (0.0, 21.0, -38.0, -14.0, 33.0)])
def test_every_clock_is_measured_where_no_two_agree(offsets):
    scene = started_apart(healthy(12, cameras=5, duration_s=20.0, rate_hz=RATE_HZ, activities=("walk",)), offsets)
    views, sync = measure_sync(*scene.watch(), reference=scene.rig.names[0])
    errors = [RATE_HZ * view.late_s[0] - offset for view, offset in zip(views, offsets, strict=True)]
    assert np.abs(errors).max() < 0.2
    assert set(sync.cameras) == set(scene.rig.names[1:])


def test_cameras_out_of_step_are_not_said_to_stand_elsewhere():
    """Offsets of all views look one by one like poses that are off."""
    scene = started_apart(
        healthy(1002, duration_s=60.0, rate_hz=RATE_HZ, activities=("walk",)), (-1.4, -0.9, 0.0, 1.5, -0.6, 1.4)
    )
    findings = inspect_health(*scene.watch())
    assert {finding.kind for finding in findings} == {Kind.LATE}
    assert {finding.cameras[0] for finding in findings} >= {"cam_0", "cam_3", "cam_5"}


def test_what_nothing_had_to_be_added_to_has_a_standard_deviation():
    scene = started_apart(healthy(2001, cameras=5, duration_s=20.0, rate_hz=RATE_HZ, activities=("walk",)), (0, 0, 10))
    late = [finding for finding in inspect_health(*scene.watch()) if finding.kind is Kind.LATE]
    assert late
    assert all(0.0 < finding.sd < 0.3 for finding in late)
