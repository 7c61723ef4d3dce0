"""The numbers a report shows, gathered range by range."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from posefuse.model.label_swaps import SwapState
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus, is_used
from posefuse.model.thinned_samples import Thinned
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
        error_px: of all used observations, of a long recording in every n-th frame, as all that are Spreads.
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
    """Gather a layer's numbers from consecutive ranges of frames.

    Everything is counted; what a long recording's errors and deviations are like is told from every n-th frame.
    """
    errors, deviations = Thinned(), Thinned()
    counted: _Counts | None = None
    for part in parts:
        layer = part.layers[layer_name]
        used = is_used(np.asarray(layer.view_status[:]))
        there = _there(part, np.asarray(layer.status[:]))
        error = np.where(used & there[:, :, None, None], np.asarray(layer.view_error_px[:]), np.nan)
        errors.add(error.astype(np.float32))
        deviations.add(1000.0 * np.sqrt((layer.sd_m**2).mean(axis=-1)))
        own = _Counts.of(part, layer, there)
        counted = own if counted is None else counted.plus(own)
    error = errors.values
    if counted is None:
        raise ValueError("a summary is of one range of frames at least")
    totals = counted.status.sum(axis=0)
    return Summary(
        layer=layer_name,
        n_points=int(counted.status.sum()),
        status_counts={code: n for i, code in enumerate(PointStatus) if (n := int(totals[i]))},
        source_counts={code: n for i, code in enumerate(Source) if code and (n := int(counted.source[i]))},
        view_status_counts=counted.view_status,
        error_px=spread(error),
        error_px_by_view=tuple(spread(error[..., v]) for v in range(error.shape[-1])),
        error_px_by_keypoint=tuple(spread(error[:, :, k]) for k in range(error.shape[2])),
        missing_by_keypoint=counted.missing / np.maximum(counted.status.sum(axis=1), 1),
        sd_mm=spread(deviations.values),
        swapped=_swapped(counted),
    )


@dataclass(frozen=True, eq=False)
class _Counts:
    """How often what is, in a range of frames, of people who are not absent.

    Attributes:
        status: shape (keypoint, PointStatus).
        missing: shape (keypoint,): points without coordinates.
        source: shape (Source,).
        view_status: shape (view, ViewStatus).
        swapped: shape (view, chain): limbs of which left and right are exchanged; None where labels were believed.
        told: shape (view, chain): limbs that tell, likewise.
    """

    status: np.ndarray
    missing: np.ndarray
    source: np.ndarray
    view_status: np.ndarray
    swapped: np.ndarray | None
    told: np.ndarray | None

    @classmethod
    def of(cls, part: Reconstruction, layer: Layer, there: np.ndarray) -> "_Counts":
        """Of a range of frames; ``there`` has shape (frame, person)."""
        status, source = np.asarray(layer.status[:])[there], np.asarray(layer.source[:])[there]
        views = np.asarray(layer.view_status[:])[there]
        swaps = None if part.swaps is None else np.asarray(part.swaps.state[:])
        return cls(
            np.stack([(status == code).sum(axis=0) for code in PointStatus], axis=-1),
            (status >= PointStatus.NOT_SEEN).sum(axis=0),
            np.array([(source == code).sum() for code in Source]),
            np.stack([(views == code).sum(axis=(0, 1)) for code in ViewStatus], axis=-1),
            None if swaps is None else (swaps == SwapState.SWAPPED).sum(axis=(0, 1)),
            None if swaps is None else (swaps != SwapState.UNKNOWN).sum(axis=(0, 1)),
        )

    def plus(self, other: "_Counts") -> "_Counts":
        """Of both ranges."""
        return _Counts(
            self.status + other.status,
            self.missing + other.missing,
            self.source + other.source,
            self.view_status + other.view_status,
            None if self.swapped is None or other.swapped is None else self.swapped + other.swapped,
            None if self.told is None or other.told is None else self.told + other.told,
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


def _swapped(counts: _Counts) -> np.ndarray | None:
    """Shape (view, chain): swapped limbs of those that tell, NaN where none does; None where labels were believed."""
    if counts.swapped is None or counts.told is None:
        return None
    return np.where(counts.told > 0, counts.swapped / np.maximum(counts.told, 1), np.nan)


def spread(values: np.ndarray) -> Spread:
    """Median, 90 % percentile and number of the values that are not NaN."""
    flat = np.asarray(values).ravel()
    flat = flat[np.isfinite(flat)]
    if not flat.size:
        return Spread(float("nan"), float("nan"), 0)
    return Spread(float(np.median(flat)), float(np.percentile(flat, 90)), int(flat.size))
