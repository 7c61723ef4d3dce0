"""Relative pose and time offset of two views that observe the same people.

Five-point hypotheses at the most plausible time offsets are scored by robust epipolar errors; the best are refined
together with the offset. Left and right sides of one view are corrected per frame where the other labels agree better.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.people.bearings import Bearings
from posefuse.calibration.people.five_point import decompose, essential_matrices
from posefuse.calibration.people.time_search import MAX_OFFSET_S, offset_candidates
from posefuse.kernels.calibration.relative_pose import (
    COLUMNS,
    RAY_A,
    RAY_B,
    STUDENT_T_DOF,
    VARIANCE_A,
    VARIANCE_B,
    VELOCITY,
    epipolar_costs,
    epipolar_residuals,
    refine_relative_pose,
)

MIN_POINTS = 30
MIN_PARALLAX = 3.0
"""Least parallax, in units of the nominal noise, of a pair of views that can determine distances."""
_MAX_SAMPLES = 100
_MAX_SCORED = 400
_MAX_REFINED = 600
_MAX_OFFSETS = 4
_N_MINIMAL = 80
_N_REFINED = 5
_MAX_STEPS = 25
_MIN_IN_FRONT = 0.6
_OUTLIER = 3.0
_PRIOR_OFFSET_S = 1.0
_MAX_SHIFT_S = 0.15
_MIN_SWAP_GAIN = 2.0
_ROTATION_STEPS = 5
_MEDIAN_TO_SD = 1.4826
_OF_B = np.array([3, 4, 5, 6, 7, 8, 10])


@dataclass(frozen=True, eq=False)
class PairGeometry:
    """Hold the relative pose of two views: ``x_b = rotation x_a + translation``.

    Attributes:
        rotation: shape (3, 3): second view from first.
        translation: shape (3,): unit vector.
        offset_s: time of the first view minus ``rate`` times that of the second.
        rate: seconds of the first view per second of the second.
        cost: mean of ``log(1 + r^2 / nu)`` over the points, of epipolar errors in units of the nominal noise.
        support: sum over the points of how much more probable they are than an error of three standard deviations.
        n_points: number of compared points.
        n_frames: number of compared frames.
        mirrored: share of the frames whose left and right are exchanged between the views.
        noise: standard deviation of the epipolar errors, robust, in units of the nominal noise.
        parallax: median distance of corresponding rays after the best rotation alone, in units of the nominal noise;
            near 1 where the views have the same center or the people are far away.
    """

    rotation: np.ndarray
    translation: np.ndarray
    offset_s: float
    rate: float
    cost: float
    support: float
    n_points: int
    n_frames: int
    mirrored: float
    noise: float
    parallax: float


@dataclass(frozen=True, eq=False)
class _Pairing:
    """Hold the corresponding rays of two views at one time offset.

    Attributes:
        table: shape (frame, keypoint, COLUMNS), NaN where a view does not observe the keypoint.
        mirror: shape (keypoint,).
    """

    table: np.ndarray
    mirror: np.ndarray

    def swapped(self, frames: np.ndarray) -> "_Pairing":
        """Return the pairing with left and right of the second view exchanged in some frames, shape (frame,), bool."""
        table = self.table.copy()
        table[..., _OF_B] = np.where(frames[:, None, None], self.table[:, self.mirror][..., _OF_B], table[..., _OF_B])
        return replace(self, table=table)

    def points(self, n: int | None = None) -> np.ndarray:
        """Return the points that both views observe, shape (point, COLUMNS); evenly chosen ones if many."""
        out = self.table[np.isfinite(self.table[..., [RAY_A, RAY_B]]).all(axis=-1)]
        if n is not None and len(out) > n:
            out = out[np.unique(np.linspace(0, len(out) - 1, n).astype(np.int64))]
        return np.ascontiguousarray(out)


def relate_pair(
    a: Bearings,
    b: Bearings,
    people: tuple[tuple[int, int], ...] = ((0, 0),),
    *,
    offsets_s: Sequence[float] | None = None,
    rate: float = 1.0,
    seed: int = 0,
) -> list[PairGeometry]:
    """Estimate the relative pose and the time offset of two views from people whom both observe.

    Args:
        a: first view.
        b: second view.
        people: corresponding persons: index in the first and in the second view.
        offsets_s: approximate time offsets to try, each refined; empty if the views are synchronized. By default,
            candidates within 2 s are found by the motion.
        rate: seconds of the first view per second of the second.
        seed: random seed.

    Returns:
        Different geometries, the most probable first; none if the views share too few points or no pose has the
        people in front of both cameras.
    """
    rng = np.random.default_rng(seed)
    search = _Search(a, b, people, rate, offsets_s is not None and len(offsets_s) == 0)
    if offsets_s is None:
        offsets_s = offset_candidates(a, b, people, MAX_OFFSET_S, rate, _MAX_OFFSETS)
    found: list[PairGeometry] = []
    for offset_s in offsets_s or (0.0,):
        found += search.at_offset(offset_s, rng)
    found.sort(key=lambda geometry: geometry.cost + _prior_cost(geometry))
    kept: list[PairGeometry] = []
    for geometry in found:
        if all(_is_different(geometry, other) for other in kept):
            kept.append(geometry)
    return kept


def _prior_cost(geometry: PairGeometry) -> float:
    """Return the cost per point of a time offset: that of one independent observation in ten frames."""
    return 0.1 * (geometry.offset_s / _PRIOR_OFFSET_S) ** 2 / max(geometry.n_frames, 10)


def _is_different(a: PairGeometry, b: PairGeometry) -> bool:
    """Return whether two geometries differ by more than 5 degrees, or by a twentieth of a second."""
    cosine = 0.5 * (float((a.rotation * b.rotation).sum()) - 1.0)
    return cosine < np.cos(np.radians(5.0)) or abs(a.offset_s - b.offset_s) > 0.05


def _pairing(a: Bearings, b: Bearings, people: tuple[tuple[int, int], ...], offset_s: float, rate: float) -> _Pairing:
    """Return the corresponding rays at one time offset."""
    times = a.sample_times(_MAX_SAMPLES)
    inside = (times - offset_s) / rate
    times = times[(inside >= b.time_s[0] - 1e-6) & (inside <= b.time_s[-1] + 1e-6)]
    tables = []
    for of_a, of_b in people:
        rays_a, _, sigma_a = a.at(times, of_a)
        rays_b, velocity, sigma_b = b.at((times - offset_s) / rate, of_b)
        variances = np.stack([sigma_a**2, sigma_b**2], axis=-1)
        tables.append(np.concatenate([rays_a, rays_b, velocity / rate, variances], axis=-1))
    return _Pairing(np.concatenate(tables), a.mirror)


@dataclass(frozen=True, eq=False)
class _Search:
    """Hold what the search of one pair of views keeps constant."""

    a: Bearings
    b: Bearings
    people: tuple[tuple[int, int], ...]
    rate: float
    is_synchronized: bool

    def at_offset(self, offset_s: float, rng: np.random.Generator) -> list[PairGeometry]:
        """Return the best geometries near one time offset."""
        pairing = _pairing(self.a, self.b, self.people, offset_s, self.rate)
        out: list[PairGeometry] = []
        has_sides = bool((pairing.mirror != np.arange(len(pairing.mirror))).any())
        for exchanged in (False, True) if has_sides else (False,):
            labeled = pairing.swapped(np.full(len(pairing.table), exchanged))
            points = labeled.points()
            if len(points) < MIN_POINTS:
                continue
            for pose in _hypotheses(points, labeled.points(_MAX_SCORED), rng):
                geometry = self.refined(labeled, pose, offset_s)
                if geometry is not None:
                    out.append(replace(geometry, mirrored=1.0 - geometry.mirrored) if exchanged else geometry)
        return out

    def refined(self, pairing: _Pairing, pose: np.ndarray, offset_s: float) -> PairGeometry | None:
        """Refine a pose and the time offset, and correct the sides of frames."""
        frames, points, _ = self._step(pairing, pose)
        frames, points, shift_s = self._step(pairing, pose)
        points[:, RAY_B:VELOCITY] += shift_s * points[:, VELOCITY:VARIANCE_A]
        residuals = np.empty(len(points))
        epipolar_residuals(pose[:3], pose[3], points, residuals)
        if share_in_front(pose, points) < _MIN_IN_FRONT:
            return None
        loss = np.log1p(residuals**2 / STUDENT_T_DOF)
        bound = np.log1p(_OUTLIER**2 / STUDENT_T_DOF)
        return PairGeometry(
            rotation=pose[:3],
            translation=pose[3],
            # Later rays of the second view agree, so its clock is behind.
            offset_s=offset_s - shift_s,
            rate=self.rate,
            cost=float(loss.mean()),
            support=float(np.maximum(bound - loss, 0.0).sum()),
            n_points=len(loss),
            n_frames=len(frames),
            mirrored=float(frames.mean()),
            noise=float(np.median(np.abs(residuals))) * _MEDIAN_TO_SD,
            parallax=rotation_residual(points),
        )

    def _step(self, pairing: _Pairing, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Correct the sides of frames and refine the pose in place; return the frames, the points and the shift."""
        frames = _exchanged_frames(pairing, pose)
        points = pairing.swapped(frames).points(_MAX_REFINED)
        if self.is_synchronized:
            points[:, VELOCITY:VARIANCE_A] = 0.0
        shift_s, _ = refine_relative_pose(pose, points, _MAX_STEPS, 0.0 if self.is_synchronized else _MAX_SHIFT_S)
        return frames, points, shift_s


def _hypotheses(points: np.ndarray, scored: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """Return the poses (4, 3) of the best five-point samples that have most points in front of both cameras."""
    chosen = rng.integers(0, len(points), (_N_MINIMAL, 5))
    samples = points[chosen]
    essentials = essential_matrices(samples[..., RAY_A:RAY_B], samples[..., RAY_B:VELOCITY])
    costs = np.empty(len(essentials))
    epipolar_costs(essentials, scored, costs)
    out = []
    for essential in essentials[np.argsort(costs, kind="stable")[:_N_REFINED]]:
        rotations, translation = decompose(essential)
        poses = [np.concatenate([r, sign * translation[None]]) for r in rotations for sign in (1.0, -1.0)]
        shares = [share_in_front(pose, scored) for pose in poses]
        if max(shares) >= _MIN_IN_FRONT:
            out.append(poses[int(np.argmax(shares))])
    return out


def share_in_front(pose: np.ndarray, points: np.ndarray) -> float:
    """Return the share of the points that lie in front of both cameras.

    Args:
        pose: shape (4, 3): rotation of the second view from the first, and unit translation.
        points: shape (point, COLUMNS).
    """
    turned = points[:, RAY_A:RAY_B] @ pose[:3].T
    rays_b = points[:, RAY_B:VELOCITY]
    normal = np.cross(rays_b, turned)
    along_a = (np.cross(pose[3], rays_b) * normal).sum(axis=1)
    along_b = (np.cross(pose[3], turned) * normal).sum(axis=1)
    return float(((along_a > 0.0) & (along_b > 0.0)).mean())


def rotation_residual(points: np.ndarray) -> float:
    """Return the median distance of corresponding rays after the best rotation, in units of the noise.

    Args:
        points: shape (point, COLUMNS).
    """
    rays_a, rays_b = points[:, RAY_A:RAY_B], points[:, RAY_B:VELOCITY]
    variance = points[:, VARIANCE_A] + points[:, VARIANCE_B]
    weight = 1.0 / variance
    squared = variance
    for _ in range(_ROTATION_STEPS):
        # Kabsch: the rotation that aligns the weighted rays.
        left, _, right = np.linalg.svd((rays_b * weight[:, None]).T @ rays_a)
        rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        squared = ((rays_b - rays_a @ rotation.T) ** 2).sum(axis=1) / variance
        weight = 1.0 / ((STUDENT_T_DOF + squared) * variance)
    return float(np.sqrt(np.median(squared)))


def _exchanged_frames(pairing: _Pairing, pose: np.ndarray) -> np.ndarray:
    """Return the frames in which the other labels agree clearly better, shape (frame,)."""
    losses = []
    for labeled in (pairing, pairing.swapped(np.ones(len(pairing.table), dtype=bool))):
        residuals = np.empty(labeled.table.shape[:2])
        epipolar_residuals(pose[:3], pose[3], labeled.table.reshape(-1, COLUMNS), residuals.ravel())
        losses.append(np.nansum(np.log1p(residuals**2 / STUDENT_T_DOF), axis=1))
    return losses[0] - losses[1] > _MIN_SWAP_GAIN
