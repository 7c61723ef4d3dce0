"""The arrays that solving pairs works in: one block of couples at a time, observations by label."""

from collections import namedtuple

import numpy as np

from posefuse.kernels.jit import kernel
from posefuse.kernels.left_right.search import MOST_GROUPS, PROPOSALS

Room = namedtuple(
    "Room",
    "places keypoints pixels trust rows weights codes lens_codes scratch ranks seen any_trust any_weights couples "
    "couple trial shares totals best labels evidence side_rows side_weights side_pixels side_errors state sums "
    "agreeing valid rays status",
)
"""By label (left, right) or side (left, right), view and lane:

places, keypoints: person-frame and pair of each lane; person-frame and keypoint of the label being read.
pixels, trust, rows, weights, codes: of the observations, by label.
lens_codes, scratch: what reading pixels needs.
ranks, seen, any_trust, any_weights: views by confidence, whichever labels they have.
couples: shape (proposal, COUPLE_ROWS, BLOCK), refined proposals; couple: the chosen one, best: which of them, totals:
their costs with the evidence of the frame before; trial, shares: scratch.
labels: shape (side, view, BLOCK), the label of the observation each point rests on, or -1.
evidence: by how much the view as labelled costs more than swapped.
side_*: the observations that a point rests on.
state, sums: of both points, as in :mod:`posefuse.kernels.cameras.points`.
agreeing, valid, rays, status: how many views each point rests on, how many observations could have been its, how many
the couple has, point codes.
"""

SearchRoom = namedtuple("SearchRoom", "rows weights normal places points costs alone rests_on groups kept kept_places")
"""Of one lane, see :func:`posefuse.kernels.left_right.search.search_lane`."""


@kernel
def make_search_room(n_views, n_tries):
    """Room for the search of one lane."""
    most = 4 * n_tries
    return SearchRoom(
        rows=np.empty((2 * n_views, 12)),
        weights=np.empty(2 * n_views),
        normal=np.empty((9, 2 * n_views)),
        places=np.empty((2, most), np.int64),
        points=np.empty((3, most)),
        costs=np.empty((2 * n_views, most)),
        alone=np.empty(most),
        rests_on=np.empty(most, np.int64),
        groups=np.empty(MOST_GROUPS, np.int64),
        kept=np.empty(PROPOSALS),
        kept_places=np.empty((2, PROPOSALS), np.int64),
    )
