"""Real recordings with limbs' left and right exchanged by hand in one view."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks import real_recordings

import posefuse
from posefuse.association import one_subject
from posefuse.left_right import relabel
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.label_swaps import SwapState
from posefuse.model.options.options import Options


def pose2sim(shared_data) -> tuple[CameraRig, Detections]:
    return real_recordings.pose2sim(shared_data("pose2sim").parent)


def caliscope_webcams(shared_data) -> tuple[CameraRig, Detections]:
    folder = shared_data("caliscope_webcams")
    return posefuse.read_cameras(folder / "config.toml"), posefuse.read_detections(folder)


def exchange_a_quarter(detections: Detections, view: int, seed: int) -> tuple[Detections, np.ndarray]:
    """A quarter of the half seconds of each limb; and which, shape (frame, 1, pair, view)."""
    skeleton, rng = detections.skeleton, np.random.default_rng(seed)
    spell = round(0.5 * (detections.rate_hz or 30.0))
    flags = np.zeros((detections.n_frames, 1, len(skeleton.pairs), detections.n_views), dtype=bool)
    for chain in skeleton.chains.values():
        members = [pair in chain for pair in skeleton.pairs]
        for start in range(0, detections.n_frames, spell):
            flags[start : start + spell, :, members, view] = rng.random() < 0.25
    tracks = one_subject.select_subject(detections, None, one_subject.longest_track_ids(detections))
    return relabel.exchange_labels(detections, tracks, flags, skeleton.pair_indices), flags


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))])
@pytest.mark.parametrize("recording", [pose2sim, pytest.param(caliscope_webcams, marks=pytest.mark.long)])
def test_swapped_limbs_in_one_view_do_not_change_the_result(recording, seed, shared_data):
    rig, detections = recording(shared_data)
    detections = detections if detections.rate_hz else detections.with_rate(60.0)
    options = Options()
    before = posefuse.reconstruct(rig, detections, options)
    exchanged, flags = exchange_a_quarter(detections, 1, seed)
    after = posefuse.reconstruct(rig, exchanged, options)
    believed = posefuse.reconstruct(rig, exchanged, replace(options, pairs="labels"))
    points = [np.asarray(result.layers["measured"].points_m) for result in (before, after, believed)]
    moved, unmended = (1000.0 * np.linalg.norm(other - points[0], axis=-1) for other in points[1:])
    assert np.nanmedian(moved) < 2.0
    assert after.swaps is not None
    # Limbs; the points of a face are hardly farther apart than the noise.
    chains = detections.skeleton.chains
    limbs = [detections.skeleton.index(name) for chain in ("arm", "leg") for pair in chains[chain] for name in pair]
    assert np.nanmean(moved[:, :, limbs]) < 0.8 * np.nanmean(unmended[:, :, limbs])
    for chain in ("arm", "leg"):
        first = detections.skeleton.pairs.index(chains[chain][0])
        messages = np.asarray(after.swaps.state)[:, 0, 1, after.swaps.chains.index(chain)]
        reference = messages != SwapState.UNKNOWN
        wrong = (messages == SwapState.SWAPPED) != flags[:, 0, first, 1]
        assert wrong[reference].mean() < 0.1
