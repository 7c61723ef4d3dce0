"""Points from several views, robustly and in batch, by arrays: a health check looks at thousands, not millions.

Observations are those of :class:`posefuse.diagnostics.state.Sight`. Wrong views are told by consensus over pairs (every
pair's point is judged by a bounded loss in all views), then all views count with the weights of Student's t.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from posefuse.diagnostics.observations import Evidence
from posefuse.diagnostics.state import Sight, State
from posefuse.model.cameras import Camera

TAILS = 2.7
"""Degrees of freedom of detectors' errors."""
_MEDIAN_SQUARED = TAILS * (2.0 ** (2.0 / TAILS) - 1.0)
"""Of both components of a bivariate Student t with these tails."""
_SHARE_OF_WIDTH = 0.0045
_BOUND = 16.0
_MOST_PAIRS = 15
_STEPS = 2
_ROUNDS = 2
_LEAST_ANGLE = np.radians(3.0)


@dataclass(frozen=True, eq=False)
class Points:
    """Points and how the views see them.

    Attributes:
        points_m: shape (sample, column, 3), NaN where fewer than two views see them.
        inside: shape (sample, column, view, 3): in camera coordinates.
        jacobian: shape (sample, column, view, 2, 3): of observations by camera coordinates, in units of the noise.
        residual: shape (sample, column, view, 2): seen less expected, in units of the noise; 0 where not seen.
        weight: shape (sample, column, view): 0 where not seen.
        sigma: shape (sample, column, view): the noise, as a length at depth 1.
        scale: the noise that was assumed, as a multiple of the usual.
        scales: shape (view,): the noise of each view as it comes out, as a multiple of the usual.
    """

    points_m: np.ndarray
    inside: np.ndarray
    jacobian: np.ndarray
    residual: np.ndarray
    weight: np.ndarray
    sigma: np.ndarray
    scale: float
    scales: np.ndarray

    @property
    def cost(self) -> float:
        """What views and points disagree: the negative log-likelihood, but for what is always the same."""
        squared = np.square(self.residual[self.weight > 0]).sum(axis=-1)
        return (0.5 * TAILS + 1.0) * float(np.log1p(squared / TAILS).sum())


def solve_points(
    evidence: Evidence, state: State, sight: Sight, scale: float | None = None, start: np.ndarray | None = None
) -> Points:
    """Points of the sampled frames.

    Args:
        evidence: the recording.
        state: what is believed of it.
        sight: what the views show.
        scale: of the noise, as a multiple of the usual; estimated where not given.
        start: shape (sample, column, 3): the points as a state much like this had them.
    """
    unit = usual_noise(evidence, sight)
    seen = np.isfinite(unit) & np.isfinite(sight.at).all(axis=-1)
    seen &= (seen.sum(axis=-1) >= 2)[..., None]
    if start is None:
        start = consensus(state, sight, np.where(seen, unit, np.nan), 1.0 if scale is None else scale)
    tried = 1.0 if scale is None else scale
    if scale is None:
        for _ in range(_ROUNDS):
            rough = _refined(state, sight, np.where(seen, unit * tried, np.nan), start)
            start, scales = rough.points_m, tried * _scales(rough)
            tried = float(np.nanmedian(scales)) if np.isfinite(scales).any() else 1.0
    solved = _refined(state, sight, np.where(seen, unit * tried, np.nan), start)
    scales = tried * _scales(solved)
    return Points(**{**solved.__dict__, "scale": tried, "scales": scales})


def usual_noise(evidence: Evidence, sight: Sight) -> np.ndarray:
    """Shape (sample, column, view): what detectors usually err by, as a length at depth 1."""
    widths = np.array([max(camera.size_px) for camera in evidence.rig.cameras])
    return _SHARE_OF_WIDTH * widths / _trust(evidence, sight) * sight.per_px


def noise_of_one(evidence: Evidence, sight: Sight, camera: Camera) -> np.ndarray:
    """The same of one view, whose arrays lack the view axis, seen through a camera."""
    return _SHARE_OF_WIDTH * max(camera.size_px) / _trust(evidence, sight) * sight.per_px


def _trust(evidence: Evidence, sight: Sight) -> np.ndarray:
    return np.clip(sight.confidence, 0.1, 1.0) if evidence.trusts else np.where(np.isnan(sight.confidence), np.nan, 1.0)


def consensus(state: State, sight: Sight, sigma: np.ndarray, scale: float) -> np.ndarray:
    """Shape (sample, column, 3): of the points that pairs of views make, those most views agree with."""
    best = np.full((*sigma.shape[:2], 3), np.nan)
    least = np.full(sigma.shape[:2], np.inf)
    rays = np.concatenate([sight.at, np.ones((*sight.at.shape[:-1], 1))], axis=-1)
    rays = np.einsum("svji,scvj->scvi", state.rotation, rays)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    centres = -np.einsum("svji,svj->svi", state.rotation, state.translation_m)
    for a, b in _pairs(sigma, rays):
        points = _midpoint(centres[:, None, a], rays[:, :, a], centres[:, None, b], rays[:, :, b])
        residual, _, _ = _residuals(state, sight, sigma * scale, points)
        loss = np.minimum(np.square(residual).sum(axis=-1), _BOUND).sum(axis=-1)
        better = np.isfinite(points).all(axis=-1) & (loss < least)
        best[better], least[better] = points[better], loss[better]
    return best


def _pairs(sigma: np.ndarray, rays: np.ndarray) -> list[tuple[int, int]]:
    """Pairs of views to try: all, or of many views those that see most together under a good angle."""
    views = sigma.shape[2]
    every = list(combinations(range(views), 2))
    if len(every) <= _MOST_PAIRS:
        return every
    seen = np.isfinite(sigma)
    worth = []
    for a, b in every:
        both = seen[..., a] & seen[..., b]
        sine = np.linalg.norm(np.cross(rays[..., a, :][both], rays[..., b, :][both]), axis=-1)
        worth.append(float(sine.sum()))
    kept: list[tuple[int, int]] = []
    often = np.zeros(views, dtype=int)
    for place in np.argsort(-np.array(worth), kind="stable"):
        a, b = every[int(place)]
        # Every view is in some pairs: a bad one must not be in all.
        if often[a] < 3 or often[b] < 3:
            kept.append((a, b))
            often[[a, b]] += 1
    return kept


def _midpoint(c1: np.ndarray, d1: np.ndarray, c2: np.ndarray, d2: np.ndarray) -> np.ndarray:
    """Where two rays are nearest, NaN where they are nearly parallel."""
    base = c2 - c1
    cosine = (d1 * d2).sum(axis=-1)
    slack = 1.0 - cosine**2
    with np.errstate(invalid="ignore", divide="ignore"):
        along1, along2 = (d1 * base).sum(axis=-1), (d2 * base).sum(axis=-1)
        s = (along1 - cosine * along2) / slack
        t = (cosine * along1 - along2) / slack
        middle = 0.5 * (c1 + s[..., None] * d1 + c2 + t[..., None] * d2)
    good = (slack > np.sin(_LEAST_ANGLE) ** 2) & (s > 0) & (t > 0)
    return np.where(good[..., None], middle, np.nan)


def _residuals(
    state: State, sight: Sight, sigma: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals in units of the noise (0 where not seen, far off where behind), camera coordinates, seen."""
    inside = np.einsum("svij,scj->scvi", state.rotation, points) + state.translation_m[:, None]
    depth = inside[..., 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        residual = (sight.at - inside[..., :2] / depth[..., None]) / sigma[..., None]
    seen = np.isfinite(sigma) & np.isfinite(depth)
    residual = np.where((seen & (depth > 1e-6))[..., None], residual, np.where(seen[..., None], 1e3, 0.0))
    return residual, inside, seen


def _refined(state: State, sight: Sight, sigma: np.ndarray, points: np.ndarray) -> Points:
    for _ in range(_STEPS):
        made = _linearised(state, sight, sigma, points)
        shape = made.weight.shape
        root = np.sqrt(made.weight)
        rows = ((made.jacobian @ state.rotation[:, None]) * root[..., None, None]).reshape(*shape[:2], -1, 3)
        across = np.swapaxes(rows, -1, -2)
        normal = across @ rows
        right = (across @ (made.residual * root[..., None]).reshape(*shape[:2], -1, 1))[..., 0]
        points = points + np.linalg.solve(normal + _ridge(normal), right[..., None])[..., 0]
    return _linearised(state, sight, sigma, points)


def _ridge(normal: np.ndarray) -> np.ndarray:
    trace = np.trace(normal, axis1=-2, axis2=-1)[..., None, None]
    return (1e-6 * np.where(np.isfinite(trace), trace, 0.0) + 1e-12) * np.eye(3)


def _linearised(state: State, sight: Sight, sigma: np.ndarray, points: np.ndarray) -> Points:
    residual, inside, seen = _residuals(state, sight, sigma, points)
    x, y, z = np.moveaxis(inside, -1, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        inverse = 1.0 / (z * sigma)
        zero = np.zeros_like(z)
        jacobian = np.stack(
            [
                np.stack([inverse, zero, -x / z * inverse], axis=-1),
                np.stack([zero, inverse, -y / z * inverse], axis=-1),
            ],
            axis=-2,
        )
    good = seen & (z > 1e-6)
    weight = np.where(good, (TAILS + 2.0) / (TAILS + np.square(residual).sum(axis=-1)), 0.0)
    return Points(
        points_m=points,
        inside=np.where(good[..., None], inside, 0.0),
        jacobian=np.where(good[..., None, None], jacobian, 0.0),
        residual=residual,
        weight=weight,
        sigma=sigma,
        scale=1.0,
        scales=np.ones(sigma.shape[2]),
    )


def _scales(solved: Points) -> np.ndarray:
    """Shape (view,): each view's noise over that assumed; NaN where too few points tell."""
    seen = solved.weight > 0
    number = seen.sum(axis=-1)
    squared = np.square(solved.residual).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        # What a point's own fit leaves of its residuals, shared among its views.
        left = np.where(number > 2, (2.0 * number - 3.0) / (2.0 * number), np.nan)
    scales = np.full(seen.shape[2], np.nan)
    for v in range(seen.shape[2]):
        told = (squared[..., v] / left)[seen[..., v] & (number > 2)]
        if len(told) >= 50:
            scales[v] = np.sqrt(np.median(told) / _MEDIAN_SQUARED)
    if np.isnan(scales).all() and (number == 2).any():
        # Two views have one number of four to disagree by.
        told = squared[seen & (number == 2)[..., None]]
        scales[:] = np.sqrt(np.median(told) * 4.0 / _MEDIAN_SQUARED) if len(told) else np.nan
    return np.maximum(scales, 1e-3)
