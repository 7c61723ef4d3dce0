"""Observations of ranges of a recording are those of the same frames of the whole."""

import numpy as np
from benchmarks.fault_scenes import healthy

from posefuse.association.one_subject import SingleSubject
from posefuse.diagnostics.observations import gather_observations
from posefuse.model.tracks import Tracks


def test_ranges_equal_the_same_frames_of_the_whole():
    rig, detections = healthy(3, cameras=3, duration_s=2.0, rate_hz=25.0, activities=("walk",)).watch()
    subject = SingleSubject.of(detections, None)
    spans = [(3, 10), (20, 41)]
    frames = np.concatenate([np.arange(*span) for span in spans])
    whole = gather_observations(rig, detections, subject.tracks(0, detections.n_frames))
    found = gather_observations(rig, detections, Tracks.concatenate([subject.tracks(*span) for span in spans]), spans)
    assert found.runs.tolist() == [0] * 7 + [1] * 21
    np.testing.assert_array_equal(found.frame_numbers, whole.frame_numbers[frames])
    np.testing.assert_array_equal(found.time_s, whole.time_s[frames])
    column = {int(k): i for i, k in enumerate(whole.keypoint_index)}
    same = [column[int(k)] for k in found.keypoint_index]
    np.testing.assert_array_equal(found.pixels, whole.pixels[frames][:, :, same])
    np.testing.assert_array_equal(found.confidence, whole.confidence[frames][:, :, same])
