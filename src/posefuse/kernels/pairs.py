"""Left and right points from rays whose labels are not believed: every couple of proposals scored, the best refined.

Works on blocks of observation rows like :mod:`posefuse.kernels.consensus`. See docs/methods.md, "Pairs".
"""

import math

from posefuse.kernels.jit import kernel, step
from posefuse.kernels.pair_choice import choose, doubt
from posefuse.kernels.pair_refine import MOVED, settle
from posefuse.kernels.pair_results import (
    assign,
    judge_side,
    keep_information,
    put_in_order,
    store_side,
    store_views,
    take_side,
)
from posefuse.kernels.pair_room import make_room, make_search_room
from posefuse.kernels.pair_search import PROPOSALS, search_lane
from posefuse.kernels.points import judge_geometry, normal_equations, store_points
from posefuse.kernels.rows import BLOCK, rows_block
from posefuse.kernels.search import rank_views
from posefuse.kernels.views import linear_errors, load_block, locate_lanes, reproject_block, weigh_block

_GENEROUS = 2
_SKETCH_ROUNDS = 7
_MOST_ROUNDS = 60
_SETTLED = 1e-2


@step
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


@step
def _propose(tries, full, none, room, search_room):
    """Search every lane, and sketch what the cheapest couples of two-ray points become over all views."""
    for j in range(BLOCK):
        if room.places[0, j] >= 0:
            search_lane(room.rows, room.weights, room.ranks, room.seen, tries, full, none, j, search_room, room.couples)
        else:
            for i in range(PROPOSALS):
                for axis in range(6):
                    room.couples[i, axis, j] = math.nan
    for i in range(PROPOSALS):
        settle(
            room.rows, room.weights, 0, _GENEROUS + _SKETCH_ROUNDS, full, none, room.couples[i], room.trial, room.sums
        )


@step
def _finish_side(cameras, distorted, fisheye, room, side, bound, min_views):
    """Status, covariance and errors of one of each lane's points."""
    take_side(room, side)
    judge_side(room.couple, side, _SETTLED, min_views, room.couple[MOVED], room.agreeing, room.valid, room.status)
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
    room = make_room(cameras.shape[0])
    search_room = make_search_room(cameras.shape[0], tries.shape[0])
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
        _propose(tries, full, none, room, search_room)
        choose(room.couples, room.places, prior_sigma, bound, previous, room.totals, room.best, room.couple)
        settle(room.rows, room.weights, _GENEROUS, _MOST_ROUNDS, full, none, room.couple, room.trial, room.sums)
        assign(room.rows, room.weights, full, none, room.couple, room.labels, room.evidence)
        put_in_order(room.trust, room.couple, room.labels, room.evidence)
        for side in range(2):
            _finish_side(cameras, distorted, fisheye, room, side, bound, min_views)
            side_points, side_covariance, side_status = points[:, :, side], covariance[:, :, side], status[:, :, side]
            store_points(room.state, room.sums[0], room.status, room.places, side_points, side_covariance, side_status)
            store_side(room, side, used, view_errors_px)
        store_views(room, view_codes, evidence, costs)
