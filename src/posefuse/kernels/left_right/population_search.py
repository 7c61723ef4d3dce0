"""Two-point solve by a small population search around the center of all rays: the method of the specification.

Source: the specification "Sparse Pose Fusion", two-point solve, and its search (called stochastic diffusion there):
agents hop past better ones by as much as they differ from them, which contracts the population to a minimum. Where the
program and the specification differ, this module follows the specification: the center is robust, the two rays of a
view support different points in the better way, and undefined numbers remove no agent. Lengths in mm.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.cameras.rays import point_ray_distance
from posefuse.kernels.jit import inline, kernel, subroutine
from posefuse.kernels.linear_algebra.symmetric_3x3 import solve_symmetric

# Park and Miller's generator: products stay below 2^47.
_MODULUS = 2147483647
_FACTOR = 48271
_WARM_UP = 8
_CENTER_ITERATIONS = 15
_CENTER_SCALE = 2.0
# The state: x, y, z of both points.
_SIZE = 6


class _Population(NamedTuple):
    """Agents, shape (agent, 6), their errors, whether each has moved, and the state of the generator, shape (1,)."""

    agents: Any
    errors: Any
    moved: Any
    generator: Any


@inline
def _next_uniform(generator):
    """Return the next number in [0, 1); ``generator`` holds the state of the generator."""
    generator[0] = generator[0] * _FACTOR % _MODULUS
    return (generator[0] - 1) / (_MODULUS - 1.0)


@inline
def _seed_generator(generator, seed, number):
    """Seed the generator for one pair, so that its numbers do not depend on the other pairs that are solved."""
    generator[0] = 1 + (seed * 7919 + 104729) % (_MODULUS - 1)
    for _ in range(_WARM_UP):
        _next_uniform(generator)
    generator[0] = 1 + (generator[0] + number) % (_MODULUS - 1)
    for _ in range(_WARM_UP):
        _next_uniform(generator)


@inline
def _next_normal(generator):
    """Return a normally distributed number (Box and Muller)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - _next_uniform(generator)))
    return radius * math.cos(2.0 * math.pi * _next_uniform(generator))


@inline
def _distance(rays, r, x, y, z):
    """Return the distance of a point from a ray."""
    distance, _ = point_ray_distance(x, y, z, rays[r, 0], rays[r, 1], rays[r, 2], rays[r, 3], rays[r, 4], rays[r, 5])
    return distance


@subroutine
def _robust_center(rays, valid, weights, sorted_distances, center):
    """Compute the point closest to all rays, with Cauchy weights that reduce the influence of distant rays.

    Args:
        rays: shape (2 view, 6), origins and unit directions.
        valid: shape (2 view,), bool.
        weights, sorted_distances: shape (2 view,), scratch.
        center: shape (3,), written.
    """
    for r in range(rays.shape[0]):
        weights[r] = 1.0 if valid[r] else 0.0
    for _ in range(_CENTER_ITERATIONS):
        xx = xy = xz = yy = yz = zz = bx = by = bz = 0.0
        for r in range(rays.shape[0]):
            w = weights[r]
            if w == 0.0:
                continue
            dx, dy, dz = rays[r, 3], rays[r, 4], rays[r, 5]
            along = rays[r, 0] * dx + rays[r, 1] * dy + rays[r, 2] * dz
            xx += w * (1.0 - dx * dx)
            xy -= w * dx * dy
            xz -= w * dx * dz
            yy += w * (1.0 - dy * dy)
            yz -= w * dy * dz
            zz += w * (1.0 - dz * dz)
            bx += w * (rays[r, 0] - along * dx)
            by += w * (rays[r, 1] - along * dy)
            bz += w * (rays[r, 2] - along * dz)
        _, center[0], center[1], center[2] = solve_symmetric(xx, xy, xz, yy, yz, zz, bx, by, bz)
        count = 0
        for r in range(rays.shape[0]):
            if valid[r]:
                distance = _distance(rays, r, center[0], center[1], center[2])
                position = count
                while position > 0 and sorted_distances[position - 1] > distance:
                    sorted_distances[position] = sorted_distances[position - 1]
                    position -= 1
                sorted_distances[position] = distance
                count += 1
        scale = max(_CENTER_SCALE * sorted_distances[count // 2], 1e-9)
        for r in range(rays.shape[0]):
            if valid[r]:
                u = _distance(rays, r, center[0], center[1], center[2]) / scale
                weights[r] = 1.0 / (1.0 + u * u)


@subroutine
def pair_error(rays, valid, center, agent, terms, separation):
    """Return the objective of the specification.

    Args:
        rays: shape (2 view, 6), origins and unit directions; the two rays of a view are adjacent.
        valid: shape (2 view,), bool.
        center: shape (3,), of all rays.
        agent: shape (6,), two points.
        terms: shape (4,): weights of e0 to e3.
        separation: distance from which on the points need not be farther apart.
    """
    x0, y0, z0, x1, y1, z1 = agent[0], agent[1], agent[2], agent[3], agent[4], agent[5]
    separation_m = math.sqrt((x0 - x1) ** 2 + (y0 - y1) ** 2 + (z0 - z1) ** 2)
    separation_term = max(0.0, -math.log(max(separation_m, 1e-300) / separation))
    ray_term = 0.0
    for v in range(rays.shape[0] // 2):
        a = 2 * v
        b = a + 1
        if valid[a] and valid[b]:
            straight = _distance(rays, a, x0, y0, z0) + _distance(rays, b, x1, y1, z1)
            crossed = _distance(rays, b, x0, y0, z0) + _distance(rays, a, x1, y1, z1)
            ray_term += min(straight, crossed)
        elif valid[a] or valid[b]:
            single = a if valid[a] else b
            ray_term += min(_distance(rays, single, x0, y0, z0), _distance(rays, single, x1, y1, z1))
    ax, ay, az = center[0] - x0, center[1] - y0, center[2] - z0
    bx, by, bz = x1 - center[0], y1 - center[1], z1 - center[2]
    to_first = math.sqrt(ax * ax + ay * ay + az * az)
    to_second = math.sqrt(bx * bx + by * by + bz * bz)
    product = to_first * to_second
    # At the center the direction is undefined: neither on the same side nor opposite.
    direction_term = 1.0 - (ax * bx + ay * by + az * bz) / product if product > 0.0 else 1.0
    error = terms[0] * separation_term + terms[1] * ray_term
    return error + terms[2] * abs(to_first - to_second) + terms[3] * direction_term


@subroutine
def _hop_agents(agents, errors, moved, best, generator):
    """Perform one round: agents that meet a better one hop past it; return the norm over axes of the largest hops."""
    n = agents.shape[0]
    total = 0.0
    ranges = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    r0, r1, r2, r3, r4, r5 = ranges
    for i in range(n):
        if i == best:
            continue
        other = min(int(_next_uniform(generator) * n), n - 1)
        if moved[other] or not errors[other] < errors[i]:
            continue
        for k in range(_SIZE):
            difference = abs(agents[i, k] - agents[other, k])
            agents[i, k] = agents[other, k] + (2.0 * _next_uniform(generator) - 1.0) * difference
            r0 = max(r0, difference) if k == 0 else r0
            r1 = max(r1, difference) if k == 1 else r1
            r2 = max(r2, difference) if k == 2 else r2
            r3 = max(r3, difference) if k == 3 else r3
            r4 = max(r4, difference) if k == 4 else r4
            r5 = max(r5, difference) if k == 5 else r5
        moved[i] = True
    total = r0 * r0 + r1 * r1 + r2 * r2 + r3 * r3 + r4 * r4 + r5 * r5
    return math.sqrt(total)


@subroutine
def _search(rays, valid, center, parameters, population):
    """Contract the population to a minimum; return the best agent, with its error left in the population."""
    agents, errors, moved, generator = population
    terms, separation = parameters.terms, parameters.separation
    n = agents.shape[0]
    for i in range(n):
        for k in range(_SIZE):
            agents[i, k] = center[k % 3] + (parameters.initial_sd * _next_normal(generator) if i > 0 else 0.0)
        moved[i] = True
    best = 0
    n_idle = 0
    for _ in range(parameters.max_iterations):
        for i in range(n):
            if moved[i]:
                errors[i] = pair_error(rays, valid, center, agents[i], terms, separation)
            moved[i] = False
        for i in range(n):
            best = i if errors[i] < errors[best] else best
        largest_hop = _hop_agents(agents, errors, moved, best, generator)
        any_hop = False
        for i in range(n):
            any_hop = any_hop or moved[i]
        # A round without any hop carries no information about the size of the population.
        n_idle = 0 if any_hop else n_idle + 1
        if (any_hop and largest_hop < parameters.tolerance) or n_idle > n:
            break
    return best


@kernel
def search_pairs(origins, directions, parameters, first_number, points, costs):
    """Solve for two points of every keypoint pair, by the objective and the search of the specification.

    Args:
        origins: shape (view, 3): ray origins, mm.
        directions: shape (candidate, view, 2, 3), unit vectors of the rays of both labels, NaN where missing.
        parameters: a PopulationSearch.
        first_number: number of the first pair; each pair has its own random numbers.
        points: shape (candidate, 6), written, mm; NaN with fewer than four rays.
        costs: shape (candidate,), written: the objective at the points.
    """
    n_rays = 2 * origins.shape[0]
    rays = np.empty((n_rays, 6))
    valid = np.empty(n_rays, np.bool_)
    weights = np.empty(n_rays)
    distances = np.empty(n_rays)
    center = np.empty(3)
    n_agents = parameters.n_agents
    population = _Population(
        agents=np.empty((n_agents, _SIZE)),
        errors=np.empty(n_agents),
        moved=np.empty(n_agents, np.bool_),
        generator=np.empty(1, np.int64),
    )
    for n in range(directions.shape[0]):
        count = 0
        for r in range(n_rays):
            for axis in range(3):
                rays[r, axis] = origins[r // 2, axis]
                rays[r, 3 + axis] = directions[n, r // 2, r % 2, axis]
            valid[r] = math.isfinite(rays[r, 3] + rays[r, 4] + rays[r, 5])
            count += 1 if valid[r] else 0
        costs[n] = math.nan
        for k in range(_SIZE):
            points[n, k] = math.nan
        if count < 4:
            continue
        _seed_generator(population.generator, parameters.seed, first_number + n)
        _robust_center(rays, valid, weights, distances, center)
        best = _search(rays, valid, center, parameters, population)
        costs[n] = population.errors[best]
        for k in range(_SIZE):
            points[n, k] = population.agents[best, k]
