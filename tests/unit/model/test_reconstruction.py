"""Reconstructions: layers that fit, ranges, statuses with sentences."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import LayerError, OptionsError, PosefuseError, ResultError
from posefuse.model.concatenate import concatenate_ranges
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer, Reconstruction, unpack_covariance
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.pipeline.reconstruct import reconstruct
from tests.people import simulate_walkers, track_perfectly
from tests.scenes import body_points, ring, simulate_detections


@pytest.fixture
def result(rng) -> Reconstruction:
    rig = ring(3)
    return reconstruct(rig, simulate_detections(rig, body_points(rng, 7), rng))


def test_chunks_concatenate_to_the_whole(result):
    parts = list(result.chunks(3))
    assert [part.n_frames for part in parts] == [3, 3, 1]
    assert Reconstruction.concatenate(parts) == result


def test_concatenated_ranges_equal_the_whole(result):
    assert concatenate_ranges(result.chunks(3), 7) == result
    everything = track_perfectly(simulate_walkers(2, 0.6))
    assert everything.poses is not None
    assert everything.swaps is not None
    assert concatenate_ranges(everything.chunks(5), everything.n_frames) == everything
    for wrong in (6, 8):
        with pytest.raises(ResultError, match=f"have 7 frames in total, but the reconstruction has {wrong}"):
            concatenate_ranges(result.chunks(3), wrong)


def test_equality_is_by_content(result):
    assert result != replace(result, rate_hz=25.0)
    other = replace(result.layers["measured"], status=np.ones_like(result.layers["measured"].status))
    assert result != replace(result, layers={"measured": other})


def test_inconsistent_arrays_are_refused(result):
    layer = result.layers["measured"]
    with pytest.raises(ResultError, match=r"covariance_m2: expected the axes \(frame, person, keypoint, entry\)"):
        replace(layer, covariance_m2=np.zeros((7, 1, 17, 9)))
    with pytest.raises(ResultError, match="Unknown layer 'raw'; the layers are measured, solved, model"):
        replace(result, layers={"raw": layer})
    with pytest.raises(ResultError, match="needs at least one layer"):
        replace(result, layers={})
    with pytest.raises(ResultError, match="has 3 views, but the rig has 2 cameras"):
        replace(result, rig=ring(2))
    with pytest.raises(ResultError, match="The tracks have the people"):
        replace(result, person_ids=("someone",))
    with pytest.raises(ResultError, match="must be unique"):
        Tracks(("a", "a"), np.zeros((1, 2, 1)), np.zeros((1, 2)))


def test_best_layer_is_the_most_processed_one(result):
    assert result.best_layer()[0] == "measured"
    both = replace(result, layers={"solved": result.layers["measured"], "measured": result.layers["measured"]})
    assert both.best_layer()[0] == "solved"
    assert both.best_layer("measured")[0] == "measured"
    with pytest.raises(ResultError, match="no layer 'model'; it has measured"):
        result.best_layer("model")


def test_absent_layer_is_an_error_that_states_how_to_get_it(result):
    with pytest.raises(KeyError) as caught:
        result.layers["solved"]
    assert isinstance(caught.value, PosefuseError)
    assert str(caught.value).startswith("This result has no layer 'solved'; it has measured. By default, points are")
    assert "`solve='trajectory'`" in str(caught.value)
    with pytest.raises(LayerError, match="There is no layer 'smoothed'. Choose one of: measured, solved, model"):
        result.layers["smoothed"]
    assert "solved" not in result.layers
    assert result.layers.get("solved") is None
    assert pickle.loads(pickle.dumps(result.layers)) == result.layers


def test_derived_numbers_of_a_layer(result):
    layer: Layer = result.layers["measured"]
    matrices = unpack_covariance(layer.covariance_m2)
    np.testing.assert_array_equal(matrices, np.swapaxes(matrices, -1, -2))
    np.testing.assert_allclose(layer.sd_m**2, np.diagonal(matrices, axis1=-2, axis2=-1))
    assert (layer.n_views == 3).all()
    assert layer.has_point.all()


def test_every_status_has_a_description():
    for code in (*PointStatus, *ViewStatus):
        assert code.sentence
        assert code.label == code.name.lower()
    assert [status.has_point for status in PointStatus] == [True] * 7 + [False] * (len(PointStatus) - 7)
    assert Source.NONE.label == ""
    assert Source.MEASURED.label == "measured"


def test_noise_must_be_positive():
    with pytest.raises(OptionsError, match="noise_scale_px must be positive"):
        NoiseModel(np.array([1.0, 0.0]))
    with pytest.raises(OptionsError, match="exponent"):
        NoiseModel(np.array([1.0]), -1.0)
