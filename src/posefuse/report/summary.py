"""Summary statistics of a layer, gathered from ranges of frames."""

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
class Distribution:
    """Median, 90th percentile and number of values; NaN if there are none."""

    median: float
    p90: float
    count: int


@dataclass(frozen=True)
class Summary:
    """Summary statistics of a layer.

    Counts are exact. In a long recording, distributions come from every n-th frame.

    Attributes:
        layer: name of the layer.
        n_points: number of points of all people and frames, without frames in which a person is absent.
        status_counts: number of points with each status.
        source_counts: number of points with coordinates from each source.
        view_status_counts: shape (view, ViewStatus): number of observations of each view with each status.
        error_px: reprojection errors of all used observations.
        error_px_by_view: the same for each view.
        error_px_by_person: the same for each person.
        error_px_by_keypoint: the same for each keypoint.
        missing_by_keypoint: share of points without coordinates for each keypoint.
        sd_mm: standard deviation of the points, root mean square over the axes.
        swapped: shape (view, limb): share of frames in which the view swaps the limb's left and right, among the frames
            in which this could be decided; NaN if there are none, and None if swaps were not examined.
    """

    layer: LayerName
    n_points: int
    status_counts: dict[PointStatus, int]
    source_counts: dict[Source, int]
    view_status_counts: np.ndarray
    error_px: Distribution
    error_px_by_view: tuple[Distribution, ...]
    error_px_by_person: tuple[Distribution, ...]
    error_px_by_keypoint: tuple[Distribution, ...]
    missing_by_keypoint: np.ndarray
    sd_mm: Distribution
    swapped: np.ndarray | None

    @property
    def used(self) -> np.ndarray:
        """Share of each view's observations that were used, shape (view,)."""
        counts = self.view_status_counts
        used = is_used(np.array(list(ViewStatus)))
        return counts[:, used].sum(axis=1) / np.maximum(counts.sum(axis=1), 1)

    def swapped_share(self, view: int) -> float:
        """Return the mean share of swapped frames over the limbs of a view; NaN if undecided for all of them."""
        shares = self.swapped[view] if self.swapped is not None else np.zeros(0)
        shares = shares[np.isfinite(shares)]
        return float(shares.mean()) if shares.size else float("nan")


def summarize(parts: Iterable[Reconstruction], layer_name: LayerName) -> Summary:
    """Gather a layer's statistics from consecutive ranges of frames."""
    errors, deviations = Thinned(), Thinned()
    counts: _Counts | None = None
    for part in parts:
        layer = part.layers[layer_name]
        used = is_used(np.asarray(layer.view_status[:]))
        present = _is_present(part, np.asarray(layer.status[:]))
        error = np.where(used & present[:, :, None, None], np.asarray(layer.view_error_px[:]), np.nan)
        errors.add(error.astype(np.float32))
        deviations.add(1000.0 * np.sqrt((layer.sd_m**2).mean(axis=-1)))
        part_counts = _Counts.of(part, layer, present)
        counts = part_counts if counts is None else counts.plus(part_counts)
    error = errors.values
    if counts is None:
        raise ValueError("a summary needs at least one range of frames")
    totals = counts.status.sum(axis=0)
    return Summary(
        layer=layer_name,
        n_points=int(counts.status.sum()),
        status_counts={code: n for i, code in enumerate(PointStatus) if (n := int(totals[i]))},
        source_counts={code: n for i, code in enumerate(Source) if code and (n := int(counts.source[i]))},
        view_status_counts=counts.view_status,
        error_px=distribution(error),
        error_px_by_view=tuple(distribution(error[..., v]) for v in range(error.shape[-1])),
        error_px_by_person=tuple(distribution(error[:, p]) for p in range(error.shape[1])),
        error_px_by_keypoint=tuple(distribution(error[:, :, k]) for k in range(error.shape[2])),
        missing_by_keypoint=counts.missing / np.maximum(counts.status.sum(axis=1), 1),
        sd_mm=distribution(deviations.values),
        swapped=_swapped_shares(counts),
    )


@dataclass(frozen=True, eq=False)
class _Counts:
    """Counts in a range of frames over the people who are present.

    Attributes:
        status: shape (keypoint, PointStatus).
        missing: shape (keypoint,): points without coordinates.
        source: shape (Source,).
        view_status: shape (view, ViewStatus).
        swapped: shape (view, limb): frames in which left and right are swapped; None if swaps were not examined.
        decided: shape (view, limb): frames in which it was decided whether they are swapped; None likewise.
    """

    status: np.ndarray
    missing: np.ndarray
    source: np.ndarray
    view_status: np.ndarray
    swapped: np.ndarray | None
    decided: np.ndarray | None

    @classmethod
    def of(cls, part: Reconstruction, layer: Layer, present: np.ndarray) -> "_Counts":
        """Count in a range of frames; ``present`` has shape (frame, person)."""
        status, source = np.asarray(layer.status[:])[present], np.asarray(layer.source[:])[present]
        views = np.asarray(layer.view_status[:])[present]
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
        """Return the sums of both counts."""
        return _Counts(
            self.status + other.status,
            self.missing + other.missing,
            self.source + other.source,
            self.view_status + other.view_status,
            None if self.swapped is None or other.swapped is None else self.swapped + other.swapped,
            None if self.decided is None or other.decided is None else self.decided + other.decided,
        )


def format_sources(counts: Mapping[Source, int]) -> str:
    """Return the share of points from each source, such as ``94.0 % smoothed, 6.0 % filled``."""
    total = max(sum(counts.values()), 1)
    return ", ".join(f"{100.0 * n / total:.1f} % {code.label}" for code, n in counts.items())


def _is_present(part: Reconstruction, status: np.ndarray) -> np.ndarray:
    """Return where a person is not absent, shape (frame, person), bool."""
    if part.tracks is None:
        return np.ones(status.shape[:2], dtype=bool)
    return np.asarray(part.tracks.state[:]) != TrackState.ABSENT


def _swapped_shares(counts: _Counts) -> np.ndarray | None:
    """Return ``Summary.swapped``."""
    if counts.swapped is None or counts.decided is None:
        return None
    return np.where(counts.decided > 0, counts.swapped / np.maximum(counts.decided, 1), np.nan)


def distribution(values: np.ndarray) -> Distribution:
    """Return the median, the 90th percentile and the number of the values that are not NaN."""
    flat = np.asarray(values).ravel()
    flat = flat[np.isfinite(flat)]
    if not flat.size:
        return Distribution(float("nan"), float("nan"), 0)
    return Distribution(float(np.median(flat)), float(np.percentile(flat, 90)), int(flat.size))


def layer_origin(result: Reconstruction, layer: str) -> str:
    """Return how the points of a layer were computed, as a phrase."""
    if layer == "model":
        return "bodies fitted to the 2D detections"
    method = result.options.triangulation.method
    if layer == "measured":
        return f"triangulated by {method}" if len(result.rig) > 1 else "from a single camera"
    if result.resolved.solve == "trajectory":
        sources = {code for part in result.windows() for code in np.unique(part.layers[layer].source[:])}
        if sources <= {Source.NONE, Source.MEASURED} and Source.MEASURED in sources:
            return "the measured points, because too few frames determine the motion of a solve over time"
        return "solved over the whole recording from the 2D detections"
    return f"triangulated by {method}, then postprocessed"
