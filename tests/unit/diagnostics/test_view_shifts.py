"""Shifts that all keypoints of a view share."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.diagnostics.view_shifts import common_shift
from posefuse.model.cameras import CameraRig, rotation_from_vector
from posefuse.pipeline.reconstruct import reconstruct
from tests.scenes import body_points, ring, simulate_detections


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.0, 12.0)])
def test_a_shift_of_all_keypoints_is_found_among_the_errors_of_single_ones(rng, shift):
    residuals = rng.normal(0.0, 4.0, (17, 2)) + shift + rng.normal(0.0, 5.0, (200, 17, 2))
    residuals[rng.uniform(size=(200, 17)) < 0.2] = np.nan
    found = common_shift(residuals)
    if shift[1]:
        assert found is not None
        np.testing.assert_allclose(found, shift, atol=3.0)
    else:
        assert found is None or np.linalg.norm(found) < 2.5
    assert common_shift(residuals[:10]) is None


@pytest.mark.parametrize("turned_deg", [0.0, 0.8])
@pytest.mark.parametrize("cameras", [3, 5])
def test_a_turned_camera_is_noted_with_the_command(rng, cameras, turned_deg):
    rig = ring(cameras)
    detections = simulate_detections(rig, body_points(rng, 60), rng, 8.0)
    first = rig.cameras[0]
    pose = np.array(first.camera_from_world)
    pose[:3] = rotation_from_vector(np.radians([turned_deg, 0.0, 0.0])) @ pose[:3]
    turned = CameraRig((replace(first, camera_from_world=pose), *rig.cameras[1:]))
    notes = [note for note in reconstruct(turned, detections).provenance.notes if "common direction" in note]
    assert len(notes) == (turned_deg > 0.0)
    for note in notes:
        assert f"px in {first.name}" in note
        assert "`posefuse refine-calibration` tests the poses" in note
