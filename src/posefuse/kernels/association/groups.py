"""People from the detections of one frame: groups grown from the best pairs.

See docs/methods/association.md. The log odds are those of
:mod:`posefuse.kernels.association.log_odds`.
"""

from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.association.group_points import (
    GROUP_ITERATIONS,
    POINT_COLUMNS,
    GroupMembers,
    centroid,
    triangulate_group,
)
from posefuse.kernels.association.log_odds import (
    JoinTerms,
    arrange_detections,
    arrange_points,
    bone_log_odds,
    join_log_odds,
)
from posefuse.kernels.cameras.lens import OK, project_point, to_camera
from posefuse.kernels.jit import inline, kernel, subroutine
from posefuse.kernels.status_codes import NO_DETECTION

# Columns of the numbers of a group.
ODDS = 0
"""Column: log odds of the group."""


N_PAIRS = 1
"""Column: number of pairs of members with positive log odds."""


STATE = 2
"""Column: open, accepted or discarded."""


GROUP_COLUMNS = 3


# The log odds of a group rarely exceed the support score of its seed pair by more than this factor.
_MUCH_LIKELIER = 2.0


# States of a group.
_OPEN = 0.0


ACCEPTED = 1.0


_DISCARDED = 2.0


class FrameContext(NamedTuple):
    """Context of a frame: cameras, image sizes and boxes of all detections.

    Attributes:
        cameras: the camera array, shape (view, COLUMNS).
        sizes_px: shape (view, 2): image sizes; 0 if the view did not record the frame.
        boxes_px: shape (row, 4): least u, v and greatest u, v of every detection of the frame, assigned or not.
        box_starts: shape (view + 1,), int64: first box of each view, and the number of boxes.
    """

    cameras: Any
    sizes_px: Any
    boxes_px: Any
    box_starts: Any


class GroupTable(NamedTuple):
    """Groups of detections, preallocated.

    Attributes:
        members: shape (group, view), int64: detection of each view, or NO_DETECTION.
        swapped: shape (group, view), bool: whether left and right are swapped.
        statistics: shape (group, GROUP_COLUMNS).
        duplicate_of: shape (detection,), int64: the group with a member that a detection repeats, -1 if none.
    """

    members: Any
    swapped: Any
    statistics: Any
    duplicate_of: Any


class _GrowingGroup(NamedTuple):
    """The group that is being grown.

    Attributes:
        unassigned: shape (detection,), bool: detections that no accepted group has.
        members: shape (view,), int64: its members in the order of joining.
        swapped: shape (view,), bool: whether left and right are swapped in each member.
        points: shape (core, POINT_COLUMNS).
        terms: JoinTerms.
    """

    unassigned: Any
    members: Any
    swapped: Any
    points: Any
    terms: Any


@subroutine
def _best_candidate(candidates, parameters, growth, count):
    """Return ``(log odds, detection, swapped)`` of the best candidate for a group; detection -1 if there is none."""
    best = parameters.join
    found = -1
    best_swapped = False
    for n in range(len(candidates.views)):
        possible = growth.unassigned[n]
        for i in range(count):
            m = growth.members[i]
            possible = possible and candidates.allowed[n, m] and candidates.views[n] != candidates.views[m]
        if not possible:
            continue
        odds = join_log_odds(candidates, parameters, growth.terms, n, False)
        is_swapped = False
        # Test swapped labels only if the detection does not fit as labeled, or is the best candidate so far.
        if odds <= parameters.join or odds > best:
            other = parameters.swap + join_log_odds(candidates, parameters, growth.terms, n, True)
            is_swapped = other > odds
            odds = max(odds, other)
        if odds > best:
            best = odds
            found = n
            best_swapped = is_swapped
    return best, found, best_swapped


@subroutine
def _miss_log_odds(candidates, parameters, context, growth, count):
    """Return the log odds of the views that should show a group and have no detection of it.

    A view should show the group if the mean of its points projects into the image. If another detection covers that
    pixel, the person may be hidden and the view is not counted.
    """
    _, x, y, z = centroid(growth.points)
    total = 0.0
    for v in range(context.cameras.shape[0]):
        irrelevant = context.sizes_px[v, 0] == 0.0
        for i in range(count):
            irrelevant = irrelevant or candidates.views[growth.members[i]] == v
        if irrelevant:
            continue
        x_c, y_c, z_c = to_camera(context.cameras, v, x, y, z)
        status, pixel_u, pixel_v = project_point(context.cameras, v, x_c, y_c, z_c)
        inside = status == OK and 0.0 <= pixel_u <= context.sizes_px[v, 0] and 0.0 <= pixel_v <= context.sizes_px[v, 1]
        total += parameters.miss if inside and not _is_covered(context, v, pixel_u, pixel_v) else 0.0
    return total


@inline
def _is_covered(context, v, pixel_u, pixel_v):
    """Return whether a detection of view ``v`` covers a pixel."""
    covered = False
    boxes = context.boxes_px
    for n in range(context.box_starts[v], context.box_starts[v + 1]):
        covered = covered or (boxes[n, 0] <= pixel_u <= boxes[n, 2] and boxes[n, 1] <= pixel_v <= boxes[n, 3])
    return covered


@subroutine
def _grow_group(candidates, parameters, context, pair_scores, growth):
    """Grow the group whose first two members are set; return its log odds and number of members."""
    members, swapped, points = growth.members, growth.swapped, growth.points
    count = 2
    swapped[0] = False
    swapped[1] = False
    odds = pair_scores[members[0], members[1]]
    group = GroupMembers(candidates.rays, candidates.weights, candidates.mirror, members, swapped)
    triangulate_group(group, count, GROUP_ITERATIONS, points)
    while count < len(members):
        arrange_points(points, growth.terms)
        gain, n, is_swapped = _best_candidate(candidates, parameters, growth, count)
        if n < 0:
            break
        odds += gain
        members[count] = n
        swapped[count] = is_swapped
        count += 1
        triangulate_group(group, count, GROUP_ITERATIONS, points)
    return odds + bone_log_odds(candidates, parameters, points) + _miss_log_odds(
        candidates, parameters, context, growth, count
    ), count


@subroutine
def _store_group(candidates, pair_scores, growth, count, odds, table, g):
    """Store a grown group in row ``g`` of the table."""
    for v in range(table.members.shape[1]):
        table.members[g, v] = NO_DETECTION
        table.swapped[g, v] = False
    pairs = 0
    for m in range(count):
        n = growth.members[m]
        table.members[g, candidates.views[n]] = n
        table.swapped[g, candidates.views[n]] = growth.swapped[m]
        for o in range(m):
            pairs += 1 if pair_scores[n, growth.members[o]] > 0.0 else 0
    table.statistics[g, ODDS] = odds
    table.statistics[g, N_PAIRS] = pairs
    table.statistics[g, STATE] = _OPEN


@inline
def _is_redundant(table, n_groups, view, a, b, support_scores):
    """Return whether a pair can be skipped: a group contains it, or a much likelier open group contains one of the two.

    If that likelier group is discarded later, the pair is considered again.
    """
    members, statistics = table.members, table.statistics
    redundant = False
    for g in range(n_groups):
        has_a = members[g, view[a]] == a
        has_b = members[g, view[b]] == b
        kept = statistics[g, STATE] != _DISCARDED
        likelier = statistics[g, STATE] == _OPEN and statistics[g, ODDS] > _MUCH_LIKELIER * support_scores
        redundant = redundant or (kept and has_a and has_b) or (likelier and (has_a or has_b))
    return redundant


@subroutine
def _grow_pairs(candidates, parameters, context, pair_scores, seeds, growth, table, n_groups):
    """Grow every non-redundant pair of unassigned detections; return the new number of groups."""
    unassigned = growth.unassigned
    n_grown = 0
    for i in range(len(seeds)):
        a = int(seeds[i, 0])
        b = int(seeds[i, 1])
        full = n_groups == len(table.members) or n_grown == parameters.max_seeds
        if (
            full
            or not (unassigned[a] and unassigned[b])
            or _is_redundant(table, n_groups, candidates.views, a, b, seeds[i, 2])
        ):
            continue
        growth.members[0] = a
        growth.members[1] = b
        odds, count = _grow_group(candidates, parameters, context, pair_scores, growth)
        _store_group(candidates, pair_scores, growth, count, odds, table, n_groups)
        n_groups += 1
        n_grown += 1
    return n_groups


@inline
def _discard_conflicts(table, n_groups, unassigned):
    """Discard open groups that contain an assigned detection; return their number."""
    members, statistics = table.members, table.statistics
    discarded = 0
    for g in range(n_groups):
        conflict = False
        for v in range(members.shape[1]):
            conflict = conflict or (members[g, v] >= 0 and not unassigned[members[g, v]])
        if conflict and statistics[g, STATE] == _OPEN:
            statistics[g, STATE] = _DISCARDED
            discarded += 1
    return discarded


@inline
def _accept_best(parameters, table, n_groups, unassigned):
    """Accept the open group with the highest log odds and mark its detections as assigned; return it, or -1."""
    members, statistics = table.members, table.statistics
    best = -1
    for g in range(n_groups):
        eligible = statistics[g, STATE] == _OPEN and statistics[g, ODDS] + parameters.prior > 0.0
        if eligible and (best < 0 or statistics[g, ODDS] > statistics[best, ODDS]):
            best = g
    if best >= 0:
        statistics[best, STATE] = ACCEPTED
        for v in range(members.shape[1]):
            if members[best, v] >= 0:
                unassigned[members[best, v]] = False
    return best


@subroutine
def _is_duplicate(candidates, parameters, pixels, n, m):
    """Return whether two detections of a view are close enough to show the same person."""
    total = 0.0
    common = 0
    near_squared = parameters.near * parameters.near
    for k in range(pixels.shape[1]):
        w = candidates.weights[n, k]
        u = candidates.weights[m, k]
        if w > 0.0 and u > 0.0:
            du = pixels[n, k, 0] - pixels[m, k, 0]
            dv = pixels[n, k, 1] - pixels[m, k, 1]
            total += min(0.5 * (du * du + dv * dv) / (1.0 / w + 1.0 / u), 4.0 * near_squared)
            common += 1
    return common > 0 and total <= near_squared * common


@subroutine
def _duplicated_group(candidates, parameters, pixels, table, n_groups, g):
    """Return the accepted group that ``g`` duplicates in every view they share; -1 if there is none."""
    members = table.members
    for h in range(n_groups):
        if table.statistics[h, STATE] != ACCEPTED or h == g:
            continue
        n_shared = 0
        n_repeated = 0
        for v in range(members.shape[1]):
            if members[g, v] >= 0 and members[h, v] >= 0:
                n_shared += 1
                n_repeated += 1 if _is_duplicate(candidates, parameters, pixels, members[g, v], members[h, v]) else 0
        if n_shared > 0 and n_repeated == n_shared:
            return h
    return -1


@subroutine
def _accept_groups(candidates, parameters, pixels, unassigned, table, n_groups):
    """Accept groups in order of log odds until another group loses a detection by it; return the number accepted.

    The caller then grows the losing group again, because it may still be better than the remaining ones.
    """
    accepted = 0
    conflict = 0
    while conflict == 0:
        best = _accept_best(parameters, table, n_groups, unassigned)
        if best < 0:
            break
        accepted += 1
        duplicated = _duplicated_group(candidates, parameters, pixels, table, n_groups, best)
        if duplicated >= 0:
            table.statistics[best, STATE] = _DISCARDED
            for v in range(table.members.shape[1]):
                if table.members[best, v] >= 0:
                    table.duplicate_of[table.members[best, v]] = duplicated
        conflict = _discard_conflicts(table, n_groups, unassigned)
    return accepted


@subroutine
def _mark_duplicates(candidates, parameters, pixels, unassigned, table, n_groups):
    """Mark unassigned detections that duplicate a member of an accepted group in their own view."""
    for n in range(len(candidates.views)):
        for g in range(n_groups):
            m = table.members[g, candidates.views[n]]
            valid = unassigned[n] and m >= 0 and table.statistics[g, STATE] == ACCEPTED
            if valid and _is_duplicate(candidates, parameters, pixels, n, m):
                table.duplicate_of[n] = g


@kernel
def form_groups(candidates, parameters, context, pixels, pair_scores, seeds, table):
    """Form groups with at most one detection per view, each detection in at most one group.

    Pairs grow in order of support, each time by the detection with the highest log odds, until no candidate qualifies.
    Of the groups that contain the same detection, the likeliest keeps it, and the others are grown again without it. A
    group that duplicates an accepted one in every common view is not a new person.

    Args:
        candidates: detections of the frame.
        parameters: of the log odds.
        context: of the frame.
        pixels: shape (detection, core, 2): pixels of the core keypoints.
        pair_scores: shape (detection, detection), from :func:`score_pairs`.
        seeds: shape (seed, 3): pairs and their support scores, best first.
        table: written; groups that keep their detections have the state ``ACCEPTED``.

    Returns:
        Number of rows written.
    """
    n_views, n_core = context.cameras.shape[0], pixels.shape[1]
    unassigned = np.ones(len(candidates.views), np.bool_)
    points = np.empty((n_core, POINT_COLUMNS))
    terms = JoinTerms(
        shown=np.empty((2, len(candidates.views), 13, n_core)),
        predicted=np.empty((9, n_core)),
        odds=np.empty(n_core),
        common=np.empty(n_core),
    )
    arrange_detections(candidates, terms)
    growth = _GrowingGroup(unassigned, np.empty(n_views, np.int64), np.empty(n_views, np.bool_), points, terms)
    table.duplicate_of[:] = -1
    n_groups = 0
    for _ in range(len(candidates.views)):
        n_groups = _grow_pairs(candidates, parameters, context, pair_scores, seeds, growth, table, n_groups)
        if _accept_groups(candidates, parameters, pixels, unassigned, table, n_groups) == 0:
            break
    _mark_duplicates(candidates, parameters, pixels, unassigned, table, n_groups)
    return n_groups
