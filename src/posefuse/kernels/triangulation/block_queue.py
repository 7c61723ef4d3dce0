"""Scheduling of points in blocks: new points, and points postponed to a more thorough search."""

import numpy as np

from posefuse.kernels.cameras.observation_blocks import index_lanes
from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.cameras.points import OK
from posefuse.kernels.jit import inline

# With more views than this, some are nearly always outliers, so a first pass with all views does not pay off.
_QUICK_UP_TO = 8


# Search modes of a block: the point of all views; an early-stopping pair search; a complete pair search.
QUICK = 0


EARLY = 1


_COMPLETE = 2


@inline
def _postpone(workspace, n_keypoints, j, queue):
    """Postpone lane ``j`` to a later block."""
    lane_indices, n_pending = workspace.lane_indices, workspace.n_pending
    workspace.n_used[j] = 0
    if lane_indices[0, j] >= 0:
        workspace.pending[queue, n_pending[queue]] = lane_indices[0, j] * n_keypoints + lane_indices[1, j]
        n_pending[queue] += 1
        lane_indices[0, j] = -1


@inline
def postpone_contested(workspace, n_keypoints, min_views, early_limit):
    """Postpone the lanes where not all views agree with the point of all views."""
    n_used, n_agreeing = workspace.n_used, workspace.n_agreeing
    for j in range(BLOCK):
        # No pair hypothesis was needed.
        workspace.best[4, j] = 0.0
        if n_used[j] >= min_views and not (workspace.lane_status[j] == OK and n_agreeing[j] == n_used[j]):
            n_agreeing[j] = 0
            _postpone(workspace, n_keypoints, j, 0 if early_limit > 0 else 1)


@inline
def postpone_undecided(workspace, n_keypoints, n_undecided):
    """Postpone the lanes that need more pairs than the first few."""
    best = workspace.best
    for j in range(BLOCK):
        if n_undecided > 0 and best[3, j] < best[6, j]:
            _postpone(workspace, n_keypoints, j, np.int64(1))


@inline
def next_block(first, total, n_keypoints, early_limit, workspace):
    """Choose the next block: new points, or postponed points as soon as they fill a block.

    Args:
        first: number of the next new point.
        total: number of new points.
        n_keypoints: keypoints per person.
        early_limit: number of pairs of an early-stopping search; 0 if every search is complete.
        workspace: a Workspace; its queues are updated and its lane indices written.

    Returns:
        The search mode of the block and the next new point.
    """
    lane_indices, pending, n_pending = workspace.lane_indices, workspace.pending, workspace.n_pending
    n_views = workspace.weights.shape[0]
    has_new = first < total
    queue = 1 if n_pending[1] >= BLOCK or (n_pending[0] == 0 and not has_new) else 0
    if has_new and n_pending[queue] < BLOCK:
        index_lanes(first, total, n_keypoints, lane_indices)
        return QUICK if n_views <= _QUICK_UP_TO else (EARLY if early_limit > 0 else _COMPLETE), first + BLOCK
    n_taken = min(n_pending[queue], BLOCK)
    # Last in, first out: the result does not depend on which lanes share a block.
    n_pending[queue] -= n_taken
    for j in range(BLOCK):
        point = pending[queue, n_pending[queue] + j] if j < n_taken else 0
        lane_indices[0, j] = point // n_keypoints if j < n_taken else -1
        lane_indices[1, j] = point % n_keypoints
    return EARLY + queue, first
