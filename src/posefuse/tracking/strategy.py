"""Interfaces of the tracker's exchangeable components; all strategies share everything else."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from posefuse.kernels.tracking.error_model import ErrorModel
from posefuse.kernels.tracking.records import State
from posefuse.model.frames import Frame
from posefuse.model.proposals import Proposals
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.records import Observation, PastState, RecentHistory, TentativeTrack, Track
from posefuse.tracking.reidentification import Reidentification
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.track_initiation import PromotionFigures

Propose = Callable[[Frame, np.ndarray], Proposals]
"""Function from a frame and a mask of its unassigned rows, shape (row,), to people whom several views show."""


@dataclass(frozen=True, eq=False)
class MatchScores:
    """Scores of assigning detections to tracks.

    Attributes:
        gain: shape (track, row): gain of a match; -inf where none is possible.
        min_gain: Gain that a match needs.
        swapped: shape (track, row, group), int8: whether left and right of a limb are swapped.
        swap_odds: shape (track, row, group): log odds of the swap.
        explained: shape (row,), bool: detections of tracked people, whether assigned or not.
    """

    gain: np.ndarray
    min_gain: float
    swapped: np.ndarray
    swap_odds: np.ndarray
    explained: np.ndarray


@dataclass(frozen=True, eq=False)
class UpdateNoise:
    """Noise model of the keypoints of one update.

    Attributes:
        law: Noise model in the form that kernels take.
        confidence: shape (row, keypoint): confidences that this model takes.
        temper: shape (track,): number of correlated frames that count as one independent frame.
    """

    law: ErrorModel
    confidence: np.ndarray
    temper: np.ndarray


@dataclass(frozen=True, eq=False)
class FrameOutcome:
    """Result of association and update for all tracks.

    Attributes:
        frame: The detections.
        time_s: Time of the frame, in seconds.
        dt_s: Time since the last frame, in seconds.
        rows: shape (track, view), int64: assigned detections, -1 for none.
        labels: shape (track, view, keypoint), int64: which of a detection's keypoints is the body's, -1 for none.
        used: shape (track, view, keypoint), bool: keypoints that the update used.
        supported: shape (track, view), bool: views that support each track.
        expected: shape (track, view), bool: views that should show each track.
    """

    frame: Frame
    time_s: float
    dt_s: float
    rows: np.ndarray
    labels: np.ndarray
    used: np.ndarray
    supported: np.ndarray
    expected: np.ndarray

    def with_expected(self, expected: np.ndarray) -> "FrameOutcome":
        """Return the outcome with other views that should show each track, shape (track, view), bool."""
        return FrameOutcome(
            self.frame, self.time_s, self.dt_s, self.rows, self.labels, self.used, self.supported, expected
        )

    def select(self, tracks: list[int]) -> "FrameOutcome":
        """Return the outcome of some tracks, in ascending order; arrays are shared if these are all of them."""
        if len(tracks) == len(self.rows):
            return self
        return FrameOutcome(
            self.frame, self.time_s, self.dt_s, self.rows[tracks], self.labels[tracks], self.used[tracks],
            self.supported[tracks], self.expected[tracks],
        )  # fmt: skip


class Prior(Protocol):
    """Prior covariance of the prediction."""

    def prepare(self, state: State, recent: RecentHistory) -> None:
        """Change the states after the last frame, in place, to those from which the prediction starts."""
        ...

    def open_shape(self, state: State, rows: np.ndarray, settings: TrackerSettings) -> np.ndarray | None:
        """Prepare the bone lengths of predicted states for the update by detections, in place.

        Args:
            state: Updated in place.
            rows: shape (track, view), int64: assigned detections, -1 for none.
            settings: Settings of the tracker.

        Returns:
            Lengths before the update, shape (track, shape), NaN where the update alone determines them; None for all.
        """
        ...

    def close_shape(self, before: np.ndarray | None, state: State, settings: TrackerSettings) -> None:
        """Change the bone lengths of updated states, in place, given those from :meth:`open_shape`."""
        ...


class Noise(Protocol):
    """Noise model of keypoints."""

    def variance_px2(
        self, projected: ProjectedBodies, frame: Frame, recent: RecentHistory, settings: TrackerSettings
    ) -> np.ndarray:
        """Return the noise variances of each detection's keypoints for each track, shape (track, row, keypoint)."""
        ...

    def update_noise(
        self,
        frame: Frame,
        rows: np.ndarray,
        labels: np.ndarray,
        recent: RecentHistory,
        dt_s: float,
        settings: TrackerSettings,
    ) -> UpdateNoise:
        """Return the noise model for the update by the assigned detections."""
        ...

    def adapt(self, outcome: FrameOutcome, recent: RecentHistory, state: State, settings: TrackerSettings) -> None:
        """Adapt the noise estimates to the residuals of the updated states."""
        ...


class Motion(Protocol):
    """Motion model of bodies."""

    def advance(self, state: State, dt_s: float, settings: TrackerSettings) -> None:
        """Predict states by a time, in place; a negative time counts as zero."""
        ...


class Score(Protocol):
    """Scores of matches and of tracks."""

    def match(
        self, projected: ProjectedBodies, frame: Frame, recent: RecentHistory, noise: Noise, settings: TrackerSettings
    ) -> MatchScores:
        """Score every pair of a detection and a track."""
        ...

    def tentative_score(self, track: TentativeTrack, time_s: float, dt_s: float, settings: TrackerSettings) -> float:
        """Return the score of a tentative track after a frame."""
        ...

    def promotion_score(self, settings: TrackerSettings) -> float:
        """Return the score that a tentative track needs to be confirmed."""
        ...

    def min_age_s(self, track: TentativeTrack, settings: TrackerSettings) -> float:
        """Return the age that a tentative track needs to be confirmed, in seconds."""
        ...

    def track_scores(
        self, outcome: FrameOutcome, tracks: Sequence[Track], state: State, settings: TrackerSettings
    ) -> np.ndarray:
        """Return the scores of the confirmed tracks after a frame, shape (track,)."""
        ...

    def initial_score(self, settings: TrackerSettings) -> float:
        """Return the score of a track that was just confirmed; a re-acquired track has at least this score."""
        ...

    def lost_score(self, settings: TrackerSettings) -> float:
        """Return the score below which a track is lost."""
        ...

    def established_score(self, settings: TrackerSettings) -> float:
        """Return the score from which a track is never again taken for a coincidence; -inf if no track ever is."""
        ...


class Distance(Protocol):
    """Distances between proposals, and between proposals and tracks."""

    def merge(self, observations: list[Observation], settings: TrackerSettings) -> list[Observation]:
        """Merge the proposals of one frame that show the same person."""
        ...

    def distance(self, track: TentativeTrack, new: Observation, settings: TrackerSettings) -> float:
        """Return the distance of a proposal from a tentative track; inf beyond the gate."""
        ...

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
        """Find the lost track that a proposal continues.

        Args:
            tracks: Confirmed tracks.
            state: States of the tracks.
            fitted: State of the body fitted to the proposal.
            observation: The proposal.
            since_s: Time at which the proposed person was first seen, in seconds.
            time_s: Time of the frame, in seconds.
            settings: Settings of the tracker.

        Returns:
            The track, or None if the person is new.
        """
        ...

    def find_reacquired(
        self, tracks: list[Track], state: State, tentative: list[TentativeTrack], settings: TrackerSettings
    ) -> list[tuple[Reidentification, TentativeTrack]]:
        """Find the lost tracks that proposals of the last frame continue, each with the proposals to fit.

        Args:
            tracks: Confirmed tracks.
            state: States of the tracks.
            tentative: Tentative tracks that a proposal of the last frame started or continued.
            settings: Settings of the tracker.
        """
        ...


class Initiation(Protocol):
    """Figures of the promotion rule, and the first body of a track."""

    def figures(self, track: TentativeTrack, settings: TrackerSettings) -> PromotionFigures:
        """Return what the promotion rule compares with its thresholds."""
        ...

    def fit(self, track: TentativeTrack, settings: TrackerSettings) -> tuple[State, list[PastState], float]:
        """Fit a body to a tentative track.

        Returns:
            State of one body in the last frame; states in earlier frames; and the median reprojection error in the last
            frame, in standard deviations.
        """
        ...


def same_settings(settings: TrackerSettings) -> TrackerSettings:
    """Return the settings unchanged."""
    return settings


@dataclass(frozen=True)
class Strategy:
    """The components in which the tracker's strategies differ, and the settings that a strategy changes."""

    prior: Prior
    noise: Noise
    score: Score
    distance: Distance
    motion: Motion
    initiation: Initiation
    configure: Callable[[TrackerSettings], TrackerSettings] = same_settings


@dataclass(frozen=True)
class TrackerSetup:
    """Everything that stays the same while a tracker runs.

    Attributes:
        settings: Cameras, skeleton, noise model and options.
        strategy: Exchangeable components.
        propose: Function that proposes people from unassigned detections.
        propose_new: The same for people who are not tracked yet.
        propose_lost: The same for people who are expected, because their tracks were lost.
    """

    settings: TrackerSettings
    strategy: Strategy
    propose: Propose
    propose_new: Propose
    propose_lost: Propose
