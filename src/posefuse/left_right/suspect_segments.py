"""Find segments in which left/right labels look wrong, and extract and replace them.

A segment is a range of frames of one person. Elsewhere a solution without labels would give the same points; the search
for segments costs almost nothing.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import fields, replace

import numpy as np

from posefuse.arrays import frozen
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.skeleton.skeletons import Skeleton
from posefuse.triangulation.linearized import linear_rows

# Bound of a residual in standard deviations, and required gain of an exchange in squared standard deviations.
_FAR_SIGMA = 5.0
_MIN_GAIN = 15.0
_MIN_SHARE, _MIN_CONSECUTIVE_SHARE = 0.25, 0.125
"""Share of a chain's pairs; limbs have so few pairs that it amounts to two of them, and to one."""
_MAX_SINGLE_CHAINS = 8
_MARGIN_S = 0.5
"""Time added before and after a suspect frame. Swaps last some tenths of a second and are recognized by the frames
around them.
"""
_MIN_SEGMENT_S = 4.0
"""Shortest total time from which a person's bones and motion are estimated."""
_MERGE_SHARE = 0.5
"""If segments cover this share of the recording, the whole recording is one segment."""


def find_suspect_frames(
    rig: CameraRig,
    detections: Detections,
    tracks: Tracks,
    noise: NoiseModel,
    layer: Layer,
    pairs: np.ndarray,
    chain_of: np.ndarray,
) -> np.ndarray:
    """Find frames in which views look swapped, in two pairs of a limb or in two consecutive frames.

    A wrong detection is sometimes close to the opposite side's point by chance, but rarely two together. Hands and
    faces, with many pairs close together, require a share of their pairs.

    Args:
        rig: the cameras.
        detections: in memory.
        tracks: assignment of detections to people.
        noise: error model of the detections.
        layer: points of the method ``consensus`` with the original labels.
        pairs: shape (pair, 2): keypoint indices, left and right, to examine.
        chain_of: shape (pair,): limb of each pair.

    Returns:
        Shape (frame, person), bool.
    """
    left, right = (np.asarray(layer.view_status)[:, :, side] for side in pairs.T)
    looks_swapped = np.zeros(left.shape, dtype=bool)
    places = np.nonzero((left == ViewStatus.OUTLIER) | (right == ViewStatus.OUTLIER))
    looks_swapped[places] = _fits_better_exchanged(rig, detections, tracks, noise, layer, pairs, places)
    # If the rays of both sides determine no points, exchanged rays may determine them.
    status = np.asarray(layer.status)
    contested = (status == PointStatus.OUTLIER) | (status == PointStatus.UNDECIDED)
    contested = contested[:, :, pairs[:, 0]] & contested[:, :, pairs[:, 1]]
    looks_swapped[contested] = (left[contested] == ViewStatus.NOT_USED) & (right[contested] == ViewStatus.NOT_USED)
    suspect_frames = np.zeros(looks_swapped.shape[:2], dtype=bool)
    for limb in _limbs(chain_of):
        of_limb = looks_swapped[:, :, limb]
        suspect_frames |= of_limb.sum(axis=2).max(axis=2, initial=0) >= max(2, math.ceil(len(limb) * _MIN_SHARE))
        consecutive = (of_limb[1:] & of_limb[:-1]).sum(axis=2).max(axis=2, initial=0) >= math.ceil(
            len(limb) * _MIN_CONSECUTIVE_SHARE
        )
        suspect_frames[1:] |= consecutive
        suspect_frames[:-1] |= consecutive
    return suspect_frames


def _limbs(chain_of: np.ndarray) -> list[np.ndarray]:
    """Return the pairs of each chain; many chains of one pair, as in a face, are merged."""
    chains = [np.flatnonzero(chain_of == c) for c in np.unique(chain_of)]
    alone = [chain for chain in chains if len(chain) == 1]
    if len(alone) <= _MAX_SINGLE_CHAINS:
        return chains
    return [*(chain for chain in chains if len(chain) > 1), np.concatenate(alone)]


def _fits_better_exchanged(
    rig: CameraRig,
    detections: Detections,
    tracks: Tracks,
    noise: NoiseModel,
    layer: Layer,
    pairs: np.ndarray,
    places: tuple[np.ndarray, ...],
) -> np.ndarray:
    """Return where a view's two observations fit a pair's points much better when exchanged, shape (n,).

    Args:
        rig: the cameras.
        detections: in memory.
        tracks: assignment of detections to people.
        noise: error model of the detections.
        layer: triangulated points.
        pairs: shape (pair, 2): keypoint indices, left and right.
        places: indices of frame, person, pair and view, shape (n,) each.
    """
    frame, person, pair, view = places
    row = tracks.rows(detections)[frame, person, view]
    keypoints_px, points_m = np.asarray(detections.keypoints_px), np.asarray(layer.points_m)
    gain = np.zeros(len(frame))
    for own, other in (pairs[pair].T, pairs[pair, ::-1].T):
        present = np.asarray(layer.view_error_px)[frame, person, own, view]
        across = np.empty(len(frame))
        for v in range(len(rig)):
            of_view = view == v
            pixels, points = (
                keypoints_px[row[of_view], other[of_view]],
                points_m[frame[of_view], person[of_view], own[of_view]],
            )
            across[of_view] = np.hypot(
                *linear_rows(rig.select(rig.names[v : v + 1]), points, pixels[:, None])[0][:, 0].T
            )
        present, across = (np.minimum(off / noise.scale_px[view], _FAR_SIGMA) ** 2 for off in (present, across))
        gain += np.nan_to_num(present - across)
    return gain > _MIN_GAIN


def extend_segments(suspect: np.ndarray, period_s: float) -> np.ndarray:
    """Extend suspect frames by a margin, enlarged if the segments are too short to estimate from.

    Args:
        suspect: shape (frame, person), bool.
        period_s: time between frames.

    Returns:
        The same shape; columns without suspect frames stay empty.
    """
    frames = len(suspect)
    required = min(round(_MIN_SEGMENT_S / period_s), frames)
    out = np.zeros_like(suspect)
    for person in np.flatnonzero(suspect.any(axis=0)):
        at, margin = np.flatnonzero(suspect[:, person]), max(round(_MARGIN_S / period_s), 1)
        while True:
            # The cumulative sum of starts and ends counts the suspect frames within the margin.
            edges = np.zeros(frames + 1, dtype=np.int64)
            np.add.at(edges, np.maximum(at - margin, 0), 1)
            np.add.at(edges, np.minimum(at + margin + 1, frames), -1)
            inside_margin = np.cumsum(edges[:-1]) > 0
            if inside_margin.sum() >= required:
                break
            margin *= 2
        out[:, person] = inside_margin if inside_margin.mean() < _MERGE_SHARE else True
    return out


def select_person(detections: Detections, tracks: Tracks, person: int, frames: np.ndarray) -> tuple[Detections, Tracks]:
    """Return the detections and tracks of one person in some frames.

    Args:
        detections: in memory.
        tracks: assignment of detections to people.
        person: index of the person.
        frames: shape (n,): ascending indices of frames.
    """
    rows = tracks.rows(detections)[frames, person]
    present = rows >= 0
    selected = rows[present]
    offsets = np.concatenate([[0], np.cumsum(present.ravel())])
    values = {
        name: None if getattr(detections, name) is None else frozen(np.asarray(getattr(detections, name))[selected])
        for name in ("keypoints_px", "confidence", "depth", "sigma_px")
    }
    part = replace(
        detections, frame_numbers=detections.frame_numbers[frames], time_s=detections.time_s[frames], offsets=offsets,
        recorded=detections.recorded[frames], track_ids=np.asarray(detections.track_ids)[selected], **values,
    )  # fmt: skip
    detection = np.where(present, 0, -1).astype(np.int32)[:, None]
    state = np.asarray(tracks.state[:])[frames, person, None]
    return part, Tracks(tracks.person_ids[person : person + 1], detection, state)


def body_skeleton(skeleton: Skeleton) -> tuple[Skeleton, np.ndarray]:
    """Return the skeleton without hands and face, and the indices of its keypoints, shape (keypoint,)."""
    of_parts = [part.keypoints for part in skeleton.parts]
    values = np.setdiff1d(np.arange(len(skeleton)), np.concatenate(of_parts)) if of_parts else np.arange(len(skeleton))
    names = {skeleton.keypoints[k] for k in values}

    def inside(rows: Iterable[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
        return tuple(row for row in rows if names.issuperset(row))

    chains = {name: rows for name, chain in skeleton.chains.items() if (rows := inside(chain))}
    keypoints = tuple(skeleton.keypoints[k] for k in values)
    edges, pairs = inside(skeleton.edges), inside(skeleton.pairs)
    return Skeleton(f"{skeleton.name}: body", keypoints, edges, pairs, chains), values


def select_keypoints(detections: Detections, skeleton: Skeleton, keypoints: np.ndarray) -> Detections:
    """Return detections, in memory, with some of their keypoints, which form another skeleton."""
    values = {
        name: None if getattr(detections, name) is None else np.asarray(getattr(detections, name))[:, keypoints]
        for name in ("keypoints_px", "confidence", "depth", "sigma_px")
    }
    return replace(detections, skeleton=skeleton, **values)


def layer_part(layer: Layer, person: int, frames: np.ndarray, keypoints: np.ndarray) -> Layer:
    """Return some frames and keypoints of one person from a layer in memory."""
    where = frames[:, None, None], person, keypoints
    return Layer(*(np.asarray(getattr(layer, field.name))[where] for field in fields(Layer)))


def replace_layer_parts(layer: Layer, parts: Sequence[tuple[int, np.ndarray, np.ndarray, Layer]]) -> Layer:
    """Return a layer with parts replaced; each part is person, frames, keypoints and layer."""
    arrays = {field.name: np.array(getattr(layer, field.name)) for field in fields(Layer)}
    for person, frames, keypoints, part in parts:
        for name, array in arrays.items():
            array[frames[:, None], person, keypoints] = np.asarray(getattr(part, name))[:, 0]
    return Layer(**arrays)
