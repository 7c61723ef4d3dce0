"""Approximate poses of all views from relative poses of pairs.

Starting from each of the best pairs, views are added one by one by their pose relative to the points of the views so
far; a bundle adjustment with rigid bones follows each. The results of several starts are ranked by their probability.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.people.bodies import BodySamples, Bones
from posefuse.calibration.people.body_bundle import (
    BodyState,
    adjust_bodies,
    initial_state,
    residuals_of,
)
from posefuse.calibration.people.common_focal import with_common_focal
from posefuse.calibration.people.likelihood import camera_costs
from posefuse.calibration.people.pairs import MIN_PARALLAX, PairGeometry
from posefuse.calibration.people.sample_sides import with_corrected_sides
from posefuse.kernels.calibration.body_bundle import (
    FOCAL,
    OFFSET,
    STUDENT_T_DOF,
    VIEW_COLUMNS,
    body_residuals,
    refine_view,
)

Edges = Mapping[tuple[int, int], Sequence[PairGeometry]]
"""Geometries of each pair of views, the most probable first."""

MAX_RATIO = 5.0
"""Largest median error of a view that observes the same people, relative to the noise of the first pair of views."""
MIN_SHARED = 30
_MIN_NOISE = 0.5
_OUTLIER = 5.0
_MIN_STARTS, _MAX_STARTS = 3, 8
_SAME_DEG = 10.0
_HYPOTHESES = 3
_VIEW_STEPS = 15
_TRANSLATION_STEPS = 4
_FINAL_ROUNDS = 3
_FINAL_PASSES = 2
_FOCAL_SPREAD = 0.01


@dataclass(frozen=True, eq=False)
class Assembly:
    """Hold approximate poses of the views that could be related.

    Attributes:
        views: indices of the views, ascending.
        samples: their observations, with corrected sides.
        state: poses, points and bones.
        cost: mean robust cost of an observation, in units of the nominal noise.
        support: sum over the observations of how much more probable they are than errors of five standard deviations.
        likelihood: logarithm of how much more probable observations and bones are than errors of five nominal standard
            deviations of all observations.
        median: shape (view,): median residual of each view in units of the nominal noise.
        exchanged: shape (sample, view), bool: where sides were exchanged.
        rejected: views that do not fit, with their median residual.
    """

    views: tuple[int, ...]
    samples: BodySamples
    state: BodyState
    cost: float
    support: float
    likelihood: float
    median: np.ndarray
    exchanged: np.ndarray
    rejected: Mapping[int, float]


def assemble(
    samples: BodySamples, bones: Bones, edges: Edges, focal_known: np.ndarray, offsets_free: bool
) -> list[Assembly]:
    """Assemble views from the geometries of pairs.

    Args:
        samples: observations of all views, at their approximate time offsets.
        bones: bones of the skeleton.
        edges: geometries of pairs.
        focal_known: shape (view,), bool.
        offsets_free: whether time offsets are estimated.

    Returns:
        Assemblies from different starts, the most probable first; none without geometries or observations. There are
        more starts if the first ones do not agree.
    """
    found: list[Assembly] = []
    if not len(samples.time_s):
        return found
    for (a, b), geometry in _starts(edges):
        if len(found) >= _MIN_STARTS and any(_is_same(found[0], other) for other in found[1:]):
            break
        found.append(_Assembler(samples, bones, edges, focal_known, offsets_free).grow(a, b, geometry))
        found.sort(key=lambda each: -each.likelihood)
    return found


def _is_same(a: Assembly, b: Assembly) -> bool:
    """Return whether two assemblies have the same views in nearly the same directions."""
    return a.views == b.views and difference_deg(a, b) < _SAME_DEG


def difference_deg(a: Assembly, b: Assembly) -> float:
    """Return the largest difference of the relative rotation of two views, in assemblies of the same views."""
    turns = np.swapaxes(a.state.rotations, 1, 2) @ b.state.rotations
    # Equal relative rotations are the same rotation of the world in all views.
    cosines = 0.5 * (np.einsum("vij,wij->vw", turns, turns) - 1.0)
    return float(np.degrees(np.arccos(np.clip(cosines.min(), -1.0, 1.0))))


def _starts(edges: Edges) -> list[tuple[tuple[int, int], PairGeometry]]:
    """Return the best geometries of the best pairs, then other geometries, the best first."""
    ranked = sorted(
        (geometry.cost - 1e-3 * geometry.n_points**0.5, rank, pair)
        for pair, geometries in edges.items()
        for rank, geometry in enumerate(geometries)
        if geometry.parallax > MIN_PARALLAX
    )
    first = [(rank, pair) for _, rank, pair in ranked if rank == 0][:_MIN_STARTS]
    rest = [(rank, pair) for _, rank, pair in ranked if (rank, pair) not in first]
    return [(pair, edges[pair][rank]) for rank, pair in (first + rest)[:_MAX_STARTS]]


def free_parameters(focal_known: np.ndarray, offsets_free: bool, focal_free: bool = True) -> np.ndarray:
    """Return the free parameters of views, shape (view, VIEW_COLUMNS): poses, and what else is unknown."""
    free = np.zeros((len(focal_known), VIEW_COLUMNS), dtype=bool)
    free[:, :OFFSET] = True
    free[1:, OFFSET] = offsets_free
    free[:, FOCAL] = ~focal_known & focal_free
    return free


def readjust(assembly: Assembly, samples: BodySamples, bones: Bones, free: np.ndarray) -> Assembly:
    """Return the assembly after an adjustment to new samples of its views.

    Args:
        assembly: initial poses.
        samples: observations of its views, at the time offsets and focal lengths found so far.
        bones: bones of the skeleton.
        free: shape (view, VIEW_COLUMNS), bool: free parameters.
    """
    rotations, centers = assembly.state.rotations, assembly.state.centers
    labeled, exchanged = with_corrected_sides(samples, rotations, centers)
    start = initial_state(labeled, bones, rotations, centers, assembly.state.log_focal)
    state = adjust_bodies(labeled, bones, _around_mean(start, free), free, _FINAL_ROUNDS)
    return _assembly(assembly.views, labeled, bones, state, exchanged, assembly.rejected)


def _around_mean(state: BodyState, free: np.ndarray) -> BodyState:
    """Return the state whose free focal lengths may differ from their mean, which is kept."""
    unknown = free[:, FOCAL]
    mean = float(state.log_focal[unknown].mean()) if unknown.any() else 0.0
    return replace(state, focal_spread=_FOCAL_SPREAD, focal_middle=np.where(unknown, mean, 0.0))


def _assembly(
    views: Sequence[int],
    samples: BodySamples,
    bones: Bones,
    state: BodyState,
    exchanged: np.ndarray,
    rejected: Mapping[int, float],
) -> Assembly:
    """Return an assembly with its residuals."""
    residuals = residuals_of(samples, state)
    median = np.array([_median(residuals[:, v]) for v in range(len(views))])
    loss = np.log1p(np.minimum(residuals[~np.isnan(residuals)], 100.0) ** 2 / STUDENT_T_DOF)
    bound = np.log1p(_OUTLIER**2 / STUDENT_T_DOF)
    support = float((bound - loss).sum())
    likelihood = 0.5 * (STUDENT_T_DOF + 2.0) * bound * len(loss) - float(camera_costs(samples, bones, state).sum())
    cost = float(loss.mean()) if len(loss) else np.inf
    return Assembly(tuple(views), samples, state, cost, support, likelihood, median, exchanged, rejected)


@dataclass(frozen=True, eq=False)
class _Assembler:
    """Grow an assembly from one pair."""

    samples: BodySamples
    bones: Bones
    edges: Edges
    focal_known: np.ndarray
    offsets_free: bool

    def grow(self, a: int, b: int, geometry: PairGeometry) -> Assembly:
        """Return the assembly that starts from one pair."""
        views = [a, b]
        rotations = np.stack([np.eye(3), geometry.rotation])
        centers = np.stack([np.zeros(3), -geometry.rotation.T @ geometry.translation])
        state = self._adjusted(views, rotations, centers, 1)
        left = [v for v in range(self.samples.n_views) if v not in views]
        rejected: dict[int, float] = {}
        most = MAX_RATIO * max(geometry.noise, _MIN_NOISE)
        while left:
            v = max(left, key=lambda v: (self._connection(v, views), -v))
            left.remove(v)
            pose, median = self._locate(v, views, state)
            if pose is None or median > most:
                rejected[v] = median
                continue
            views.append(v)
            rotations = np.concatenate([state.rotations, pose[None, :3]])
            centers = np.concatenate([state.centers, pose[None, 3]])
            state = self._adjusted(views, rotations, centers, 1)
        return self._finished(views, state, rejected)

    def _connection(self, view: int, views: list[int]) -> float:
        """Return the support of a view by the geometries with other views."""
        pairs = [tuple(sorted((view, other))) for other in views]
        return sum(self.edges[pair][0].support for pair in pairs if self.edges.get(pair))  # type: ignore[index,misc]

    def _labeled(self, views: list[int], rotations: np.ndarray, centers: np.ndarray) -> tuple[BodySamples, np.ndarray]:
        """Return the observations of some views with corrected sides, and where they were exchanged."""
        return with_corrected_sides(self.samples.select_views(views), rotations, centers)

    def _adjusted(self, views: list[int], rotations: np.ndarray, centers: np.ndarray, rounds: int) -> BodyState:
        """Return the adjusted state of some views."""
        labeled, _ = self._labeled(views, rotations, centers)
        state = initial_state(labeled, self.bones, rotations, centers)
        return adjust_bodies(labeled, self.bones, state, self._free(views, False), rounds)

    def _free(self, views: list[int], final: bool) -> np.ndarray:
        return free_parameters(self.focal_known[views], final and self.offsets_free, final)

    def _locate(self, view: int, views: list[int], state: BodyState) -> tuple[np.ndarray | None, float]:
        """Return the best pose of another view, shape (4, 3): rotation and center, and its median residual."""
        best: tuple[float, np.ndarray | None] = (np.inf, None)
        median = np.inf
        observed = self.samples.observed[:, view]
        for turn in self._rotations(view, views, state):
            for mirrored in (False, True):
                labeled = observed[:, self.samples.mirror] if mirrored else observed
                shared = np.isfinite(labeled[..., 0]) & np.isfinite(state.points[..., 0])
                if shared.sum() < MIN_SHARED:
                    return None, np.inf
                pose, residuals = locate_view(turn, state.points[shared], labeled[shared])
                cost = float(np.log1p(np.minimum(residuals, 100.0) ** 2 / STUDENT_T_DOF).mean())
                if cost < best[0]:
                    best, median = (cost, pose), _median(residuals)
        return best[1], median

    def _rotations(self, view: int, views: list[int], state: BodyState) -> list[np.ndarray]:
        """Return the rotations of a view that its pairs with other views suggest."""
        out = []
        for place, other in enumerate(views):
            pair = (min(view, other), max(view, other))
            for geometry in self.edges.get(pair, ())[:_HYPOTHESES]:
                turn = geometry.rotation if pair[0] == other else geometry.rotation.T
                out.append(turn @ state.rotations[place])
        return out

    def _finished(self, views: list[int], state: BodyState, rejected: dict[int, float]) -> Assembly:
        """Return the final adjustment of an assembly, with its views in order."""
        order = np.argsort(views)
        views = [views[i] for i in order]
        rotations, centers = state.rotations[order], state.centers[order]
        log_focal = np.zeros(len(views))
        free = self._free(views, True)
        labeled, exchanged = self._labeled(views, rotations, centers)
        for k in range(_FINAL_PASSES):
            if k > 0:
                labeled, exchanged = self._labeled(views, rotations, centers)
            start = initial_state(labeled, self.bones, rotations, centers, log_focal)
            start = with_common_focal(labeled, self.bones, start, free)
            state = adjust_bodies(labeled, self.bones, _around_mean(start, free), free, _FINAL_ROUNDS)
            rotations, centers, log_focal = state.rotations, state.centers, state.log_focal
        return _assembly(views, labeled, self.bones, state, exchanged, rejected)


def locate_view(turn: np.ndarray, points: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose of a view from known points, and the residuals in units of the nominal noise.

    Args:
        turn: shape (3, 3): approximate rotation.
        points: shape (point, 3).
        rays: shape (point, 10): observations.

    Returns:
        Rotation and center, shape (4, 3), and residuals, shape (point,), infinite behind the camera.
    """
    points, rays = np.ascontiguousarray(points), np.ascontiguousarray(rays)
    rotation = np.ascontiguousarray(turn).copy()
    center = _center(rotation, points, rays)
    refine_view(rotation, center, points, rays, _VIEW_STEPS)
    residuals = np.empty((len(points), 1, 1))
    body_residuals(rotation[None], center[None], points[:, None], rays[:, None, None], residuals)
    return np.concatenate([rotation, center[None]]), residuals[:, 0, 0]


def _median(values: np.ndarray) -> float:
    """Return the median of known values; infinite without any."""
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else np.inf


def _center(rotation: np.ndarray, points: np.ndarray, observed: np.ndarray) -> np.ndarray:
    """Return the center of a view of known rotation: nearest to the lines of sight, reweighted."""
    rays = observed[:, :3] @ rotation
    weight = np.ones(len(points))
    center = np.zeros(3)
    for _ in range(_TRANSLATION_STEPS):
        across = weight[:, None, None] * (np.eye(3) - rays[:, :, None] * rays[:, None])
        center = np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, points), rcond=None)[0]
        sight = points - center
        squared = np.maximum((sight**2).sum(axis=1), 1e-12)
        error = np.maximum(squared - (sight * rays).sum(axis=1) ** 2, 0.0) / squared
        variance = observed[:, 9] ** 2
        weight = 1.0 / ((3.0 + error / variance) * variance * squared)
    return center
