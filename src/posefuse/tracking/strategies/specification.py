"""The strategy `specification`: the specification's own scores, noise recursion, prior and proposal distance.

The terms are those of the specification, with the minus signs that its displayed equations have lost, and with seconds
for frames and standard deviations for pixels. Each term can be switched off by an option. See
docs/methods/specification.md. The strategy serves comparisons and uses plain NumPy.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from posefuse.arrays import frozen
from posefuse.errors import OptionsError, choices
from posefuse.kernels.tracking.records import State
from posefuse.model.frames import Frame
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.records import PastState, RecentHistory, TentativeTrack, Track
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategies.pelvis_distance import PelvisDistance
from posefuse.tracking.strategies.promotion_fit import fit_first_body
from posefuse.tracking.strategies.tentative_state import buffer_of
from posefuse.tracking.strategies.twist_motion import TwistMotion
from posefuse.tracking.strategy import FrameOutcome, MatchScores, Noise, Strategy, UpdateNoise
from posefuse.tracking.track_initiation import PromotionFigures, core_bones, fit_body, is_of_two_views

_MIN_VARIANCE = 1e-10
"""Variance that remains of a reset covariance, in m^2 and rad^2, so that it has an inverse where no time has passed."""
_MATCH_GAIN = 1e6
"""Gain of a match before its cost: as many detections as possible are matched, at the least total cost."""
_MIN_AGE_S = 1e-9
_MIN_CONFIDENCE = 0.5
"""Confidences that encode noise are at least 1, those of unused keypoints are 0."""


class ProcessNoisePrior:
    """Prior of process noise alone: the prediction is certain up to the process noise since the last update."""

    def prepare(self, state: State, recent: RecentHistory) -> None:
        """Reset the covariance of the tracks that the last frame updated; that of the others keeps growing."""
        size = state.covariance.shape[1]
        n, h = state.velocity.shape[1], state.shape.shape[1]
        for p in np.flatnonzero(recent.updated):
            certain = np.full(size, _MIN_VARIANCE)
            certain[n : n + h] *= float(state.free[p] != 0)
            state.covariance[p] = np.diag(certain)

    def open_shape(self, state: State, rows: np.ndarray, settings: TrackerSettings) -> np.ndarray | None:
        """Give the lengths of matched bodies the prior from which an update computes their step.

        The squared distances from the predicted lengths and, with weight lambda_beta, from those of all people, both in
        units of the tree's covariance, sum to one quadratic form.
        """
        options, tree = settings.options.specification, settings.tree
        if options.shape_gain is None:
            return None
        n, h, weight = tree.n_pose, tree.n_shape, options.shape_weight
        before = np.full_like(state.shape, np.nan)
        for p in np.flatnonzero((state.free != 0) & (rows >= 0).any(axis=1)):
            before[p] = state.shape[p]
            state.shape[p] = (before[p] + weight * tree.shape_m) / (1.0 + weight)
            state.covariance[p, n : n + h] = 0.0
            state.covariance[p, :, n : n + h] = 0.0
            state.covariance[p, n : n + h, n : n + h] = tree.shape_covariance / (1.0 + weight)
        return before

    def close_shape(self, before: np.ndarray | None, state: State, settings: TrackerSettings) -> None:
        """Apply the fraction eta_beta of the step of the lengths."""
        gain = settings.options.specification.shape_gain
        if before is not None and gain is not None:
            state.shape[:] = np.where(np.isfinite(before), before + gain * (state.shape - before), state.shape)


class RecursiveNoise:
    """Noise variance per view and keypoint of a person, updated by confidences and residuals."""

    def variance_px2(
        self, projected: ProjectedBodies, frame: Frame, recent: RecentHistory, settings: TrackerSettings
    ) -> np.ndarray:
        """Return the noise variances, shape (track, row, keypoint)."""
        known = recent.noise_px2[:, frame.view]
        base = settings.variance_px2(frame.confidence, frame.view)
        return _clip(np.where(np.isfinite(known), known, base), frame.view, settings)

    def update_noise(
        self,
        frame: Frame,
        rows: np.ndarray,
        labels: np.ndarray,
        recent: RecentHistory,
        dt_s: float,
        settings: TrackerSettings,
    ) -> UpdateNoise:
        """Encode the variances as confidences of a noise model that has the largest noise at confidence 1.

        A keypoint is assigned to at most one person, so its confidence encodes that person's variances.
        Frames count as independent.
        """
        most_px = settings.options.specification.max_noise * settings.law.scale_px
        confidence = np.zeros(frame.confidence.shape)
        for p, v in zip(*np.nonzero(rows >= 0), strict=True):
            row, own = rows[p, v], labels[p, v] >= 0
            order = labels[p, v, own]
            base = settings.variance_px2(frame.confidence[row : row + 1], np.array([v]))[0]
            known = recent.noise_px2[p, v, own]
            variance = np.where(np.isfinite(known), known, base[order])
            variance = _clip(variance[None], np.array([v]), settings)[0]
            usable = _is_usable(frame.confidence[row], settings)[order]
            confidence[row, order] = np.where(usable, most_px[v] / np.sqrt(variance), 0.0)
        law = settings.law._replace(scale_px=most_px, exponent=1.0, floor_m=0.0, min_confidence=_MIN_CONFIDENCE)
        return UpdateNoise(law, frozen(confidence), np.ones(len(rows)))

    def adapt(self, outcome: FrameOutcome, recent: RecentHistory, state: State, settings: TrackerSettings) -> None:
        """Apply one step of the recursion to the used keypoints."""
        o = settings.options.specification
        keep = math.exp(-outcome.dt_s / o.noise_memory_s)
        off_px = residuals_px(outcome, state, settings)
        for p, v in zip(*np.nonzero(outcome.rows >= 0), strict=True):
            confidence = outcome.frame.confidence[outcome.rows[p, v]][None, outcome.labels[p, v]]
            base = settings.variance_px2(confidence, np.array([v]))[0]
            most_px = o.max_residual_sigma * settings.law.scale_px[v]
            now = base + o.noise_gain * np.minimum(off_px[p, v], most_px) ** 2
            known = recent.noise_px2[p, v]
            after = keep * np.where(np.isfinite(known), known, base) + (1.0 - keep) * now
            after = _clip(after[None], np.array([v]), settings)[0]
            recent.noise_px2[p, v] = np.where(outcome.used[p, v], after, known)


class WeightedScore:
    """Weighted sums of terms for and against a match or a person."""

    def match(
        self, projected: ProjectedBodies, frame: Frame, recent: RecentHistory, noise: Noise, settings: TrackerSettings
    ) -> MatchScores:
        """Score matches by squared normalized distances, with a bonus for an unchanged 2D track identity."""
        o = settings.options.specification
        off = frame.keypoints_px[None] - projected.pixels[:, frame.view]
        squared = (off**2).sum(axis=-1) / noise.variance_px2(projected, frame, recent, settings)
        weights = joint_weights(settings)
        common = np.isfinite(squared) & _is_usable(frame.confidence, settings) & (weights > 0.0)
        squared = np.where(common, weights * np.where(common, squared, 0.0), 0.0).sum(axis=-1)
        count, total = common.sum(axis=-1), np.where(common, weights, 0.0).sum(axis=-1)
        ids = recent.detector_ids[:, frame.view]
        cost = squared - o.id_bonus * ((ids == frame.track_ids) & (frame.track_ids >= 0))
        enough = count >= min(settings.options.min_joints, int((weights > 0.0).sum()))
        near = enough & (squared <= o.match_gate * total)
        swapped = np.zeros((*cost.shape, settings.n_groups), dtype=np.int8)
        gain = np.ascontiguousarray(np.where(near, _MATCH_GAIN - cost, -np.inf))
        return MatchScores(gain, 0.0, swapped, np.zeros(swapped.shape), np.zeros(len(frame.view), dtype=bool))

    def tentative_score(self, track: TentativeTrack, time_s: float, dt_s: float, settings: TrackerSettings) -> float:
        """Add pairs and views; subtract reprojection errors, variation of bone lengths and missing frames."""
        o = settings.options.specification
        last = track.observations[-1]
        if last.time_s == time_s:
            gain = o.pairs_weight * last.n_pairs + o.views_weight * last.n_views - o.error_weight * last.error_sigma
        else:
            gain = -o.missing_weight
        keep = math.exp(-dt_s / o.score_memory_s)
        return keep * track.score + (1.0 - keep) * (gain - o.bones_weight * _bone_variation(track, settings))

    def promotion_score(self, settings: TrackerSettings) -> float:
        """Return tau_promote."""
        return settings.options.specification.promote_score

    def min_age_s(self, track: TentativeTrack, settings: TrackerSettings) -> float:
        """Return A_min, which is longer for two views."""
        options = settings.options.initiation
        return options.min_age_two_views_s if is_of_two_views(track, settings) else options.min_age_s

    def track_scores(
        self, outcome: FrameOutcome, tracks: Sequence[Track], state: State, settings: TrackerSettings
    ) -> np.ndarray:
        """Add views and used keypoints; subtract reprojection errors and frames without support."""
        o = settings.options.specification
        views, shown = outcome.supported.sum(axis=1), outcome.used.any(axis=1).mean(axis=1)
        error = _mean_sigma(residuals_px(outcome, state, settings), outcome, settings)
        gain = o.active_views_weight * views + o.active_joints_weight * shown
        gain = gain - o.active_error_weight * error - o.active_missing_weight * (views == 0)
        keep = math.exp(-outcome.dt_s / o.score_memory_s)
        return keep * np.array([track.log_odds for track in tracks]) + (1.0 - keep) * gain

    def initial_score(self, settings: TrackerSettings) -> float:
        """Return the score that promotion needs."""
        return settings.options.specification.promote_score

    def lost_score(self, settings: TrackerSettings) -> float:
        """Return tau_lost."""
        return settings.options.specification.lost_score

    def established_score(self, settings: TrackerSettings) -> float:
        """Return -inf: no promoted track is taken for a coincidence."""
        return -math.inf


class CoreBody:
    """Figures of the buffer; bone lengths by weighted medians over it, and a pose of the core keypoints."""

    def figures(self, track: TentativeTrack, settings: TrackerSettings) -> PromotionFigures:
        """Return the share of hits in the last L frames, mean views and errors, and the variation of bone lengths."""
        buffer = buffer_of(track, settings)
        last_s = track.observations[-1].time_s
        age_s = last_s - track.observations[0].time_s
        n_frames = 1.0 + (track.frames - 1) * min(1.0, settings.options.specification.buffer_s / max(age_s, _MIN_AGE_S))
        return PromotionFigures(
            len(buffer),
            round(n_frames),
            float(np.mean([each.n_views for each in buffer])),
            float(np.mean([each.error_sigma for each in buffer])),
            partial(_bone_variation, track, settings),
        )

    def fit(self, track: TentativeTrack, settings: TrackerSettings) -> tuple[State, list[PastState], float]:
        """Fit a body to the buffer of a tentative track."""
        if not settings.options.specification.promotion_fit:
            return fit_body(track.observations, settings)
        return fit_first_body(buffer_of(track, settings), settings)


def configure(settings: TrackerSettings) -> TrackerSettings:
    """Return the settings with the strategy's rules of termination, with lengths fixed once, and without a smoother.

    Each detection belongs to one person. The covariances of the strategy do not allow a smoother to use later frames.

    Raises:
        OptionsError: If a joint weight is of a keypoint that the skeleton lacks.
    """
    options, o = settings.options, settings.options.specification
    unknown = [name for name in o.weight_of_joint if name not in settings.skeleton.keypoints]
    if unknown:
        raise OptionsError(
            f"tracker.specification.joint_weights names {unknown[0]!r}, which is no keypoint of the skeleton "
            f"{settings.skeleton.name!r}. Its keypoints: {choices(settings.skeleton.keypoints, 30)}."
        )
    beyond_m, outside_s = options.terminate_beyond_m, options.terminate_outside_after_s
    if beyond_m is None and o.terminate_variance_m2 is not None:
        beyond_m = math.sqrt(o.terminate_variance_m2)
    outside_s = o.terminate_outside_after_s if outside_s is None else outside_s
    options = replace(
        options, smoother="none", terminate_beyond_m=beyond_m, terminate_outside_after_s=outside_s,
        fix_shape_sd_m=None, reopen_shape_sigma=None,
        shared_detections=replace(options.shared_detections, enabled=False),
    )  # fmt: skip
    return replace(settings, options=options)


STRATEGY = Strategy(
    ProcessNoisePrior(), RecursiveNoise(), WeightedScore(), PelvisDistance(), TwistMotion(), CoreBody(), configure
)


def joint_weights(settings: TrackerSettings) -> np.ndarray:
    """Return the weights of keypoints in the matching cost, shape (keypoint,), 0 where a keypoint does not count."""
    options = settings.options.specification
    weights = np.ones(len(settings.skeleton))
    if options.core_matching:
        weights[:] = 0.0
        weights[settings.core] = 1.0
    for name, weight in options.weight_of_joint.items():
        weights[settings.skeleton.index(name)] *= weight
    return weights


def residuals_px(outcome: FrameOutcome, state: State, settings: TrackerSettings) -> np.ndarray:
    """Return the distances of matched keypoints from those of the updated bodies, shape (track, view, keypoint)."""
    matched = (outcome.rows >= 0)[..., None, None]
    pixels = np.nan
    if matched.any():
        pixels = outcome.frame.keypoints_px[np.maximum(outcome.rows, 0)[..., None], outcome.labels]
    residuals = np.where(matched, pixels, np.nan) - _projected(state, settings).pixels
    return np.linalg.norm(residuals, axis=-1)


def _projected(state: State, settings: TrackerSettings) -> ProjectedBodies:
    return ProjectedBodies.of(state, settings.cameras, settings.body)


def _clip(variance_px2: np.ndarray, view: np.ndarray, settings: TrackerSettings) -> np.ndarray:
    """Limit variances to those between ``min_noise`` and ``max_noise``, shape (..., row or view, keypoint)."""
    o, scale_px = settings.options.specification, settings.law.scale_px[view][:, None]
    return np.clip(variance_px2, (o.min_noise * scale_px) ** 2, (o.max_noise * scale_px) ** 2)


def _is_usable(confidence: np.ndarray, settings: TrackerSettings) -> np.ndarray:
    """Return the keypoints with a high enough confidence, or with none."""
    return ~(confidence < settings.law.min_confidence)


def _bone_variation(track: TentativeTrack, settings: TrackerSettings) -> float:
    """Return the median coefficient of variation of core bone lengths in the buffer; 0 for a single frame."""
    lengths, _ = core_bones(TentativeTrack(track.number, buffer_of(track, settings)), settings)
    if not lengths.size:
        return 0.0
    return float(np.median(np.nanstd(lengths, axis=0, ddof=1) / np.nanmean(lengths, axis=0)))


def _mean_sigma(off_px: np.ndarray, outcome: FrameOutcome, settings: TrackerSettings) -> np.ndarray:
    """Return the mean residual of used keypoints, in standard deviations at confidence 1, shape (track,)."""
    counted = outcome.used & np.isfinite(off_px)
    relative = np.where(counted, off_px, 0.0) / settings.law.scale_px[:, None]
    return relative.sum(axis=(1, 2)) / np.maximum(counted.sum(axis=(1, 2)), 1)
