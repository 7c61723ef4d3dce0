"""Find views whose confidences carry no information about detection errors."""

import numpy as np

from posefuse.diagnostics.examination import Examination
from posefuse.diagnostics.normalized_views import normalize_views
from posefuse.diagnostics.recording_model import RecordingModel
from posefuse.diagnostics.sample_points import SamplePoints
from posefuse.model.findings import Finding, FindingKind

_MIN_ERRORS, _MIN_CORRELATION, _CORRELATED_ERRORS = 500, 0.055, 8.0
_MIN_CONFIDENCE_SD = 0.02


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return a finding for each view with uninformative confidences, or one finding if that is all of them."""
    if examination.points is None or not examination.detected.confidence_varies:
        return ()
    names = examination.observations.rig.names
    correlations = error_correlations(examination)
    uninformative = [v for v in range(len(correlations)) if _is_uninformative(correlations, v)]
    known = [v for v, (r, _) in enumerate(correlations) if np.isfinite(r)]
    remedy = (
        "Do not weight by confidence: `triangulation.confidence_exponent=0`. `posefuse.calibrate_noise` estimates the "
        "relation of errors to confidence."
    )
    if uninformative and uninformative == known:
        size = float(np.mean([correlations[v][0] for v in uninformative]))
        sd = float(np.mean([correlations[v][1] for v in uninformative]))
        sentence = (
            "Confidences carry no information about errors: detections with high confidence are as inaccurate as "
            f"others (rank correlation {size:+.2f} +- {sd:.2f})."
        )
        return (_finding((), size, sd, sentence, remedy),)
    return tuple(
        _finding(
            (names[v],),
            *correlations[v],
            f"Confidences of view {names[v]!r} carry no information about its errors (rank correlation "
            f"{correlations[v][0]:+.2f} +- {correlations[v][1]:.2f}), unlike those of the other views.",
            remedy,
        )
        for v in uninformative
    )


def _is_uninformative(correlations: list[tuple[float, float]], view: int) -> bool:
    """Return whether a view's correlation is closer to zero than to that of the other views."""
    correlation, sd = correlations[view]
    others = [r for v, (r, _) in enumerate(correlations) if v != view and np.isfinite(r)]
    required = max(_MIN_CORRELATION, -0.5 * float(np.median(others)) if others else 0.0)
    # A short recording does not determine the correlation well enough for a finding.
    return correlation > -required and sd < _MIN_CORRELATION


def error_correlations(examination: Examination) -> list[tuple[float, float]]:
    """Return the rank correlation of errors in px with confidence and its standard deviation, for each view."""
    points, model = examination.points, examination.fine.final.model  # type: ignore[union-attr]
    assert points is not None
    normalized = normalize_views(examination.observations, model)
    leave_one_out = _leave_one_out_errors(points, model)
    out = []
    for v in range(examination.observations.n_views):
        usable = (points.weight[..., v] > 0) & ((points.weight > 0).sum(axis=-1) > 2)
        confidence = normalized.confidence[..., v][usable]
        noise = (points.sigma[..., v] / normalized.pixel_size[..., v])[usable]
        error = leave_one_out[..., v][usable] * noise
        if len(error) < _MIN_ERRORS or np.std(confidence) < _MIN_CONFIDENCE_SD:
            out.append((np.nan, np.nan))
            continue
        out.append((_rank_correlation(error, confidence), float(np.sqrt(_CORRELATED_ERRORS / len(error)))))
    return out


def _leave_one_out_errors(points: SamplePoints, model: RecordingModel) -> np.ndarray:
    """Return the error of each observation from the point of the other views, in units of the noise.

    The shape is (sample, column, view). The point of all views is closer to confident observations by construction,
    which would suggest an informative confidence.
    """
    shape = points.weight.shape
    rows = (points.jacobian @ model.rotation[:, None]) * np.sqrt(points.weight)[..., None, None]
    flat = rows.reshape(*shape[:2], -1, 3)
    normal = np.swapaxes(flat, -1, -2) @ flat
    trace = np.trace(normal, axis1=-2, axis2=-1)
    usable = np.isfinite(trace) & (trace > 0)
    normal = np.where(usable[..., None, None], normal, np.eye(3)) + 1e-6 * trace[..., None, None] * np.eye(3)
    normal = np.where(usable[..., None, None], normal, np.eye(3))
    leverage = rows @ np.linalg.inv(normal)[:, :, None] @ np.swapaxes(rows, -1, -2)
    remainder = np.eye(2) - np.minimum(leverage, 1e6) + 1e-3 * np.eye(2)
    return np.linalg.norm(np.linalg.solve(remainder, points.residual[..., None])[..., 0], axis=-1)


def _rank_correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Return Spearman's rank correlation."""
    ranks = [np.argsort(np.argsort(values, kind="stable"), kind="stable").astype(float) for values in (a, b)]
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])


def _finding(cameras: tuple[str, ...], size: float, sd: float, sentence: str, remedy: str) -> Finding:
    # Informative confidences correlate with -0.1 or below; half of that is undecided.
    certainty = float(np.clip(1.0 / (1.0 + np.exp(-(size + _MIN_CORRELATION) / max(0.5 * sd, 0.01))), 0.5, 0.95))
    return Finding(
        FindingKind.CONFIDENCE, cameras, None, size, "rank correlation", sd, certainty, 5.0, sentence, remedy
    )
