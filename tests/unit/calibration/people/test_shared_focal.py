"""Unknown focal lengths of cameras of one kind are estimated together, those of different cameras are not."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.calibration_scores import score_calibration

from posefuse.calibration.people import estimate as module
from posefuse.calibration.people.estimate import estimate_people
from tests.unit.calibration.people.matched_scenes import disturbed, walking_person


def relative(found) -> np.ndarray:
    return np.array([camera.matrix[0, 0] / max(camera.size_px) for camera in found.cameras])


def test_similar_cameras_share_their_focal_length(monkeypatch):
    matched, rig = walking_person(duration_s=6.0, seed=1)
    start = disturbed(matched, 4, focal=0.1)
    found = estimate_people(start)
    monkeypatch.setattr(module, "with_shared_focal", lambda joint, *_: joint)
    alone = estimate_people(start)
    assert score_calibration(found.cameras, rig).worst_focal < score_calibration(alone.cameras, rig).worst_focal
    assert np.ptp(np.log(relative(found))) < 0.5 * np.ptp(np.log(relative(alone)))
    variances = [np.diagonal(each.covariance[:, 8, :, 8]) for each in (found, alone)]
    assert (variances[0] < variances[1]).all()


def test_another_lens_is_recognized():
    matched, _ = walking_person(duration_s=6.0, seed=1)
    zoomed = matched.views[1]
    matrix = np.array(zoomed.camera.matrix)
    center = matrix[:2, 2].copy()
    matrix[:2, :2] *= 1.6
    pixels = center + 1.6 * (zoomed.keypoints_px - center)
    other = replace(zoomed, camera=replace(zoomed.camera, matrix=matrix), keypoints_px=pixels)
    views = (matched.views[0], other, *matched.views[2:])
    found = relative(estimate_people(disturbed(replace(matched, views=views), 4, focal=0.05)))
    assert found[1] / np.median(found) == pytest.approx(1.6, rel=0.15)


def test_known_focal_lengths_are_unaffected():
    matched, rig = walking_person(duration_s=2.0)
    assert score_calibration(estimate_people(matched).cameras, rig).worst_focal == 0.0
