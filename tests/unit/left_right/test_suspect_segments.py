"""Only stretches in which labels look wrong are gone into, and what is gone into comes out as it would by itself."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from posefuse.left_right import relabel
from posefuse.left_right.suspect_segments import alone, around, part_of, with_parts
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
    """Two recordings of one person each as one of two."""
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
    """A limb's left and right taken for each other in a view for some frames."""
    skeleton = detections.skeleton
    flags = np.zeros((detections.n_frames, 1, len(skeleton.pairs), detections.n_views), dtype=bool)
    for p, pair in enumerate(skeleton.pairs):
        flags[start:stop, :, p, view] = pair in skeleton.chains[chain]
    return relabel.relabelled(detections, of_one(detections), flags, skeleton.pair_indices)


def of_one(detections: Detections) -> Tracks:
    shape = (detections.n_frames, 1, detections.n_views)
    return Tracks(("a",), np.zeros(shape, dtype=np.int32), np.full(shape[:2], 2))


def believed(scene: Scene, detections: Detections, tracks: Tracks) -> Layer:
    return consensus.solve(scene.rig, detections, tracks, NOISE, OPTIONS.triangulation)


def assert_same(one: Layer, other: Layer) -> None:
    for field in fields(Layer):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)


@given(arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=90)), st.floats(0.01, 0.5))
@settings(max_examples=80, deadline=None)
def test_frames_around_signs_hold_them_and_enough_to_learn_from(signs, period_s):
    near = around(signs, period_s)
    assert (near | ~signs).all()
    np.testing.assert_array_equal(near.any(axis=0), signs.any(axis=0))
    for column in near[:, near.any(axis=0)].T:
        assert column.sum() >= min(round(4.0 / period_s), len(signs))
        assert column.all() or column.mean() < 0.5


def test_nothing_far_from_signs_is_gone_into():
    signs = np.zeros((3000, 1), dtype=bool)
    signs[500:800] = True
    near = np.flatnonzero(around(signs, 0.02)[:, 0])
    assert (near[0], near[-1]) == (475, 824)


def test_a_person_alone_is_triangulated_as_among_others(scene):
    detections, tracks = both(scene.detections, swapped(scene.detections, "leg", 1, 20, 60))
    whole, frames = believed(scene, detections, tracks), np.array([3, 4, 25, 26, 90])
    everything = np.arange(len(detections.skeleton))
    for person in range(2):
        mine, own = alone(detections, tracks, person, frames)
        assert_same(believed(scene, mine, own), part_of(whole, person, frames, everything))
        assert_same(
            with_parts(whole, [(person, frames, everything, part_of(whole, person, frames, everything))]), whole
        )


def test_who_shows_no_sign_keeps_the_points_of_the_labels(scene):
    other = swapped(scene.detections, "leg", 1, 60, 90)
    detections, tracks = both(scene.detections, other)
    layer, swaps = relabel.solve(scene.rig, detections, tracks, NOISE, OPTIONS)
    labels = believed(scene, detections, tracks)
    everything, points = np.arange(detections.n_frames), np.arange(len(detections.skeleton))
    assert_same(part_of(layer, 0, everything, points), part_of(labels, 0, everything, points))
    assert not (np.asarray(swaps.state)[:, 0] == SwapState.SWAPPED).any()
    far = np.r_[: 60 - 40, 90 + 40 : len(everything)]
    assert_same(part_of(layer, 1, far, points), part_of(labels, 1, far, points))
    mended, right = np.asarray(layer.points_m)[60:90, 1], np.asarray(labels.points_m)[60:90, 0]
    assert np.nanmax(np.linalg.norm(mended - right, axis=-1)) < 1e-9
    leg = swaps.chains.index("leg")
    assert (np.asarray(swaps.state)[62:88, 1, 1, leg] == SwapState.SWAPPED).all()


def test_swaps_all_over_are_put_right_as_in_one_piece(scene):
    """Where stretches make up most of a recording the answer is that of asking in every frame."""
    disturbed = scene.detections
    for start in range(0, disturbed.n_frames, 60):
        disturbed = swapped(disturbed, "arm", start // 60 % 4, start, start + 30)
    tracks = of_one(disturbed)
    layer, swaps = relabel.solve(scene.rig, disturbed, tracks, NOISE, OPTIONS)
    whole = relabel.put_right(scene.rig, disturbed, tracks, NOISE, OPTIONS, believed(scene, disturbed, tracks))
    assert_same(layer, whole[0])
    assert swaps == whole[1]
    assert (np.asarray(swaps.state) == SwapState.SWAPPED).any()
