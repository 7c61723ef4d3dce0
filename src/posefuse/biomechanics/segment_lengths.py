"""How long everybody's segments are, and how much these lengths breathe."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction

_ROBUST_SD = 1.4826


@dataclass(frozen=True)
class SegmentLength:
    """One segment of one person.

    Attributes:
        person: name.
        near: keypoint.
        far: keypoint.
        median_m: its length, NaN where it was never seen.
        sd_m: how much that varies from frame to frame, robustly (1.48 times the median deviation).
        n_frames: in how many frames both ends are known.
    """

    person: str
    near: str
    far: str
    median_m: float
    sd_m: float
    n_frames: int


def segment_lengths(parts: Iterable[Reconstruction], layer: LayerName) -> tuple[SegmentLength, ...]:
    """The lengths of the skeleton's edges of everybody.

    Args:
        parts: consecutive ranges of frames, at least one.
        layer: of which points.
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
    everything = np.concatenate(lengths)
    return tuple(
        _told(name, near, far, everything[:, p, e])
        for p, name in enumerate(part.person_ids)
        for e, (near, far) in enumerate(part.skeleton.edges)
    )


def _told(person: str, near: str, far: str, lengths_m: np.ndarray) -> SegmentLength:
    known = lengths_m[np.isfinite(lengths_m)].astype(np.float64)
    if not len(known):
        return SegmentLength(person, near, far, float("nan"), float("nan"), 0)
    middle = float(np.median(known))
    return SegmentLength(person, near, far, middle, _ROBUST_SD * float(np.median(np.abs(known - middle))), len(known))
