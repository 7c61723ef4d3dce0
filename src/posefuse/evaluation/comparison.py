"""Comparison of triangulation methods on one recording: reprojection errors, missing points and CPU time."""

from dataclasses import dataclass

import numpy as np

from posefuse.evaluation.accuracy import Truth, evaluate
from posefuse.evaluation.paired_results import PeoplePoints
from posefuse.evaluation.people import matched_errors_mm
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import ViewStatus, is_used

SHARES = np.linspace(0.0, 1.0, 401)
"""Fractions of the observations at which a distribution of errors is sampled."""

_NO_DETECTION = (ViewStatus.UNSEEN, ViewStatus.NOT_RECORDED)
_NEVER_USED = (*_NO_DETECTION, ViewStatus.LOW_CONFIDENCE, ViewStatus.BEYOND_LENS)
_REJECTED = (ViewStatus.OUTLIER, ViewStatus.BEHIND_CAMERA)


@dataclass(frozen=True)
class ErrorSpread:
    """A distribution of reprojection errors, in px. NaN without errors.

    Attributes:
        median_px: median.
        p95_px: 95th percentile.
        at_shares_px: quantiles at :data:`SHARES`; infinite for detections without an error.
    """

    median_px: float
    p95_px: float
    at_shares_px: tuple[float, ...]


@dataclass(frozen=True)
class MethodNumbers:
    """Statistics of one method on a recording. NaN where undefined.

    Attributes:
        method: name.
        min_views: minimum number of valid or agreeing views of a point.
        used_error: errors over the used views; also small if a method rejects correct views.
        all_error: errors over every detection, the same set for every method; infinite if the point is missing or
            not visible to the camera.
        mean_views_used: mean number of used views of points with coordinates.
        missing_share: fraction of points without coordinates.
        rejected_share: fraction of usable detections that were rejected, without those of missing points.
        acceleration_m_s2: median acceleration of the points; None without a frame rate.
        cpu_ms_per_frame: CPU time of the triangulation; None if not measured.
        truth_median_mm: median distance to the ground truth; None without.
        truth_p99_mm: 99th percentile of the distance.
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
    """Several methods on one recording with otherwise equal options.

    Attributes:
        methods: one record per method, in the requested order.
        n_frames: number of frames.
        n_views: number of cameras.
        n_keypoints: number of keypoints per person.
        rate_hz: nominal frame rate, or None if unknown.
        noise: noise model used by all methods.
        notes: notes of readers, stages and methods, without repetition.
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
    """Return the statistics of one method's result.

    Args:
        result: result in meters, in memory; its measured layer is used.
        truth: ground truth on the same frames; for several people, paired with the result.
        cpu_s_per_frame: CPU time of the triangulation.

    Raises:
        ResultError: if the truth does not match the result.
    """
    layer = result.layers["measured"]
    views = np.asarray(layer.view_status[:])
    has_point = layer.has_point
    usable = int((~np.isin(views, _NEVER_USED)).sum())
    errors = (None, None) if truth is None else _errors_mm(result, truth)
    min_views = result.resolved.triangulation.min_views
    assert min_views is not None
    return MethodNumbers(
        method=result.resolved.triangulation.method,
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
    """Return the median and 99th percentile of the distances, of matched people; NaN without any."""
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
    """Return the distribution of errors (any shape, no NaN, infinity allowed)."""
    flat = np.asarray(errors_px, dtype=np.float64).ravel()
    if not flat.size:
        return ErrorSpread(float("nan"), float("nan"), (float("nan"),) * len(SHARES))
    # No interpolation: it is undefined between a number and infinity.
    at = np.quantile(flat, [0.5, 0.95, *SHARES], method="inverted_cdf")
    return ErrorSpread(float(at[0]), float(at[1]), tuple(at[2:].tolist()))


def acceleration_m_s2(result: Reconstruction) -> float | None:
    """Return the median acceleration over three consecutive frames, which contains motion and jitter.

    Returns:
        m/s², None without a frame rate and in unrelated frames, NaN if no point occurs in three consecutive frames.
    """
    if result.rate_hz is None or not result.has_identities:
        return None
    points = np.asarray(result.layers["measured"].points_m[:])
    in_a_row = result.frame_numbers[2:] - result.frame_numbers[:-2] == 2
    change = (points[2:] - 2.0 * points[1:-1] + points[:-2])[in_a_row]
    size = np.linalg.norm(change, axis=-1) * result.rate_hz**2
    size = size[np.isfinite(size)]
    return float(np.median(size)) if size.size else float("nan")
