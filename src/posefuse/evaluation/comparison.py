"""Triangulation methods side by side on one recording: how they agree with the detections, and at what price."""

from dataclasses import dataclass

import numpy as np

from posefuse.evaluation.accuracy import Truth, evaluate
from posefuse.evaluation.people import matched_errors_mm
from posefuse.evaluation.together import PeoplePoints
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import ViewStatus, is_used

SHARES = np.linspace(0.0, 1.0, 401)
"""Of the observations: where a distribution of errors is kept."""

_NO_DETECTION = (ViewStatus.UNSEEN, ViewStatus.NOT_RECORDED)
_NEVER_USED = (*_NO_DETECTION, ViewStatus.LOW_CONFIDENCE, ViewStatus.BEYOND_LENS)
_REJECTED = (ViewStatus.OUTLIER, ViewStatus.BEHIND_CAMERA)


@dataclass(frozen=True)
class ErrorSpread:
    """A distribution of reprojection errors, in px. NaN where there are none.

    Attributes:
        median_px: half are at most so large.
        p95_px: 95 % are.
        at_shares_px: the errors below which the :data:`SHARES` lie, increasing; infinite for detections without one.
    """

    median_px: float
    p95_px: float
    at_shares_px: tuple[float, ...]


@dataclass(frozen=True)
class MethodNumbers:
    """What one method made of a recording. NaN where there is nothing to count.

    Attributes:
        method: its name.
        min_views: points with fewer valid (or agreeing) views are missing.
        used_error: over the views the points rest on; small too where inconvenient views are dropped.
        all_error: over every detection there is, so of the same ones for every method; one whose point is missing, or
            lies where its camera cannot see it, is infinitely far off.
        mean_views_used: by the points that have coordinates.
        missing_share: of all points, those without coordinates.
        rejected_share: of all detections that could have been used, those that a point was found without. Those of
            missing points are not among them.
        acceleration_m_s2: median over points of the change of velocity from frame to frame; None without a rate.
        cpu_ms_per_frame: of triangulation alone; None where it was not taken.
        truth_median_mm: distance to the known positions; None without.
        truth_p99_mm: 99 % of them are at most so large.
    """

    method: str
    min_views: int
    used_error: ErrorSpread
    all_error: ErrorSpread
    mean_views_used: float
    missing_share: float
    rejected_share: float
    acceleration_m_s2: float | None
    cpu_ms_per_frame: float | None
    truth_median_mm: float | None
    truth_p99_mm: float | None


@dataclass(frozen=True)
class Comparison:
    """Several methods on one recording, all else alike.

    Attributes:
        methods: one record each, in the order asked for.
        n_frames: of the recording.
        n_views: cameras.
        n_keypoints: of a person.
        rate_hz: nominal frame rate, or None where unknown.
        noise: how noisy the detections were taken to be, by all methods.
        notes: what readers, stages and methods found worth saying, each once.
    """

    methods: tuple[MethodNumbers, ...]
    n_frames: int
    n_views: int
    n_keypoints: int
    rate_hz: float | None
    noise: NoiseModel
    notes: tuple[str, ...] = ()


def method_numbers(
    result: Reconstruction, truth: Truth | PeoplePoints | None, cpu_s_per_frame: float | None
) -> MethodNumbers:
    """The numbers of one method's result.

    Args:
        result: in metres, in memory; its measured layer is looked at.
        truth: known positions of the same frames; of many people, with the result's beside them.
        cpu_s_per_frame: what triangulation took.

    Raises:
        ResultError: if the truth does not fit the result.
    """
    layer = result.layers["measured"]
    views = np.asarray(layer.view_status[:])
    has_point = layer.has_point
    usable = int((~np.isin(views, _NEVER_USED)).sum())
    errors = (None, None) if truth is None else _errors_mm(result, truth)
    min_views = result.options.triangulation.min_views
    assert min_views is not None
    return MethodNumbers(
        method=result.options.triangulation.method,
        min_views=min_views,
        used_error=_used_error(layer),
        all_error=_all_error(layer),
        mean_views_used=float(layer.n_views[has_point].mean()) if has_point.any() else float("nan"),
        missing_share=float(1.0 - has_point.mean()),
        rejected_share=int(np.isin(views, _REJECTED).sum()) / usable if usable else float("nan"),
        acceleration_m_s2=acceleration_m_s2(result),
        cpu_ms_per_frame=None if cpu_s_per_frame is None else 1000.0 * cpu_s_per_frame,
        truth_median_mm=errors[0],
        truth_p99_mm=errors[1],
    )


def _errors_mm(result: Reconstruction, truth: Truth | PeoplePoints) -> tuple[float, float]:
    """Median and 99 % of the distances, of many people over those who are matched; NaN where there are none."""
    if not result.layers["measured"].has_point.any():
        return float("nan"), float("nan")
    if isinstance(truth, Truth):
        accuracy = evaluate(result, truth)
        return accuracy.median_mm, accuracy.p99_mm
    errors = matched_errors_mm(truth)
    errors = errors[np.isfinite(errors)]
    return (float(np.median(errors)), float(np.percentile(errors, 99))) if errors.size else (float("nan"), float("nan"))


def _used_error(layer: Layer) -> ErrorSpread:
    errors = np.asarray(layer.view_error_px[:])[is_used(np.asarray(layer.view_status[:]))]
    return spread_of(errors[np.isfinite(errors)])


def _all_error(layer: Layer) -> ErrorSpread:
    errors = np.asarray(layer.view_error_px[:])[~np.isin(layer.view_status[:], _NO_DETECTION)]
    return spread_of(np.where(np.isfinite(errors), errors, np.inf))


def spread_of(errors_px: np.ndarray) -> ErrorSpread:
    """The distribution of errors (any shape, no NaN, infinite ones allowed)."""
    flat = np.asarray(errors_px, dtype=np.float64).ravel()
    if not flat.size:
        return ErrorSpread(float("nan"), float("nan"), (float("nan"),) * len(SHARES))
    # No interpolation: between a number and infinity there is nothing.
    at = np.quantile(flat, [0.5, 0.95, *SHARES], method="inverted_cdf")
    return ErrorSpread(float(at[0]), float(at[1]), tuple(at[2:].tolist()))


def acceleration_m_s2(result: Reconstruction) -> float | None:
    """Median size of the change of velocity over three consecutive frames: what moves, and what trembles.

    Returns:
        In m/s², None without a frame rate, NaN where no point is there three times in a row.
    """
    if result.rate_hz is None:
        return None
    points = np.asarray(result.layers["measured"].points_m[:])
    in_a_row = result.frame_numbers[2:] - result.frame_numbers[:-2] == 2
    change = (points[2:] - 2.0 * points[1:-1] + points[:-2])[in_a_row]
    size = np.linalg.norm(change, axis=-1) * result.rate_hz**2
    size = size[np.isfinite(size)]
    return float(np.median(size)) if size.size else float("nan")
