"""Two points apart around the middle of all rays, by a small population search: the specification's own method.

Source: the specification "Sparse Pose Fusion", two-point solve, and its authors' search (called stochastic diffusion
there): agents hop past better ones by as much as they differ from them, which shrinks the population onto a minimum.
Where program and specification differ, this does what the specification says: the centre is robust, a view's two rays
serve different points in the better way, and no agent is lost to a number that is not defined. Lengths in mm.
"""

import math

import numpy as np

from posefuse.kernels.cameras.points import solve_symmetric
from posefuse.kernels.cameras.rays import point_ray_distance
from posefuse.kernels.jit import inline, kernel, step

# Park and Miller's generator: products stay below 2^47.
_MODULUS = 2147483647
_FACTOR = 48271
_STIRS = 8
_CENTRE_ROUNDS = 15
_CENTRE_SCALE = 2.0
# The state: x, y, z of both points.
_SIZE = 6


@inline
def _draw(random):
    """The next number from 0 to below 1; ``random`` holds the generator's state."""
    random[0] = random[0] * _FACTOR % _MODULUS
    return (random[0] - 1) / (_MODULUS - 1.0)


@inline
def _start_draws(random, seed, number):
    """Begin the draws of a couple, so that they do not depend on which others are solved."""
    random[0] = 1 + (seed * 7919 + 104729) % (_MODULUS - 1)
    for _ in range(_STIRS):
        _draw(random)
    random[0] = 1 + (random[0] + number) % (_MODULUS - 1)
    for _ in range(_STIRS):
        _draw(random)


@inline
def _normal(random):
    """A number of the normal law (Box and Muller's)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - _draw(random)))
    return radius * math.cos(2.0 * math.pi * _draw(random))


@inline
def _distance(rays, r, x, y, z):
    distance, _ = point_ray_distance(x, y, z, rays[r, 0], rays[r, 1], rays[r, 2], rays[r, 3], rays[r, 4], rays[r, 5])
    return distance


@step
def _centre(rays, there, weights, sorted_distances, centre):
    """Where all rays come closest, those far off by their kind counting less (Cauchy's weights).

    Args:
        rays: shape (2 view, 6), origins and unit directions.
        there: shape (2 view,), bool.
        weights, sorted_distances: shape (2 view,), scratch.
        centre: shape (3,), written.
    """
    for r in range(rays.shape[0]):
        weights[r] = 1.0 if there[r] else 0.0
    for _ in range(_CENTRE_ROUNDS):
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
        _, centre[0], centre[1], centre[2] = solve_symmetric(xx, xy, xz, yy, yz, zz, bx, by, bz)
        count = 0
        for r in range(rays.shape[0]):
            if there[r]:
                distance = _distance(rays, r, centre[0], centre[1], centre[2])
                place = count
                while place > 0 and sorted_distances[place - 1] > distance:
                    sorted_distances[place] = sorted_distances[place - 1]
                    place -= 1
                sorted_distances[place] = distance
                count += 1
        scale = max(_CENTRE_SCALE * sorted_distances[count // 2], 1e-9)
        for r in range(rays.shape[0]):
            if there[r]:
                u = _distance(rays, r, centre[0], centre[1], centre[2]) / scale
                weights[r] = 1.0 / (1.0 + u * u)


@step
def pair_error(rays, there, centre, agent, terms, separation):
    """The specification's objective.

    Args:
        rays: shape (2 view, 6), origins and unit directions; the two rays of a view side by side.
        there: shape (2 view,), bool.
        centre: shape (3,), of all rays.
        agent: shape (6,), two points.
        terms: shape (4,): weights of e0 to e3.
        separation: from so far apart on the points need not keep apart.
    """
    x0, y0, z0, x1, y1, z1 = agent[0], agent[1], agent[2], agent[3], agent[4], agent[5]
    between = math.sqrt((x0 - x1) ** 2 + (y0 - y1) ** 2 + (z0 - z1) ** 2)
    keep_apart = max(0.0, -math.log(max(between, 1e-300) / separation))
    to_rays = 0.0
    for v in range(rays.shape[0] // 2):
        a = 2 * v
        b = a + 1
        if there[a] and there[b]:
            straight = _distance(rays, a, x0, y0, z0) + _distance(rays, b, x1, y1, z1)
            crossed = _distance(rays, b, x0, y0, z0) + _distance(rays, a, x1, y1, z1)
            to_rays += min(straight, crossed)
        elif there[a] or there[b]:
            only = a if there[a] else b
            to_rays += min(_distance(rays, only, x0, y0, z0), _distance(rays, only, x1, y1, z1))
    ax, ay, az = centre[0] - x0, centre[1] - y0, centre[2] - z0
    bx, by, bz = x1 - centre[0], y1 - centre[1], z1 - centre[2]
    to_first = math.sqrt(ax * ax + ay * ay + az * az)
    to_second = math.sqrt(bx * bx + by * by + bz * bz)
    product = to_first * to_second
    # At the centre there is no direction: neither on the same side nor opposite.
    opposite = 1.0 - (ax * bx + ay * by + az * bz) / product if product > 0.0 else 1.0
    error = terms[0] * keep_apart + terms[1] * to_rays
    return error + terms[2] * abs(to_first - to_second) + terms[3] * opposite


@step
def _hop(agents, errors, moved, best, random):
    """One round: agents that meet a better one hop past it; the largest hop, over the axes, in quadrature."""
    n = agents.shape[0]
    total = 0.0
    ranges = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    r0, r1, r2, r3, r4, r5 = ranges
    for i in range(n):
        if i == best:
            continue
        other = min(int(_draw(random) * n), n - 1)
        if moved[other] or not errors[other] < errors[i]:
            continue
        for k in range(_SIZE):
            away = abs(agents[i, k] - agents[other, k])
            agents[i, k] = agents[other, k] + (2.0 * _draw(random) - 1.0) * away
            r0 = max(r0, away) if k == 0 else r0
            r1 = max(r1, away) if k == 1 else r1
            r2 = max(r2, away) if k == 2 else r2
            r3 = max(r3, away) if k == 3 else r3
            r4 = max(r4, away) if k == 4 else r4
            r5 = max(r5, away) if k == 5 else r5
        moved[i] = True
    total = r0 * r0 + r1 * r1 + r2 * r2 + r3 * r3 + r4 * r4 + r5 * r5
    return math.sqrt(total)


@step
def _search(rays, there, centre, terms, separation, jitter, tolerance, rounds, agents, errors, moved, random):
    """Shrink the population onto a minimum; which agent is the best, its error left in ``errors``."""
    n = agents.shape[0]
    for i in range(n):
        for k in range(_SIZE):
            agents[i, k] = centre[k % 3] + (jitter * _normal(random) if i > 0 else 0.0)
        moved[i] = True
    best = 0
    idle = 0
    for _ in range(rounds):
        for i in range(n):
            if moved[i]:
                errors[i] = pair_error(rays, there, centre, agents[i], terms, separation)
            moved[i] = False
        for i in range(n):
            best = i if errors[i] < errors[best] else best
        reach = _hop(agents, errors, moved, best, random)
        hopped = False
        for i in range(n):
            hopped = hopped or moved[i]
        # A round in which nobody met a better one says nothing about the size of the population.
        idle = 0 if hopped else idle + 1
        if (hopped and reach < tolerance) or idle > n:
            break
    return best


@kernel
def search_pairs(
    origins, directions, terms, separation, jitter, tolerance, rounds, n_agents, seed, first_number, points, costs
):
    """Two points of every couple of keypoints, by the specification's objective and search.

    Args:
        origins: shape (view, 3), where rays begin, mm.
        directions: shape (couple, view, 2, 3), unit vectors of the rays of both labels, NaN where there is none.
        terms: shape (4,): weights of the objective's terms e0 to e3.
        separation: from so far apart (mm) on the points need not keep apart.
        jitter: standard deviation of the population at the start, mm.
        tolerance: the search ends when the population's last hops were within this, mm.
        rounds: or after so many rounds.
        n_agents: the size of the population.
        seed: of the draws.
        first_number: number of the first couple; each has draws of its own.
        points: shape (couple, 6), written, mm; NaN with fewer than four rays.
        costs: shape (couple,), written: the objective there.
    """
    n_rays = 2 * origins.shape[0]
    rays = np.empty((n_rays, 6))
    there = np.empty(n_rays, np.bool_)
    weights = np.empty(n_rays)
    distances = np.empty(n_rays)
    centre = np.empty(3)
    agents = np.empty((n_agents, _SIZE))
    errors = np.empty(n_agents)
    moved = np.empty(n_agents, np.bool_)
    random = np.empty(1, np.int64)
    for n in range(directions.shape[0]):
        count = 0
        for r in range(n_rays):
            for axis in range(3):
                rays[r, axis] = origins[r // 2, axis]
                rays[r, 3 + axis] = directions[n, r // 2, r % 2, axis]
            there[r] = math.isfinite(rays[r, 3] + rays[r, 4] + rays[r, 5])
            count += 1 if there[r] else 0
        costs[n] = math.nan
        for k in range(_SIZE):
            points[n, k] = math.nan
        if count < 4:
            continue
        _start_draws(random, seed, first_number + n)
        _centre(rays, there, weights, distances, centre)
        best = _search(rays, there, centre, terms, separation, jitter, tolerance, rounds, agents, errors, moved, random)
        costs[n] = errors[best]
        for k in range(_SIZE):
            points[n, k] = agents[best, k]
