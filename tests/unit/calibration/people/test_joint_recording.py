"""Views with clocks of their own become one recording."""

import numpy as np
import pytest

from posefuse.calibration.people.joint_recording import joint_recording
from tests.unit.calibration.people.matched_scenes import walking_person


def test_views_of_other_rates_and_starts_observe_the_same_moments():
    matched, rig = walking_person(cameras=3, duration_s=4.0, rates_hz=(25.0, 30.0), offsets_s=(0.0, 0.5, -0.8))
    recording, place = joint_recording(matched)
    assert recording.xy.shape[:3] == (120, 3, 26)
    assert place.shape == (1, 26)
    assert np.isnan(recording.time_s[100:, 0]).all()
    frames = np.arange(30, 60)
    xy, sigma = recording.at(frames, np.zeros((len(frames), 3)))
    assert np.isfinite(sigma).mean() > 0.9
    # Interpolated observations agree with the true cameras: errors in px are those of the detector.
    focal, points = rig.cameras[0].matrix[0, 0], []
    for column in range(26):
        rows, right = [], []
        for v, camera in enumerate(rig.cameras):
            for axis in range(2):
                row = camera.rotation[axis] - xy[5, column, v, axis] * camera.rotation[2]
                rows.append(row)
                right.append(row @ camera.center_m)
        residual = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[1]
        points.append(residual)
    assert focal * np.sqrt(np.median(points)) / 5.0 < 30.0


def test_keypoints_of_one_view_are_not_used():
    matched, _ = walking_person(cameras=3, duration_s=2.0)
    for view in matched.views[1:]:
        view.keypoints_px[:, :, :5] = np.nan
    recording, place = joint_recording(matched)
    assert recording.xy.shape[2] == 21
    assert (place[0, :5] == -1).all()
    assert place[0, 5:].tolist() == list(range(21))


def test_uniform_confidence_carries_no_information():
    matched, _ = walking_person(cameras=2, duration_s=2.0)
    for view in matched.views:
        view.confidence[:] = 0.2
    sigma = joint_recording(matched)[0].sigma
    camera = matched.views[0].camera
    expected = 0.0045 * max(camera.size_px) / camera.matrix[0, 0]
    assert np.nanmedian(sigma) == pytest.approx(expected, rel=0.1)
