"""Epipolar distances and disagreement between views."""

import numpy as np
import pytest
from benchmarks.fault_scenes import plant

from posefuse.diagnostics.epipolar import PosedView, disagreement_table, posed_views, squared_distances
from posefuse.diagnostics.normalized_views import normalize_views
from posefuse.diagnostics.observations import sample_frames
from posefuse.diagnostics.recording_model import RecordingModel

from .conftest import observe


def test_distance_of_parallel_cameras_is_the_vertical_offset():
    rotation, sigma = np.eye(3)[None], np.full(1, 0.01)
    a = PosedView(np.array([[0.1, 0.0]]), sigma, rotation, np.zeros((1, 3)))
    b = PosedView(np.array([[-0.1, 0.03]]), sigma, rotation, np.array([[1.0, 0.0, 0.0]]))
    assert squared_distances(a, b) == pytest.approx(0.03**2 / (2 * 0.01**2))
    assert squared_distances(b, a) == pytest.approx(squared_distances(a, b))


def test_only_pairs_with_the_faulty_view_disagree(walk):
    scene, _ = plant(walk, "rotated image", (2,), 180.0)
    observations = observe(scene)
    frames = sample_frames(len(observations.pixels), observations.runs, observations.period_s, 0.2, 40)
    model = RecordingModel.from_calibration(observations, frames)
    table = disagreement_table(posed_views(observations, model, normalize_views(observations, model), 1.0))
    faulty = np.zeros((4, 4), dtype=bool)
    faulty[2], faulty[:, 2] = True, True
    reference = np.isfinite(table)
    assert table[reference & faulty].min() > 2 * table[reference & ~faulty].max()
