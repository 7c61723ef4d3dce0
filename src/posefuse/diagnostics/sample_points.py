"""Triangulate sampled points robustly in one batch of arrays, for the recording check.

The points number thousands, not millions. Observations are those of
:class:`~posefuse.diagnostics.normalized_views.NormalizedViews`. A consensus over pairs of views gives the start: every
pair's point is scored by a bounded loss in all views. All views then enter an iteratively reweighted least-squares fit
with Student-t weights.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from posefuse.diagnostics.normalized_views import NormalizedViews
from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.recording_model import RecordingModel
from posefuse.model.cameras import Camera

STUDENT_T_DOF = 2.7
"""Degrees of freedom of the Student-t distribution of detection errors."""
_MEDIAN_SQUARED = STUDENT_T_DOF * (2.0 ** (2.0 / STUDENT_T_DOF) - 1.0)
"""Median squared length of a bivariate Student-t vector of unit scale."""
_NOISE_PER_WIDTH = 0.0045
_MAX_SQUARED = 16.0
_MAX_PAIRS = 15
_REFINEMENT_STEPS = 2
_SCALE_ROUNDS = 2
_MIN_ANGLE = np.radians(3.0)


@dataclass(frozen=True, eq=False)
class SamplePoints:
    """Hold triangulated points and their reprojection in every view.

    Attributes:
        points_m: shape (sample, column, 3), NaN where fewer than two views observe the point.
        camera_xyz: shape (sample, column, view, 3): in camera coordinates.
        jacobian: shape (sample, column, view, 2, 3): derivative of observations by camera coordinates, in units of the
            noise.
        residual: shape (sample, column, view, 2): observed minus projected, in units of the noise; 0 where not
            observed.
        weight: shape (sample, column, view): Student-t weight, 0 where not observed.
        sigma: shape (sample, column, view): standard deviation of the noise in the normalized image plane.
        noise_scale: assumed noise as a multiple of the expected noise.
        view_scales: shape (view,): estimated noise of each view as a multiple of the expected noise.
    """

    points_m: np.ndarray
    camera_xyz: np.ndarray
    jacobian: np.ndarray
    residual: np.ndarray
    weight: np.ndarray
    sigma: np.ndarray
    noise_scale: float
    view_scales: np.ndarray

    @property
    def cost(self) -> float:
        """Return the negative log-likelihood of all residuals, up to a constant."""
        squared = np.square(self.residual[self.weight > 0]).sum(axis=-1)
        return (0.5 * STUDENT_T_DOF + 1.0) * float(np.log1p(squared / STUDENT_T_DOF).sum())


def triangulate_samples(
    observations: TrackedObservations,
    model: RecordingModel,
    normalized: NormalizedViews,
    scale: float | None = None,
    start: np.ndarray | None = None,
) -> SamplePoints:
    """Triangulate the sampled points.

    Args:
        observations: of the recording.
        model: hypothesis about the recording.
        normalized: observations under that hypothesis.
        scale: noise as a multiple of the expected noise; estimated if None.
        start: shape (sample, column, 3): starting points, from a similar model.
    """
    unit = expected_noise(observations, normalized)
    seen = np.isfinite(unit) & np.isfinite(normalized.xy).all(axis=-1)
    seen &= (seen.sum(axis=-1) >= 2)[..., None]
    if start is None:
        start = pairwise_consensus(model, normalized, np.where(seen, unit, np.nan), 1.0 if scale is None else scale)
    assumed = 1.0 if scale is None else scale
    if scale is None:
        for _ in range(_SCALE_ROUNDS):
            rough = _refine(model, normalized, np.where(seen, unit * assumed, np.nan), start)
            start, scales = rough.points_m, assumed * _relative_scales(rough)
            assumed = float(np.nanmedian(scales)) if np.isfinite(scales).any() else 1.0
    solved = _refine(model, normalized, np.where(seen, unit * assumed, np.nan), start)
    scales = assumed * _relative_scales(solved)
    return SamplePoints(**{**solved.__dict__, "noise_scale": assumed, "view_scales": scales})


def expected_noise(observations: TrackedObservations, normalized: NormalizedViews) -> np.ndarray:
    """Return the usual standard deviation of detectors in the normalized image plane, shape (sample, column, view)."""
    widths = np.array([max(camera.size_px) for camera in observations.rig.cameras])
    return _NOISE_PER_WIDTH * widths / _confidence_weights(observations, normalized) * normalized.pixel_size


def expected_noise_of_view(
    observations: TrackedObservations, normalized: NormalizedViews, camera: Camera
) -> np.ndarray:
    """Return the expected noise of one view seen through ``camera``; the arrays have no view axis."""
    return (
        _NOISE_PER_WIDTH * max(camera.size_px) / _confidence_weights(observations, normalized) * normalized.pixel_size
    )


def _confidence_weights(observations: TrackedObservations, normalized: NormalizedViews) -> np.ndarray:
    """Return confidences clipped to [0.1, 1], or 1 for every detection if they carry no information."""
    return (
        np.clip(normalized.confidence, 0.1, 1.0)
        if observations.confidence_varies
        else np.where(np.isnan(normalized.confidence), np.nan, 1.0)
    )


def pairwise_consensus(
    model: RecordingModel, normalized: NormalizedViews, sigma: np.ndarray, scale: float
) -> np.ndarray:
    """Return the midpoint of two views with the lowest bounded loss in all views, shape (sample, column, 3)."""
    best = np.full((*sigma.shape[:2], 3), np.nan)
    lowest = np.full(sigma.shape[:2], np.inf)
    rays = np.concatenate([normalized.xy, np.ones((*normalized.xy.shape[:-1], 1))], axis=-1)
    rays = np.einsum("svji,scvj->scvi", model.rotation, rays)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    centers = -np.einsum("svji,svj->svi", model.rotation, model.translation_m)
    for a, b in _view_pairs(sigma, rays):
        points = _midpoint(centers[:, None, a], rays[:, :, a], centers[:, None, b], rays[:, :, b])
        residual, _, _ = _residuals(model, normalized, sigma * scale, points)
        loss = np.minimum(np.square(residual).sum(axis=-1), _MAX_SQUARED).sum(axis=-1)
        better = np.isfinite(points).all(axis=-1) & (loss < lowest)
        best[better], lowest[better] = points[better], loss[better]
    return best


def _view_pairs(sigma: np.ndarray, rays: np.ndarray) -> list[tuple[int, int]]:
    """Return all pairs of views, or, of many, those with the most shared points at valid angles."""
    views = sigma.shape[2]
    all_pairs = list(combinations(range(views), 2))
    if len(all_pairs) <= _MAX_PAIRS:
        return all_pairs
    seen = np.isfinite(sigma)
    scores = []
    for a, b in all_pairs:
        both = seen[..., a] & seen[..., b]
        sine = np.linalg.norm(np.cross(rays[..., a, :][both], rays[..., b, :][both]), axis=-1)
        scores.append(float(sine.sum()))
    chosen: list[tuple[int, int]] = []
    uses = np.zeros(views, dtype=int)
    for place in np.argsort(-np.array(scores), kind="stable"):
        a, b = all_pairs[int(place)]
        # Every view enters at least three pairs, so that no faulty view dominates.
        if uses[a] < 3 or uses[b] < 3:
            chosen.append((a, b))
            uses[[a, b]] += 1
    return chosen


def _midpoint(c1: np.ndarray, d1: np.ndarray, c2: np.ndarray, d2: np.ndarray) -> np.ndarray:
    """Return the midpoint of the shortest segment between two rays, NaN where they are nearly parallel."""
    base = c2 - c1
    cosine = (d1 * d2).sum(axis=-1)
    slack = 1.0 - cosine**2
    with np.errstate(invalid="ignore", divide="ignore"):
        along1, along2 = (d1 * base).sum(axis=-1), (d2 * base).sum(axis=-1)
        s = (along1 - cosine * along2) / slack
        t = (cosine * along1 - along2) / slack
        middle = 0.5 * (c1 + s[..., None] * d1 + c2 + t[..., None] * d2)
    valid = (slack > np.sin(_MIN_ANGLE) ** 2) & (s > 0) & (t > 0)
    return np.where(valid[..., None], middle, np.nan)


def _residuals(
    model: RecordingModel, normalized: NormalizedViews, sigma: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return residuals, camera coordinates, and which observations count.

    Residuals are in units of the noise: 0 where not observed, 1000 where the point lies behind the camera.
    """
    camera_xyz = np.einsum("svij,scj->scvi", model.rotation, points) + model.translation_m[:, None]
    depth = camera_xyz[..., 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        residual = (normalized.xy - camera_xyz[..., :2] / depth[..., None]) / sigma[..., None]
    seen = np.isfinite(sigma) & np.isfinite(depth)
    residual = np.where((seen & (depth > 1e-6))[..., None], residual, np.where(seen[..., None], 1e3, 0.0))
    return residual, camera_xyz, seen


def _refine(model: RecordingModel, normalized: NormalizedViews, sigma: np.ndarray, points: np.ndarray) -> SamplePoints:
    """Refine points by reweighted Gauss-Newton steps."""
    for _ in range(_REFINEMENT_STEPS):
        current = _linearize(model, normalized, sigma, points)
        shape = current.weight.shape
        root = np.sqrt(current.weight)
        rows = ((current.jacobian @ model.rotation[:, None]) * root[..., None, None]).reshape(*shape[:2], -1, 3)
        across = np.swapaxes(rows, -1, -2)
        normal = across @ rows
        right = (across @ (current.residual * root[..., None]).reshape(*shape[:2], -1, 1))[..., 0]
        points = points + np.linalg.solve(normal + _ridge(normal), right[..., None])[..., 0]
    return _linearize(model, normalized, sigma, points)


def _ridge(normal: np.ndarray) -> np.ndarray:
    """Return a small multiple of the identity that keeps the normal equations solvable."""
    trace = np.trace(normal, axis1=-2, axis2=-1)[..., None, None]
    return (1e-6 * np.where(np.isfinite(trace), trace, 0.0) + 1e-12) * np.eye(3)


def _linearize(
    model: RecordingModel, normalized: NormalizedViews, sigma: np.ndarray, points: np.ndarray
) -> SamplePoints:
    """Return residuals, Jacobians and weights at the given points."""
    residual, camera_xyz, seen = _residuals(model, normalized, sigma, points)
    x, y, z = np.moveaxis(camera_xyz, -1, 0)
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
    valid = seen & (z > 1e-6)
    weight = np.where(valid, (STUDENT_T_DOF + 2.0) / (STUDENT_T_DOF + np.square(residual).sum(axis=-1)), 0.0)
    return SamplePoints(
        points_m=points,
        camera_xyz=np.where(valid[..., None], camera_xyz, 0.0),
        jacobian=np.where(valid[..., None, None], jacobian, 0.0),
        residual=residual,
        weight=weight,
        sigma=sigma,
        noise_scale=1.0,
        view_scales=np.ones(sigma.shape[2]),
    )


def _relative_scales(solved: SamplePoints) -> np.ndarray:
    """Return each view's noise divided by the assumed one, shape (view,); NaN where too few points determine it."""
    seen = solved.weight > 0
    number = seen.sum(axis=-1)
    squared = np.square(solved.residual).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        # Share of its squared residuals that remains after fitting a point's three coordinates.
        left = np.where(number > 2, (2.0 * number - 3.0) / (2.0 * number), np.nan)
    scales = np.full(seen.shape[2], np.nan)
    for v in range(seen.shape[2]):
        known = (squared[..., v] / left)[seen[..., v] & (number > 2)]
        if len(known) >= 50:
            scales[v] = np.sqrt(np.median(known) / _MEDIAN_SQUARED)
    if np.isnan(scales).all() and (number == 2).any():
        # A point of two views has one redundant measurement out of four.
        known = squared[seen & (number == 2)[..., None]]
        scales[:] = np.sqrt(np.median(known) * 4.0 / _MEDIAN_SQUARED) if len(known) else np.nan
    return np.maximum(scales, 1e-3)
