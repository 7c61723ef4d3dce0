"""The strategy `posefuse`: log odds, tempered noise model, propagated covariance. See docs/methods/tracking.md."""

import math
from collections.abc import Sequence

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.records import Detections
from posefuse.kernels.tracking.frame_statistics import add_identity_scores
from posefuse.kernels.tracking.matching import score_detections
from posefuse.kernels.tracking.records import DetectionScores, MatchParameters, State
from posefuse.model.frames import Frame
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.reacquisition import find_reacquired_tracks
from posefuse.tracking.records import Observation, PastState, RecentHistory, TentativeTrack, Track
from posefuse.tracking.reidentification import Reidentification, find_lost_track
from posefuse.tracking.settings import TrackerSettings, filter_memory_s, tempering_factor
from posefuse.tracking.strategy import FrameOutcome, MatchScores, Noise, Strategy, UpdateNoise
from posefuse.tracking.track_initiation import PromotionFigures, fit_body, is_of_two_views, promotion_figures
from posefuse.tracking.track_set import advance_state

_MIN_EVIDENCE = 1e-3
"""Evidence per frame, in nats, below which views practically never confirm a track."""


class PropagatedPrior:
    """Prior of the Kalman filter: the covariance of the prediction is F P F^T + Q."""

    def prepare(self, state: State, recent: RecentHistory) -> None:
        """Keep the states as they are."""

    def open_shape(self, state: State, rows: np.ndarray, settings: TrackerSettings) -> np.ndarray | None:
        """Keep the lengths as they are."""

    def close_shape(self, before: np.ndarray | None, state: State, settings: TrackerSettings) -> None:
        """Keep the lengths of the update."""


class TemperedNoise:
    """Noise by confidence, with a floor of the body model, tempered for the correlation of errors in time."""

    def variance_px2(
        self, projected: ProjectedBodies, frame: Frame, recent: RecentHistory, settings: TrackerSettings
    ) -> np.ndarray:
        """Return the noise variances, shape (track, row, keypoint)."""
        floor_px = settings.law.floor_m * projected.px_per_m[:, frame.view]
        return settings.variance_px2(frame.confidence, frame.view) + floor_px**2

    def update_noise(
        self,
        frame: Frame,
        rows: np.ndarray,
        labels: np.ndarray,
        recent: RecentHistory,
        dt_s: float,
        settings: TrackerSettings,
    ) -> UpdateNoise:
        """Return the noise model with the detector's confidences."""
        since_s, n_views = np.full(len(rows), dt_s), (rows >= 0).sum(axis=1)
        memory_s = filter_memory_s(n_views, recent.single_view_s, since_s, settings.options)
        return UpdateNoise(settings.law, frame.confidence, tempering_factor(since_s, memory_s))

    def adapt(self, outcome: FrameOutcome, recent: RecentHistory, state: State, settings: TrackerSettings) -> None:
        """Change nothing: the noise model is fixed."""


class FadingMotion:
    """Velocities that decay, each number of the pose on its own."""

    def advance(self, state: State, dt_s: float, settings: TrackerSettings) -> None:
        """Predict states by a time, in place; a negative time counts as zero."""
        advance_state(state, dt_s, settings)


class LogOddsScore:
    """Log odds that a detection shows a person, and that a person is present."""

    def match(
        self, projected: ProjectedBodies, frame: Frame, recent: RecentHistory, noise: Noise, settings: TrackerSettings
    ) -> MatchScores:
        """Score matches by the predictive likelihood against clutter, with sides as labeled or swapped."""
        s, o, n = settings, settings.options, len(recent.detector_ids)
        scores = np.empty((n, len(frame.view)))
        shape = (n, len(frame.view), s.n_groups)
        swapped, odds = np.zeros(shape, dtype=np.int8), np.empty(shape)
        parameters = MatchParameters(
            o.clutter_m, o.keypoint_evidence, o.independent_keypoints,
            min(o.match_evidence, o.lifecycle.explained_evidence) - max(o.id_evidence, 0.0),
        )  # fmt: skip
        score_detections(
            projected.arrays, Detections(frame.keypoints_px, frame.confidence, frame.view), s.sides, s.law,
            recent.swapped, parameters, DetectionScores(scores, swapped, odds),
        )  # fmt: skip
        explained = np.empty(len(frame.view), dtype=bool)
        track_ids, least = frozen(frame.track_ids, np.int64), o.lifecycle.explained_evidence
        add_identity_scores(recent.detector_ids, frame.view, track_ids, o.id_evidence, least, scores, explained)
        return MatchScores(scores, o.match_evidence, swapped, odds, explained)

    def tentative_score(self, track: TentativeTrack, time_s: float, dt_s: float, settings: TrackerSettings) -> float:
        """Return the sum of the log odds of all observations."""
        return sum(each.log_odds for each in track.observations)

    def promotion_score(self, settings: TrackerSettings) -> float:
        """Return the log odds that a track needs."""
        return settings.options.initiation.promote_log_odds

    def min_age_s(self, track: TentativeTrack, settings: TrackerSettings) -> float:
        """Return the age that a track needs; two views must accumulate ``two_views_log_odds``."""
        initiation = settings.options.initiation
        if not is_of_two_views(track, settings):
            return initiation.min_age_s
        gain, loss = _view_evidence(settings)
        shown = [gain * each.n_views + loss * each.n_silent for each in track.observations]
        evidence = max(float(np.mean(shown)), _MIN_EVIDENCE) / settings.options.evidence_time_s
        return max(initiation.min_age_two_views_s, initiation.two_views_log_odds / evidence)

    def track_scores(
        self, outcome: FrameOutcome, tracks: Sequence[Track], state: State, settings: TrackerSettings
    ) -> np.ndarray:
        """Add the evidence of views that show a person, and of views that should and do not."""
        o = settings.options
        gain, loss = _view_evidence(settings)
        least, weight = -o.lifecycle.max_missing_views * gain, min(1.0, outcome.dt_s / o.evidence_time_s)
        n_supported = outcome.supported.sum(axis=1).tolist()
        n_missing = (outcome.expected & ~outcome.supported).sum(axis=1).tolist()
        scores = np.empty(len(tracks))
        for p, (track, shown, missing) in enumerate(zip(tracks, n_supported, n_missing, strict=True)):
            missed = loss * missing
            # What occludes a person in one view often does so in others; a coincidence is not occluded.
            if shown and track.established:
                missed = max(missed, least)
            score = track.log_odds + (gain * shown + missed) * weight
            scores[p] = min(max(score, -o.max_log_odds), o.max_log_odds)
        return scores

    def initial_score(self, settings: TrackerSettings) -> float:
        """Return half of the largest log odds."""
        return settings.options.max_log_odds / 2

    def lost_score(self, settings: TrackerSettings) -> float:
        """Return the log odds below which a person is probably absent."""
        return settings.options.lost_log_odds

    def established_score(self, settings: TrackerSettings) -> float:
        """Return the largest log odds."""
        return settings.options.max_log_odds


def _view_evidence(settings: TrackerSettings) -> tuple[float, float]:
    """Return the log likelihood ratios of a view that shows a person, and of one that should and does not."""
    o = settings.options
    return math.log(o.detection_share / o.false_share), math.log((1.0 - o.detection_share) / (1.0 - o.false_share))


class TrunkDistance:
    """Distances between trunks in meters, and log odds of bone lengths."""

    def merge(self, observations: list[Observation], settings: TrackerSettings) -> list[Observation]:
        """Return the proposals unchanged: groups of detections are one per person already."""
        return observations

    def distance(self, track: TentativeTrack, new: Observation, settings: TrackerSettings) -> float:
        """Return the distance from the last trunk, in meters; inf beyond the reach of a person."""
        options, last = settings.options, track.observations[-1]
        reach = options.initiation.gate_m + options.motion.top_speed_m_s * (new.time_s - last.time_s)
        distance = float(np.linalg.norm(new.torso_m - last.torso_m))
        return distance if distance < reach else math.inf

    def find_lost(
        self,
        tracks: list[Track],
        state: State,
        fitted: State,
        observation: Observation,
        since_s: float,
        time_s: float,
        settings: TrackerSettings,
    ) -> Reidentification | None:
        """Find the lost track by position and bone lengths."""
        return find_lost_track(tracks, state, fitted, observation, since_s, time_s, settings)

    def find_reacquired(
        self, tracks: list[Track], state: State, tentative: list[TentativeTrack], settings: TrackerSettings
    ) -> list[tuple[Reidentification, TentativeTrack]]:
        """Find the lost tracks by the log odds of the proposals, of the position, and of the bone lengths."""
        return find_reacquired_tracks(tracks, state, tentative, settings)


class FilteredBody:
    """Figures of all frames, and a body filtered from the detections of all observations."""

    def figures(self, track: TentativeTrack, settings: TrackerSettings) -> PromotionFigures:
        """Return the median error, and the variation of bone lengths beyond the noise."""
        return promotion_figures(track, settings)

    def fit(self, track: TentativeTrack, settings: TrackerSettings) -> tuple[State, list[PastState], float]:
        """Fit a body to the first observation and filter it to the last."""
        return fit_body(track.observations, settings)


STRATEGY = Strategy(
    PropagatedPrior(), TemperedNoise(), LogOddsScore(), TrunkDistance(), FadingMotion(), FilteredBody()
)  # fmt: skip
