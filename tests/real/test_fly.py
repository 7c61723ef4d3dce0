"""A real fly with a kinematic tree: six legs in seven cameras that each show one side."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks import held_out_recordings, real_recordings

import posefuse
from posefuse.calibration.people.match import match_views
from posefuse.calibration.people.tracks import tracks_in_views
from posefuse.errors import CalibrationError
from posefuse.model.detections import Detections
from posefuse.model.options.tracker import InitiationOptions
from posefuse.skeleton.skeletons import shipped_skeleton

METRES_PER_UNIT = 0.72e-3
"""The recording's unit is its own; with this, the fly's front legs are as long as a fly's are."""


def test_tracks_every_leg_of_a_tethered_fly(shared_data):
    folder = shared_data("deepfly_7cam")
    rig, detections = real_recordings.deepfly_7cam(folder.parent)
    cameras = []
    for camera in rig.cameras:
        pose = np.array(camera.camera_from_world)
        pose[:3, 3] *= METRES_PER_UNIT
        cameras.append(replace(camera, camera_from_world=pose))
    rig = replace(rig, cameras=tuple(cameras))
    fly = replace(detections, skeleton=shipped_skeleton("fly_38")).with_rate(100.0)
    # Fifteen frames are all there are.
    initiation = InitiationOptions(min_age_s=0.025, min_age_two_views_s=0.045)
    options = posefuse.Options(
        people="one", bodies="fit", pairs="labels", exclude_camera=("camera_3",),
        tracker=posefuse.TrackerOptions(initiation=initiation),
    )  # fmt: skip
    result = posefuse.reconstruct(rig, fly, options)
    model = np.asarray(result.layers["model"].points_m[:, 0])
    present = np.isfinite(model).all(axis=(1, 2))
    assert present.mean() > 0.9
    second = METRES_PER_UNIT * np.load(folder / "deepfly_7cam.npz")["points3d"]
    off_um = 1e6 * np.linalg.norm(model[present] - second[present], axis=-1)
    # A hundredth of its length.
    assert np.median(off_um) < 35.0
    assert (np.asarray(result.layers["model"].n_views[4:]) >= 3).mean() > 0.9
    assert result.poses is not None
    assert result.poses.nis_dof[5, 0] > 200


def test_fly_tracked_at_25_hz_has_small_reprojection_errors(shared_data):
    """The legs move too far between frames to be predicted."""
    case = held_out_recordings.fly(shared_data("fly_3cam").parent)
    rig, fast = case.rig, case.detections
    pixels, confidence = fast.dense()
    fly = Detections.from_dense(fast.skeleton, fast.view_names, pixels[::12], confidence[::12], rate_hz=25.0)
    result = posefuse.reconstruct(rig, fly, posefuse.Options(people="many"))
    assert result.person_ids == ("person_1",)
    model, measured = (np.asarray(result.layers[name].points_m[:, 0]) for name in ("model", "measured"))
    assert result.skeleton.tree is not None
    share = np.linalg.norm(model - measured, axis=-1) / result.skeleton.tree.size_m
    assert np.isfinite(share).mean() > 0.9
    assert np.nanmedian(share) < 0.02
    assert np.nanpercentile(share, 90) < 0.05


def test_cameras_of_a_fly_cannot_be_calibrated_from_it(shared_data):
    """Telephoto lenses: the error says why, instead of poses that are wrong by tens of degrees."""
    rig, detections = real_recordings.fly_3cam(shared_data("fly_3cam").parent)
    with pytest.raises(CalibrationError, match="Perspective is too weak"):
        match_views(tracks_in_views(detections, rig.cameras))
