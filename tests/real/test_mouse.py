"""A real mouse, whose skeleton says nothing of how it moves, followed as one of many."""

import numpy as np
from benchmarks import real

import posefuse
from posefuse.model.tracks import TrackState


def test_the_mouse_is_one_animal_all_the_time(shared_data):
    rig, detections = real.sleap_mouse(shared_data("sleap_mouse").parent)
    assert detections.skeleton.tree is None
    detections = detections if detections.rate_hz else detections.with_rate(60)
    result = posefuse.reconstruct(rig, detections, posefuse.Options(people="many"))
    assert result.person_ids == ("person_1",)
    assert result.tracks is not None
    active = np.asarray(result.tracks.state[:, 0]) == TrackState.ACTIVE
    # 7 frames are needed to believe in it.
    assert active[8:].all()
    model, measured = (np.asarray(result.layers[name].points_m[8:, 0]) for name in ("model", "measured"))
    apart = np.linalg.norm(model - measured, axis=-1)
    assert np.nanmedian(apart) < 0.003
