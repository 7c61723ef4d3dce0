"""Approximate calibrations from people in real recordings, against the calibrations of the laboratories."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.people.match import match_views
from posefuse.calibration.people.tracks import tracks_in_views
from posefuse.errors import CalibrationError
from posefuse.io.calibration.read import read_cameras
from posefuse.io.keypoints.read import read_keypoints
from posefuse.io.keypoints.request import Request
from posefuse.model.options.options import Options
from posefuse.preprocess.match_cameras import match_views as match_cameras
from posefuse.progress import Silent
from tests.filmed_people import pose_errors


def observed(folder, calibration, keypoints, focal_factor=None):
    """Return the rig and the people in its views; with a factor, focal lengths are unknown and wrong by it."""
    detections = read_keypoints(folder / keypoints, Request.of(Options(), Silent()))
    rig, detections, _ = match_cameras(read_cameras(folder / calibration), detections, Options())
    people = tracks_in_views(detections, rig.cameras, focal_factor is None)
    if focal_factor is None:
        return rig, people
    views = []
    for view in people.views:
        matrix = view.camera.matrix.copy()
        matrix[:2, :2] *= focal_factor
        views.append(replace(view, camera=replace(view.camera, matrix=matrix)))
    return rig, replace(people, views=tuple(views))


@pytest.mark.parametrize("focal_factor", [None, 0.75, 1.3])
def test_balancing_person(shared_data, focal_factor):
    rig, people = observed(
        shared_data("pose2sim"), "calibration/Calib_qualisys.toml", "balancing_one_person/pose-associated", focal_factor
    )
    matched = match_views(people)
    rotations_deg, centers_m, scale = pose_errors(rig, matched)
    assert np.median(rotations_deg) < 3.0
    assert np.median(centers_m) < (0.1 if focal_factor is None else 0.25)
    assert scale == pytest.approx(1.0, abs=0.12)
    np.testing.assert_allclose(matched.offset_s, 0.0, atol=0.02)
    if focal_factor is not None:
        focal = [view.camera.matrix[0, 0] / rig[view.camera.name].matrix[0, 0] for view in matched.views]
        assert np.median(np.abs(np.log(focal))) < 0.1


def test_webcams(shared_data):
    rig, people = observed(shared_data("caliscope_webcams"), "config.toml", "xy_HOLISTIC.csv")
    rotations_deg, centers_m, _ = pose_errors(rig, match_views(people))
    assert np.median(rotations_deg) < 9.0
    assert np.median(centers_m) < 0.1


def test_balancing_person_with_shifted_clocks(shared_data):
    rig, people = observed(
        shared_data("pose2sim"), "calibration/Calib_qualisys.toml", "balancing_one_person/pose-associated"
    )
    shifts_s = (0.0, -0.4, 0.0, 0.2)
    views = tuple(replace(v, time_s=v.time_s - shift) for v, shift in zip(people.views, shifts_s, strict=True))
    matched = match_views(replace(people, views=views))
    assert np.median(pose_errors(rig, matched)[0]) < 3.0
    # Half a frame of 60 Hz is 8 ms.
    np.testing.assert_allclose(matched.offset_s, shifts_s, atol=0.01)


@pytest.mark.parametrize(("first", "second"), [((1, 0), (2, 1)), ((1, 1), (2, 0))])
def test_views_of_different_people_for_two_seconds_are_refused(shared_data, first, second):
    """Two people who walk beside each other, of whom each view shows one."""
    _, people = observed(shared_data("pose2sim"), "calibration/Calib_qualisys.toml", "two_people/pose")
    views = []
    for view, person in (first, second):
        tracks = people.views[view]
        one = {"keypoints_px": tracks.keypoints_px[:, [person]], "confidence": tracks.confidence[:, [person]]}
        views.append(replace(tracks, **one))
    with pytest.raises(CalibrationError, match=r"does not agree|hardly better|equally well"):
        match_views(replace(people, views=tuple(views)))
