"""Detections whose keypoints belong to two people: which keypoint is whose.

A detection is split by the log likelihood ratio of each keypoint between the two predicted people, with a penalty for
every edge of a spanning tree of the skeleton whose ends belong to different people: detectors confuse limbs rather than
single keypoints. The labeling with the highest total is exact (dynamic programming over the tree).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.jit import kernel, subroutine
from posefuse.kernels.tracking.matching import Scoring, compute_noise, score_keypoint


class SplitParameters(NamedTuple):
    """Parameters of the split of detections between two people.

    Attributes:
        clutter_m: size of the area in which an unrelated keypoint may lie.
        min_log_odds: lower bound of the log odds of one keypoint.
        max_keypoints: the evidence counts as at most this many keypoints.
        distance_m: largest distance of two people in the image, at their depth, at which a detection may show both.
        edge_evidence: evidence against an edge whose ends belong to different people.
        min_evidence: evidence that the second person's keypoints need.
    """

    clutter_m: float
    min_log_odds: float
    max_keypoints: float
    distance_m: float
    edge_evidence: float
    min_evidence: float


class _SplitWorkspace(NamedTuple):
    """Scratch arrays of a split, each of shape (keypoint,) except ``best``, shape (keypoint, 2)."""

    gain: Any
    best: Any
    is_second: Any
    chosen: Any


class _SplitInput(NamedTuple):
    """What all splits of a frame have in common; ``place``, shape (track, view, 3), is that of :func:`_locate`."""

    projected: Any
    keypoints_px: Any
    scoring: Any
    graph: Any
    split: Any
    place: Any


@subroutine
def _locate(projected, core, p, v):
    """Return the mean core keypoint of a person in a view, in px, and the mean scale, in px/m; NaN if not visible."""
    x, y, scale, count = 0.0, 0.0, 0.0, 0.0
    for i in range(core.shape[0]):
        k = core[i]
        if math.isfinite(projected.pixels[p, v, k, 0]):
            x += projected.pixels[p, v, k, 0]
            y += projected.pixels[p, v, k, 1]
            scale += projected.scale_px_per_m[p, v, k]
            count += 1.0
    return x / count, y / count, scale / count


@subroutine
def _split_keypoints(graph, edge_evidence, workspace):
    """Find the labeling of keypoints as the first or the second person's with the highest total."""
    order, parents, _ = graph
    gain, best, is_second, _ = workspace
    for k in range(order.shape[0]):
        best[k, 0] = 0.0
        best[k, 1] = gain[k] if gain[k] == gain[k] else 0.0
    for i in range(order.shape[0] - 1, -1, -1):
        k = order[i]
        if parents[k] >= 0:
            best[parents[k], 0] += max(best[k, 0], best[k, 1] - edge_evidence)
            best[parents[k], 1] += max(best[k, 1], best[k, 0] - edge_evidence)
    for i in range(order.shape[0]):
        k = order[i]
        preference = 0.0
        if parents[k] >= 0:
            preference = edge_evidence if is_second[parents[k]] != 0 else -edge_evidence
        is_second[k] = 1 if best[k, 1] + preference > best[k, 0] else 0


@subroutine
def _second_evidence(given, p, q, v, row, labels, workspace):
    """Split the detection of one person between that person and a second one; return the evidence for the second."""
    gain, _, is_second, _ = workspace
    for k in range(labels.shape[0]):
        gain[k] = math.nan
        if labels[k] >= 0:
            gain[k] = score_keypoint(
                given.projected, given.keypoints_px, given.scoring, q, row, v, k, labels[k]
            ) - score_keypoint(given.projected, given.keypoints_px, given.scoring, p, row, v, k, labels[k])
    _split_keypoints(given.graph, given.split.edge_evidence, workspace)
    total, count = 0.0, 0.0
    for k in range(labels.shape[0]):
        # A keypoint that fits the second person no better, only its limb, stays with the first.
        if is_second[k] != 0 and gain[k] > 0.0:
            total += gain[k]
            count += 1.0
        else:
            is_second[k] = 0
    return total / count * min(count, given.split.max_keypoints) if count > 0.0 else 0.0


@subroutine
def _find_owner(given, q, v, assignment, workspace):
    """Return the track with the detection that shows most of track ``q``, -1 for none; write the keypoints of ``q``."""
    place, rows = given.place, assignment.rows
    most, owner = given.split.min_evidence, -1
    for p in range(rows.shape[0]):
        if p == q or rows[p, v] < 0:
            continue
        du, dv = place[p, v, 0] - place[q, v, 0], place[p, v, 1] - place[q, v, 1]
        if not du * du + dv * dv < (given.split.distance_m * place[q, v, 2]) ** 2:
            continue
        evidence = _second_evidence(given, p, q, v, rows[p, v], assignment.labels[p, v], workspace)
        if evidence > most:
            most, owner = evidence, p
            for k in range(workspace.chosen.shape[0]):
                workspace.chosen[k] = workspace.is_second[k]
    return owner


@kernel
def share_detections(projected, detections, error_model, graph, may_share, split, assignment):
    """Share detections that show two people with those who have no detection of their own in that view.

    Args:
        projected: ProjectedKeypoints.
        detections: Detections.
        error_model: an ErrorModel.
        graph: KeypointGraph.
        may_share: shape (track,), bool: tracks that may receive keypoints.
        split: SplitParameters.
        assignment: SharedAssignment, in and out.
    """
    keypoints_px, confidence, view_of_row = detections
    rows, labels, shared = assignment
    n, n_views, n_keypoints = labels.shape
    place = np.empty((n, n_views, 3))
    for p in range(n):
        for v in range(n_views):
            shared[p, v] = rows[p, v]
            place[p, v, 0], place[p, v, 1], place[p, v, 2] = _locate(projected, graph.core, p, v)
    noise_px2 = np.empty(confidence.shape)
    compute_noise(confidence, view_of_row, error_model, noise_px2)
    least = split.min_log_odds
    scoring = Scoring(noise_px2, error_model.floor_m, error_model.nu, split.clutter_m, least, math.exp(-least))
    given = _SplitInput(projected, keypoints_px, scoring, graph, split, place)
    workspace = _SplitWorkspace(
        gain=np.empty(n_keypoints),
        best=np.empty((n_keypoints, 2)),
        is_second=np.empty(n_keypoints, np.int64),
        chosen=np.empty(n_keypoints, np.int64),
    )
    for q in range(n):
        for v in range(n_views):
            if not may_share[q] or rows[q, v] >= 0:
                continue
            owner = _find_owner(given, q, v, assignment, workspace)
            if owner < 0:
                continue
            shared[q, v] = rows[owner, v]
            for k in range(n_keypoints):
                labels[q, v, k] = labels[owner, v, k] if workspace.chosen[k] != 0 else -1
                labels[owner, v, k] = -1 if workspace.chosen[k] != 0 else labels[owner, v, k]
