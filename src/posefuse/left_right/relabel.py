"""Triangulate with corrected left/right labels.

Pairs are solved without trusting the labels; the assignment over time decides which point is the left one; the swaps
this implies for each view are undone in the detections, and these are triangulated. The label-free solution alone has
to separate the two points in every view and frame, which would push them apart where they are close relative to the
noise. See docs/methods.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from posefuse.left_right.layout import Layout
from posefuse.left_right.model_selection import bounded_cost, revert_unsupported_swaps
from posefuse.left_right.pairs.label_likelihood import robust_evidence
from posefuse.left_right.pairs.registry import SOLVERS
from posefuse.left_right.registry import assign_sides
from posefuse.left_right.results import DEFAULT_RATE_HZ, PairSequence
from posefuse.left_right.suspect_segments import (
    body_skeleton,
    extend_segments,
    find_suspect_frames,
    layer_part,
    replace_layer_parts,
    select_keypoints,
    select_person,
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

# Share of pairs that are swapped independently: initial value and bounds of the estimate.
_INITIAL_SHARE, _MIN_SHARE, _MAX_SHARE = 0.02, 1e-4, 0.4
_ITERATIONS = 10
_MAX_EVIDENCE = 200.0
_UNUSABLE = (ViewStatus.UNSEEN, ViewStatus.NOT_RECORDED, ViewStatus.LOW_CONFIDENCE, ViewStatus.BEYOND_LENS)


def solve(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: Options
) -> tuple[Layer, Swaps]:
    """Triangulate every keypoint of every person with corrected left/right labels.

    Args:
        rig: the cameras, in the order of the detections' views.
        detections: in memory; several seconds, because left and right are assigned over time.
        tracks: assignment of detections to people, for the same frames.
        noise: error model of the detections.
        options: ``pairs`` is ``enumerate`` or ``sds``.

    Returns:
        The measured layer, and the swaps of each view.
    """
    layer = find_method(options.triangulation.method).solve(rig, detections, tracks, noise, options.triangulation)
    if not _outliers_reveal_swaps(rig, options):
        return correct_swaps(rig, detections, tracks, noise, options, layer)
    swaps = _no_swaps(layer, detections.skeleton)
    state, parts = np.array(swaps.state), []
    for segments in _suspect_segments(rig, detections, tracks, noise, layer):
        for person in np.flatnonzero(segments.frames.any(axis=0)):
            frames = np.flatnonzero(segments.frames[:, person])
            selected, own_tracks = select_person(detections, tracks, int(person), frames)
            selected = select_keypoints(selected, segments.skeleton, segments.keypoints)
            as_labeled = layer_part(layer, int(person), frames, segments.keypoints)
            corrected, found = correct_swaps(rig, selected, own_tracks, noise, options, as_labeled)
            parts.append((int(person), frames, segments.keypoints, corrected))
            chains = [swaps.chains.index(chain) for chain in found.chains]
            state[np.ix_(frames, np.array([person]), np.arange(len(rig)), np.array(chains))] = found.state
    return (replace_layer_parts(layer, parts), replace(swaps, state=state)) if parts else (layer, swaps)


@dataclass(frozen=True, eq=False)
class _Segments:
    """Hold the frames whose labels are not trusted.

    Attributes:
        skeleton: of the affected keypoints.
        keypoints: shape (keypoint,): their indices in the whole skeleton.
        frames: shape (frame, person), bool.
    """

    skeleton: Skeleton
    keypoints: np.ndarray
    frames: np.ndarray


def _suspect_segments(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, layer: Layer
) -> tuple[_Segments, ...]:
    """Return segments of the body where its labels look swapped, and of the whole skeleton where hands or faces do.

    Hands and faces have most of the pairs, so they are solved only where needed.
    """
    whole, period_s = detections.skeleton, 1.0 / (detections.rate_hz or DEFAULT_RATE_HZ)
    body, keypoints = body_skeleton(whole)
    pairs, chain_of = whole.pair_indices, Layout.of(whole).chain_of
    of_body = np.asarray(np.isin(pairs, keypoints).all(axis=1))

    def frames_of(which: np.ndarray) -> np.ndarray:
        signs = find_suspect_frames(rig, detections, tracks, noise, layer, pairs[which], chain_of[which])
        return extend_segments(signs, period_s)

    found = _Segments(body, keypoints, frames_of(of_body))
    if of_body.all():
        return (replace(found, skeleton=whole),)
    return found, _Segments(whole, np.arange(len(whole)), frames_of(~of_body))


def correct_swaps(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: Options, layer: Layer
) -> tuple[Layer, Swaps]:
    """Triangulate with corrected labels in all frames; ``layer`` holds the points with the original labels."""
    method, skeleton = find_method(options.triangulation.method), detections.skeleton
    pairs, chain_of = skeleton.pair_indices, Layout.of(skeleton).chain_of

    def solve_exchanged(swapped: np.ndarray) -> Layer:
        return method.solve(
            rig, exchange_labels(detections, tracks, swapped, pairs), tracks, noise, options.triangulation
        )

    found = find_swaps(rig, detections, tracks, noise, options, midline(layer, skeleton))
    swapped, swaps = found.of_limb, found.swaps
    corrected = solve_exchanged(swapped)
    if found.independent.any():
        other = solve_exchanged(swapped ^ found.independent)
        is_better = bounded_cost(corrected, noise, pairs) - bounded_cost(other, noise, pairs) > (
            found.independent * found.odds
        ).sum(axis=-1)
        swapped = swapped ^ (found.independent & is_better[..., None])
        corrected = _replace_pairs(corrected, other, is_better, pairs)
    if options.sides == "chains":
        swapped, reverted = revert_unsupported_swaps(swapped, layer, corrected, noise, pairs, chain_of)
        if reverted.any():
            corrected, swaps = solve_exchanged(swapped), _with_reverted_states(swaps, swapped, reverted, chain_of)
    status = np.array(corrected.view_status)
    used = status[:, :, pairs]
    status[:, :, pairs] = np.where((used == ViewStatus.USED) & swapped[:, :, :, None], ViewStatus.USED_SWAPPED, used)
    return replace(corrected, view_status=status), swaps


def _replace_pairs(one: Layer, other: Layer, chosen: np.ndarray, pairs: np.ndarray) -> Layer:
    """Return a layer with some pairs from another; ``chosen`` has shape (frame, person, pair)."""
    frame, person, pair = np.nonzero(chosen)
    arrays = {}
    for field in fields(Layer):
        array = np.array(getattr(one, field.name))
        for column in pairs[pair].T:
            array[frame, person, column] = np.asarray(getattr(other, field.name))[frame, person, column]
        arrays[field.name] = array
    return Layer(**arrays)


def _with_reverted_states(swaps: Swaps, swapped: np.ndarray, reverted: np.ndarray, chain_of: np.ndarray) -> Swaps:
    """Return the swap states after some limbs were set to the majority of their views."""
    state = np.array(swaps.state[:])
    for chain in range(len(swaps.chains)):
        first = np.flatnonzero(chain_of == chain)[0]
        where = reverted[:, :, first, None] & (state[..., chain] != SwapState.UNKNOWN)
        state[..., chain] = np.where(where, swapped[:, :, first], state[..., chain])
    return replace(swaps, state=state)


def _outliers_reveal_swaps(rig: CameraRig, options: Options) -> bool:
    """Return whether the method's rejected views reveal swapped labels.

    Only suspect segments then need the label-free solution.
    """
    is_default = options.pairs == "enumerate" and options.sides == "chains"
    return is_default and find_method(options.triangulation.method).supports_left_right and len(rig) > 2


def _no_swaps(layer: Layer, skeleton: Skeleton) -> Swaps:
    """Return the swap states of views without any swap."""
    layout = Layout.of(skeleton)
    pairs = skeleton.pair_indices
    unseen = np.isin(np.asarray(layer.view_status)[:, :, pairs], _UNUSABLE)
    seen = np.logical_not(unseen.all(axis=3))
    state = [seen[:, :, layout.chain_of == c].any(axis=2) for c in range(len(layout.chains))]
    return Swaps(
        layout.chains, np.where(np.stack(state, axis=-1), SwapState.AS_LABELED, SwapState.UNKNOWN).astype(np.int8)
    )


@dataclass(frozen=True, eq=False)
class DetectedSwaps:
    """Hold detected label swaps.

    Attributes:
        of_limb: shape (frame, person, pair, view), bool: swaps of the limb.
        independent: the same shape: pairs whose state differs from that of their limb.
        odds: shape (view,): prior cost of an independent swap, in squared standard deviations.
        swaps: states of the limbs.
    """

    of_limb: np.ndarray
    independent: np.ndarray
    odds: np.ndarray
    swaps: Swaps


def find_swaps(
    rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: Options, midline_m: np.ndarray
) -> DetectedSwaps:
    """Detect swapped labels.

    Args:
        rig: the cameras.
        detections: in memory.
        tracks: assignment of detections to people.
        noise: error model of the detections.
        options: pair solver and left/right method.
        midline_m: from :func:`midline`.
    """
    pairs = detections.skeleton.pair_indices
    solver = SOLVERS[str(options.pairs)]
    solved = solver(rig, detections, tracks, noise, options.triangulation, pairs, options.pair_search)
    solved = replace(
        solved,
        evidence=robust_evidence(rig, detections, tracks, noise, pairs, solved, options.triangulation.min_confidence),
    )
    sequence = PairSequence.of(solved, rig, detections, tracks, midline_m)
    assignment = assign_sides(sequence, options.sides, options.side_search)
    of_limb = np.moveaxis(assignment.chain_swapped, 2, 3)[:, :, Layout.of(detections.skeleton).chain_of]
    swapped = of_limb == SwapState.SWAPPED
    evidence = sequence.by_frame(assignment.applied(solved).evidence)
    independent, odds = independent_swaps(np.where(swapped, -evidence, evidence))
    return DetectedSwaps(swapped, independent, odds, Swaps(assignment.chains, assignment.chain_swapped))


def independent_swaps(evidence: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find pairs that are swapped while the rest of their limb is not, or vice versa.

    Their frequency in each view is estimated from all of them by expectation maximization: some detectors swap only
    whole limbs, others each pair independently.

    Args:
        evidence: shape (frame, person, pair, view): twice the log-likelihood ratio of an independent swap; 0 without
            information.

    Returns:
        The same shape, bool; and shape (view,): twice the log odds against it.
    """
    evidence = np.clip(evidence.astype(np.float64), -_MAX_EVIDENCE, _MAX_EVIDENCE)
    share = np.full(evidence.shape[-1], _INITIAL_SHARE)
    informative = evidence != 0.0
    count = np.maximum(informative.sum(axis=(0, 1, 2)), 1)
    for _ in range(_ITERATIONS):
        probability = 1.0 / (1.0 + np.exp(-0.5 * evidence) * (1.0 - share) / share)
        share = np.clip(np.where(informative, probability, 0.0).sum(axis=(0, 1, 2)) / count, _MIN_SHARE, _MAX_SHARE)
    odds = 2.0 * np.log((1.0 - share) / share)
    return evidence > odds, odds


def midline(layer: Layer, skeleton: Skeleton) -> np.ndarray:
    """Return the positions of keypoints without an opposite side, shape (frame, person, keypoint, 3); NaN elsewhere."""
    alone = skeleton.mirror == np.arange(len(skeleton))
    return np.where(alone[:, None], np.asarray(layer.points_m), np.nan)


def exchange_labels(detections: Detections, tracks: Tracks, swapped: np.ndarray, pairs: np.ndarray) -> Detections:
    """Return the detections with left and right exchanged where they are swapped.

    Args:
        detections: in memory.
        tracks: assignment of detections to people.
        swapped: shape (frame, person, pair, view), bool.
        pairs: shape (pair, 2): keypoint indices, left and right.
    """
    rows = tracks.rows(detections)
    keypoints_px = np.array(detections.keypoints_px)
    confidence = np.array(detections.confidence)
    for p, (left, right) in enumerate(pairs):
        swapped_rows = rows[swapped[:, :, p] & (rows >= 0)]
        for values in (keypoints_px, confidence):
            values[swapped_rows, left], values[swapped_rows, right] = (
                values[swapped_rows, right],
                values[swapped_rows, left],
            )
    return replace(detections, keypoints_px=keypoints_px, confidence=confidence)
