"""Do a detector's confidences say anything about its errors?"""

from typing import TYPE_CHECKING

import numpy as np

from posefuse.diagnostics.findings import Finding, Kind
from posefuse.diagnostics.points import Points
from posefuse.diagnostics.state import State, look

if TYPE_CHECKING:
    from posefuse.diagnostics.examine import Examination

_FEWEST, _LEAST_RELATION, _INDEPENDENT = 500, 0.055, 8.0
_LEAST_SPREAD = 0.02


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Views whose errors are no smaller where confidence is higher; one finding if that is all of them."""
    if examination.points is None or not examination.seen.trusts:
        return ()
    names = examination.evidence.rig.names
    told = relations(examination)
    mute = [v for v in range(len(told)) if _is_mute(told, v)]
    known = [v for v, (r, _) in enumerate(told) if np.isfinite(r)]
    remedy = "Do not weigh by them: --triangulation.confidence-exponent 0; posefuse calibrate-noise measures their law."
    if mute and mute == known:
        sentence = "Confidences say nothing about errors: detections of high confidence are as far off as others."
        size = float(np.mean([told[v][0] for v in mute]))
        return (_finding((), size, float(np.mean([told[v][1] for v in mute])), sentence, remedy),)
    return tuple(
        _finding(
            (names[v],),
            *told[v],
            f"Confidences of view {names[v]!r} say nothing about its errors, unlike the other views'.",
            remedy,
        )
        for v in mute
    )


def _is_mute(told: list[tuple[float, float]], view: int) -> bool:
    """Whether a view's relation is nearer to none than to that of the others."""
    relation, sd = told[view]
    others = [r for v, (r, _) in enumerate(told) if v != view and np.isfinite(r)]
    least = max(_LEAST_RELATION, -0.5 * float(np.median(others)) if others else 0.0)
    # A short recording tells little: then nothing is said.
    return relation > -least and sd < _LEAST_RELATION


def relations(examination: "Examination") -> list[tuple[float, float]]:
    """For each view the rank correlation of errors in px with confidence, and its standard deviation."""
    points, state = examination.points, examination.fine.last.state  # type: ignore[union-attr]
    assert points is not None
    sight = look(examination.evidence, state)
    left_out = _left_out(points, state)
    out = []
    for v in range(examination.evidence.n_views):
        good = (points.weight[..., v] > 0) & ((points.weight > 0).sum(axis=-1) > 2)
        trust = sight.confidence[..., v][good]
        noise = (points.sigma[..., v] / sight.per_px[..., v])[good]
        error = left_out[..., v][good] * noise
        if len(error) < _FEWEST or np.std(trust) < _LEAST_SPREAD:
            out.append((np.nan, np.nan))
            continue
        out.append((_rank_correlation(error, trust), float(np.sqrt(_INDEPENDENT / len(error)))))
    return out


def _left_out(points: Points, state: State) -> np.ndarray:
    """Shape (sample, column, view): how far each view is from the point of the others, in units of the noise.

    From the point of all it is nearer the more it is trusted, which would look as if confidence told of errors.
    """
    shape = points.weight.shape
    rows = (points.jacobian @ state.rotation[:, None]) * np.sqrt(points.weight)[..., None, None]
    flat = rows.reshape(*shape[:2], -1, 3)
    normal = np.swapaxes(flat, -1, -2) @ flat
    trace = np.trace(normal, axis1=-2, axis2=-1)
    good = np.isfinite(trace) & (trace > 0)
    normal = np.where(good[..., None, None], normal, np.eye(3)) + 1e-6 * trace[..., None, None] * np.eye(3)
    normal = np.where(good[..., None, None], normal, np.eye(3))
    lever = rows @ np.linalg.inv(normal)[:, :, None] @ np.swapaxes(rows, -1, -2)
    rest = np.eye(2) - np.minimum(lever, 1e6) + 1e-3 * np.eye(2)
    return np.linalg.norm(np.linalg.solve(rest, points.residual[..., None])[..., 0], axis=-1)


def _rank_correlation(a: np.ndarray, b: np.ndarray) -> float:
    ranks = [np.argsort(np.argsort(values, kind="stable"), kind="stable").astype(float) for values in (a, b)]
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])


def _finding(cameras: tuple[str, ...], size: float, sd: float, sentence: str, remedy: str) -> Finding:
    # Where confidence tells, the correlation is -0.1 or stronger: half way between that and none is a toss-up.
    certainty = float(np.clip(1.0 / (1.0 + np.exp(-(size + _LEAST_RELATION) / max(0.5 * sd, 0.01))), 0.5, 0.95))
    return Finding(Kind.CONFIDENCE, cameras, None, size, "rank correlation", sd, certainty, 5.0, sentence, remedy)
