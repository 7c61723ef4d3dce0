"""Who is not where they were foretold, but where they can have leapt.

The law of motion is that of what people and animals mostly do; a startled one accelerates more than that for a moment.
Expecting it always would tell nobody apart. So it is thought of only where views show somebody where nobody is foretold
to be, and somebody beside is missing: if more views then show them, they have leapt.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from posefuse.kernels.tracking.records import State
from posefuse.model.proposals import Proposals
from posefuse.tracking.body_states import chosen
from posefuse.tracking.settings import Settings

_FAR = 1e6


@dataclass(frozen=True)
class Leap:
    """Somebody who leapt.

    Attributes:
        place: theirs.
        proposal: what shows them now, by number.
        shift_m: shape (3,): from where they were foretold.
    """

    place: int
    proposal: int
    shift_m: np.ndarray


def may_have(rows: np.ndarray, free: np.ndarray, may: np.ndarray) -> np.ndarray:
    """Whom fewer views show than have a detection that is nobody's and do not show them, two at least.

    Args:
        rows: shape (track, view), int64: the detections of everybody, -1 for none.
        free: shape (view,), bool: views with detections that are nobody's.
        may: shape (track,), bool: who is asked about.

    Returns:
        Shape (who,), int64: their places.
    """
    shown = rows >= 0
    elsewhere = (free & ~shown).sum(axis=1)
    return np.flatnonzero(may & (elsewhere >= 2) & (elsewhere > shown.sum(axis=1)))


def leaps(
    who: np.ndarray,
    rows: np.ndarray,
    points_m: np.ndarray,
    gone_s: np.ndarray,
    proposals: Proposals,
    settings: Settings,
) -> list[Leap]:
    """Who is where free detections, and their own, propose somebody, whom more views show than show them.

    Args:
        who: shape (who,), int64: places of those who may have leapt.
        rows: shape (track, view), int64: the detections of everybody.
        points_m: shape (track, keypoint, 3): where everybody is foretold to be.
        gone_s: shape (who,): since when two views have not shown them.
        proposals: from these detections.
        settings: of the tracker.
    """
    births, motion = settings.options.births, settings.options.motion
    cost = np.full((len(who), len(proposals)), _FAR)
    shift = np.zeros((*cost.shape, 3))
    for i, p in enumerate(who):
        shown = np.count_nonzero(rows[p] >= 0)
        # Who is seen by nobody has to be somewhere.
        surely = proposals.log_odds >= (births.promote_log_odds if shown else 0.0)
        for j in np.flatnonzero(surely & (proposals.n_views > max(shown, 1))):
            away = proposals.points_m[j] - points_m[p]
            both = np.isfinite(away[:, 0])
            if both.any():
                apart = float(np.linalg.norm(away[both], axis=1).mean())
                if apart < births.gate_m + motion.top_speed_m_s * gone_s[i]:
                    cost[i, j], shift[i, j] = apart, np.median(away[both], axis=0)
    matches = zip(*linear_sum_assignment(cost), strict=True)
    return [Leap(int(who[i]), int(j), shift[i, j]) for i, j in matches if cost[i, j] < _FAR]


def leapt(state: State, leap: Leap, dt_s: float, settings: Settings) -> State:
    """The state of one who leapt: there, as fast as that takes, and as little known as after accelerations so large."""
    motion, n = settings.options.motion, settings.tree.n_pose
    out = chosen(state, [leap.place])
    cov = out.covariance[0]
    decay, power, dt = settings.decay_s, motion.leap_power * settings.power, dt_s + motion.leap_s
    fade = np.exp(-dt / decay)
    i, v = np.arange(n), len(cov) - n + np.arange(n)
    mixed = 0.5 * power * decay**2 * (1.0 - fade) ** 2
    cov[i, i] += power * decay**2 * (dt - 2.0 * decay * (1.0 - fade) + 0.5 * decay * (1.0 - fade**2))
    cov[i, v] += mixed
    cov[v, i] += mixed
    cov[v, v] += 0.5 * power * decay * (1.0 - fade**2)
    shrink = np.ones(len(cov))
    shrink[:n] = np.sqrt(np.minimum(1.0, settings.most / cov[i, i]))
    cov *= shrink[:, None] * shrink
    out.root[0] += leap.shift_m
    out.velocity[0, :3] += cov[v[:3], i[:3]] / cov[i[:3], i[:3]] * leap.shift_m
    return out
