"""People from the detections of one frame: odds of every pair, and groups grown from the best pairs.

See docs/methods.md, "People from several views"; the odds are those of :mod:`posefuse.kernels.association.agreement`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.association.agreement import (
    KNOWN,
    POINT,
    POINT_COLUMNS,
    bone_odds,
    join_odds,
    locate,
    look,
    middle,
    pair_odds,
    within,
)
from posefuse.kernels.cameras.lens import OK, project_point, to_camera
from posefuse.kernels.jit import inline, kernel, step
from posefuse.kernels.status_codes import NO_DETECTION

_GROUP_ROUNDS = 3

# Columns of the numbers of a group.
ODDS = 0
PAIRS = 1
"""How many pairs of its members have positive odds."""
STATE = 2
GROUP_COLUMNS = 3

# A group grown from a pair is hardly more than so many times likelier, in log odds, than the pair with its support.
_FAR_LIKELIER = 2.0

# What becomes of a group.
_OPEN = 0.0
TAKEN = 1.0
_GONE = 2.0


class Surroundings(NamedTuple):
    """What else there is in a frame.

    Attributes:
        cameras: the camera array, shape (view, COLUMNS).
        sizes_px: shape (view, 2): of the images; 0 where the view has no frame.
        boxes_px: shape (row, 4): least u, v, greatest u, v of every detection of the frame, claimed or not.
        box_view: shape (row,), int64.
    """

    cameras: Any
    sizes_px: Any
    boxes_px: Any
    box_view: Any


class Drafts(NamedTuple):
    """Groups, as many as there is room for.

    Attributes:
        groups: shape (group, view), int64: detections, or NO_DETECTION.
        sides: shape (group, view), bool: whose left and right are swapped.
        numbers: shape (group, GROUP_COLUMNS).
        duplicate_of: shape (detection,), int64: the group whose member a detection repeats, -1 if none.
    """

    groups: Any
    sides: Any
    numbers: Any
    duplicate_of: Any


class _Growing(NamedTuple):
    """The group being grown: its members in the order they came, whose sides are swapped, and its points."""

    members: Any
    swapped: Any
    points: Any


@kernel
def pair_evidence(sight, law, volume, evidence, seed):
    """Log odds that detections of different views show one person, for all pairs.

    Args:
        sight: of the frame.
        law: of odds.
        volume: shape (6,): low x y z, high x y z, where people can be.
        evidence: shape (detection, detection), written: log odds of the rays; -inf for pairs that cannot be.
        seed: shape (detection, detection), written: the same with what the bones say.
    """
    n_detections, n_core = sight.weights.shape
    points = np.empty((n_core, POINT_COLUMNS))
    members = np.empty(2, np.int64)
    swapped = np.zeros(2, np.bool_)
    for a in range(n_detections):
        evidence[a, a] = -math.inf
        seed[a, a] = -math.inf
        for b in range(a):
            odds = -math.inf
            bones_say = 0.0
            if sight.views[a] != sight.views[b] and sight.allowed[a, b]:
                members[0] = b
                members[1] = a
                odds = pair_odds(sight, law, members, swapped, points)
                if odds > -math.inf and within(points, volume):
                    bones_say = bone_odds(sight, law, points)
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
def _best_join(sight, law, free, growing, count):
    """The detection that most likely belongs to a group: ``(odds, detection, swapped)``; detection -1 if none does."""
    best = law.join
    found = -1
    best_swapped = False
    for n in range(len(sight.views)):
        possible = free[n]
        for i in range(count):
            m = growing.members[i]
            possible = possible and sight.allowed[n, m] and sight.views[n] != sight.views[m]
        if not possible:
            continue
        odds = join_odds(sight, law, growing.points, n, False)
        sides = False
        # Of detections that fit as they are only the best so far are asked whether they fit better the other way.
        if odds <= law.join or odds > best:
            other = law.swap + join_odds(sight, law, growing.points, n, True)
            sides = other > odds
            odds = max(odds, other)
        if odds > best:
            best = odds
            found = n
            best_swapped = sides
    return best, found, best_swapped


@step
def _missed(sight, law, around, growing, count):
    """Log odds of the views that should show a group and show nothing there.

    A view should if the middle of the points lies in its image; where any detection covers that place, the person may
    be hidden behind it.
    """
    _, x, y, z = middle(growing.points)
    total = 0.0
    for v in range(around.cameras.shape[0]):
        there = around.sizes_px[v, 0] == 0.0
        for i in range(count):
            there = there or sight.views[growing.members[i]] == v
        if there:
            continue
        x_c, y_c, z_c = to_camera(around.cameras, v, x, y, z)
        status, pixel_u, pixel_v = project_point(around.cameras, v, x_c, y_c, z_c)
        inside = status == OK and 0.0 <= pixel_u <= around.sizes_px[v, 0] and 0.0 <= pixel_v <= around.sizes_px[v, 1]
        total += law.miss if inside and not _covered(around, v, pixel_u, pixel_v) else 0.0
    return total


@inline
def _covered(around, v, pixel_u, pixel_v):
    """Whether a detection of view ``v`` covers a pixel."""
    covered = False
    boxes = around.boxes_px
    for n in range(len(around.box_view)):
        across = boxes[n, 0] <= pixel_u <= boxes[n, 2] and boxes[n, 1] <= pixel_v <= boxes[n, 3]
        covered = covered or (around.box_view[n] == v and across)
    return covered


@step
def _grow(sight, law, around, evidence, free, growing):
    """Grow the group whose first two members are given: ``(odds, members)``."""
    members, swapped, points = growing
    count = 2
    swapped[0] = False
    swapped[1] = False
    odds = evidence[members[0], members[1]]
    locate(sight.rays, sight.weights, sight.mirror, members, swapped, count, _GROUP_ROUNDS, points)
    while count < len(members):
        more, n, sides = _best_join(sight, law, free, growing, count)
        if n < 0:
            break
        odds += more
        members[count] = n
        swapped[count] = sides
        count += 1
        locate(sight.rays, sight.weights, sight.mirror, members, swapped, count, _GROUP_ROUNDS, points)
    return odds + bone_odds(sight, law, points) + _missed(sight, law, around, growing, count), count


@step
def _store(sight, evidence, growing, count, odds, drafts, g):
    """Write down a grown group."""
    for v in range(drafts.groups.shape[1]):
        drafts.groups[g, v] = NO_DETECTION
        drafts.sides[g, v] = False
    pairs = 0
    for m in range(count):
        n = growing.members[m]
        drafts.groups[g, sight.views[n]] = n
        drafts.sides[g, sight.views[n]] = growing.swapped[m]
        for o in range(m):
            pairs += 1 if evidence[n, growing.members[o]] > 0.0 else 0
    drafts.numbers[g, ODDS] = odds
    drafts.numbers[g, PAIRS] = pairs
    drafts.numbers[g, STATE] = _OPEN


@inline
def _is_vain(drafts, n_groups, view, a, b, supported):
    """Whether a pair need not be grown now: some group holds it, or one far likelier holds either of the two.

    If that other group is not to be had after all, the pair's turn comes again.
    """
    groups, numbers = drafts.groups, drafts.numbers
    vain = False
    for g in range(n_groups):
        has_a = groups[g, view[a]] == a
        has_b = groups[g, view[b]] == b
        stands = numbers[g, STATE] != _GONE
        likelier = numbers[g, STATE] == _OPEN and numbers[g, ODDS] > _FAR_LIKELIER * supported
        vain = vain or (stands and has_a and has_b) or (likelier and (has_a or has_b))
    return vain


@step
def _grow_seeds(sight, law, around, evidence, seeds, free, growing, drafts, n_groups):
    """Grow every pair worth it whose detections are free: the number of groups there are then."""
    grown = 0
    for i in range(len(seeds)):
        a = int(seeds[i, 0])
        b = int(seeds[i, 1])
        full = n_groups == len(drafts.groups) or grown == law.max_seeds
        if full or not (free[a] and free[b]) or _is_vain(drafts, n_groups, sight.views, a, b, seeds[i, 2]):
            continue
        growing.members[0] = a
        growing.members[1] = b
        odds, count = _grow(sight, law, around, evidence, free, growing)
        _store(sight, evidence, growing, count, odds, drafts, n_groups)
        n_groups += 1
        grown += 1
    return n_groups


@inline
def _drop_losers(drafts, n_groups, free):
    """Drop the open groups that want a detection which is no longer free: how many they are."""
    groups, numbers = drafts.groups, drafts.numbers
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
def _take_best(law, drafts, n_groups, free):
    """Let the likeliest open group have its detections: its number, -1 if none has the odds for it."""
    groups, numbers = drafts.groups, drafts.numbers
    best = -1
    for g in range(n_groups):
        likely = numbers[g, STATE] == _OPEN and numbers[g, ODDS] + law.prior > 0.0
        if likely and (best < 0 or numbers[g, ODDS] > numbers[best, ODDS]):
            best = g
    if best >= 0:
        numbers[best, STATE] = TAKEN
        for v in range(groups.shape[1]):
            if groups[best, v] >= 0:
                free[groups[best, v]] = False
    return best


@step
def _repeats(sight, law, pixels, n, m):
    """Whether two detections of a view lie so near each other that they are of one person."""
    total = 0.0
    common = 0
    near_squared = law.near * law.near
    for k in range(pixels.shape[1]):
        w = sight.weights[n, k]
        u = sight.weights[m, k]
        if w > 0.0 and u > 0.0:
            du = pixels[n, k, 0] - pixels[m, k, 0]
            dv = pixels[n, k, 1] - pixels[m, k, 1]
            total += min(0.5 * (du * du + dv * dv) / (1.0 / w + 1.0 / u), 4.0 * near_squared)
            common += 1
    return common > 0 and total <= near_squared * common


@step
def _repeated_group(sight, law, pixels, drafts, n_groups, g):
    """The group already taken that ``g`` repeats in every view the two share; -1 if none."""
    groups = drafts.groups
    for h in range(n_groups):
        if drafts.numbers[h, STATE] != TAKEN or h == g:
            continue
        shared = 0
        repeated = 0
        for v in range(groups.shape[1]):
            if groups[g, v] >= 0 and groups[h, v] >= 0:
                shared += 1
                repeated += 1 if _repeats(sight, law, pixels, groups[g, v], groups[h, v]) else 0
        if shared > 0 and repeated == shared:
            return h
    return -1


@step
def _take(sight, law, pixels, free, drafts, n_groups):
    """Let groups have their detections, the likeliest first, until one loses by it: how many had.

    That one is to be grown anew before any other is taken, for it may still be better.
    """
    taken = 0
    lost = 0
    while lost == 0:
        best = _take_best(law, drafts, n_groups, free)
        if best < 0:
            break
        taken += 1
        again = _repeated_group(sight, law, pixels, drafts, n_groups, best)
        if again >= 0:
            drafts.numbers[best, STATE] = _GONE
            for v in range(drafts.groups.shape[1]):
                if drafts.groups[best, v] >= 0:
                    drafts.duplicate_of[drafts.groups[best, v]] = again
        lost = _drop_losers(drafts, n_groups, free)
    return taken


@step
def _mark_duplicates(sight, law, pixels, free, drafts, n_groups):
    """Detections left over that repeat a group's member in its own view."""
    for n in range(len(sight.views)):
        for g in range(n_groups):
            m = drafts.groups[g, sight.views[n]]
            known = free[n] and m >= 0 and drafts.numbers[g, STATE] == TAKEN
            if known and _repeats(sight, law, pixels, n, m):
                drafts.duplicate_of[n] = g


@kernel
def group(sight, law, around, pixels, evidence, seeds, drafts):
    """Groups of detections, at most one a view, each detection in at most one of them.

    Pairs grow, the best supported first, by the detection that most likely belongs to them, until none does. Of the
    groups that want the same detection the likeliest gets it; the others are grown anew without it. A group that
    repeats, view by view, one already taken is not another person.

    Args:
        sight: of the frame.
        law: of odds.
        around: what else there is.
        pixels: shape (detection, core, 2): of the core keypoints.
        evidence: shape (detection, detection), from :func:`pair_evidence`.
        seeds: shape (seed, 3): pairs and their support, best first.
        drafts: written; groups that have their detections are in the state ``TAKEN``.

    Returns:
        How many groups were written.
    """
    n_views = around.cameras.shape[0]
    free = np.ones(len(sight.views), np.bool_)
    points = np.empty((pixels.shape[1], POINT_COLUMNS))
    growing = _Growing(np.empty(n_views, np.int64), np.empty(n_views, np.bool_), points)
    drafts.duplicate_of[:] = -1
    n_groups = 0
    for _ in range(len(sight.views)):
        n_groups = _grow_seeds(sight, law, around, evidence, seeds, free, growing, drafts, n_groups)
        if _take(sight, law, pixels, free, drafts, n_groups) == 0:
            break
    _mark_duplicates(sight, law, pixels, free, drafts, n_groups)
    return n_groups
