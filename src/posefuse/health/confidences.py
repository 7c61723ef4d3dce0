"""Do a detector's confidences say anything about its errors?"""

from typing import TYPE_CHECKING

import numpy as np

from posefuse.health.findings import Finding, Kind

if TYPE_CHECKING:
    from posefuse.health.examine import Examination

_FEWEST, _LEAST_RELATION, _INDEPENDENT = 500, 0.08, 8.0
_LEAST_SPREAD = 0.02


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Views whose errors are no smaller where confidence is higher; one finding if that is all of them."""
    if examination.points is None or not examination.seen.trusts:
        return ()
    names = examination.evidence.rig.names
    told = relations(examination)
    mute = [v for v, (r, sd) in enumerate(told) if r > -_LEAST_RELATION and r - 2.0 * sd > -_LEAST_RELATION - 0.07]
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


def relations(examination: "Examination") -> list[tuple[float, float]]:
    """For each view the rank correlation of errors in px with confidence, and its standard deviation."""
    from posefuse.health.state import look

    points, state = examination.points, examination.fine.last.state  # type: ignore[union-attr]
    assert points is not None
    sight = look(examination.evidence, state)
    out = []
    for v in range(examination.evidence.n_views):
        good = (points.weight[..., v] > 0) & ((points.weight > 0).sum(axis=-1) > 2)
        trust = sight.confidence[..., v][good]
        noise = (points.sigma[..., v] / sight.per_px[..., v])[good]
        error = np.linalg.norm(points.residual[..., v, :][good], axis=-1) * noise
        if len(error) < _FEWEST or np.std(trust) < _LEAST_SPREAD:
            out.append((np.nan, np.nan))
            continue
        out.append((_rank_correlation(error, trust), float(np.sqrt(_INDEPENDENT / len(error)))))
    return out


def _rank_correlation(a: np.ndarray, b: np.ndarray) -> float:
    ranks = [np.argsort(np.argsort(values, kind="stable"), kind="stable").astype(float) for values in (a, b)]
    return float(np.corrcoef(*ranks)[0, 1])


def _finding(cameras: tuple[str, ...], size: float, sd: float, sentence: str, remedy: str) -> Finding:
    certainty = float(np.clip(1.0 - 0.5 * np.exp((-_LEAST_RELATION - 0.05 - size) / max(sd, 0.02)), 0.5, 0.95))
    return Finding(Kind.CONFIDENCE, cameras, None, size, "rank correlation", sd, certainty, 5.0, sentence, remedy)
