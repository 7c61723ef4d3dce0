"""Initiation of tracks: tentative tracks collect observations, and a body is fitted to them by the filter."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from posefuse.arrays import kernel_array
from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.records import USED, AssignedDetections, State, UpdateResults
from posefuse.kernels.tracking.update import update_people
from posefuse.kinematics.initial_pose import bone_vectors, initial_state, turn_bones
from posefuse.model.frames import Frame
from posefuse.model.graphs import best_assignment
from posefuse.model.proposals import Proposals
from posefuse.tracking.body_states import ProjectedBodies, select_states
from posefuse.tracking.frame_clock import TIME_TOLERANCE_S
from posefuse.tracking.records import Observation, PastState, TentativeTrack
from posefuse.tracking.settings import TrackerSettings, tempering_factor

_IMPOSSIBLE = 1e6
"""Cost of an assignment that is not allowed."""
_FIRST_ITERATIONS = 12
"""Gauss-Newton steps for the first frame of a body."""


def observation_of(frame: Frame, time_s: float, proposals: Proposals, index: int, mirror: np.ndarray) -> Observation:
    """Return the detections of a proposal as an observation with corrected sides.

    Args:
        frame: The detections.
        time_s: Time of the frame, in seconds.
        proposals: Proposals of the frame.
        index: Index of the proposal.
        mirror: shape (keypoint,): the keypoint of the other side.
    """
    rows = proposals.rows[index]
    shape = (len(rows), *frame.keypoints_px.shape[1:])
    pixels, confidence = np.full(shape, np.nan), np.full(shape[:2], np.nan)
    for v in np.flatnonzero(rows >= 0):
        order = mirror if proposals.swapped[index, v] else slice(None)
        pixels[v], confidence[v] = frame.keypoints_px[rows[v]][order], frame.confidence[rows[v]][order]
    return Observation(
        time_s, frame.number, pixels, confidence, rows, proposals.points_m[index], proposals.covariance_m2[index],
        proposals.torso_m[index], float(proposals.log_odds[index]), float(proposals.error_sigma[index]),
        int(proposals.n_pairs[index]),
    )  # fmt: skip


def continue_tentative(
    tracks: list[TentativeTrack],
    observations: list[Observation],
    distance: Callable[[TentativeTrack, Observation], float],
) -> list[Observation]:
    """Assign observations to tentative tracks and return the remaining observations.

    Args:
        tracks: Updated in place.
        observations: Observations of this frame.
        distance: Distance of a new observation from a track; inf if it cannot continue the track.
    """
    for track in tracks:
        track.frames += 1
    if not tracks or not observations:
        return observations
    cost = np.full((len(tracks), len(observations)), _IMPOSSIBLE)
    for i, track in enumerate(tracks):
        for j, new in enumerate(observations):
            cost[i, j] = min(distance(track, new), _IMPOSSIBLE)
    assigned = set()
    for i, j in best_assignment(cost):
        if cost[i, j] < _IMPOSSIBLE:
            tracks[i].observations.append(observations[j])
            assigned.add(j)
    return [new for j, new in enumerate(observations) if j not in assigned]


def is_of_two_views(track: TentativeTrack, settings: TrackerSettings) -> bool:
    """Return whether a tentative track was seen by hardly more views, on average, than it must be."""
    return float(np.mean([e.n_views for e in track.observations])) < settings.options.initiation.min_views + 0.5


def is_expired(track: TentativeTrack, time_s: float, min_age_s: float, settings: TrackerSettings) -> bool:
    """Return whether a tentative track is dropped; one that needs a long time to be confirmed lasts twice as long."""
    options = settings.options.initiation
    limit_s = options.max_age_s * (2.0 if min_age_s > options.min_age_two_views_s else 1.0)
    too_old = time_s - track.observations[0].time_s > limit_s + TIME_TOLERANCE_S
    return too_old or time_s - track.observations[-1].time_s > options.max_missing_s + TIME_TOLERANCE_S


@dataclass(frozen=True)
class PromotionFigures:
    """What the promotion rule compares with its thresholds.

    Attributes:
        n_hits: Number of frames that show the person.
        n_frames: Number of frames in the same time.
        n_views: Mean number of views.
        error_sigma: Reprojection error, in standard deviations.
        measure_variation: Function that returns the relative variation of bone lengths.
    """

    n_hits: int
    n_frames: float
    n_views: float
    error_sigma: float
    measure_variation: Callable[[], float]

    @cached_property
    def bone_variation(self) -> float:
        """Relative variation of bone lengths, which takes longer to compute than the others."""
        return self.measure_variation()


def promotion_figures(track: TentativeTrack, settings: TrackerSettings) -> PromotionFigures:
    """Return figures over all frames of a track: the median error, and the variation beyond the noise."""
    return PromotionFigures(
        len(track.observations),
        track.frames,
        float(np.mean([each.n_views for each in track.observations])),
        float(np.median([each.error_sigma for each in track.observations])),
        partial(_bone_variation, track, settings),
    )


def is_confirmed(
    track: TentativeTrack,
    time_s: float,
    promotion_score: float,
    min_age_s: float,
    figures: Callable[[TentativeTrack, TrackerSettings], PromotionFigures],
    settings: TrackerSettings,
) -> bool:
    """Return whether a tentative track satisfies the promotion rule.

    Args:
        track: The tentative track.
        time_s: Time of the frame, in seconds.
        promotion_score: Score that the track needs.
        min_age_s: Age that the track needs, in seconds.
        figures: Function that computes the figures of a track.
        settings: Settings of the tracker.
    """
    options = settings.options.initiation
    age = time_s - track.observations[0].time_s
    if (
        len(track.observations) < 2
        or track.observations[-1].time_s != time_s
        or age < min_age_s - TIME_TOLERANCE_S
        or not track.score >= promotion_score
    ):
        return False
    found = figures(track, settings)
    return (
        found.n_hits >= options.hit_share * found.n_frames
        and found.n_views >= options.min_views
        and found.error_sigma <= options.max_error_sigma
        and found.bone_variation <= options.max_bone_variation
    )


def core_bones(track: TentativeTrack, settings: TrackerSettings) -> tuple[np.ndarray, np.ndarray]:
    """Return lengths and variances of the core bones that more than one frame shows, shape (frame, bone) each.

    Args:
        track: The tentative track.
        settings: Settings of the tracker.
    """
    edges = settings.core_edges
    points = np.stack([e.points_m for e in track.observations])
    variances = np.stack([e.covariance_m2[:, (0, 3, 5)].mean(axis=1) for e in track.observations])
    lengths = np.linalg.norm(points[:, edges[:, 0]] - points[:, edges[:, 1]], axis=-1)
    noise = variances[:, edges].sum(axis=-1)
    usable = np.isfinite(lengths).sum(axis=0) > 1
    return lengths[:, usable], noise[:, usable]


def _bone_variation(track: TentativeTrack, settings: TrackerSettings) -> float:
    """Return the relative variation of core bone lengths beyond the noise; 0 if it cannot be measured."""
    lengths, noise = core_bones(track, settings)
    if not lengths.size:
        return 0.0
    excess = np.nanvar(lengths, axis=0, ddof=1) - np.nanmean(noise, axis=0)
    return float(np.median(np.sqrt(np.maximum(excess, 0.0)) / np.nanmean(lengths, axis=0)))


def fit_body(
    observations: list[Observation],
    settings: TrackerSettings,
    shape_m: np.ndarray | None = None,
    covariance: np.ndarray | None = None,
) -> tuple[State, list[PastState], float]:
    """Fit a body to the first observation and filter it to the last.

    Args:
        observations: Observations, oldest first.
        settings: Settings of the tracker.
        shape_m: shape (shape,): mean of the bone lengths; None for that of the tree.
        covariance: shape (shape, shape): covariance of the bone lengths; None for that of the tree.

    Returns:
        State of one body in the last frame; states in the frames before it; and the median reprojection error in the
        last frame, in standard deviations.
    """
    past: list[PastState] = []
    state = fit_last_state(observations, settings, shape_m, covariance, past)
    return state, past[:-1], reprojection_error_sigma(state, observations[-1], settings)


def fit_last_state(
    observations: list[Observation],
    settings: TrackerSettings,
    shape_m: np.ndarray | None = None,
    covariance: np.ndarray | None = None,
    past: list[PastState] | None = None,
) -> State:
    """Fit a body to the first observation, filter it to the last, and return the state of one body there.

    Args:
        observations: Observations, oldest first.
        settings: Settings of the tracker.
        shape_m: shape (shape,): mean of the bone lengths; None for that of the tree.
        covariance: shape (shape, shape): covariance of the bone lengths; None for that of the tree.
        past: Receives the states in all frames.
    """
    tree = settings.tree
    mean = tree.shape_m if shape_m is None else shape_m
    spread = tree.shape_covariance if covariance is None else covariance
    state = initial_state(tree, observations[0].points_m, mean, spread, settings.options.motion)
    seen = np.zeros(len(tree.bones), dtype=bool)
    for i, each in enumerate(observations):
        since_s = each.time_s - observations[i - 1].time_s if i else np.inf
        if i:
            predict_people(np.array([since_s]), settings.motion, state)
        shown = bone_vectors(tree, each.points_m)
        turn_bones(state.bones[0], shown, np.flatnonzero(~seen & (i > 0)))
        seen |= np.isfinite(shown).all(axis=1)
        update_by_observation(state, each, settings, since_s)
        if past is not None:
            now = select_states(state, [0])
            past.append(PastState(each.number, each.time_s, now, each.rows, each.keypoints_px, each.confidence))
    return state


def update_by_observation(
    state: State, observation: Observation, settings: TrackerSettings, since_s: float
) -> np.ndarray:
    """Update one body by an observation.

    Args:
        state: State of one body, updated in place.
        observation: The observation.
        settings: Settings of the tracker.
        since_s: Time since the last observation, with which it shares errors, in seconds; inf for the first one, which
            counts fully and is not gated.

    Returns:
        Keypoints that were used, shape (view, keypoint), bool.
    """
    views, keypoints = observation.confidence.shape
    use = np.empty((1, views, keypoints), dtype=np.int64)
    rows = np.where(observation.rows >= 0, np.arange(views), -1)[None]
    labels = np.tile(np.arange(keypoints), (1, views, 1))
    first = np.isinf(since_s)
    law = settings.law._replace(gate=np.inf) if first else settings.law
    temper = tempering_factor(np.array([since_s]), settings.options.error_memory_s)
    keypoints_px, confidence = kernel_array(observation.keypoints_px), kernel_array(observation.confidence)
    detections = AssignedDetections(rows, labels, keypoints_px, confidence)
    iterations = _FIRST_ITERATIONS if first else settings.options.iterations
    out = UpdateResults(use, np.empty(1), np.empty(1))
    update_people(settings.cameras, settings.body, law, detections, temper, iterations, state, out)
    return use[0] == USED


def reprojection_error_sigma(state: State, observation: Observation, settings: TrackerSettings) -> float:
    """Return the median reprojection error of one body, in standard deviations; inf without keypoints."""
    projected = ProjectedBodies.of(state, settings.cameras, settings.body)
    law = settings.law
    confidence = np.where(np.isfinite(observation.confidence), observation.confidence, 1.0)
    sigma = law.scale_px[:, None] * np.maximum(confidence, 0.05) ** -law.exponent
    sigma = np.hypot(sigma, law.floor_m * projected.px_per_m[0])
    error = np.linalg.norm(observation.keypoints_px - projected.pixels[0], axis=-1) / sigma
    return float(np.median(error[np.isfinite(error)])) if np.isfinite(error).any() else np.inf
