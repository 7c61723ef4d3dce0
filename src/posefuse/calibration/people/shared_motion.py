"""Test whether views agree because they show the same people at the same time.

Under the null hypothesis, a view agrees with the others as well when its time runs backward: it films something else,
or the people move less than the errors of the detector, slow ones included. A walk stays a walk when it is shifted in
time, but not when it runs backward.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posefuse.calibration.people.assemble import Assembly, assemble, locate_view
from posefuse.calibration.people.bearings import Bearings
from posefuse.calibration.people.bodies import Bones, sample_bodies
from posefuse.calibration.people.body_bundle import pooled_scale
from posefuse.calibration.people.likelihood import body_costs, observation_costs
from posefuse.calibration.people.pairs import relate_pair
from posefuse.calibration.people.rates import at_rate
from posefuse.calibration.people.rigs import N_SAMPLES, People, Rig
from posefuse.kernels.calibration.ray_points import triangulate_rays
from posefuse.model.cameras import rotation_from_vector

MIN_GAIN = 0.1
"""Least gain in the logarithm of the probability of an observation by its own time instead of the best wrong one.

Views that film something else, and people who stand still, gain -0.5 to 0.1 in simulations, others 0.15 to 5.
"""
CLEAR_GAIN = 0.4
"""The same for two views that are chosen among three, of which a wrong pair gains up to 0.3."""
_STARTS = 5
"""Times at which a view starts to run backward, as shares of the recording; the best is compared."""
_SHARES_OF_PAIR = (0.0, 0.5)
_GEOMETRIES = 3
_TURNS_DEG = (0.0, 90.0, 180.0, 270.0)
_EVERY, _TWO = 2, 2


def weakest_view(
    views: Sequence[Bearings], table: People, bones: Bones, focal_known: np.ndarray, rig: Rig, seed: int
) -> tuple[int, float]:
    """Return the view of a rig that gains least by its own time instead of backward, and its gain per observation.

    Args:
        views: directions of all views.
        table: index of each person in every view, -1 where a view does not observe it.
        bones: bones of the skeleton.
        focal_known: shape (view,), bool.
        rig: the rig.
        seed: random seed.
    """
    assembly = rig.assembly
    if len(assembly.views) == _TWO:
        a, b = assembly.views
        people = tuple((person[a], person[b]) for person in table if person[a] >= 0 and person[b] >= 0)
        timed = [at_rate(views[v], rig.rate[v]) for v in (a, b)]
        return b, gain_of_pair(timed, people, bones, focal_known[[a, b]], assembly, seed)
    gains = [gain_of_view(assembly, place) for place in range(len(assembly.views))]
    weakest = int(np.argmin(gains))
    return assembly.views[weakest], gains[weakest]


def backward(person: np.ndarray, share: float = 0.0) -> np.ndarray:
    """Return the index of the sample that takes the place of each one when time runs backward.

    Args:
        person: shape (sample,): person of each sample; the samples of each are ordered by time.
        share: by which share of the samples of a person the beginning is later.
    """
    out = np.empty(len(person), dtype=np.int64)
    for p in np.unique(person):
        places = np.flatnonzero(person == p)
        out[places] = np.roll(places[::-1], round(share * len(places)))
    return out


def gain_of_view(assembly: Assembly, place: int) -> float:
    """Return by how much the observations of a view are more probable in their own time than backward, per observation.

    The view is located by the points of the others in both cases.

    Args:
        assembly: of at least three views.
        place: of the view in the assembly.
    """
    samples, state = assembly.samples, assembly.state
    rest = [v for v in range(samples.n_views) if v != place]
    rotations, centers = (np.ascontiguousarray(each[rest]) for each in (state.rotations, state.centers))
    points = np.empty_like(state.points)
    triangulate_rays(rotations, centers, samples.select_views(rest).observed, points)
    person, points, observed = samples.person[::_EVERY], points[::_EVERY], samples.observed[::_EVERY, place]
    down = state.rotations[place, 1]
    turns = [state.rotations[place] @ rotation_from_vector(np.radians(a) * down).T for a in _TURNS_DEG]
    own = _best_cost(points, observed, samples.mirror, turns[:1])
    others = [
        _best_cost(points, observed[backward(person, k / _STARTS)], samples.mirror, turns) for k in range(_STARTS)
    ]
    return min(others) - own


def _best_cost(points: np.ndarray, observed: np.ndarray, mirror: np.ndarray, turns: Sequence[np.ndarray]) -> float:
    """Return the mean cost of an observation of a view in its best pose; infinite without observations."""
    best = np.inf
    for labeled in (observed, observed[:, mirror]):
        shared = np.isfinite(points[..., 0]) & np.isfinite(labeled[..., 0])
        if shared.any():
            for turn in turns:
                _, residuals = locate_view(turn, points[shared], labeled[shared])
                best = min(best, float(observation_costs(residuals, pooled_scale(residuals)).mean()))
    return best


def gain_of_pair(
    views: Sequence[Bearings],
    people: Sequence[tuple[int, int]],
    bones: Bones,
    focal_known: np.ndarray,
    assembly: Assembly,
    seed: int,
) -> float:
    """Return by how much two views are more probable in their own time than with the second backward, per observation.

    Args:
        views: directions of both views.
        people: corresponding persons: index in the first and in the second view.
        bones: bones of the skeleton.
        focal_known: shape (2,), bool.
        assembly: of both views.
        seed: random seed.
    """
    others = []
    for share in _SHARES_OF_PAIR:
        pair = [views[0], _backward_view(views[1], share)]
        for geometry in relate_pair(pair[0], pair[1], tuple(people), seed=seed)[:_GEOMETRIES]:
            late = np.array([0.0, geometry.offset_s])
            samples = sample_bodies(pair, people, late, np.ones(2), N_SAMPLES)
            for found in assemble(samples, bones, {(0, 1): [geometry]}, focal_known, True):
                others.append(_mean_cost(found, bones))
    return min(others, default=np.inf) - _mean_cost(assembly, bones)


def _mean_cost(assembly: Assembly, bones: Bones) -> float:
    """Return the cost of an assembly per observation."""
    n = np.isfinite(assembly.samples.observed[..., 0]).sum()
    return float(body_costs(assembly.samples, bones, assembly.state).sum()) / max(int(n), 1)


def _backward_view(view: Bearings, share: float) -> Bearings:
    """Return a view in which each person does everything backward, within the frames that show the person."""
    rays, sigma = view.rays.copy(), view.sigma.copy()
    for p in range(view.n_people):
        seen = np.flatnonzero(np.isfinite(view.sigma[:, p]).any(axis=1))
        other = seen[backward(np.zeros(len(seen), dtype=np.int64), share)]
        rays[seen, p], sigma[seen, p] = view.rays[other, p], view.sigma[other, p]
    return replace(view, rays=rays, sigma=sigma)
