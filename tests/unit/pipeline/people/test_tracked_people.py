"""Bodies of people tracked through a recording."""

import numpy as np

from posefuse.model.options.options import Options
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.track_recording import track_people
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.progress import Silent
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd


def test_keypoints_without_uncertainties_are_those_of_the_bodies():
    scene = simulate_crowd(CrowdOptions(people=1, duration_s=1.0, seed=3, skeleton="coco_wholebody_133"))
    options, detections = Options(), scene.detections
    tracker = tracker_of(scene.rig, detections.skeleton, default_noise(scene.rig, options), options)
    people = track_people(scene.rig, detections, options, Silent(), tracker=tracker)
    layer, _ = people.bodies(scene.rig, detections, 0, people.smoother().take(detections.n_frames))
    points_m = people.points_m()
    assert np.isfinite(points_m).any(axis=(0, 1, 3)).mean() > 0.9
    np.testing.assert_allclose(points_m, np.asarray(layer.points_m), rtol=0, atol=1e-9)
