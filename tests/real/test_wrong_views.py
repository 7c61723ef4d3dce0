"""Real recordings with wrong views: rejected observations and identified cameras."""

import numpy as np
import pytest
from benchmarks import real_recordings

import posefuse
from posefuse.errors import PosefuseWarning
from posefuse.model.status import ViewStatus


def test_faulty_fly_camera_is_rejected_and_identified(shared_data):
    rig, detections = real_recordings.deepfly_7cam(shared_data("deepfly_7cam").parent)
    with pytest.warns(PosefuseWarning, match="'camera_3'") as messages:
        result = posefuse.reconstruct(rig, detections)
    assert len(messages) == 1
    shares = real_recordings.rejected_shares(result)
    assert shares.pop("camera_3") > 0.5
    assert max(shares.values()) < 0.2
    layer = result.layers["measured"]
    assert 2.0 < np.nanmedian(layer.reprojection_error_px) < 3.8
    # Distant points, such as those of the side that a camera does not show, are not used.
    far = layer.view_error_px > 25.0
    assert far[..., 2].any()
    assert far[..., 4].any()
    assert (layer.view_status[far] == ViewStatus.OUTLIER).all()


def test_camera_with_a_swapped_calibration_is_identified(shared_data):
    folder = shared_data("sleap_mouse").parent
    with pytest.warns(PosefuseWarning) as messages:
        result = posefuse.reconstruct(*real_recordings.sleap_mouse(folder, "calibration.toml"))
    assert any("camera 'side'" in str(warning.message) for warning in messages)
    assert real_recordings.rejected_shares(result)["side"] > 0.95


def test_correct_calibration_has_no_faulty_camera(shared_data):
    rig, detections = real_recordings.sleap_mouse(shared_data("sleap_mouse").parent)
    assert detections.skeleton.keypoints[0] == "Nose"
    assert detections.skeleton.edges
    assert ("Shoulder_left", "Shoulder_right") in detections.skeleton.pairs
    result = posefuse.reconstruct(rig, detections)
    assert np.nanmedian(result.layers["measured"].reprojection_error_px) < 5.0
    assert not any("contradicts the other cameras" in note for note in result.provenance.notes)


def test_fly_with_telephoto_lenses_is_reconstructed(shared_data):
    rig, detections = real_recordings.fly_3cam(shared_data("fly_3cam").parent)
    result = posefuse.reconstruct(rig, detections)
    layer = result.layers["measured"]
    assert layer.has_point.mean() > 0.98
    assert np.nanmedian(layer.reprojection_error_px) < 1.9
    assert max(real_recordings.rejected_shares(result).values()) < 0.05
