"""The preset `specification`: the seed's own scores, noise recursion, prior and distance of proposals.

As they stand there, with the minus signs that its displayed equations have lost, and with seconds for frames and
sigmas for pixels; docs/methods.md, "The specification's own terms", has the formulas and what is read into them. Kept
to be compared with: plain NumPy.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse.csgraph import connected_components

from posefuse.arrays import frozen
from posefuse.kernels.tracking.records import State
from posefuse.model.frames import Frame
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import Sight
from posefuse.tracking.records import Evidence, Lately, Tentative, Track
from posefuse.tracking.settings import Settings
from posefuse.tracking.stages import Likeness, Noise, Seen, Stages, Trust
from posefuse.tracking.track_initiation import core_bones, is_of_two_views

_CERTAIN = 1e-10
"""What is left of a covariance that is forgotten, m^2 and rad^2: it keeps its inverse where no time has passed."""
_MATCHED = 1e6
"""What a match is worth before its cost, so that as many as pass the gate are matched, at the least cost together."""
_USABLE = 0.5
"""Confidences made of noises are 1 at least, of keypoints that do not count 0."""


class ProcessNoisePrior:
    """The prediction is certain but for the process noise since the last update: x - x' in Q^-1."""

    smoothable = False

    def settle(self, state: State, lately: Lately) -> None:
        """Forget the covariance of everybody whom the last frame showed; others' goes on growing."""
        size = state.covariance.shape[1]
        n, h = state.velocity.shape[1], state.shape.shape[1]
        for p in np.flatnonzero(lately.renewed):
            certain = np.full(size, _CERTAIN)
            certain[n : n + h] *= float(state.free[p] != 0)
            state.covariance[p] = np.diag(certain)


class RecursiveNoise:
    """A variance for each view and keypoint of a person, fed by confidences and by residuals."""

    def variance_px2(self, sight: Sight, frame: Frame, lately: Lately, settings: Settings) -> np.ndarray:
        """Shape (track, row, keypoint)."""
        known = lately.noise_px2[:, frame.view]
        base = settings.variance_px2(frame.confidence, frame.view)
        return _clipped(np.where(np.isfinite(known), known, base), frame.view, settings)

    def trust(
        self,
        frame: Frame,
        rows: np.ndarray,
        labels: np.ndarray,
        lately: Lately,
        dt_s: float,
        settings: Settings,
    ) -> Trust:
        """The variances, as confidences of a law whose noise at confidence 1 is the greatest there can be.

        A detection is one person's at most, so that its confidences can stand for that person's variances. Frames are
        taken for independent.
        """
        most_px = settings.options.specification.max_noise * settings.law.scale_px
        confidence = np.zeros(frame.confidence.shape)
        for p, v in zip(*np.nonzero(rows >= 0), strict=True):
            row, order = rows[p, v], labels[p, v]
            base = settings.variance_px2(frame.confidence[row : row + 1], np.array([v]))[0]
            known = lately.noise_px2[p, v]
            variance = np.where(np.isfinite(known), known, base[order])
            variance = _clipped(variance[None], np.array([v]), settings)[0]
            usable = _is_usable(frame.confidence[row], settings)[order]
            confidence[row, order] = np.where(usable, most_px[v] / np.sqrt(variance), 0.0)
        law = settings.law._replace(scale_px=most_px, exponent=1.0, floor_m=0.0, min_confidence=_USABLE)
        return Trust(law, frozen(confidence), np.ones(len(rows)))

    def learn(self, seen: Seen, lately: Lately, state: State, settings: Settings) -> None:
        """One step of the recursion, for the keypoints that counted."""
        o = settings.options.specification
        keep = math.exp(-seen.dt_s / o.noise_memory_s)
        off_px = residuals_px(seen, state, settings)
        for p, v in zip(*np.nonzero(seen.rows >= 0), strict=True):
            confidence = seen.frame.confidence[seen.rows[p, v]][None, seen.labels[p, v]]
            base = settings.variance_px2(confidence, np.array([v]))[0]
            most_px = o.max_residual_sigma * settings.law.scale_px[v]
            now = base + o.noise_gain * np.minimum(off_px[p, v], most_px) ** 2
            known = lately.noise_px2[p, v]
            after = keep * np.where(np.isfinite(known), known, base) + (1.0 - keep) * now
            after = _clipped(after[None], np.array([v]), settings)[0]
            lately.noise_px2[p, v] = np.where(seen.used[p, v], after, known)


class WeightedScore:
    """Sums of weighted terms: of a detection's squared distances, of what speaks for a person and against them."""

    def match(self, sight: Sight, frame: Frame, lately: Lately, noise: Noise, settings: Settings) -> Likeness:
        """By the sum of squared distances in sigmas, less the bonus for the detector's own identity."""
        o = settings.options.specification
        off = frame.keypoints_px[None] - sight.pixels[:, frame.view]
        squared = (off**2).sum(axis=-1) / noise.variance_px2(sight, frame, lately, settings)
        common = np.isfinite(squared) & _is_usable(frame.confidence, settings)
        squared, count = np.where(common, squared, 0.0).sum(axis=-1), common.sum(axis=-1)
        ids = lately.ids[:, frame.view]
        cost = squared - o.id_bonus * ((ids == frame.track_ids) & (frame.track_ids >= 0))
        near = (count >= settings.options.min_joints) & (squared <= o.match_gate * count)
        swapped = np.zeros((*cost.shape, settings.n_groups), dtype=np.int8)
        gain = np.ascontiguousarray(np.where(near, _MATCHED - cost, -np.inf))
        return Likeness(gain, 0.0, swapped, np.zeros(swapped.shape), np.zeros(len(frame.view), dtype=bool))

    def tentative(self, each: Tentative, time_s: float, dt_s: float, settings: Settings) -> float:
        """Pairs and views speak for it, reprojection errors, varying bones and misses against it."""
        o = settings.options.specification
        last = each.evidence[-1]
        if last.time_s == time_s:
            gain = o.pairs_weight * last.n_pairs + o.views_weight * last.n_views - o.error_weight * last.error_sigma
        else:
            gain = -o.missing_weight
        keep = math.exp(-dt_s / o.score_memory_s)
        return keep * each.score + (1.0 - keep) * (gain - o.bones_weight * _bone_variation(each, settings))

    def promotes_from(self, settings: Settings) -> float:
        """tau_promote."""
        return settings.options.specification.promote_score

    def waits_s(self, each: Tentative, settings: Settings) -> float:
        """A_min, longer where two views see them."""
        births = settings.options.births
        return births.min_age_two_views_s if is_of_two_views(each, settings) else births.min_age_s

    def active(self, seen: Seen, tracks: Sequence[Track], state: State, settings: Settings) -> np.ndarray:
        """Views and keypoints speak for somebody, reprojection errors and frames without support against them."""
        o = settings.options.specification
        views, shown = seen.supported.sum(axis=1), seen.used.any(axis=1).mean(axis=1)
        error = _mean_sigma(residuals_px(seen, state, settings), seen, settings)
        gain = o.active_views_weight * views + o.active_joints_weight * shown
        gain = gain - o.active_error_weight * error - o.active_missing_weight * (views == 0)
        keep = math.exp(-seen.dt_s / o.score_memory_s)
        return keep * np.array([track.log_odds for track in tracks]) + (1.0 - keep) * gain

    def begins_with(self, settings: Settings) -> float:
        """As much as it took to be believed."""
        return settings.options.specification.promote_score

    def lost_below(self, settings: Settings) -> float:
        """tau_lost."""
        return settings.options.specification.lost_score

    def sure_from(self, settings: Settings) -> float:
        """Who is promoted is there."""
        return -math.inf


class PelvisDistance:
    """Squared metres between pelvises, and between core keypoints about them, each in its unit."""

    def merge(self, found: list[Evidence], settings: Settings) -> list[Evidence]:
        """Clusters of proposals, those that are near each other or to one in between; each at its centroid."""
        if len(found) < 2:
            return found
        points = np.stack([each.points_m for each in found])
        near = proposal_distance(points[:, None], points[None], settings) <= settings.options.specification.cluster_gate
        labels = connected_components(near, directed=False)[1]
        return [_centroid([found[i] for i in np.flatnonzero(labels == n)]) for n in dict.fromkeys(labels.tolist())]

    def apart(self, last: Evidence, new: Evidence, settings: Settings) -> float:
        """d_prop; inf beyond the gate."""
        away = float(proposal_distance(last.points_m, new.points_m, settings))
        return away if away <= settings.options.specification.cluster_gate else math.inf

    def returning(
        self, tracks: list[Track], state: State, born: State, seen: Evidence, since_s: float, time_s: float,
        settings: Settings,
    ) -> tuple[int, str, str] | None:  # fmt: skip
        """Whoever is foretold nearest to the proposal, if near enough (C_reacq)."""
        lost = [p for p, track in enumerate(tracks) if track.state == TrackState.LOST]
        if not lost:
            return None
        away = proposal_distance(_foreseen(state, settings).points_m[lost], seen.points_m, settings)
        best = int(np.argmin(away))
        if not away[best] <= settings.options.specification.reacquire_gate:
            return None
        lost_s = time_s - tracks[lost[best]].seen_s
        return lost[best], f"C_reacq {away[best]:.1f} from where they are foretold after {lost_s:.1f} s", ""


STAGES = Stages(ProcessNoisePrior(), RecursiveNoise(), WeightedScore(), PelvisDistance())


def proposal_distance(one_m: np.ndarray, other_m: np.ndarray, settings: Settings) -> np.ndarray:
    """The seed's d_prop, and its C_reacq: |r - r'|^2 / tau_r^2 + lambda_Z sum |Z - Z'|^2 / tau_Z^2.

    Args:
        one_m: shape (..., keypoint, 3), NaN where missing.
        other_m: the same, shapes that go together.
        settings: of the tracker.

    Returns:
        Shape (...), without unit; the sum is over the core keypoints that both have. inf where there are none.
    """
    o = settings.options.specification
    roots = [_pelvis(points, settings) for points in (one_m, other_m)]
    one, other = (points[..., settings.core, :] - root for points, root in zip((one_m, other_m), roots, strict=True))
    squared = ((one - other) ** 2).sum(axis=-1)
    moved = ((roots[0] - roots[1])[..., 0, :] ** 2).sum(axis=-1)
    shapes = np.where(np.isfinite(squared), squared, 0.0).sum(axis=-1)
    total = moved / o.tau_root_m**2 + o.core_weight * shapes / o.tau_core_m**2
    return np.where(np.isfinite(squared).any(axis=-1), total, np.inf)


def residuals_px(seen: Seen, state: State, settings: Settings) -> np.ndarray:
    """Shape (track, view, keypoint): how far matched keypoints are from where the updated bodies have them, or NaN."""
    there = (seen.rows >= 0)[..., None, None]
    theirs = seen.frame.keypoints_px[np.maximum(seen.rows, 0)[..., None], seen.labels] if there.any() else np.nan
    off = np.where(there, theirs, np.nan) - _foreseen(state, settings).pixels
    return np.linalg.norm(off, axis=-1)


def _foreseen(state: State, settings: Settings) -> Sight:
    return Sight.of(state, settings.cameras, settings.body)


def _clipped(variance_px2: np.ndarray, view: np.ndarray, settings: Settings) -> np.ndarray:
    """Between the least and the greatest there can be; shape (..., row or view, keypoint)."""
    o, scale_px = settings.options.specification, settings.law.scale_px[view][:, None]
    return np.clip(variance_px2, (o.min_noise * scale_px) ** 2, (o.max_noise * scale_px) ** 2)


def _is_usable(confidence: np.ndarray, settings: Settings) -> np.ndarray:
    """Which keypoints a detector is sure enough of; all where it does not say."""
    return ~(confidence < settings.law.min_confidence)


def _bone_variation(each: Tentative, settings: Settings) -> float:
    """The median coefficient of variation of the lengths of the core's bones; 0 of a single frame."""
    lengths, _ = core_bones(each, settings)
    if not lengths.size:
        return 0.0
    return float(np.median(np.nanstd(lengths, axis=0, ddof=1) / np.nanmean(lengths, axis=0)))


def _mean_sigma(off_px: np.ndarray, seen: Seen, settings: Settings) -> np.ndarray:
    """Shape (track,): the mean residual of the keypoints that counted, in sigmas of confidence 1; 0 without any."""
    counted = seen.used & np.isfinite(off_px)
    relative = np.where(counted, off_px, 0.0) / settings.law.scale_px[:, None]
    return relative.sum(axis=(1, 2)) / np.maximum(counted.sum(axis=(1, 2)), 1)


def _pelvis(points_m: np.ndarray, settings: Settings) -> np.ndarray:
    """Shape (..., 1, 3): the keypoint at the tree's root; where there is none, the middle of the core."""
    core = points_m[..., settings.core, :]
    there = np.isfinite(core)
    middle = np.where(there, core, 0.0).sum(axis=-2, keepdims=True) / np.maximum(there.sum(axis=-2, keepdims=True), 1)
    root = np.flatnonzero(settings.tree.keypoint_nodes == 0)
    if not len(root):
        return middle
    own = points_m[..., root[:1], :]
    return np.where(np.isfinite(own), own, middle)


def _centroid(proposals: list[Evidence]) -> Evidence:
    """The likeliest of a cluster, at the mean of all and supported by the pairs of all."""
    best = max(proposals, key=lambda each: each.log_odds)
    if len(proposals) == 1:
        return best
    points = np.stack([each.points_m for each in proposals])
    there = np.isfinite(points)
    mean = np.where(there, points, 0.0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
    return replace(
        best,
        points_m=np.where(there.any(axis=0), mean, np.nan),
        torso_m=np.mean([each.torso_m for each in proposals], axis=0),
        n_pairs=sum(each.n_pairs for each in proposals),
    )
