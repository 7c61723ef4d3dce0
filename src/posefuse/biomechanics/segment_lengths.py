"""Measure the segment lengths of every person, and their variation over time."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction

_ROBUST_SD = 1.4826


@dataclass(frozen=True)
class SegmentLength:
    """Describe one segment of one person.

    Attributes:
        person: name of the person.
        near: proximal keypoint.
        far: distal keypoint.
        median_m: median length, NaN without observations.
        sd_m: robust standard deviation over frames (1.4826 times the median absolute deviation).
        n_frames: number of frames in which both ends are known.
    """

    person: str
    near: str
    far: str
    median_m: float
    sd_m: float
    n_frames: int


def segment_lengths(parts: Iterable[Reconstruction], layer: LayerName) -> tuple[SegmentLength, ...]:
    """Return the lengths of the skeleton's edges for every person.

    Args:
        parts: consecutive ranges of frames, at least one.
        layer: name of the layer.
    """
    lengths: list[np.ndarray] = []
    part = None
    for part in parts:
        points, edges = np.asarray(part.layers[layer].points_m[:]), part.skeleton.edge_indices
        lengths.append(
            np.linalg.norm(points[:, :, edges[:, 0]] - points[:, :, edges[:, 1]], axis=-1).astype(np.float32)
        )
    if part is None:
        return ()
    all_lengths = np.concatenate(lengths)
    return tuple(
        _summarize(name, near, far, all_lengths[:, p, e])
        for p, name in enumerate(part.person_ids)
        for e, (near, far) in enumerate(part.skeleton.edges)
    )


def _summarize(person: str, near: str, far: str, lengths_m: np.ndarray) -> SegmentLength:
    """Return the median and spread of one segment."""
    known = lengths_m[np.isfinite(lengths_m)].astype(np.float64)
    if not len(known):
        return SegmentLength(person, near, far, float("nan"), float("nan"), 0)
    median = float(np.median(known))
    return SegmentLength(person, near, far, median, _ROBUST_SD * float(np.median(np.abs(known - median))), len(known))
