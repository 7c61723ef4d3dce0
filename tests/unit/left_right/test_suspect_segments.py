"""Only suspect segments are solved without labels, with the same result as the whole recording."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from posefuse.left_right import relabel
from posefuse.left_right.suspect_segments import extend_segments, layer_part, replace_layer_parts, select_person
from posefuse.model.detections import Detections
from posefuse.model.label_swaps import SwapState
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Layer
from posefuse.model.tracks import Tracks
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import Scene, simulate
from posefuse.triangulation import consensus

OPTIONS = Options(pairs="enumerate")
OPTIONS = replace(OPTIONS, triangulation=replace(OPTIONS.triangulation, min_views=2))
NOISE = NoiseModel(np.full(4, CLEAN.sigma_px))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return simulate(SceneOptions(cameras=4, duration_s=6.0, detector=CLEAN, seed=5))


def both(one: Detections, other: Detections) -> tuple[Detections, Tracks]:
    """Merge two recordings of one person into one of two people."""
    rows = one.offsets[-1]
    offsets = 2 * np.asarray(one.offsets)
    mixed = {
        name: np.stack([getattr(one, name), getattr(other, name)], axis=1).reshape(
            2 * rows, *getattr(one, name).shape[1:]
        )
        for name in ("keypoints_px", "confidence", "track_ids")
    }
    detection = np.tile(np.arange(2, dtype=np.int32)[:, None], (one.n_frames, 1, one.n_views))
    return replace(one, offsets=offsets, **mixed), Tracks(("a", "b"), detection, np.full(detection.shape[:2], 2))


def swapped(detections: Detections, chain: str, view: int, start: int, stop: int) -> Detections:
    """Swap left and right of a limb in one view and a range of frames."""
    skeleton = detections.skeleton
    flags = np.zeros((detections.n_frames, 1, len(skeleton.pairs), detections.n_views), dtype=bool)
    for p, pair in enumerate(skeleton.pairs):
        flags[start:stop, :, p, view] = pair in skeleton.chains[chain]
    return relabel.exchange_labels(detections, of_one(detections), flags, skeleton.pair_indices)


def of_one(detections: Detections) -> Tracks:
    shape = (detections.n_frames, 1, detections.n_views)
    return Tracks(("a",), np.zeros(shape, dtype=np.int32), np.full(shape[:2], 2))


def as_labeled(scene: Scene, detections: Detections, tracks: Tracks) -> Layer:
    return consensus.solve(scene.rig, detections, tracks, NOISE, OPTIONS.triangulation)


def assert_same(one: Layer, other: Layer) -> None:
    for field in fields(Layer):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)


@given(arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=90)), st.floats(0.01, 0.5))
@settings(max_examples=80, deadline=None)
def test_segments_contain_suspect_frames_and_are_long_enough(suspect, period_s):
    near = extend_segments(suspect, period_s)
    assert (near | ~suspect).all()
    np.testing.assert_array_equal(near.any(axis=0), suspect.any(axis=0))
    for column in near[:, near.any(axis=0)].T:
        assert column.sum() >= min(round(4.0 / period_s), len(suspect))
        assert column.all() or column.mean() < 0.5


def test_segments_end_after_the_margin():
    suspect = np.zeros((3000, 1), dtype=bool)
    suspect[500:800] = True
    near = np.flatnonzero(extend_segments(suspect, 0.02)[:, 0])
    assert (near[0], near[-1]) == (475, 824)


def test_selected_person_has_the_same_points(scene):
    detections, tracks = both(scene.detections, swapped(scene.detections, "leg", 1, 20, 60))
    whole, frames = as_labeled(scene, detections, tracks), np.array([3, 4, 25, 26, 90])
    everything = np.arange(len(detections.skeleton))
    for person in range(2):
        first, own = select_person(detections, tracks, person, frames)
        assert_same(as_labeled(scene, first, own), layer_part(whole, person, frames, everything))
        assert_same(
            replace_layer_parts(whole, [(person, frames, everything, layer_part(whole, person, frames, everything))]),
            whole,
        )


def test_person_without_swaps_keeps_its_points(scene):
    other = swapped(scene.detections, "leg", 1, 60, 90)
    detections, tracks = both(scene.detections, other)
    layer, swaps = relabel.solve(scene.rig, detections, tracks, NOISE, OPTIONS)
    labels = as_labeled(scene, detections, tracks)
    everything, points = np.arange(detections.n_frames), np.arange(len(detections.skeleton))
    assert_same(layer_part(layer, 0, everything, points), layer_part(labels, 0, everything, points))
    assert not (np.asarray(swaps.state)[:, 0] == SwapState.SWAPPED).any()
    far = np.r_[: 60 - 40, 90 + 40 : len(everything)]
    assert_same(layer_part(layer, 1, far, points), layer_part(labels, 1, far, points))
    corrected, right = np.asarray(layer.points_m)[60:90, 1], np.asarray(labels.points_m)[60:90, 0]
    assert np.nanmax(np.linalg.norm(corrected - right, axis=-1)) < 1e-9
    leg = swaps.chains.index("leg")
    assert (np.asarray(swaps.state)[62:88, 1, 1, leg] == SwapState.SWAPPED).all()


def test_frequent_swaps_are_corrected_as_one_segment(scene):
    """If segments cover most of a recording, the result is that of all frames."""
    disturbed = scene.detections
    for start in range(0, disturbed.n_frames, 60):
        disturbed = swapped(disturbed, "arm", start // 60 % 4, start, start + 30)
    tracks = of_one(disturbed)
    layer, swaps = relabel.solve(scene.rig, disturbed, tracks, NOISE, OPTIONS)
    whole = relabel.correct_swaps(scene.rig, disturbed, tracks, NOISE, OPTIONS, as_labeled(scene, disturbed, tracks))
    assert_same(layer, whole[0])
    assert swaps == whole[1]
    assert (np.asarray(swaps.state) == SwapState.SWAPPED).any()
