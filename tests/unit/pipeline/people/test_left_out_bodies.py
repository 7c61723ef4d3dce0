"""Known bodies are fitted to a range of frames and some of the views."""

from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.pipeline.people.left_out_bodies import Bodies
from posefuse.pipeline.reconstruct import prepare
from posefuse.progress import Silent
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate


@pytest.mark.parametrize("cameras", [2, 3])
def test_bodies_of_a_short_range_have_the_known_lengths(cameras):
    scene = simulate(SceneOptions(duration_s=2, cameras=3, seed=3))
    plan = prepare(scene.rig, scene.detections, posefuse.Options(bodies="fit", health="off"), Silent())
    bodies = Bodies.of(plan.bodies, plan.options)
    assert bodies is not None
    names = scene.rig.names[:cameras]
    detections = plan.detections.frames(20, 32).views(names)
    tracks = plan.subjects.tracks(20, 32)
    tracks = posefuse.Tracks(tracks.person_ids, np.asarray(tracks.detection)[:, :, :cameras], tracks.state)
    noise = replace(plan.noise, scale_px=plan.noise.scale_px[:cameras])
    points = bodies.points(scene.rig.select(names), detections, tracks, noise)
    error = np.linalg.norm(points - np.asarray(scene.truth.layers["measured"].points_m)[20:32], axis=-1)
    # Two views at once are as accurate as the detector of the simulation allows.
    assert np.nanmedian(error) < 0.07
    assert np.isfinite(error).mean() > 0.95


def test_people_without_bodies_have_none():
    scene = simulate(SceneOptions(duration_s=1, cameras=3))
    plan = prepare(scene.rig, scene.detections, posefuse.Options(health="off"), Silent())
    assert Bodies.of(plan.bodies or plan.subjects, plan.options) is None
