"""The default layer of real recordings predicts cameras that nothing has seen."""

import numpy as np
import pytest
from benchmarks import held_out
from benchmarks.held_out_recordings import RECORDINGS

from posefuse.model.tracks import Tracks, TrackState


@pytest.mark.long
def test_default_layer_of_a_mouse_with_a_misplaced_camera_is_the_best(shared_data):
    case = RECORDINGS["sleap_mouse"](shared_data("sleap_mouse").parent)
    figures = held_out.compare(case, held_out.EVERYTHING)
    actual = figures[held_out.DEFAULT]
    assert actual.median_px < 7.3
    assert actual.median_px <= 1.01 * min(each.median_px for each in figures.values())
    assert actual.mean_px <= 1.01 * min(each.mean_px for each in figures.values())
    assert actual.predicted > 0.99


def test_people_are_matched_by_the_detections_that_they_share():
    """The names differ, and one person is lost for a frame."""
    detection = np.array([[[0, 1, 0], [1, 0, 1]], [[1, 1, -1], [0, 0, 1]], [[0, 0, 0], [-1, -1, -1]]])
    reference = Tracks(("a", "b"), detection, np.full((3, 2), TrackState.ACTIVE, dtype=np.int8))
    ours = Tracks(("x", "y"), detection[:, ::-1][:, :, [0, 2]], np.full((3, 2), TrackState.ACTIVE, dtype=np.int8))
    assert held_out.same_people(ours, reference, [0, 2]).tolist() == [[1, 0]] * 3
    # A person whom the other views do not show is none of the others.
    stranger = Tracks(("x",), detection[:, :1, :2], np.full((3, 1), TrackState.ACTIVE, dtype=np.int8))
    assert held_out.same_people(stranger, reference, [0, 1])[:, 1].tolist() == [-1] * 3
    nobody = Tracks((), detection[:, :0, :2], np.zeros((3, 0), dtype=np.int8))
    assert (held_out.same_people(nobody, reference, [0, 2]) == -1).all()
