"""Records of the tracker: tracks, their recent history, observations of new people, and the people of a frame."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from posefuse.arguments import checked
from posefuse.kernels.tracking.records import State
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_frames import BodyFrame
from posefuse.tracking.bone_lengths import LengthMonitor
from posefuse.tracking.pooled_lengths import PooledLengths


@dataclass
class Track:
    """A confirmed track of one person.

    Attributes:
        number: Number of the tracked body, counted from 1; it stays with the body when identities are swapped.
        name: Name of the person as whom the body is identified.
        state: ACTIVE or LOST.
        log_odds: Log odds of presence; another strategy's score.
        last_seen_s: Time of the last support, in seconds.
        shape_observed_s: Time for which two views have shown the person since the estimate of the bone lengths began,
            in seconds; it limits their accuracy.
        last_multiview_s: Time of the last support by two views, in seconds. A single view does not fix the distance.
        last_inside_s: Time at which the person was last where two views overlap, in seconds.
        established: Whether the views have shown enough to rule out a coincidence of two false detections.
        known_shape: Bone lengths and their covariance before the lengths were fixed; None while they are estimated.
        lengths: Recent comparisons of the bone lengths with the views.
        pooled: All comparisons since the estimate of the bone lengths began.
    """

    number: int
    name: str
    state: TrackState
    log_odds: float
    last_seen_s: float
    shape_observed_s: float = 0.0
    last_multiview_s: float = -np.inf
    last_inside_s: float = np.nan
    established: bool = False
    known_shape: tuple[np.ndarray, np.ndarray] | None = None
    lengths: LengthMonitor = field(default_factory=LengthMonitor)
    pooled: PooledLengths = field(default_factory=PooledLengths)


class RecentHistory(NamedTuple):
    """Running statistics of the last frames, one entry per track.

    Attributes:
        swapped: shape (track, view, group): probability that left and right of a limb are swapped.
        detector_ids: shape (track, view), int64: 2D track identity of the last match, -1 for none.
        displaced_s: shape (track, keypoint): time for which most views have contradicted a keypoint.
        noise_px2: shape (track, view, keypoint): noise variances of a strategy that estimates them, NaN if unknown.
        updated: shape (track,), bool: whether the last frame changed the state.
        single_view_s: shape (track,): time for which a single view has shown the person.
        posture_observed_s: shape (track,): time for which several views have shown the posture.
        leans: shape (track, segment + bone): recent means of the cosines between each third axis and the trunk's.
        leans_variance: shape (track, segment + bone): variances of these cosines over time.
        trunk_axis: shape (track, 3): recent mean of the trunk's third axis.
        height_observed_s: shape (track,): time for which several views have shown the height, where up is known.
        lowest_m: shape (track,): recent mean height of the body's lowest point.
        lowest_variance_m2: shape (track,): variance of that height over time.
    """

    swapped: np.ndarray
    detector_ids: np.ndarray
    displaced_s: np.ndarray
    noise_px2: np.ndarray
    updated: np.ndarray
    single_view_s: np.ndarray
    posture_observed_s: np.ndarray
    leans: np.ndarray
    leans_variance: np.ndarray
    trunk_axis: np.ndarray
    height_observed_s: np.ndarray
    lowest_m: np.ndarray
    lowest_variance_m2: np.ndarray

    @classmethod
    def new(cls, tracks: int, views: int, groups: int, keypoints: int, movers: int) -> "RecentHistory":
        """Return the history of tracks that were just confirmed.

        Args:
            tracks: Number of tracks.
            views: Number of views.
            groups: Number of groups of keypoints whose sides swap together.
            keypoints: Number of keypoints.
            movers: Number of segments and bones of a body.
        """
        return cls(
            np.zeros((tracks, views, groups)),
            np.full((tracks, views), -1, dtype=np.int64),
            np.zeros((tracks, keypoints)),
            np.full((tracks, views, keypoints), np.nan),
            np.ones(tracks, dtype=bool),
            np.zeros(tracks),
            np.zeros(tracks),
            np.zeros((tracks, movers)),
            np.zeros((tracks, movers)),
            np.zeros((tracks, 3)),
            np.zeros(tracks),
            np.zeros(tracks),
            np.zeros(tracks),
        )

    def joined(self, other: "RecentHistory") -> "RecentHistory":
        """Return the histories of both sets of tracks."""
        return RecentHistory(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def select(self, tracks: list[int]) -> "RecentHistory":
        """Return a copy of the histories of some tracks."""
        return RecentHistory(*(each[tracks] for each in self))


@dataclass(frozen=True, eq=False)
class Observation:
    """The detections of one person in one frame, with the points that they give.

    Attributes:
        time_s: Time of the frame, in seconds.
        number: Number of the frame.
        keypoints_px: shape (view, keypoint, 2), NaN where no detection shows the person; sides are corrected.
        confidence: shape (view, keypoint).
        rows: shape (view,), int64: detections of the frame, -1 for none.
        points_m: shape (keypoint, 3).
        covariance_m2: shape (keypoint, 6).
        torso_m: shape (3,).
        log_odds: Log odds of the proposal.
        error_sigma: Median reprojection error of the proposal.
        n_pairs: Number of pairs of views that support the proposal.
        n_silent: Number of views that should show the person and do not; only counted if few views show the person.
    """

    time_s: float
    number: int
    keypoints_px: np.ndarray
    confidence: np.ndarray
    rows: np.ndarray
    points_m: np.ndarray
    covariance_m2: np.ndarray
    torso_m: np.ndarray
    log_odds: float
    error_sigma: float
    n_pairs: int = 0
    n_silent: int = 0

    @property
    def n_views(self) -> int:
        """Number of views that show the person."""
        return int((self.rows >= 0).sum())


@dataclass
class TentativeTrack:
    """A track that is not confirmed yet.

    Attributes:
        number: Number of the tentative track.
        observations: Observations of the person, oldest first.
        frames: Number of frames since the first observation.
        score: Score of the track; its meaning depends on the strategy.
    """

    number: int
    observations: list[Observation]
    frames: int = 1
    score: float = 0.0


@dataclass
class Candidate:
    """A track that may show a lost person.

    Attributes:
        since_s: Time just before the first observation, in seconds.
        position: Log odds of the place where the person appeared.
        observations: Recent observations.
        next_check_s: Time of observation at which its bone lengths are compared next, in seconds.
    """

    since_s: float
    position: float
    observations: deque[Observation]
    next_check_s: float


@dataclass
class DoubtfulIdentity:
    """A lost person, and the tracks that may show the person.

    Attributes:
        number: Number of the track that has the person's name.
        lost: The track as it was when it was lost.
        state: State of its body alone, predicted since then.
        candidates: By track number, the track with the name, and new tracks that appeared later.
    """

    number: int
    lost: Track
    state: State
    candidates: dict[int, Candidate]


@dataclass(frozen=True, eq=False)
class PastState:
    """State of one person in an earlier frame, found when the track was confirmed.

    Attributes:
        number: Number of the frame.
        time_s: Time of the frame, in seconds.
        state: State of one person.
        rows: shape (view,), int64: detections of the frame, -1 for none.
        keypoints_px: shape (view, keypoint, 2): detected keypoints with corrected sides, NaN where there is none.
        confidence: shape (view, keypoint).
    """

    number: int
    time_s: float
    state: State
    rows: np.ndarray
    keypoints_px: np.ndarray
    confidence: np.ndarray


@checked
@dataclass(frozen=True, eq=False)
class Person:
    """One person in one frame, from this and earlier frames.

    Attributes:
        name: Name of the person; tentative people have a number.
        state: TENTATIVE, ACTIVE or LOST.
        points_m: shape (keypoint, 3), NaN where the body has no such point.
        covariance_m2: shape (keypoint, 6).
        rows: shape (view,), int64: detections of the frame assigned to the person, -1 for none.
        used: shape (view, keypoint), bool: keypoints that the update used, also those of a detection of another person
            that shows both.
        log_odds: Log odds of presence; another strategy's score.
        missing_s: Time since the last support, in seconds.
        nis: Normalized innovation squared, summed over the used keypoints; NaN for new tracks.
        nis_dof: Expected value of ``nis``: two per keypoint and view.
    """

    name: str
    state: TrackState
    points_m: np.ndarray
    covariance_m2: np.ndarray
    rows: np.ndarray
    used: np.ndarray
    log_odds: float
    missing_s: float
    nis: float = np.nan
    nis_dof: int = 0


@checked
@dataclass(frozen=True, eq=False)
class People:
    """All people in one frame.

    Attributes:
        number: Number of the frame.
        time_s: Time of the frame, in seconds.
        people: Active people first, then lost ones, then tentative ones.
        events: Events of this frame.
    """

    number: int
    time_s: float
    people: tuple[Person, ...]
    events: tuple[Event, ...]


@dataclass(frozen=True)
class IdentitySwap:
    """Two tracks whose names were swapped in a frame.

    Attributes:
        numbers: Numbers of the two tracks.
        since_s: Time from which the new names apply, in seconds.
    """

    numbers: tuple[int, int]
    since_s: float


@dataclass(frozen=True, eq=False)
class AssignedKeypoints:
    """Detected keypoints that were assigned to tracks in one frame.

    Attributes:
        numbers: Numbers of the tracks.
        keypoints_px: shape (row, keypoint, 2): the detections, moved to the time of the states.
        confidence: shape (row, keypoint).
        rows: shape (track, view), int64: assigned detections, -1 for none.
        labels: shape (track, view, keypoint), int64: which of a detection's keypoints is the body's, -1 for none.
    """

    numbers: tuple[int, ...]
    keypoints_px: np.ndarray
    confidence: np.ndarray
    rows: np.ndarray
    labels: np.ndarray


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """Everything that the tracker found in one frame.

    Attributes:
        people: All people in the frame.
        past_states: By name, states in earlier frames of people who were confirmed or re-identified in this frame.
        swaps: Identity swaps found in this frame.
        assigned: Assigned keypoints; None if they are not kept.
        bodies: The bodies to which hands and faces are anchored; None if the skeleton has no such parts.
    """

    people: People
    past_states: Mapping[str, list[PastState]]
    swaps: tuple[IdentitySwap, ...]
    assigned: AssignedKeypoints | None = None
    bodies: BodyFrame | None = None
