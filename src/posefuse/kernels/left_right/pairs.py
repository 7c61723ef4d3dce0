"""Left and right points from rays whose labels are not believed: every couple of proposals scored, the best refined.

Works on blocks of observation rows like :mod:`posefuse.kernels.triangulation.consensus`. See docs/methods.md, "Pairs".
"""

import math

import numpy as np

from posefuse.kernels.cameras.observation_rows import BLOCK, rows_block
from posefuse.kernels.cameras.points import STATE_ROWS, SUM_ROWS, judge_geometry, normal_equations, store_points
from posefuse.kernels.cameras.views import linear_errors, load_block, locate_lanes, reproject_block, weigh_block
from posefuse.kernels.jit import inline, kernel, step
from posefuse.kernels.left_right.branch_and_bound import MOST_VIEWS, make_proof_room, prove_lane
from posefuse.kernels.left_right.choice import choose, doubt
from posefuse.kernels.left_right.refine import COUPLE_COST, COUPLE_ROWS, MOVED, settle
from posefuse.kernels.left_right.results import (
    assign,
    judge_side,
    keep_information,
    put_in_order,
    store_side,
    store_views,
    take_side,
)
from posefuse.kernels.left_right.search import PROPOSALS, search_lane
from posefuse.kernels.left_right.workspace import Room, make_search_room
from posefuse.kernels.triangulation.pair_search import rank_views

_GENEROUS = 2
_SKETCH_ROUNDS = 5
_MOST_ROUNDS = 60
_SETTLED = 1e-2


@inline
def _load(
    cameras, distorted, fisheye, keypoints_px, confidence, rows_of, pairs, scale_px, exponent, min_confidence, room
):
    """Read both observations of every lane, and rank the views by what confidence either has."""
    for label in range(2):
        for j in range(BLOCK):
            room.keypoints[0, j] = room.places[0, j]
            room.keypoints[1, j] = pairs[room.places[1, j], label]
        pixels, trust, view_codes = room.pixels[label], room.trust[label], room.codes[label]
        load_block(keypoints_px, confidence, rows_of, room.keypoints, min_confidence, pixels, trust, view_codes)
        for v in range(cameras.shape[0]):
            rows_block(cameras, distorted, fisheye, v, pixels, room.lens_codes, room.rows[label], room.scratch)
        weigh_block(scale_px, exponent, trust, room.lens_codes, view_codes, room.weights[label])
    for v in range(cameras.shape[0]):
        for j in range(BLOCK):
            left = room.weights[0, v, j] > 0.0
            right = room.weights[1, v, j] > 0.0
            room.any_weights[v, j] = 1.0 if left | right else 0.0
            room.any_trust[v, j] = (room.trust[0, v, j] if left else 0.0) + (room.trust[1, v, j] if right else 0.0)
    rank_views(room.any_trust, room.any_weights, room.ranks, room.seen)


@inline
def _propose(tries, full, none, room, search_room):
    """Search every lane, and sketch what the cheapest couples of two-ray points become over all views."""
    for j in range(BLOCK):
        if room.places[0, j] >= 0:
            search_lane(room.rows, room.weights, room.ranks, room.seen, tries, full, none, j, search_room, room.couples)
        else:
            for i in range(PROPOSALS):
                for axis in range(6):
                    room.couples[i, axis, j] = math.nan


@inline
def _empty(couple):
    """Whether no lane has such a proposal."""
    lanes = 0
    for j in range(BLOCK):
        lanes += 1 if couple[0, j] == couple[0, j] else 0
    return lanes == 0


@step
def _prove(rows, weights, seen, full, none, couples, sums, room):
    """Where views are few, put a couple last that costs less than the cheapest of the others, if there is any."""
    bound = full + (none - full) * (1.0 / 3.0)
    better = couples[PROPOSALS]
    for j in range(BLOCK):
        few = 2 <= seen[j] <= MOST_VIEWS
        for i in range(6):
            better[i, j] = couples[0, i, j] if few else math.nan
        if not few:
            continue
        cost = math.inf
        for couple in couples[:PROPOSALS]:
            # What one costs that has not settled is not to be believed: it may be about to give a point up.
            if not couple[MOVED, j] < _SETTLED:
                couple[COUPLE_COST, j] = math.inf
            elif couple[COUPLE_COST, j] < cost:
                cost = couple[COUPLE_COST, j]
                for i in range(6):
                    better[i, j] = couple[i, j]
        for v in range(weights.shape[1]):
            cost -= 0.0 if weights[0, v, j] > 0.0 else bound
            cost -= 0.0 if weights[1, v, j] > 0.0 else bound
        prove_lane(rows, weights, full, none, better, cost, j, sums, room)


@inline
def _refine(full, none, prior_sigma, previous, room, proof_room):
    """Sketch what the proposals become over all views, choose the cheapest couple, and settle that."""
    bound = full + (none - full) * (1.0 / 3.0)
    # One loop for all, so that its body is compiled once.
    for i in range(PROPOSALS + 2):
        if i < PROPOSALS:
            begin = 0
            couple, end = room.couples[i], 1 if _empty(room.couples[i]) else _GENEROUS + _SKETCH_ROUNDS
        elif i == PROPOSALS:
            _prove(room.rows, room.weights, room.seen, full, none, room.couples, room.sums[0], proof_room)
            couple, begin = room.couples[i], _GENEROUS
            end = _GENEROUS if _empty(couple) else _GENEROUS + _SKETCH_ROUNDS
        else:
            choose(room.couples, room.places, prior_sigma, bound, previous, room.totals, room.best, room.couple)
            couple, begin, end = room.couple, _GENEROUS, _MOST_ROUNDS
        settle(room.rows, room.weights, begin, end, full, none, couple, room.trial, room.shares, room.sums)


@inline
def _take_given(given, room):
    """Points that were found in another way, without rivals."""
    for j in range(BLOCK):
        n = room.places[0, j]
        k = room.places[1, j]
        room.best[j] = 0
        room.couple[COUPLE_COST, j] = 0.0
        room.couple[MOVED, j] = 0.0
        for axis in range(6):
            room.couple[axis, j] = given[n, k, axis] if n >= 0 else math.nan
            for i in range(PROPOSALS + 1):
                room.couples[i, axis, j] = math.nan
        for i in range(PROPOSALS + 1):
            room.totals[i, j] = 0.0


@inline
def _finish_side(cameras, distorted, fisheye, room, side, bound, min_views):
    """Status, covariance and errors of one of each lane's points."""
    take_side(room, side)
    moved, agreeing, valid = room.couple[MOVED], room.agreeing, room.valid
    judge_side(room.couple, side, _SETTLED, min_views, moved, agreeing, valid, room.rays, room.status)
    normal_equations(room.side_rows, room.side_weights, room.state, room.sums[0])
    keep_information(room.sums[0], room.state)
    doubt(room.couples, room.totals, room.best, room.couple, side, room.state, bound, room.status)
    judge_geometry(room.state, room.sums[0], room.status)
    reproject_block(cameras, distorted, fisheye, room.side_pixels, room.state, room.side_errors)
    linear_errors(room.side_rows, room.side_weights, room.state, room.side_errors)


@kernel
def solve_pairs(
    cameras,
    distorted,
    fisheye,
    keypoints_px,
    confidence,
    rows_of,
    pairs,
    scale_px,
    exponent,
    min_confidence,
    min_views,
    tries,
    full_sigma,
    none_sigma,
    prior_sigma,
    previous,
    given,
    points,
    covariance,
    status,
    used,
    view_errors_px,
    view_codes,
    evidence,
    costs,
):
    """Two points of every pair of keypoints, the labels of observations being evidence for their order only.

    Args:
        cameras: the camera array, shape (view, COLUMNS).
        distorted: None if the rig has no lens with distortion polynomials.
        fisheye: None if it has no fisheye.
        keypoints_px: shape (detection, keypoint, 2), NaN where missing.
        confidence: shape (detection, keypoint), NaN where the detector gives none.
        rows_of: shape (person_frame, view), int64: rows of the two above, or NO_DETECTION or NOT_RECORDED.
        pairs: shape (pair, 2), int64: keypoints, left and right.
        scale_px: shape (view,): the noise of a detection of confidence 1, in px per axis.
        exponent: the noise is ``scale_px / confidence^exponent``.
        min_confidence: detections below are not used.
        min_views: points with fewer agreeing views are missing (at least 2).
        tries: shape (try, 2), int64: ranks of views to try together, the most promising first.
        full_sigma: a residual of fewer sigmas counts whole.
        none_sigma: a residual of more sigmas does not count; the observation is not this point's.
        prior_sigma: how far points move between frames, in the world's unit; inf to ask every frame alone.
        previous: shape (person, pair, 6), in and out: the points of the frame before; NaN where there are none.
        given: shape (person_frame, pair, 6): points to take as they are; with no person_frame, they are sought.
        points: shape (person_frame, pair, 2, 3), written: left and right.
        covariance: shape (person_frame, pair, 2, 6), written: xx xy xz yy yz zz.
        status: shape (person_frame, pair, 2), int8, written: point codes.
        used: shape (person_frame, pair, view, 2), int8, written: the label of the observation each point rests on, 0
            left, 1 right, -1 none.
        view_errors_px: shape (person_frame, pair, view, 2), float32, written: the distance of that observation.
        view_codes: shape (person_frame, pair, view, 2), int8, written: what became of the observation of each label.
        evidence: shape (person_frame, pair, view), float32, written: by how much (squared sigmas) the view as labelled
            costs more than swapped.
        costs: shape (person_frame, pair), written: the bounded cost of the couple, squared sigmas.
    """
    n_pairs = pairs.shape[0]
    total = rows_of.shape[0] * n_pairs
    n_views = cameras.shape[0]
    # Made here and not elsewhere: the compiler must know the length of their last axis to use vector instructions.
    room = Room(
        places=np.empty((2, BLOCK), np.int64),
        keypoints=np.empty((2, BLOCK), np.int64),
        pixels=np.empty((2, n_views, 2, BLOCK)),
        trust=np.empty((2, n_views, BLOCK)),
        rows=np.empty((2, n_views, 12, BLOCK)),
        weights=np.empty((2, n_views, BLOCK)),
        codes=np.empty((2, n_views, BLOCK), np.int64),
        lens_codes=np.empty((n_views, BLOCK), np.int64),
        scratch=np.empty((6, BLOCK)),
        ranks=np.empty((n_views, BLOCK), np.int64),
        seen=np.empty(BLOCK, np.int64),
        any_trust=np.empty((n_views, BLOCK)),
        any_weights=np.empty((n_views, BLOCK)),
        couples=np.empty((PROPOSALS + 1, COUPLE_ROWS, BLOCK)),
        couple=np.empty((COUPLE_ROWS, BLOCK)),
        trial=np.empty((COUPLE_ROWS, BLOCK)),
        shares=np.empty((4, BLOCK)),
        totals=np.empty((PROPOSALS + 1, BLOCK)),
        best=np.empty(BLOCK, np.int64),
        labels=np.empty((2, n_views, BLOCK), np.int64),
        evidence=np.empty((n_views, BLOCK)),
        side_rows=np.empty((n_views, 12, BLOCK)),
        side_weights=np.empty((n_views, BLOCK)),
        side_pixels=np.empty((n_views, 2, BLOCK)),
        side_errors=np.empty((n_views, BLOCK)),
        state=np.empty((STATE_ROWS, BLOCK)),
        sums=np.empty((2, SUM_ROWS, BLOCK)),
        agreeing=np.empty(BLOCK, np.int64),
        valid=np.empty(BLOCK, np.int64),
        rays=np.empty(BLOCK, np.int64),
        status=np.empty(BLOCK, np.int64),
    )
    search_room = make_search_room(n_views, tries.shape[0])
    proof_room = make_proof_room()
    full, none = full_sigma * full_sigma, none_sigma * none_sigma
    bound = full + (none - full) / 3.0
    for first in range(0, total, BLOCK):
        locate_lanes(first, total, n_pairs, room.places)
        _load(
            cameras,
            distorted,
            fisheye,
            keypoints_px,
            confidence,
            rows_of,
            pairs,
            scale_px,
            exponent,
            min_confidence,
            room,
        )
        if given.shape[0] > 0:
            _take_given(given, room)
        else:
            _propose(tries, full, none, room, search_room)
            _refine(full, none, prior_sigma, previous, room, proof_room)
        assign(room.rows, room.weights, full, none, room.couple, room.labels, room.evidence)
        put_in_order(room.trust, room.couple, room.labels, room.evidence)
        for side in range(2):
            _finish_side(cameras, distorted, fisheye, room, side, bound, min_views)
            side_points, side_covariance, side_status = points[:, :, side], covariance[:, :, side], status[:, :, side]
            store_points(room.state, room.sums[0], room.status, room.places, side_points, side_covariance, side_status)
            store_side(room, side, used, view_errors_px)
        store_views(room, bound, view_codes, evidence, costs)
