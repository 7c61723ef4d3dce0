"""Real recordings in which some views are wrong: what is rejected, and which camera is named."""

import numpy as np
import pytest
from benchmarks import real_recordings

import posefuse
from posefuse.errors import PosefuseWarning
from posefuse.model.status import ViewStatus


def test_the_junk_camera_of_a_fly_is_rejected_and_named(shared_data):
    rig, detections = real_recordings.deepfly_7cam(shared_data("deepfly_7cam").parent)
    with pytest.warns(PosefuseWarning, match="'camera_3'") as said:
        result = posefuse.reconstruct(rig, detections)
    assert len(said) == 1
    shares = real_recordings.rejected_shares(result)
    assert shares.pop("camera_3") > 0.5
    assert max(shares.values()) < 0.2
    layer = result.layers["measured"]
    assert 2.0 < np.nanmedian(layer.reprojection_error_px) < 3.8
    # What lies far off, points of the side a camera does not see among them, is used nowhere.
    far = layer.view_error_px > 25.0
    assert far[..., 2].any()
    assert far[..., 4].any()
    assert (layer.view_status[far] == ViewStatus.OUTLIER).all()


def test_a_camera_with_anothers_calibration_is_named(shared_data):
    folder = shared_data("sleap_mouse").parent
    with pytest.warns(PosefuseWarning) as said:
        result = posefuse.reconstruct(*real_recordings.sleap_mouse(folder, "calibration.toml"))
    assert any("camera 'side'" in str(warning.message) for warning in said)
    assert real_recordings.rejected_shares(result)["side"] > 0.95


def test_with_the_good_calibration_no_camera_is_blamed(shared_data):
    rig, detections = real_recordings.sleap_mouse(shared_data("sleap_mouse").parent)
    assert detections.skeleton.keypoints[0] == "Nose"
    assert detections.skeleton.edges
    assert ("Shoulder_left", "Shoulder_right") in detections.skeleton.pairs
    result = posefuse.reconstruct(rig, detections)
    assert np.nanmedian(result.layers["measured"].reprojection_error_px) < 5.0
    assert not any("contradicts the other cameras" in note for note in result.provenance.notes)


def test_a_fly_before_telephoto_lenses(shared_data):
    rig, detections = real_recordings.fly_3cam(shared_data("fly_3cam").parent)
    result = posefuse.reconstruct(rig, detections)
    layer = result.layers["measured"]
    assert layer.has_point.mean() > 0.98
    assert np.nanmedian(layer.reprojection_error_px) < 1.9
    assert max(real_recordings.rejected_shares(result).values()) < 0.05
