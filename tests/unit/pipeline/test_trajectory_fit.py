"""The sample to which the solve over time is fitted."""

from itertools import pairwise

import numpy as np

from posefuse.model.options.options import Options
from posefuse.model.tracks import TrackState
from posefuse.pipeline import measured_layer
from posefuse.pipeline.measured_layer import MeasuredRanges
from posefuse.pipeline.reconstruct import prepare
from posefuse.pipeline.trajectory_fit import training_spans
from posefuse.progress import Silent
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate


def test_training_spans_cover_every_person():
    state = np.zeros((5000, 2), dtype=np.int8)
    state[:, 0] = TrackState.ACTIVE
    state[2100:2150, 1] = TrackState.ACTIVE
    spans = training_spans(state)
    assert all(0 <= start < stop <= 5000 for start, stop in spans)
    assert all(before[1] <= after[0] for before, after in pairwise(spans))
    assert any(start <= 2125 < stop for start, stop in spans)
    assert training_spans(state[:90, :1]) == [(0, 90)]


def test_ranges_are_measured_once_up_to_a_bound(monkeypatch):
    scene = simulate(SceneOptions(duration_s=1.2, cameras=3))
    plan = prepare(scene.rig, scene.detections, Options(bodies="none", solve="frame", health="off"), Silent())
    calls = []
    measure = measured_layer.measure_points
    monkeypatch.setattr(measured_layer, "measure_points", lambda piece: calls.append(piece) or measure(piece))
    sample = MeasuredRanges(plan, [(0, 10), (10, 25)])
    first, second = list(sample), list(sample)
    assert len(calls) == 2
    assert [span for span, _ in first] == [(0, 10), (10, 25)]
    assert all(one is other for (_, one), (_, other) in zip(first, second, strict=True))
    monkeypatch.setattr(measured_layer, "_MAX_KEPT_BYTES", 0.0)
    sample = MeasuredRanges(plan, [(0, 10), (10, 25)])
    for (_, one), (_, other) in zip(list(sample), list(sample), strict=True):
        np.testing.assert_array_equal(one.layers["measured"].points_m, other.layers["measured"].points_m)
    assert len(calls) == 6
