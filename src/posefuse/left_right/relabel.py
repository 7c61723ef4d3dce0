"""Keypoints by a method that believes labels, after the labels of left and right were put right.

Pairs are solved from rays whose labels are not believed; which point is left is decided over time; what that says of
each view's labels is put into the detections, and these are triangulated. Solving for two points needs to tell them
apart in every view and frame by itself; where they are close to each other for the noise, that alone would push them
apart. See docs/methods.md, "Left and right".
"""

from dataclasses import dataclass, fields, replace
from importlib import import_module

import numpy as np

from posefuse.left_right.layout import Layout
from posefuse.left_right.model_selection import cost, settled
from posefuse.left_right.pairs.label_likelihood import robust_evidence
from posefuse.left_right.registry import decide_sides
from posefuse.left_right.results import UNKNOWN_RATE_HZ, PairsInTime
from posefuse.left_right.suspect_segments import (
    alone,
    around,
    of_keypoints,
    part_of,
    signs_of_swaps,
    with_parts,
    without_parts,
)
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.label_swaps import Swaps, SwapState
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.skeleton.skeletons import Skeleton
from posefuse.triangulation.registry import find_method

_MODULES = {"enumerate": "enumerated", "sds": "population_search"}
# Shares of pairs that are swapped on their own: to begin with, and between which they are sought.
_RARE, _RAREST, _MOST = 0.02, 1e-4, 0.4
_ROUNDS = 10
_MOST_EVIDENCE = 200.0
_SAYS_NOTHING = (ViewStatus.UNSEEN, ViewStatus.NOT_RECORDED, ViewStatus.LOW_CONFIDENCE, ViewStatus.BEYOND_LENS)


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: Options
) -> tuple[Layer, Swaps]:
    """Triangulate every keypoint of every person, left and right put right.

    Args:
        rig: the cameras, in the order of the detections' views.
        detections: in memory; some seconds of them, for sides are decided over time.
        tracks: whose detection is whose, of the same frames.
        noise: of the detections.
        options: ``pairs`` is ``enumerate`` or ``sds``.

    Returns:
        The measured layer, and which views took left for right.
    """
    layer = find_method(options.triangulation.method).solve(rig, detections, tracks, noise, options.triangulation)
    if not _can_tell(rig, options):
        return put_right(rig, detections, tracks, noise, options, layer)
    swaps = _as_labelled(layer, detections.skeleton)
    state, parts = np.array(swaps.state), []
    for asked in _asked(rig, detections, tracks, noise, layer):
        for person in np.flatnonzero(asked.frames.any(axis=0)):
            frames = np.flatnonzero(asked.frames[:, person])
            mine, own = alone(detections, tracks, int(person), frames)
            mine = of_keypoints(mine, asked.skeleton, asked.keypoints)
            believed = part_of(layer, int(person), frames, asked.keypoints)
            better, found = put_right(rig, mine, own, noise, options, believed)
            parts.append((int(person), frames, asked.keypoints, better))
            chains = [swaps.chains.index(chain) for chain in found.chains]
            state[np.ix_(frames, np.array([person]), np.arange(len(rig)), np.array(chains))] = found.state
    return (with_parts(layer, parts), replace(swaps, state=state)) if parts else (layer, swaps)


@dataclass(frozen=True, eq=False)
class _Asked:
    """Where labels are not believed.

    Attributes:
        skeleton: of the keypoints whose labels those are.
        keypoints: shape (keypoint,): their places among all.
        frames: shape (frame, person), bool.
    """

    skeleton: Skeleton
    keypoints: np.ndarray
    frames: np.ndarray


def _asked(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, layer: Layer
) -> tuple[_Asked, ...]:
    """Bodies where those show signs of swaps; and whole where hands or faces do, which have most of the pairs."""
    whole, period_s = detections.skeleton, 1.0 / (detections.rate_hz or UNKNOWN_RATE_HZ)
    body, keypoints = without_parts(whole)
    pairs, chain_of = whole.pair_indices, Layout.of(whole).chain_of
    of_body = np.asarray(np.isin(pairs, keypoints).all(axis=1))

    def near_signs(which: np.ndarray) -> np.ndarray:
        signs = signs_of_swaps(rig, detections, tracks, noise, layer, pairs[which], chain_of[which])
        return around(signs, period_s)

    found = _Asked(body, keypoints, near_signs(of_body))
    if of_body.all():
        return (replace(found, skeleton=whole),)
    return found, _Asked(whole, np.arange(len(whole)), near_signs(~of_body))


def put_right(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: Options, layer: Layer
) -> tuple[Layer, Swaps]:
    """Points with sides put right, by not believing the labels in any frame; ``layer``: points by labels."""
    method, skeleton = find_method(options.triangulation.method), detections.skeleton
    pairs, chain_of = skeleton.pair_indices, Layout.of(skeleton).chain_of

    def exchanged(swapped: np.ndarray) -> Layer:
        return method.solve(rig, relabelled(detections, tracks, swapped, pairs), tracks, noise, options.triangulation)

    found = find_swaps(rig, detections, tracks, noise, options, midline(layer, skeleton))
    swapped, swaps = found.of_limb, found.swaps
    better = exchanged(swapped)
    if found.on_its_own.any():
        other = exchanged(swapped ^ found.on_its_own)
        pays = cost(better, noise, pairs) - cost(other, noise, pairs) > (found.on_its_own * found.odds).sum(axis=-1)
        swapped = swapped ^ (found.on_its_own & pays[..., None])
        better = _mixed(better, other, pays, pairs)
    if options.sides == "chains":
        swapped, back = settled(swapped, layer, better, noise, pairs, chain_of)
        if back.any():
            better, swaps = exchanged(swapped), _taken_back(swaps, swapped, back, chain_of)
    status = np.array(better.view_status)
    used = status[:, :, pairs]
    status[:, :, pairs] = np.where((used == ViewStatus.USED) & swapped[:, :, :, None], ViewStatus.USED_SWAPPED, used)
    return replace(better, view_status=status), swaps


def _mixed(one: Layer, other: Layer, chosen: np.ndarray, pairs: np.ndarray) -> Layer:
    """A layer with some pairs from another: ``chosen`` has shape (frame, person, pair)."""
    frame, person, pair = np.nonzero(chosen)
    arrays = {}
    for field in fields(Layer):
        array = np.array(getattr(one, field.name))
        for column in pairs[pair].T:
            array[frame, person, column] = np.asarray(getattr(other, field.name))[frame, person, column]
        arrays[field.name] = array
    return Layer(**arrays)


def _taken_back(swaps: Swaps, swapped: np.ndarray, back: np.ndarray, chain_of: np.ndarray) -> Swaps:
    """The states of limbs whose views were all taken alike after all."""
    state = np.array(swaps.state[:])
    for chain in range(len(swaps.chains)):
        first = np.flatnonzero(chain_of == chain)[0]
        where = back[:, :, first, None] & (state[..., chain] != SwapState.UNKNOWN)
        state[..., chain] = np.where(where, swapped[:, :, first], state[..., chain])
    return replace(swaps, state=state)


def _can_tell(rig: CameraRig, options: Options) -> bool:
    """Whether points made by labels would show that some are swapped, and nobody asked for another rule than labels."""
    usual = options.pairs == "enumerate" and options.sides == "chains"
    return usual and find_method(options.triangulation.method).supports_left_right and len(rig) > 2


def _as_labelled(layer: Layer, skeleton: Skeleton) -> Swaps:
    """No view took left for right."""
    layout = Layout.of(skeleton)
    pairs = skeleton.pair_indices
    unseen = np.isin(np.asarray(layer.view_status)[:, :, pairs], _SAYS_NOTHING)
    seen = np.logical_not(unseen.all(axis=3))
    state = [seen[:, :, layout.chain_of == c].any(axis=2) for c in range(len(layout.chains))]
    return Swaps(
        layout.chains, np.where(np.stack(state, axis=-1), SwapState.AS_LABELLED, SwapState.UNKNOWN).astype(np.int8)
    )


@dataclass(frozen=True, eq=False)
class Found:
    """Which labels look the wrong way round.

    Attributes:
        of_limb: shape (frame, person, pair, view), bool: by the state of the limb.
        on_its_own: the same shape: the pair looks otherwise than its limb.
        odds: shape (view,): what that costs beforehand, in squared sigmas.
        swaps: the states of limbs.
    """

    of_limb: np.ndarray
    on_its_own: np.ndarray
    odds: np.ndarray
    swaps: Swaps


def find_swaps(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: Options, midline_m: np.ndarray
) -> Found:
    """Which labels are the wrong way round.

    Args:
        rig: the cameras.
        detections: in memory.
        tracks: whose detection is whose.
        noise: of the detections.
        options: how pairs are solved and sides decided.
        midline_m: from :func:`midline`.
    """
    pairs = detections.skeleton.pair_indices
    finder = import_module(f"posefuse.left_right.pairs.{_MODULES[str(options.pairs)]}")
    solved = finder.solve(rig, detections, tracks, noise, options.triangulation, pairs, options.pair_search)
    solved = replace(
        solved,
        evidence=robust_evidence(rig, detections, tracks, noise, pairs, solved, options.triangulation.min_confidence),
    )
    given = PairsInTime.of(solved, rig, detections, tracks, midline_m)
    sides = decide_sides(given, options.sides, options.side_search)
    of_limb = np.moveaxis(sides.chain_swapped, 2, 3)[:, :, Layout.of(detections.skeleton).chain_of]
    swapped = of_limb == SwapState.SWAPPED
    evidence = given.by_frame(sides.applied(solved).evidence)
    on_its_own, odds = on_their_own(np.where(swapped, -evidence, evidence))
    return Found(swapped, on_its_own, odds, Swaps(sides.chains, sides.chain_swapped))


def on_their_own(evidence: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which pairs are swapped while the rest of their limb is not, or the other way round.

    How often that happens in each view is learned from all of them (expectation maximisation): some detectors swap
    whole limbs and nothing else, some each pair by itself.

    Args:
        evidence: shape (frame, person, pair, view): twice the log-likelihood ratio of that; 0 where nothing tells.

    Returns:
        The same shape, bool; and shape (view,), twice the logarithm of the odds against it.
    """
    evidence = np.clip(evidence.astype(np.float64), -_MOST_EVIDENCE, _MOST_EVIDENCE)
    share = np.full(evidence.shape[-1], _RARE)
    tells = evidence != 0.0
    count = np.maximum(tells.sum(axis=(0, 1, 2)), 1)
    for _ in range(_ROUNDS):
        likely = 1.0 / (1.0 + np.exp(-0.5 * evidence) * (1.0 - share) / share)
        share = np.clip(np.where(tells, likely, 0.0).sum(axis=(0, 1, 2)) / count, _RAREST, _MOST)
    odds = 2.0 * np.log((1.0 - share) / share)
    return evidence > odds, odds


def midline(layer: Layer, skeleton: Skeleton) -> np.ndarray:
    """Shape (frame, person, keypoint, 3): where keypoints without a partner are; NaN elsewhere."""
    alone = skeleton.mirror == np.arange(len(skeleton))
    return np.where(alone[:, None], np.asarray(layer.points_m), np.nan)


def relabelled(detections: Detections, tracks: Tracks, swapped: np.ndarray, pairs: np.ndarray) -> Detections:
    """The detections with left and right exchanged where they are swapped.

    Args:
        detections: in memory.
        tracks: whose detection is whose.
        swapped: shape (frame, person, pair, view), bool.
        pairs: shape (pair, 2): keypoints, left and right.
    """
    rows = tracks.rows(detections)
    keypoints_px = np.array(detections.keypoints_px)
    confidence = np.array(detections.confidence)
    for p, (left, right) in enumerate(pairs):
        these = rows[swapped[:, :, p] & (rows >= 0)]
        for values in (keypoints_px, confidence):
            values[these, left], values[these, right] = values[these, right], values[these, left]
    return replace(detections, keypoints_px=keypoints_px, confidence=confidence)
