"""Correction of swapped labels in the detections, and its effect on the points."""

from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.association import one_subject
from posefuse.errors import DetectionsError
from posefuse.left_right import model_selection, relabel
from posefuse.left_right.pairs import enumerated
from posefuse.left_right.pairs.label_likelihood import robust_evidence
from posefuse.model.detections import Detections
from posefuse.model.label_swaps import SwapState
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import ViewStatus
from posefuse.pipeline.measured_layer import reconstruct_chunks
from posefuse.pipeline.reconstruct import prepare
from posefuse.progress import Silent
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import Scene, simulate

NOISE = Options(noise_scale_px=CLEAN.sigma_px)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return simulate(SceneOptions(cameras=4, duration_s=4.0, detector=CLEAN, seed=3))


def exchange(detections: Detections, view: int, chain: str, start: int, stop: int) -> Detections:
    """Swap left and right of a limb in one view and a range of frames."""
    skeleton = detections.skeleton
    flags = np.zeros((detections.n_frames, 1, len(skeleton.pairs), detections.n_views), dtype=bool)
    for p, pair in enumerate(skeleton.pairs):
        flags[start:stop, :, p, view] = pair in skeleton.chains[chain]
    return relabel.exchange_labels(detections, tracks_of(detections), flags, skeleton.pair_indices)


def tracks_of(detections: Detections):
    return one_subject.select_subject(detections, None, one_subject.longest_track_ids(detections))


def measured(result: Reconstruction) -> np.ndarray:
    return np.asarray(result.layers["measured"].points_m)


def test_exchanging_labels_twice_restores_them(scene, rng):
    detections = scene.detections
    pairs = detections.skeleton.pair_indices
    flags = rng.random((detections.n_frames, 1, len(pairs), detections.n_views)) < 0.3
    once = relabel.exchange_labels(detections, tracks_of(detections), flags, pairs)
    twice = relabel.exchange_labels(once, tracks_of(detections), flags, pairs)
    np.testing.assert_array_equal(twice.keypoints_px, detections.keypoints_px)
    changed = (np.asarray(once.keypoints_px) != np.asarray(detections.keypoints_px)).any(axis=-1)
    expected = np.zeros_like(changed)
    for p, pair in enumerate(pairs):
        expected[:, pair] = flags[:, 0, p].reshape(-1, 1)
    visible = np.isfinite(np.asarray(detections.keypoints_px)[..., 0])
    assert not (changed & ~expected).any()
    assert (changed | ~(expected & visible)).all()


def test_points_are_unchanged_without_swaps(scene):
    actual = posefuse.reconstruct(scene.rig, scene.detections, NOISE)
    as_labeled = posefuse.reconstruct(scene.rig, scene.detections, replace(NOISE, pairs="labels"))
    np.testing.assert_array_equal(measured(actual), measured(as_labeled))
    assert actual.swaps is not None
    assert as_labeled.swaps is None
    assert not (np.asarray(actual.swaps.state) == SwapState.SWAPPED).any()


@pytest.mark.parametrize("chain", ["leg", "arm"])
def test_swapped_limb_is_corrected(chain, scene):
    swapped = exchange(scene.detections, 1, chain, 40, 70)
    actual = posefuse.reconstruct(scene.rig, swapped, NOISE)
    undisturbed = posefuse.reconstruct(scene.rig, scene.detections, replace(NOISE, pairs="labels"))
    moved = np.linalg.norm(measured(actual) - measured(undisturbed), axis=-1)
    assert np.nanpercentile(moved, 99) < 1e-9
    assert actual.swaps is not None
    state = np.asarray(actual.swaps.state)[:, 0, 1, actual.swaps.chains.index(chain)]
    assert (state[41:69] == SwapState.SWAPPED).mean() > 0.9
    assert not (state[:38] == SwapState.SWAPPED).any()
    assert not (state[72:] == SwapState.SWAPPED).any()
    status = np.asarray(actual.layers["measured"].view_status)[45:65, 0, :, 1]
    columns = [
        scene.detections.skeleton.index(name) for pair in scene.detections.skeleton.chains[chain] for name in pair
    ]
    assert (status[:, columns] == ViewStatus.USED_SWAPPED).mean() > 0.9


def test_result_is_independent_of_chunks(scene):
    swapped = exchange(scene.detections, 1, "leg", 40, 70)
    plan = prepare(scene.rig, swapped, NOISE, Silent())
    whole = posefuse.reconstruct(scene.rig, swapped, NOISE)
    plan = replace(plan, options=replace(plan.options, chunk_frames=50))
    parts = Reconstruction.concatenate(list(reconstruct_chunks(plan, Silent())))
    np.testing.assert_array_equal(measured(parts), measured(whole))
    assert parts.swaps == whole.swaps


@pytest.mark.parametrize("share", [0.0, 0.001, 0.25])
def test_share_of_independent_swaps_is_estimated(share, rng):
    truth = rng.random((500, 1, 8, 3)) < share
    # Twice the log-likelihood ratio of a normal number with mean +-d.
    d = 2.0
    evidence = 4.0 * d * (np.where(truth, d, -d) + rng.standard_normal(truth.shape))
    assert (relabel.independent_swaps(evidence)[0] != truth).mean() < 0.03


def test_evidence_is_positive_for_swapped_labels(scene):
    noise, pairs = NoiseModel(np.full(4, CLEAN.sigma_px)), scene.detections.skeleton.pair_indices
    swapped = exchange(scene.detections, 1, "arm", 0, scene.detections.n_frames)
    tracks = tracks_of(swapped)
    solved = enumerated.solve(scene.rig, swapped, tracks, noise, TriangulationOptions(min_views=2), pairs)
    evidence = robust_evidence(scene.rig, swapped, tracks, noise, pairs, solved)
    arms = [pair in swapped.skeleton.chains["arm"] for pair in swapped.skeleton.pairs]
    assert (evidence[:, arms, 1] > 0.0).mean() > 0.9
    assert (evidence[:, :, [0, 2, 3]] < 0.0).mean() > 0.9
    # Heavy tails limit the evidence of a single outlier.
    assert np.abs(evidence).max() < 100.0


def test_unsupported_segment_is_reverted(scene):
    options = TriangulationOptions(min_views=2)
    noise, tracks = NoiseModel(np.full(4, CLEAN.sigma_px)), tracks_of(scene.detections)
    pairs, chain_of = scene.detections.skeleton.pair_indices, np.zeros(len(scene.detections.skeleton.pairs))
    solve = relabel.find_method("consensus").solve
    wrong = np.zeros((scene.detections.n_frames, 1, len(pairs), 4), dtype=bool)
    wrong[10:20, :, :, 2] = True
    as_labeled = solve(scene.rig, scene.detections, tracks, noise, options)
    exchanged = solve(
        scene.rig, relabel.exchange_labels(scene.detections, tracks, wrong, pairs), tracks, noise, options
    )
    kept, reverted = model_selection.revert_unsupported_swaps(wrong, as_labeled, exchanged, noise, pairs, chain_of)
    assert not kept.any()
    assert reverted[10:20].all()
    assert not reverted[:10].any()
    # The other way round: the labels are wrong there, and exchanging them mends it.
    kept, reverted = model_selection.revert_unsupported_swaps(wrong, exchanged, as_labeled, noise, pairs, chain_of)
    np.testing.assert_array_equal(kept, wrong)
    assert not reverted.any()


@pytest.mark.parametrize(("method", "pairs"), [("consensus", "enumerate"), ("simple", "labels"), ("ransac", "labels")])
def test_default_pair_solver_depends_on_the_method(method, pairs, scene):
    options = replace(NOISE, triangulation=TriangulationOptions(method=method))
    assert prepare(scene.rig, scene.detections, options, Silent()).options.pairs == pairs


@pytest.mark.parametrize("choices", [{"pairs": "sds"}, {"sides": "votes"}, {"sides": "plane", "up": "z"}])
def test_all_combinations_run(choices, scene):
    short = exchange(scene.detections, 1, "leg", 10, 20).frames(0, 30)
    result = posefuse.reconstruct(scene.rig, short, replace(NOISE, **choices))
    assert result.swaps is not None
    assert np.isfinite(measured(result)).mean() > 0.95


@pytest.mark.parametrize("offset_s", [0.004, -0.015])
def test_small_time_offsets_change_nothing(offset_s, scene):
    swapped = exchange(scene.detections, 1, "leg", 40, 70)
    times = np.array(swapped.time_s)
    times[:, 3] += offset_s
    odd = posefuse.reconstruct(scene.rig, replace(swapped, time_s=times), NOISE)
    even = posefuse.reconstruct(scene.rig, swapped, NOISE)
    moved = np.linalg.norm(measured(odd) - measured(even), axis=-1)
    assert np.nanpercentile(moved, 99) < 1e-9


def test_unrelated_clocks_are_an_error(scene):
    times = np.array(scene.detections.time_s)
    times[:, 1:] += 3600.0 * np.arange(1, times.shape[1])
    with pytest.raises(DetectionsError, match="same clock"):
        posefuse.reconstruct(scene.rig, replace(scene.detections, time_s=times), NOISE)


@pytest.mark.parametrize("choices", [{"pairs": "sds"}, {"sides": "votes"}, {}])
def test_recording_without_detections(choices, scene):
    empty = replace(
        scene.detections,
        offsets=np.zeros_like(scene.detections.offsets),
        keypoints_px=np.empty((0, len(scene.detections.skeleton), 2)),
        confidence=np.empty((0, len(scene.detections.skeleton))),
        track_ids=np.empty(0, dtype=np.int64),
    )
    result = posefuse.reconstruct(scene.rig, empty, replace(NOISE, **choices))
    assert np.isnan(measured(result)).all()


def test_detections_below_min_confidence_are_ignored(scene):
    swapped = exchange(scene.detections, 1, "leg", 40, 70)
    confidence = np.array(swapped.confidence)
    confidence[3::4] = 0.05
    result = posefuse.reconstruct(scene.rig, replace(swapped, confidence=confidence), NOISE)
    assert result.swaps is not None
    state = np.asarray(result.swaps.state)
    assert (state[45:65, 0, 1, result.swaps.chains.index("leg")] == SwapState.SWAPPED).all()
    assert (state[:, :, 3] == SwapState.UNKNOWN).all()


def test_two_of_three_views_suffice(scene):
    """A third camera without detections must not prevent the correction."""
    three = scene.detections.views(scene.detections.view_names[:3])
    keypoints = np.array(exchange(three, 1, "leg", 40, 70).keypoints_px)
    keypoints[2::3] = np.nan
    result = posefuse.reconstruct(scene.rig.select(scene.rig.names[:3]), replace(three, keypoints_px=keypoints), NOISE)
    error = np.linalg.norm(measured(result) - np.asarray(scene.truth.layers["measured"].points_m), axis=-1)
    legs = [three.skeleton.index(name) for pair in three.skeleton.chains["leg"] for name in pair]
    assert np.isfinite(error[40:70][:, :, legs]).mean() > 0.95
    assert np.nanmedian(error[40:70][:, :, legs]) < 0.02
