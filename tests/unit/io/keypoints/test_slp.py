"""SLEAP project files."""

import numpy as np
import sleap_io

from posefuse import read_detections


def test_manual_instance_replaces_the_prediction_that_it_corrects(tmp_path):
    skeleton = sleap_io.Skeleton(nodes=["a", "b"], edges=[("a", "b")])
    video = sleap_io.Video(filename="cam.mp4", open_backend=False)
    guess = sleap_io.PredictedInstance.from_numpy(np.array([[1.0, 2], [3, 4]]), skeleton, point_scores=np.ones(2))
    hand = sleap_io.Instance.from_numpy(np.array([[5.0, 6], [7, 8]]), skeleton)
    hand.from_predicted = guess
    frame = sleap_io.LabeledFrame(video=video, frame_idx=2, instances=[guess, hand])
    sleap_io.save_file(sleap_io.Labels([frame]), tmp_path / "x.slp", verbose=False)
    detections = read_detections(tmp_path / "x.slp")
    np.testing.assert_array_equal(detections.keypoints_px[:], [[[5, 6], [7, 8]]])
    assert np.isnan(detections.confidence[:]).all()
    assert detections.skeleton.edges == (("a", "b"),)
