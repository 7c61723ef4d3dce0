"""People who are not believed yet: what frames show of them is kept for a short time, to be confirmed or forgotten."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import linear_sum_assignment

from posefuse.model.frames import Frame
from posefuse.model.proposals import Proposals
from posefuse.tracking.frame_clock import SAME_S
from posefuse.tracking.records import Evidence, Tentative
from posefuse.tracking.settings import Settings

_FAR = 1e6


def evidence_of(frame: Frame, time_s: float, proposals: Proposals, which: int, mirror: np.ndarray) -> Evidence:
    """What a proposal's detections show, their sides put right."""
    rows = proposals.rows[which]
    shape = (len(rows), *frame.keypoints_px.shape[1:])
    pixels, trust = np.full(shape, np.nan), np.full(shape[:2], np.nan)
    for v in np.flatnonzero(rows >= 0):
        order = mirror if proposals.swapped[which, v] else slice(None)
        pixels[v], trust[v] = frame.keypoints_px[rows[v]][order], frame.confidence[rows[v]][order]
    return Evidence(
        time_s, frame.number, pixels, trust, rows, proposals.points_m[which], proposals.covariance_m2[which],
        proposals.torso_m[which], float(proposals.log_odds[which]), float(proposals.error_sigma[which]),
        int(proposals.n_pairs[which]),
    )  # fmt: skip


def continue_with(
    tentative: list[Tentative], found: list[Evidence], apart: Callable[[Evidence, Evidence], float]
) -> list[Evidence]:
    """Give every tentative person the proposal that goes on where they were; the proposals that are nobody's.

    Args:
        tentative: in and out.
        found: of this frame.
        apart: how far a proposal is from what was last seen of somebody; inf where it cannot be them.
    """
    for each in tentative:
        each.frames += 1
    if not tentative or not found:
        return found
    cost = np.full((len(tentative), len(found)), _FAR)
    for i, each in enumerate(tentative):
        for j, new in enumerate(found):
            cost[i, j] = min(apart(each.evidence[-1], new), _FAR)
    taken = set()
    for i, j in zip(*linear_sum_assignment(cost), strict=True):
        if cost[i, j] < _FAR:
            tentative[i].evidence.append(found[j])
            taken.add(int(j))
    return [new for j, new in enumerate(found) if j not in taken]


def is_of_two_views(each: Tentative, settings: Settings) -> bool:
    """Whether a tentative person was seen by hardly more views, on average, than one must be seen by."""
    return float(np.mean([e.n_views for e in each.evidence])) < settings.options.births.min_views + 0.5


def is_over(each: Tentative, time_s: float, waits_s: float, settings: Settings) -> bool:
    """Whether a tentative person is to be forgotten; who must be old to be believed may get twice as old."""
    births = settings.options.births
    most_s = births.max_age_s * (2.0 if waits_s > births.min_age_two_views_s else 1.0)
    too_old = time_s - each.evidence[0].time_s > most_s + SAME_S
    return too_old or time_s - each.evidence[-1].time_s > births.max_missing_s + SAME_S


def is_believable(each: Tentative, time_s: float, promotes_from: float, waits_s: float, settings: Settings) -> bool:
    """Whether what is known of a tentative person is enough to follow them: the rule of promotion.

    Args:
        each: the person.
        time_s: of this frame.
        promotes_from: the least score.
        waits_s: how old they must be.
        settings: of the tracker.
    """
    births = settings.options.births
    views = float(np.mean([e.n_views for e in each.evidence]))
    age = time_s - each.evidence[0].time_s
    return (
        len(each.evidence) > 1
        and each.evidence[-1].time_s == time_s
        and age >= waits_s - SAME_S
        and len(each.evidence) >= births.hit_share * each.frames
        and views >= births.min_views
        and float(np.median([e.error_sigma for e in each.evidence])) <= births.max_error_sigma
        and each.score >= promotes_from
        and _bone_variation(each, settings) <= births.max_bone_variation
    )


def core_bones(each: Tentative, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    """Lengths of the core's bones that more than one frame shows, and their variances, shape (frame, bone) both.

    Args:
        each: the person.
        settings: of the tracker.
    """
    edges = settings.skeleton.edge_indices
    edges = edges[np.isin(edges, settings.core).all(axis=1)]
    points = np.stack([e.points_m for e in each.evidence])
    variances = np.stack([e.covariance_m2[:, (0, 3, 5)].mean(axis=1) for e in each.evidence])
    lengths = np.linalg.norm(points[:, edges[:, 0]] - points[:, edges[:, 1]], axis=-1)
    noise = variances[:, edges].sum(axis=-1)
    usable = np.isfinite(lengths).sum(axis=0) > 1
    return lengths[:, usable], noise[:, usable]


def _bone_variation(each: Tentative, settings: Settings) -> float:
    """By which share the bones of the core vary from frame to frame, noise taken off; 0 where that cannot be told."""
    lengths, noise = core_bones(each, settings)
    if not lengths.size:
        return 0.0
    excess = np.nanvar(lengths, axis=0, ddof=1) - np.nanmean(noise, axis=0)
    return float(np.median(np.sqrt(np.maximum(excess, 0.0)) / np.nanmean(lengths, axis=0)))
