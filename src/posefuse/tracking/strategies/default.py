"""The preset `posefuse`: odds, the noise law tempered, the propagated covariance. See docs/methods.md, "People"."""

import math
from collections.abc import Sequence

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.tracking.frame_statistics import add_identity_scores
from posefuse.kernels.tracking.matching import score_detections
from posefuse.kernels.tracking.records import State
from posefuse.model.frames import Frame
from posefuse.tracking.body_states import Sight
from posefuse.tracking.records import Evidence, Lately, Tentative, Track
from posefuse.tracking.reidentification import who_returns
from posefuse.tracking.settings import Settings, memory_s, tempering
from posefuse.tracking.stages import Likeness, Noise, Seen, Stages, Trust
from posefuse.tracking.track_initiation import is_of_two_views

_EXPLAINED = 3.0
"""A detection of this much evidence is somebody's who is followed, even if another one is more so."""
_MOST_HIDDEN = -1.2
"""Views that do not see somebody whom one does see count no more than this many that do."""
_HARDLY = 1e-3
"""Nats: where views say no more than this for somebody, or speak against them, that is for ever."""


class PropagatedPrior:
    """What is known is carried on: P of the prediction is F P F^T + Q."""

    smoothable = True

    def settle(self, state: State, lately: Lately) -> None:
        """Nothing is forgotten."""


class LawfulNoise:
    """The noise law by confidence and a floor of the model, tempered for how long errors last."""

    def variance_px2(self, sight: Sight, frame: Frame, lately: Lately, settings: Settings) -> np.ndarray:
        """Shape (track, row, keypoint)."""
        floor_px = settings.law.floor_m * sight.size_px[:, frame.view]
        return settings.variance_px2(frame.confidence, frame.view) + floor_px**2

    def trust(
        self,
        frame: Frame,
        rows: np.ndarray,
        labels: np.ndarray,
        lately: Lately,
        dt_s: float,
        settings: Settings,
    ) -> Trust:
        """The detector's own confidence."""
        since_s = np.full(len(rows), dt_s)
        temper = tempering(since_s, memory_s((rows >= 0).sum(axis=1), lately.alone_s, since_s, settings.options))
        return Trust(settings.law, frame.confidence, temper)

    def learn(self, seen: Seen, lately: Lately, state: State, settings: Settings) -> None:
        """A law is known before."""


class OddsScore:
    """Log odds: that a detection is somebody's, and that somebody is there."""

    def match(self, sight: Sight, frame: Frame, lately: Lately, noise: Noise, settings: Settings) -> Likeness:
        """By the predictive likelihood against clutter, sides as labelled or exchanged."""
        s, o, n = settings, settings.options, len(lately.ids)
        scores = np.empty((n, len(frame.view)))
        shape = (n, len(frame.view), s.n_groups)
        swapped, odds = np.zeros(shape, dtype=np.int8), np.empty(shape)
        score_detections(
            sight.pixels, sight.spread, sight.size_px, frame.keypoints_px, frame.confidence, frame.view,
            s.skeleton.mirror, s.group_of, s.n_groups, s.law, lately.swapped,
            o.clutter_m, o.keypoint_evidence, o.independent_keypoints, scores, swapped, odds,
        )  # fmt: skip
        explained = np.empty(len(frame.view), dtype=bool)
        track_ids = frozen(frame.track_ids, np.int64)
        add_identity_scores(lately.ids, frame.view, track_ids, o.id_evidence, _EXPLAINED, scores, explained)
        return Likeness(scores, o.match_evidence, swapped, odds, explained)

    def tentative(self, each: Tentative, time_s: float, dt_s: float, settings: Settings) -> float:
        """The log odds of all its frames together."""
        return sum(e.log_odds for e in each.evidence)

    def promotes_from(self, settings: Settings) -> float:
        """Promotion is by the odds alone."""
        return settings.options.births.promote_log_odds

    def waits_s(self, each: Tentative, settings: Settings) -> float:
        """Two views fit by chance: until these, and those that are silent, make ``two_views_log_odds`` in all."""
        births = settings.options.births
        if not is_of_two_views(each, settings):
            return births.min_age_s
        gain, loss = _worth(settings)
        shown = [gain * e.n_views + loss * e.n_silent for e in each.evidence]
        speaks = max(float(np.mean(shown)), _HARDLY) / settings.options.evidence_time_s
        return max(births.min_age_two_views_s, births.two_views_log_odds / speaks)

    def active(self, seen: Seen, tracks: Sequence[Track], state: State, settings: Settings) -> np.ndarray:
        """Every view that shows somebody is for them, every view that should and does not is against them."""
        o = settings.options
        gain, loss = _worth(settings)
        missed = loss * (seen.expected & ~seen.supported).sum(axis=1)
        # What hides somebody from one view often hides them from others too; a coincidence nothing hides.
        hides = seen.supported.any(axis=1) & np.array([track.sure for track in tracks])
        missed = np.where(hides, np.maximum(missed, _MOST_HIDDEN * gain), missed)
        evidence = gain * seen.supported.sum(axis=1) + missed
        before = np.array([track.log_odds for track in tracks])
        after = before + evidence * min(1.0, seen.dt_s / o.evidence_time_s)
        return np.minimum(np.maximum(after, -o.most_log_odds), o.most_log_odds)

    def begins_with(self, settings: Settings) -> float:
        """Half as certain as can be."""
        return settings.options.most_log_odds / 2

    def lost_below(self, settings: Settings) -> float:
        """Where they are hardly likely to be there."""
        return settings.options.lost_log_odds

    def sure_from(self, settings: Settings) -> float:
        """As certain as can be."""
        return settings.options.most_log_odds


def _worth(settings: Settings) -> tuple[float, float]:
    """Log odds of a view that shows somebody, and of one that should and does not."""
    o = settings.options
    return math.log(o.detection_share / o.false_share), math.log((1.0 - o.detection_share) / (1.0 - o.false_share))


class TrunkDistance:
    """Metres between trunks, and log odds of bodies' lengths."""

    def merge(self, found: list[Evidence], settings: Settings) -> list[Evidence]:
        """Proposals of groups are one a person already."""
        return found

    def apart(self, last: Evidence, new: Evidence, settings: Settings) -> float:
        """How far the trunk is off, m; inf beyond how far people get."""
        options = settings.options
        within = options.births.gate_m + options.motion.top_speed_m_s * (new.time_s - last.time_s)
        away = float(np.linalg.norm(new.torso_m - last.torso_m))
        return away if away < within else math.inf

    def returning(
        self, tracks: list[Track], state: State, born: State, seen: Evidence, since_s: float, time_s: float,
        settings: Settings,
    ) -> tuple[int, str, str] | None:  # fmt: skip
        """By where they can have gone, and by their bones."""
        return who_returns(tracks, state, born, seen.torso_m, since_s, time_s, settings)


STAGES = Stages(PropagatedPrior(), LawfulNoise(), OddsScore(), TrunkDistance())
