"""The numbers a report shows, gathered range by range."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from posefuse.model.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus, is_used
from posefuse.model.swaps import SwapState
from posefuse.model.tracks import TrackState


@dataclass(frozen=True)
class Spread:
    """A distribution in three numbers; NaN where it is empty."""

    median: float
    p90: float
    count: int


@dataclass(frozen=True)
class Summary:
    """What a layer is like.

    Attributes:
        layer: which.
        n_points: keypoints of all people and frames, but for frames in which a person is absent.
        status_counts: how many points have each status.
        source_counts: how many of those with coordinates came about in each way.
        view_status_counts: shape (view, ViewStatus): how many observations of each view.
        error_px: of all used observations.
        error_px_by_view: per view.
        error_px_by_keypoint: per keypoint.
        missing_by_keypoint: share of points without coordinates, per keypoint.
        sd_mm: standard deviation, root mean square over the axes, of the points there are.
        swapped: shape (view, chain): of the time that tells, the share in which the view takes the limb's left for its
            right, NaN where it never tells; None where labels were believed.
    """

    layer: LayerName
    n_points: int
    status_counts: dict[PointStatus, int]
    source_counts: dict[Source, int]
    view_status_counts: np.ndarray
    error_px: Spread
    error_px_by_view: tuple[Spread, ...]
    error_px_by_keypoint: tuple[Spread, ...]
    missing_by_keypoint: np.ndarray
    sd_mm: Spread
    swapped: np.ndarray | None

    @property
    def used(self) -> np.ndarray:
        """Shape (view,): the share of each view's observations that points rest on."""
        counts = self.view_status_counts
        used = is_used(np.array(list(ViewStatus)))
        return counts[:, used].sum(axis=1) / np.maximum(counts.sum(axis=1), 1)

    def swapped_in(self, view: int) -> float:
        """The share of limbs and time in which a view takes left for right; NaN where none tells."""
        shares = self.swapped[view] if self.swapped is not None else np.zeros(0)
        shares = shares[np.isfinite(shares)]
        return float(shares.mean()) if shares.size else float("nan")


def summarise(parts: Iterable[Reconstruction], layer_name: LayerName) -> Summary:
    """Gather a layer's numbers from consecutive ranges of frames."""
    errors, statuses, sources, view_statuses, deviations, swaps = [], [], [], [], [], []
    for part in parts:
        layer = part.layers[layer_name]
        status = np.asarray(layer.status[:])
        view_status = np.asarray(layer.view_status[:])
        used = is_used(view_status)
        there = _there(part, status)
        errors.append(np.where(used, np.asarray(layer.view_error_px[:]), np.nan)[there])
        statuses.append(status[there])
        sources.append(np.asarray(layer.source[:])[there])
        view_statuses.append(view_status[there])
        deviations.append(1000.0 * np.sqrt((layer.sd_m**2).mean(axis=-1)).ravel())
        if part.swaps is not None:
            swaps.append(np.asarray(part.swaps.state[:]))
    error = np.concatenate(errors)
    status = np.concatenate(statuses)
    source = np.concatenate(sources)
    view_status = np.concatenate(view_statuses)
    counts = [[int((view_status[..., v] == code).sum()) for code in ViewStatus] for v in range(view_status.shape[-1])]
    return Summary(
        layer=layer_name,
        n_points=int(status.size),
        status_counts={code: int((status == code).sum()) for code in PointStatus if (status == code).any()},
        source_counts={code: n for code in Source if code and (n := int((source == code).sum()))},
        view_status_counts=np.array(counts),
        error_px=spread(error),
        error_px_by_view=tuple(spread(error[..., v]) for v in range(error.shape[-1])),
        error_px_by_keypoint=tuple(spread(error[:, k]) for k in range(error.shape[1])),
        missing_by_keypoint=(status >= PointStatus.NOT_SEEN).sum(axis=0) / max(len(status), 1),
        sd_mm=spread(np.concatenate(deviations)),
        swapped=swapped_share(np.concatenate(swaps)) if swaps else None,
    )


def sources_in_words(counts: Mapping[Source, int]) -> str:
    """Which shares of the points came about how: ``94.0 % smoothed, 6.0 % filled``."""
    total = max(sum(counts.values()), 1)
    return ", ".join(f"{100.0 * n / total:.1f} % {code.label}" for code, n in counts.items())


def _there(part: Reconstruction, status: np.ndarray) -> np.ndarray:
    """Shape (frame, person), bool: who is not absent."""
    if part.tracks is None:
        return np.ones(status.shape[:2], dtype=bool)
    return np.asarray(part.tracks.state[:]) != TrackState.ABSENT


def swapped_share(state: np.ndarray) -> np.ndarray:
    """Shape (view, chain): the share of the frames of all people that tell, shape (frame, person, view, chain)."""
    told = (state != SwapState.UNKNOWN).sum(axis=(0, 1))
    swapped = (state == SwapState.SWAPPED).sum(axis=(0, 1))
    return np.where(told > 0, swapped / np.maximum(told, 1), np.nan)


def spread(values: np.ndarray) -> Spread:
    """Median, 90 % percentile and number of the values that are not NaN."""
    flat = np.asarray(values).ravel()
    flat = flat[np.isfinite(flat)]
    if not flat.size:
        return Spread(float("nan"), float("nan"), 0)
    return Spread(float(np.median(flat)), float(np.percentile(flat, 90)), int(flat.size))
