"""People from the detections of one frame: odds of every pair, and groups grown from the best pairs.

See docs/methods.md, "People from several views"; the odds are those of :mod:`posefuse.kernels.agreement`.
"""

import math

import numpy as np

from posefuse.kernels.agreement import (
    KNOWN,
    POINT,
    POINT_COLUMNS,
    bone_odds,
    join_odds,
    locate,
    look,
    pair_odds,
    within,
)
from posefuse.kernels.codes import NO_DETECTION
from posefuse.kernels.jit import inline, kernel, step
from posefuse.kernels.lens import OK, project_point, to_camera

_GROUP_ROUNDS = 3

# Columns of the numbers of a group.
ODDS = 0
PAIRS = 1
"""How many pairs of its members have positive odds."""
SEED_A = 2
SEED_B = 3
STATE = 4
GROUP_COLUMNS = 5

# A group grown from a pair is hardly more than so many times likelier, in log odds, than the pair with its support.
_FAR_LIKELIER = 2.0

# What becomes of a group.
_OPEN = 0.0
_TAKEN = 1.0
_GONE = 2.0


@kernel
def pair_evidence(
    rays,
    weights,
    mirror,
    view,
    bones,
    allowed,
    clutter_px,
    volume,
    min_common,
    outlier_share,
    independent,
    independent_bones,
    evidence,
    seed,
):
    """Log odds that detections of different views show one person, for all pairs.

    Args:
        rays: shape (detection, core, 12), from :func:`posefuse.kernels.agreement.observe`.
        weights: shape (detection, core).
        mirror: shape (core,), int64: each keypoint's partner.
        view: shape (detection,), int64, not decreasing.
        bones: shape (bone, 4): two core keypoints, shortest and longest distance in m.
        allowed: shape (detection, detection), bool, symmetric: which pairs may be.
        clutter_px: shape (view,): width of the region where anything else may lie.
        volume: shape (6,): low x y z, high x y z, where people can be.
        min_common: with fewer common keypoints nothing is said.
        outlier_share: how many keypoints are wrong in a detection of the right person.
        independent: at most so many keypoints count.
        independent_bones: at most so many bones count.
        evidence: shape (detection, detection), written: log odds of the rays; -inf for pairs that cannot be.
        seed: shape (detection, detection), written: the same with what the bones say.
    """
    n_detections, n_core = weights.shape
    points = np.empty((n_core, POINT_COLUMNS))
    members = np.empty(2, np.int64)
    swapped = np.zeros(2, np.bool_)
    for a in range(n_detections):
        evidence[a, a] = -math.inf
        seed[a, a] = -math.inf
        for b in range(a):
            odds = -math.inf
            bones_say = 0.0
            if view[a] != view[b] and allowed[a, b]:
                members[0] = b
                members[1] = a
                clutter_a = clutter_px[view[b]]
                clutter_b = clutter_px[view[a]]
                odds = pair_odds(
                    rays,
                    weights,
                    mirror,
                    members,
                    swapped,
                    clutter_a,
                    clutter_b,
                    min_common,
                    outlier_share,
                    independent,
                    points,
                )
                if odds > -math.inf and within(points, volume):
                    bones_say = bone_odds(points, bones, outlier_share, independent_bones)
                else:
                    odds = -math.inf
            evidence[a, b] = odds
            evidence[b, a] = odds
            seed[a, b] = odds + bones_say
            seed[b, a] = odds + bones_say


@kernel
def pair_bodies(rays, weights, pairs, bodies, errors_px):
    """Points of all keypoints of pairs of detections, and what each of the two is off by.

    Args:
        rays: shape (detection, keypoint, 12).
        weights: shape (detection, keypoint).
        pairs: shape (pair, 2), int64.
        bodies: shape (pair, keypoint, 3), written; NaN where missing.
        errors_px: shape (pair, keypoint, 2), written.
    """
    n_core = weights.shape[1]
    points = np.empty((n_core, POINT_COLUMNS))
    mirror = np.arange(n_core)
    swapped = np.zeros(2, np.bool_)
    members = np.empty(2, np.int64)
    for i in range(len(pairs)):
        members[0] = pairs[i, 0]
        members[1] = pairs[i, 1]
        locate(rays, weights, mirror, members, swapped, 2, _GROUP_ROUNDS, points)
        for k in range(n_core):
            known = points[k, KNOWN] > 0.0
            for j in range(3):
                bodies[i, k, j] = points[k, POINT + j] if known else math.nan
            for m in range(2):
                _, r, s = look(rays, members[m], k, points[k, POINT], points[k, POINT + 1], points[k, POINT + 2])
                errors_px[i, k, m] = math.sqrt(r * r + s * s) if known else math.nan


@kernel
def support(seed, evidence, view, n_views, supported):
    """How well the other views go with a pair: its odds, and in each other view the best that goes with both.

    Args:
        seed: shape (detection, detection), from :func:`pair_evidence`.
        evidence: shape (detection, detection).
        view: shape (detection,), int64.
        n_views: of the rig.
        supported: shape (detection, detection), written below the diagonal; -inf above and for pairs against the odds.
    """
    best = np.empty(n_views)
    for a in range(len(view)):
        for b in range(len(view)):
            supported[a, b] = -math.inf
            if b >= a or not seed[a, b] > 0.0:
                continue
            best[:] = 0.0
            for c in range(len(view)):
                both = min(evidence[a, c], evidence[b, c])
                best[view[c]] = max(best[view[c]], both)
            supported[a, b] = seed[a, b] + best.sum()


@kernel
def near_known(rays, weights, view, known_m, focal_px, within_m, core, near):
    """Which known people each detection shows.

    Args:
        rays: shape (detection, core, 12).
        weights: shape (detection, core).
        view: shape (detection,), int64.
        known_m: shape (person, keypoint, 3), NaN where missing.
        focal_px: shape (view,).
        within_m: a detection shows a person if its keypoints are on average no farther from theirs, at their depth.
        core: shape (core,), int64.
        near: shape (detection, person), bool, written.
    """
    for n in range(len(view)):
        for i in range(known_m.shape[0]):
            total = 0.0
            common = 0
            for j in range(len(core)):
                x = known_m[i, core[j], 0]
                y = known_m[i, core[j], 1]
                z = known_m[i, core[j], 2]
                if not (weights[n, j] > 0.0 and math.isfinite(x + y + z)):
                    continue
                depth = rays[n, j, 8] * x + rays[n, j, 9] * y + rays[n, j, 10] * z + rays[n, j, 11]
                r = rays[n, j, 0] * x + rays[n, j, 1] * y + rays[n, j, 2] * z + rays[n, j, 3]
                s = rays[n, j, 4] * x + rays[n, j, 5] * y + rays[n, j, 6] * z + rays[n, j, 7]
                off = math.sqrt(r * r + s * s) / focal_px[view[n]] if depth > 0.0 else math.inf
                total += min(off, 4.0 * within_m)
                common += 1
            near[n, i] = common > 0 and total <= within_m * common


@step
def _best_join(
    rays,
    weights,
    mirror,
    view,
    allowed,
    free,
    clutter_px,
    min_common,
    outlier_share,
    independent,
    join,
    swap,
    members,
    swapped,
    count,
    points,
):
    """The detection that most likely belongs to a group: ``(odds, detection, swapped)``; detection -1 if none does."""
    best = join
    found = -1
    best_swapped = False
    for n in range(len(view)):
        possible = free[n]
        for i in range(count):
            possible = possible and allowed[n, members[i]] and view[n] != view[members[i]]
        if not possible:
            continue
        clutter = clutter_px[view[n]]
        odds = join_odds(rays, weights, mirror, points, n, False, clutter, min_common, outlier_share, independent)
        sides = False
        if odds <= join and swap > -math.inf:
            other = swap + join_odds(
                rays, weights, mirror, points, n, True, clutter, min_common, outlier_share, independent
            )
            sides = other > odds
            odds = max(odds, other)
        if odds > best:
            best = odds
            found = n
            best_swapped = sides
    return best, found, best_swapped


@step
def _missed(cameras, sizes_px, boxes_px, box_view, view, members, count, points, miss):
    """Log odds of the views that should show a group and show nothing there.

    A view should if the middle of the points lies in its image; where any detection covers that place, the person may
    be hidden behind it.
    """
    known = 0
    x = 0.0
    y = 0.0
    z = 0.0
    for k in range(points.shape[0]):
        if points[k, KNOWN] > 0.0:
            known += 1
            x += points[k, POINT]
            y += points[k, POINT + 1]
            z += points[k, POINT + 2]
    total = 0.0
    for v in range(cameras.shape[0]):
        there = sizes_px[v, 0] == 0.0
        for i in range(count):
            there = there or view[members[i]] == v
        if there:
            continue
        x_c, y_c, z_c = to_camera(cameras, v, x / known, y / known, z / known)
        status, pixel_u, pixel_v = project_point(cameras, v, x_c, y_c, z_c)
        inside = status == OK and 0.0 <= pixel_u <= sizes_px[v, 0] and 0.0 <= pixel_v <= sizes_px[v, 1]
        hidden = False
        for n in range(len(box_view)):
            across = boxes_px[n, 0] <= pixel_u <= boxes_px[n, 2] and boxes_px[n, 1] <= pixel_v <= boxes_px[n, 3]
            hidden = hidden or (box_view[n] == v and across)
        total += miss if inside and not hidden else 0.0
    return total


@step
def _grow(
    cameras,
    sizes_px,
    boxes_px,
    box_view,
    rays,
    weights,
    mirror,
    view,
    bones,
    allowed,
    free,
    evidence,
    clutter_px,
    min_common,
    outlier_share,
    independent,
    independent_bones,
    join,
    swap,
    miss,
    members,
    swapped,
    points,
):
    """Grow the group whose first two members are given: ``(odds, members)``."""
    count = 2
    swapped[0] = False
    swapped[1] = False
    odds = evidence[members[0], members[1]]
    locate(rays, weights, mirror, members, swapped, count, _GROUP_ROUNDS, points)
    while count < len(members):
        more, n, sides = _best_join(
            rays,
            weights,
            mirror,
            view,
            allowed,
            free,
            clutter_px,
            min_common,
            outlier_share,
            independent,
            join,
            swap,
            members,
            swapped,
            count,
            points,
        )
        if n < 0:
            break
        odds += more
        members[count] = n
        swapped[count] = sides
        count += 1
        locate(rays, weights, mirror, members, swapped, count, _GROUP_ROUNDS, points)
    odds += bone_odds(points, bones, outlier_share, independent_bones)
    odds += _missed(cameras, sizes_px, boxes_px, box_view, view, members, count, points, miss)
    return odds, count


@inline
def _is_vain(groups, numbers, n_groups, view, a, b, supported):
    """Whether a pair need not be grown now: some group holds it, or one far likelier holds either of the two.

    If that other group is not to be had after all, the pair's turn comes again.
    """
    vain = False
    for g in range(n_groups):
        has_a = groups[g, view[a]] == a
        has_b = groups[g, view[b]] == b
        stands = numbers[g, STATE] != _GONE
        likelier = numbers[g, STATE] == _OPEN and numbers[g, ODDS] > _FAR_LIKELIER * supported
        vain = vain or (stands and has_a and has_b) or (likelier and (has_a or has_b))
    return vain


@inline
def _drop_losers(groups, numbers, n_groups, free):
    """Drop the open groups that want a detection which is no longer free: how many they are."""
    dropped = 0
    for g in range(n_groups):
        lost = False
        for v in range(groups.shape[1]):
            lost = lost or (groups[g, v] >= 0 and not free[groups[g, v]])
        if lost and numbers[g, STATE] == _OPEN:
            numbers[g, STATE] = _GONE
            dropped += 1
    return dropped


@inline
def _take_best(groups, numbers, n_groups, prior, free):
    """Let the likeliest open group have its detections: its number, -1 if none has the odds for it."""
    best = -1
    for g in range(n_groups):
        likely = numbers[g, STATE] == _OPEN and numbers[g, ODDS] + prior > 0.0
        if likely and (best < 0 or numbers[g, ODDS] > numbers[best, ODDS]):
            best = g
    if best >= 0:
        numbers[best, STATE] = _TAKEN
        for v in range(groups.shape[1]):
            if groups[best, v] >= 0:
                free[groups[best, v]] = False
    return best


@step
def _repeats(keypoints_px, weights, core, chosen, n, m, near):
    """Whether two detections of a view lie so near each other that they are of one person."""
    total = 0.0
    common = 0
    for j in range(len(core)):
        w = weights[n, j]
        u = weights[m, j]
        if w > 0.0 and u > 0.0:
            du = keypoints_px[chosen[n], core[j], 0] - keypoints_px[chosen[m], core[j], 0]
            dv = keypoints_px[chosen[n], core[j], 1] - keypoints_px[chosen[m], core[j], 1]
            total += min(0.5 * (du * du + dv * dv) / (1.0 / w + 1.0 / u), 4.0 * near * near)
            common += 1
    return common > 0 and total <= near * near * common


@step
def _repeated_group(keypoints_px, weights, core, chosen, groups, numbers, n_groups, g, near):
    """The group already taken that ``g`` repeats in every view the two share; -1 if none."""
    for h in range(n_groups):
        if numbers[h, STATE] != _TAKEN or h == g:
            continue
        shared = 0
        repeated = 0
        for v in range(groups.shape[1]):
            if groups[g, v] >= 0 and groups[h, v] >= 0:
                shared += 1
                same = _repeats(keypoints_px, weights, core, chosen, groups[g, v], groups[h, v], near)
                repeated += 1 if same else 0
        if shared > 0 and repeated == shared:
            return h
    return -1


@kernel
def group(
    cameras,
    sizes_px,
    boxes_px,
    box_view,
    keypoints_px,
    chosen,
    core,
    rays,
    weights,
    mirror,
    view,
    bones,
    allowed,
    evidence,
    seeds,
    clutter_px,
    min_common,
    outlier_share,
    independent,
    independent_bones,
    join,
    swap,
    miss,
    prior,
    near,
    max_seeds,
    groups,
    sides,
    numbers,
    duplicate_of,
):
    """Groups of detections, at most one a view, each detection in at most one of them.

    Pairs grow, the best supported first, by the detection that most likely belongs to them, until none does. Of the
    groups that want the same detection the likeliest gets it; the others are grown anew without it.

    Args:
        cameras: the camera array.
        sizes_px: shape (view, 2): of the images; 0 where the view has no frame.
        boxes_px: shape (row, 4): least u, v, greatest u, v of every detection of the frame, claimed or not.
        box_view: shape (row,), int64.
        keypoints_px: shape (row, keypoint, 2).
        chosen: shape (detection,), int64: rows of the detections that are free.
        core: shape (core,), int64.
        rays: shape (detection, core, 12).
        weights: shape (detection, core).
        mirror: shape (core,), int64.
        view: shape (detection,), int64.
        bones: shape (bone, 4).
        allowed: shape (detection, detection), bool.
        evidence: shape (detection, detection), from :func:`pair_evidence`.
        seeds: shape (seed, 3): pairs and their support, best first.
        clutter_px: shape (view,).
        min_common: of core keypoints.
        outlier_share: how many keypoints are wrong in a detection of the right person.
        independent: at most so many keypoints count.
        independent_bones: at most so many bones count.
        join: log odds from which on a detection joins.
        swap: log odds that a detection has its sides swapped; -inf if none has.
        miss: log odds of a view that should show the person and does not.
        prior: log odds of a group before anything is known.
        near: detections of a view are of one person if so many sigmas apart.
        max_seeds: at most so many pairs are grown at a time.
        groups: shape (group, view), int64, written: detections, or NO_DETECTION; as many groups as there is room for.
        sides: shape (group, view), bool, written: whose left and right are swapped.
        numbers: shape (group, GROUP_COLUMNS), written.
        duplicate_of: shape (detection,), int64, written: the group whose member a detection repeats, -1 if none.

    Returns:
        How many groups were written; those with positive odds have a 1 in the column ``STATE``.
    """
    n_views = cameras.shape[0]
    free = np.ones(len(view), np.bool_)
    members = np.empty(n_views, np.int64)
    swapped = np.empty(n_views, np.bool_)
    points = np.empty((len(core), POINT_COLUMNS))
    duplicate_of[:] = -1
    n_groups = 0
    for _ in range(len(view)):
        grown = 0
        for i in range(len(seeds)):
            a, b = int(seeds[i, 0]), int(seeds[i, 1])
            full = n_groups == len(groups) or grown == max_seeds
            if full or not (free[a] and free[b]) or _is_vain(groups, numbers, n_groups, view, a, b, seeds[i, 2]):
                continue
            members[0] = a
            members[1] = b
            odds, count = _grow(
                cameras,
                sizes_px,
                boxes_px,
                box_view,
                rays,
                weights,
                mirror,
                view,
                bones,
                allowed,
                free,
                evidence,
                clutter_px,
                min_common,
                outlier_share,
                independent,
                independent_bones,
                join,
                swap,
                miss,
                members,
                swapped,
                points,
            )
            groups[n_groups] = NO_DETECTION
            sides[n_groups] = False
            pairs = 0
            for m in range(count):
                groups[n_groups, view[members[m]]] = members[m]
                sides[n_groups, view[members[m]]] = swapped[m]
                for o in range(m):
                    pairs += 1 if evidence[members[m], members[o]] > 0.0 else 0
            numbers[n_groups, ODDS] = odds
            numbers[n_groups, PAIRS] = pairs
            numbers[n_groups, SEED_A] = a
            numbers[n_groups, SEED_B] = b
            numbers[n_groups, STATE] = _OPEN
            n_groups += 1
            grown += 1
        taken = 0
        lost = 0
        # Once a group has lost a detection it is to be grown anew before any other is taken: it may still be better.
        while lost == 0:
            best = _take_best(groups, numbers, n_groups, prior, free)
            if best < 0:
                break
            taken += 1
            again = _repeated_group(keypoints_px, weights, core, chosen, groups, numbers, n_groups, best, near)
            if again >= 0:
                numbers[best, STATE] = _GONE
                for v in range(n_views):
                    if groups[best, v] >= 0:
                        duplicate_of[groups[best, v]] = again
            lost = _drop_losers(groups, numbers, n_groups, free)
        if taken == 0:
            break
    for n in range(len(view)):
        for g in range(n_groups):
            m = groups[g, view[n]]
            if free[n] and numbers[g, STATE] == _TAKEN and m >= 0:
                if _repeats(keypoints_px, weights, core, chosen, n, m, near):
                    duplicate_of[n] = g
    return n_groups
