"""Third step of the tracker: update the predicted states by the assigned detections."""

from dataclasses import dataclass

import numpy as np

from posefuse.arrays import kernel_array
from posefuse.kernels.tracking.frame_statistics import update_gated_time
from posefuse.kernels.tracking.records import USED, AssignedDetections, State, UpdateResults
from posefuse.kernels.tracking.update import update_people
from posefuse.model.frames import Frame
from posefuse.model.track_events import Event
from posefuse.tracking.associate import Association
from posefuse.tracking.body_states import KeypointUses
from posefuse.tracking.frame_clock import view_times
from posefuse.tracking.predict import FrameInput, Prediction
from posefuse.tracking.reinitialize import (
    has_unknown_directions,
    is_long_gap,
    reinitialize_directions,
    reinitialize_limb,
)
from posefuse.tracking.single_view_priors import (
    apply_height_prior,
    apply_posture_prior,
    observe_height,
    observe_posture,
)
from posefuse.tracking.strategy import Propose, TrackerSetup, UpdateNoise
from posefuse.tracking.track_set import TrackSet


@dataclass(frozen=True, eq=False)
class Update:
    """Result of the update.

    Attributes:
        used: shape (track, view, keypoint), bool: keypoints that the update used.
        supported: shape (track, view), bool: views that support each track.
        innovations: By the number of each updated track: normalized innovation squared, and its degrees of freedom.
        events: Limbs that were reinitialized.
    """

    used: np.ndarray
    supported: np.ndarray
    innovations: dict[int, tuple[float, int]]
    events: tuple[Event, ...]


def update(
    tracks: TrackSet, frame: FrameInput, prediction: Prediction, association: Association, setup: TrackerSetup
) -> Update:
    """Update all tracks by their detections.

    Args:
        tracks: Updated in place: states and recent histories.
        frame: The frame.
        prediction: Predicted tracks.
        association: Assigned detections.
        setup: Setup of the tracker.
    """
    s, recent = setup.settings, tracks.recent
    if not len(tracks):
        views, keypoints = len(s.rig), len(s.skeleton)
        return Update(np.empty((0, views, keypoints), dtype=bool), np.empty((0, views), dtype=bool), {}, ())
    if s.options.single_view.enabled:
        alone = recent.single_view_s > 0.0
        state = tracks.state if prediction.state_before is None else prediction.state_before
        apply_posture_prior(state, recent, alone, frame.dt_s, s)
        apply_height_prior(state, recent, alone, frame.dt_s, s)
    if s.options.reinitialization.enabled and is_long_gap(frame.dt_s, s):
        _reinitialize_unknown_directions(tracks, prediction, association, setup)
    predicted = tracks.state if prediction.state_before is None else prediction.state_before
    lengths = setup.strategy.prior.open_shape(predicted, association.rows, s)
    use, nis = _update_states(tracks, frame, prediction, association, setup)
    setup.strategy.prior.close_shape(lengths, tracks.state, s)
    uses = KeypointUses.of(use)
    supported = uses.of_view >= s.options.min_joints
    if s.options.single_view.enabled:
        n_views = supported.sum(axis=1)
        observe_posture(tracks.state, recent, n_views, frame.dt_s, s)
        observe_height(prediction.projected, recent, n_views, frame.dt_s, s)
    events: tuple[Event, ...] = ()
    if s.options.reinitialization.enabled:
        events = _reinitialize_displaced_limbs(tracks, frame, association, uses, setup)
    n_used = uses.of_view.sum(axis=1)
    np.greater(n_used, 0, out=recent.updated)
    return Update(use == USED, supported, _innovations(tracks, nis, n_used), events)


def _update_states(
    tracks: TrackSet, frame: FrameInput, prediction: Prediction, association: Association, setup: TrackerSetup
) -> tuple[np.ndarray, np.ndarray]:
    """Update all states, view by view if the views differ in time.

    Returns:
        What each keypoint was used for, shape (track, view, keypoint), and squared innovations, shape (track,).
    """
    s, rows = setup.settings, association.shared
    noise = setup.strategy.noise.update_noise(
        association.frame, rows, association.labels, tracks.recent, frame.view_dt_s, s
    )
    use, nis = np.empty(association.labels.shape, dtype=np.int64), np.zeros(len(tracks))
    if prediction.state_before is None:
        nis += _update_by(tracks.state, rows, association, noise, setup, use)
        return use, nis
    tracks.state, now_s = prediction.state_before, frame.time_s - frame.dt_s
    # The original frame says when each view was taken; merging partial detections does not change that.
    for time_s, views in view_times(association.frame, frame.time_s):
        setup.strategy.motion.advance(tracks.state, time_s - now_s, s)
        now_s = max(now_s, time_s)
        part = np.empty_like(use)
        nis += _update_by(tracks.state, np.where(views, rows, -1), association, noise, setup, part)
        use[:, views] = part[:, views]
    return use, nis


def _update_by(
    state: State, rows: np.ndarray, association: Association, noise: UpdateNoise, setup: TrackerSetup, use: np.ndarray
) -> np.ndarray:
    """Update states by some of the detections and return squared innovations, shape (track,)."""
    s, innovation = setup.settings, np.empty(len(rows))
    keypoints_px, confidence = association.frame.keypoints_px, kernel_array(noise.confidence)
    detections = AssignedDetections(rows, association.labels, keypoints_px, confidence)
    out = UpdateResults(use, np.empty(len(rows)), innovation)
    update_people(s.cameras, s.body, noise.law, detections, noise.temper, s.options.iterations, state, out)
    return innovation


def _innovations(tracks: TrackSet, nis: np.ndarray, n_used: np.ndarray) -> dict[int, tuple[float, int]]:
    """Return innovations by track number; ``nis`` and ``n_used``, the number of used keypoints: shape (track,)."""
    each = zip(tracks.tracks, nis.tolist(), n_used.tolist(), strict=True)
    return {track.number: (total, 2 * count) for track, total, count in each if count}


def _reinitialize_unknown_directions(
    tracks: TrackSet, prediction: Prediction, association: Association, setup: TrackerSetup
) -> None:
    """Turn segments and bones whose predicted directions are unknown to where the views show them."""
    unknown = has_unknown_directions(tracks.state, setup.settings)
    rows = association.rows
    for p in np.flatnonzero(unknown.any(axis=1) & ((rows >= 0).sum(axis=1) > 1)):
        points = _triangulated_points(association.frame, rows[p], setup.propose, len(setup.settings.skeleton))
        before = prediction.state_before
        for state in (tracks.state,) if before is None else (tracks.state, before):
            reinitialize_directions(state, int(p), unknown[p], points, setup.settings)


def _reinitialize_displaced_limbs(
    tracks: TrackSet, frame: FrameInput, association: Association, uses: KeypointUses, setup: TrackerSetup
) -> tuple[Event, ...]:
    """Reinitialize limbs that most views have shown elsewhere for some time."""
    s, displaced_s = setup.settings, tracks.recent.displaced_s
    limit_s = s.options.reinitialization.limb_after_s
    if update_gated_time(uses.used, uses.gated, frame.dt_s, displaced_s) < limit_s:
        return ()
    events = []
    for p in np.flatnonzero(displaced_s.max(axis=1) >= limit_s):
        k = int(displaced_s[p].argmax())
        displaced_s[p] = 0.0
        points = _triangulated_points(association.frame, association.rows[p], setup.propose, len(s.skeleton))
        if reinitialize_limb(tracks.state, int(p), k, points, s):
            reason = f"{uses.gated[p, k]} cameras show the {s.skeleton.keypoints[k]} elsewhere"
            name = tracks.tracks[p].name
            events.append(Event(association.frame.number, frame.time_s, name, "limb_reinitialized", reason))
    return tuple(events)


def _triangulated_points(frame: Frame, rows: np.ndarray, propose: Propose, n_keypoints: int) -> np.ndarray:
    """Return the points of one person from the detections alone, shape (keypoint, 3), NaN where there are none."""
    own = np.zeros(len(frame.view), dtype=bool)
    own[rows[rows >= 0]] = True
    proposals = propose(frame, own)
    if not len(proposals):
        return np.full((n_keypoints, 3), np.nan)
    return proposals.points_m[int(proposals.n_views.argmax())]
