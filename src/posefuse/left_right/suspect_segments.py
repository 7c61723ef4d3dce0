"""Where labels of left and right look wrong, and recordings of nothing but those stretches.

A stretch is some frames of one person. Elsewhere not believing the labels would come to the same points; asking where
costs next to nothing.
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

# Farther off says nothing more, and how much less an exchange must cost, in squared sigmas.
_FAR_SIGMA = 5.0
_MUCH = 15.0
_SHARE, _SHARE_ON_END = 0.25, 0.125
"""Of the pairs of a hand or a face: those of a body's limbs are so few that it comes to two, and to one."""
_FEW = 8
_REACH_S = 0.5
"""Before and after a sign. Swaps last for some tenths of a second, and what they are told by is what comes around."""
_ENOUGH_S = 4.0
"""A person's bones and movements are learned from at least so much."""
_MOST_OF_IT = 0.5
"""Where stretches make up that share, they are one."""


def signs_of_swaps(
    rig: CameraRig,
    detections: Detections,
    tracks: Tracks,
    noise: NoiseModel,
    layer: Layer,
    pairs: np.ndarray,
    chain_of: np.ndarray,
) -> np.ndarray:
    """Where views look as if left and right were swapped, in two pairs of a limb or two frames on end.

    A wrong detection comes to lie near the other side's point by chance now and then, but not two together. Of
    hands and faces, which have many pairs close together, that takes a share of them.

    Args:
        rig: the cameras.
        detections: in memory.
        tracks: whose detection is whose.
        noise: of the detections.
        layer: points by ``consensus``, labels believed.
        pairs: shape (pair, 2): keypoints, left and right, of which signs are looked for.
        chain_of: shape (pair,): the limb of each pair.

    Returns:
        Shape (frame, person), bool.
    """
    left, right = (np.asarray(layer.view_status)[:, :, side] for side in pairs.T)
    looks = np.zeros(left.shape, dtype=bool)
    places = np.nonzero((left == ViewStatus.OUTLIER) | (right == ViewStatus.OUTLIER))
    looks[places] = _better_exchanged(rig, detections, tracks, noise, layer, pairs, places)
    # Where rays of both sides fix no points there may be two pairs of rays that do.
    status = np.asarray(layer.status)
    contested = (status == PointStatus.OUTLIER) | (status == PointStatus.UNDECIDED)
    contested = contested[:, :, pairs[:, 0]] & contested[:, :, pairs[:, 1]]
    looks[contested] = (left[contested] == ViewStatus.NOT_USED) & (right[contested] == ViewStatus.NOT_USED)
    found = np.zeros(looks.shape[:2], dtype=bool)
    for limb in _limbs(chain_of):
        mine = looks[:, :, limb]
        found |= mine.sum(axis=2).max(axis=2, initial=0) >= max(2, math.ceil(len(limb) * _SHARE))
        on_end = (mine[1:] & mine[:-1]).sum(axis=2).max(axis=2, initial=0) >= math.ceil(len(limb) * _SHARE_ON_END)
        found[1:] |= on_end
        found[:-1] |= on_end
    return found


def _limbs(chain_of: np.ndarray) -> list[np.ndarray]:
    """The pairs of each chain; where there are many chains of one pair, as in a face, those together."""
    chains = [np.flatnonzero(chain_of == c) for c in np.unique(chain_of)]
    alone = [chain for chain in chains if len(chain) == 1]
    if len(alone) <= _FEW:
        return chains
    return [*(chain for chain in chains if len(chain) > 1), np.concatenate(alone)]


def _better_exchanged(
    rig: CameraRig,
    detections: Detections,
    tracks: Tracks,
    noise: NoiseModel,
    layer: Layer,
    pairs: np.ndarray,
    places: tuple[np.ndarray, ...],
) -> np.ndarray:
    """Shape (n,): where a view's two observations fit a pair's points much better the other way round.

    Args:
        rig: the cameras.
        detections: in memory.
        tracks: whose detection is whose.
        noise: of the detections.
        layer: of points.
        pairs: shape (pair, 2): keypoints, left and right.
        places: frame, person, pair and view, shape (n,) each.
    """
    frame, person, pair, view = places
    row = tracks.rows(detections)[frame, person, view]
    keypoints_px, points_m = np.asarray(detections.keypoints_px), np.asarray(layer.points_m)
    gain = np.zeros(len(frame))
    for own, other in (pairs[pair].T, pairs[pair, ::-1].T):
        there = np.asarray(layer.view_error_px)[frame, person, own, view]
        across = np.empty(len(frame))
        for v in range(len(rig)):
            mine = view == v
            pixels, points = keypoints_px[row[mine], other[mine]], points_m[frame[mine], person[mine], own[mine]]
            across[mine] = np.hypot(*linear_rows(rig.select(rig.names[v : v + 1]), points, pixels[:, None])[0][:, 0].T)
        there, across = (np.minimum(off / noise.scale_px[view], _FAR_SIGMA) ** 2 for off in (there, across))
        gain += np.nan_to_num(there - across)
    return gain > _MUCH


def around(signs: np.ndarray, period_s: float) -> np.ndarray:
    """The frames with some time before and after signs, longer where those are little to learn from.

    Args:
        signs: shape (frame, person), bool.
        period_s: from one frame to the next.

    Returns:
        The same shape; columns without a sign stay so.
    """
    frames = len(signs)
    enough = min(round(_ENOUGH_S / period_s), frames)
    out = np.zeros_like(signs)
    for person in np.flatnonzero(signs.any(axis=0)):
        at, reach = np.flatnonzero(signs[:, person]), max(round(_REACH_S / period_s), 1)
        while True:
            # Starts and ends add up to how many signs reach a frame.
            edges = np.zeros(frames + 1, dtype=np.int64)
            np.add.at(edges, np.maximum(at - reach, 0), 1)
            np.add.at(edges, np.minimum(at + reach + 1, frames), -1)
            near = np.cumsum(edges[:-1]) > 0
            if near.sum() >= enough:
                break
            reach *= 2
        out[:, person] = near if near.mean() < _MOST_OF_IT else True
    return out


def alone(detections: Detections, tracks: Tracks, person: int, frames: np.ndarray) -> tuple[Detections, Tracks]:
    """The recording of one person in some frames.

    Args:
        detections: in memory.
        tracks: whose detection is whose.
        person: counted from 0.
        frames: shape (n,): ascending, counted from 0.
    """
    rows = tracks.rows(detections)[frames, person]
    there = rows >= 0
    mine = rows[there]
    offsets = np.concatenate([[0], np.cumsum(there.ravel())])
    kept = {
        name: None if getattr(detections, name) is None else frozen(np.asarray(getattr(detections, name))[mine])
        for name in ("keypoints_px", "confidence", "depth", "sigma_px")
    }
    seen = replace(
        detections, frame_numbers=detections.frame_numbers[frames], time_s=detections.time_s[frames], offsets=offsets,
        recorded=detections.recorded[frames], track_ids=np.asarray(detections.track_ids)[mine], **kept,
    )  # fmt: skip
    detection = np.where(there, 0, -1).astype(np.int32)[:, None]
    state = np.asarray(tracks.state[:])[frames, person, None]
    return seen, Tracks(tracks.person_ids[person : person + 1], detection, state)


def without_parts(skeleton: Skeleton) -> tuple[Skeleton, np.ndarray]:
    """The body without its hands and face, as sides are decided on, and its keypoints' places, shape (keypoint,)."""
    of_parts = [part.keypoints for part in skeleton.parts]
    kept = np.setdiff1d(np.arange(len(skeleton)), np.concatenate(of_parts)) if of_parts else np.arange(len(skeleton))
    names = {skeleton.keypoints[k] for k in kept}

    def inside(rows: Iterable[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
        return tuple(row for row in rows if names.issuperset(row))

    chains = {name: rows for name, chain in skeleton.chains.items() if (rows := inside(chain))}
    keypoints = tuple(skeleton.keypoints[k] for k in kept)
    edges, pairs = inside(skeleton.edges), inside(skeleton.pairs)
    return Skeleton(f"{skeleton.name}: body", keypoints, edges, pairs, chains), kept


def of_keypoints(detections: Detections, skeleton: Skeleton, keypoints: np.ndarray) -> Detections:
    """Detections, in memory, of some of their keypoints, which are those of another skeleton."""
    cut = {
        name: None if getattr(detections, name) is None else np.asarray(getattr(detections, name))[:, keypoints]
        for name in ("keypoints_px", "confidence", "depth", "sigma_px")
    }
    return replace(detections, skeleton=skeleton, **cut)


def part_of(layer: Layer, person: int, frames: np.ndarray, keypoints: np.ndarray) -> Layer:
    """Some frames and keypoints of a person, of a layer in memory."""
    where = frames[:, None, None], person, keypoints
    return Layer(*(np.asarray(getattr(layer, field.name))[where] for field in fields(Layer)))


def with_parts(layer: Layer, parts: Sequence[tuple[int, np.ndarray, np.ndarray, Layer]]) -> Layer:
    """A layer with some people, in some frames, as other layers have them: person, frames, keypoints, layer of each."""
    arrays = {field.name: np.array(getattr(layer, field.name)) for field in fields(Layer)}
    for person, frames, keypoints, part in parts:
        for name, array in arrays.items():
            array[frames[:, None], person, keypoints] = np.asarray(getattr(part, name))[:, 0]
    return Layer(**arrays)
