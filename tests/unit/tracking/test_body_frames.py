"""Mirror images of parts, and hands that a detection shows where the other one is."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.arrays import frozen
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.crowd_options import NO_FAULTS, CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from posefuse.synthetic.options import CLEAN
from posefuse.tracking.body_frames import find_exchanged, mirror_images

WHOLE = find_skeleton("coco_wholebody_133")
LEFT, RIGHT, _ = WHOLE.parts


def test_mirror_images_are_mutual():
    images = mirror_images(WHOLE)
    assert images == [1, 0, None]
    for i, j in enumerate(images):
        if j is not None:
            np.testing.assert_array_equal(WHOLE.mirror[WHOLE.parts[i].keypoints], WHOLE.parts[j].keypoints)


@pytest.mark.parametrize("exchanged", [False, True])
def test_exchanged_hands_are_found(exchanged):
    """In one view of the last frame, a detection shows the hands exchanged."""
    scene = simulate_crowd(
        CrowdOptions(people=1, cameras=4, duration_s=1.0, skeleton=WHOLE.name, detector=CLEAN, faults=NO_FAULTS)
    )
    tracker = tracker_of(scene.rig, WHOLE, default_noise(scene.rig, Options()), Options())
    frames = [Frame.of(scene.detections, i) for i in range(scene.detections.n_frames)]
    for frame in frames[:-1]:
        tracker.process(frame)
    pixels = frames[-1].keypoints_px.copy()
    if exchanged:
        both = np.concatenate([LEFT.keypoints, RIGHT.keypoints])
        pixels[0, both] = pixels[0, WHOLE.mirror[both]]
    frame = replace(frames[-1], keypoints_px=frozen(pixels))
    bodies = tracker.track_bodies(frame).bodies
    assert bodies is not None
    expected = np.zeros_like(bodies.exchanged)
    expected[bodies.rows == 0, :2] = exchanged
    np.testing.assert_array_equal(bodies.exchanged, expected)
    projected = tracker.confirmed.projected(tracker.settings.cameras, tracker.settings)
    far = find_exchanged(frame, bodies.rows, projected, WHOLE, mirror_images(WHOLE), margin_m=10.0)
    assert not far.any()
