"""Assignment of people who moved farther than the motion model predicts.

The motion model describes how people and animals mostly move; a startled one accelerates more for a moment. A model
that always expects such accelerations cannot distinguish people. So they are considered only where views show an
unassigned person and a predicted person is missing: if more views show that person than the prediction, the person
moved fast.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.model.graphs import best_assignment
from posefuse.model.proposals import Proposals
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import select_states, set_state
from posefuse.tracking.predict import FrameInput, Prediction
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategy import MatchScores, TrackerSetup
from posefuse.tracking.track_set import TrackSet

_IMPOSSIBLE = 1e6
"""Cost of an assignment that is not allowed, in meters."""


@dataclass(frozen=True)
class FastMotion:
    """A track that moved farther than predicted.

    Attributes:
        track: Index of the track.
        proposal: Index of the proposal that shows the person now.
        shift_m: shape (3,): displacement from the prediction.
    """

    track: int
    proposal: int
    shift_m: np.ndarray


def assign_fast_motion(
    tracks: TrackSet,
    frame: FrameInput,
    prediction: Prediction,
    rows: np.ndarray,
    scores: MatchScores,
    unassigned: np.ndarray,
    setup: TrackerSetup,
) -> None:
    """Assign the detections of people who moved farther than predicted, in place.

    Args:
        tracks: Updated in place: states.
        frame: The frame.
        prediction: Predicted tracks; updated in place: states at the time of the last frame.
        rows: shape (track, view), updated in place.
        scores: Updated in place: swaps of the detections that are assigned.
        unassigned: shape (row,), bool; changed.
        setup: Setup of the tracker.
    """
    s, detections = setup.settings, frame.frame
    if not unassigned.any():
        return
    views_free = np.bincount(detections.view[unassigned], minlength=len(s.rig)) > 0
    candidates = find_candidates(rows, views_free, tracks.is_in_state(TrackState.ACTIVE))
    if not len(candidates):
        return
    unassigned[rows[candidates][rows[candidates] >= 0]] = True
    proposals = setup.propose(detections, unassigned)
    unseen_s = np.array([frame.time_s - tracks.tracks[p].last_multiview_s for p in candidates])
    odds = s.options.fast_motion.swap_log_odds
    for motion in find_fast_motions(candidates, rows, prediction.projected.points_m, unseen_s, proposals, s):
        p = motion.track
        rows[p] = proposals.rows[motion.proposal]
        for v in np.flatnonzero(rows[p] >= 0):
            swapped = proposals.swapped[motion.proposal, v]
            scores.swapped[p, rows[p, v]] = swapped
            scores.swap_odds[p, rows[p, v]] = odds if swapped else -odds
        set_state(tracks.state, p, displaced_state(tracks.state, motion, frame.dt_s, s))
        before = prediction.state_before
        if before is not None:
            set_state(before, p, displaced_state(before, motion, 0.0, s))


def find_candidates(rows: np.ndarray, views_free: np.ndarray, active: np.ndarray) -> np.ndarray:
    """Return the tracks that fewer views show than have unassigned detections instead, at least two.

    Args:
        rows: shape (track, view), int64: assigned detections, -1 for none.
        views_free: shape (view,), bool: views with unassigned detections.
        active: shape (track,), bool: tracks to consider.

    Returns:
        shape (candidate,), int64: indices of tracks.
    """
    shown = rows >= 0
    elsewhere = (views_free & ~shown).sum(axis=1)
    return np.flatnonzero(active & (elsewhere >= 2) & (elsewhere > shown.sum(axis=1)))


def find_fast_motions(
    candidates: np.ndarray,
    rows: np.ndarray,
    points_m: np.ndarray,
    unseen_s: np.ndarray,
    proposals: Proposals,
    settings: TrackerSettings,
) -> list[FastMotion]:
    """Find the tracks that proposals show within reach, in more views than the prediction.

    Args:
        candidates: shape (candidate,), int64: indices of tracks.
        rows: shape (track, view), int64: assigned detections, -1 for none.
        points_m: shape (track, keypoint, 3): predicted points.
        unseen_s: shape (candidate,): time since two views last supported each candidate, in seconds.
        proposals: People proposed from the unassigned detections and those of the candidates.
        settings: Settings of the tracker.
    """
    initiation, motion = settings.options.initiation, settings.options.motion
    cost = np.full((len(candidates), len(proposals)), _IMPOSSIBLE)
    shift = np.zeros((*cost.shape, 3))
    for i, p in enumerate(candidates):
        n_views = np.count_nonzero(rows[p] >= 0)
        # A person whom no view shows must be elsewhere, so even odds suffice.
        likely = proposals.log_odds >= (initiation.promote_log_odds if n_views else 0.0)
        for j in np.flatnonzero(likely & (proposals.n_views > max(n_views, 1))):
            displacement = proposals.points_m[j] - points_m[p]
            common = np.isfinite(displacement[:, 0])
            if common.any():
                distance = float(np.linalg.norm(displacement[common], axis=1).mean())
                if distance < initiation.gate_m + motion.top_speed_m_s * unseen_s[i]:
                    cost[i, j], shift[i, j] = distance, np.median(displacement[common], axis=0)
    matches = best_assignment(cost)
    return [FastMotion(int(candidates[i]), j, shift[i, j]) for i, j in matches if cost[i, j] < _IMPOSSIBLE]


def displaced_state(state: State, motion: FastMotion, dt_s: float, settings: TrackerSettings) -> State:
    """Return the state of one body after a fast motion.

    The body is displaced, has the velocity that the displacement needs, and the uncertainty of a prediction with the
    larger accelerations of ``tracker.fast_motion``.

    Args:
        state: State of all bodies.
        motion: Fast motion of one of them.
        dt_s: Time since the last frame, in seconds.
        settings: Settings of the tracker.
    """
    options, n = settings.options.fast_motion, settings.tree.n_pose
    out = select_states(state, [motion.track])
    cov = out.covariance[0]
    decay, power, dt = settings.decay_s, options.acceleration_factor * settings.power, dt_s + options.onset_s
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
    out.root[0] += motion.shift_m
    out.velocity[0, :3] += cov[v[:3], i[:3]] / cov[i[:3], i[:3]] * motion.shift_m
    return out
