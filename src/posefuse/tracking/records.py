"""What the tracker remembers of people beside their states, and what it says of a frame."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState


@dataclass
class Track:
    """A person who is followed.

    Attributes:
        number: of the body that is followed, as long as it is; counted from 1.
        name: of the person whom it is taken for.
        state: ACTIVE or LOST.
        log_odds: that they are there; another preset's score of it.
        seen_s: when they were last supported.
        firm_s: when two views last supported them: one alone does not fix how far away somebody is.
        trusted: the shape and its covariance before they were last in doubt.
        lost_at_m: shape (3,): where they were last supported.
        sought_s: for how long two views have shown them: over which their shape could be seen.
        settled_s: when the shape was kept.
        inside_s: when they were last where two views overlap.
        sure: whether views have shown so much of them that they are no coincidence of two false detections.
    """

    number: int
    name: str
    state: TrackState
    log_odds: float
    seen_s: float
    lost_at_m: np.ndarray
    sought_s: float = 0.0
    settled_s: float = np.nan
    firm_s: float = -np.inf
    inside_s: float = np.nan
    sure: bool = False
    trusted: tuple[np.ndarray, np.ndarray] | None = None


class Lately(NamedTuple):
    """What the last detections of all who are followed were like, side by side in the order of the tracks.

    Attributes:
        swapped: shape (track, view, group): how probable it is that their sides are exchanged.
        ids: shape (track, view), int64: the detector's identity of the last match, -1 for none.
        off_s: shape (track, keypoint): for how long most views have seen each keypoint elsewhere.
        noise_px2: shape (track, view, keypoint): how noisy theirs are, where a preset learns that; NaN where not known.
        renewed: shape (track,), bool: whose states the last frame changed.
        alone_s: shape (track,): for how long one view alone has shown each.
        looked_s: shape (track,): for how long several views have shown each.
        leans: shape (track, segment + bone): cosines between each one's third axis and the trunk's, on average lately.
        leans_variance: shape (track, segment + bone): of these over time.
        upright: shape (track, 3): the trunk's third axis, on average lately.
        stood_s: shape (track,): for how long several views have shown each, where up is known.
        floor_m: shape (track,): how high the lowest point of each has been, on average lately.
        floor_variance: shape (track,): of that over time, m^2.
    """

    swapped: np.ndarray
    ids: np.ndarray
    off_s: np.ndarray
    noise_px2: np.ndarray
    renewed: np.ndarray
    alone_s: np.ndarray
    looked_s: np.ndarray
    leans: np.ndarray
    leans_variance: np.ndarray
    upright: np.ndarray
    stood_s: np.ndarray
    floor_m: np.ndarray
    floor_variance: np.ndarray

    @classmethod
    def unknown(cls, tracks: int, views: int, groups: int, keypoints: int, movers: int) -> "Lately":
        """Of people just believed, whose bodies have so many segments and bones."""
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

    def joined(self, other: "Lately") -> "Lately":
        """The tracks of both."""
        return Lately(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def chosen(self, tracks: list[int]) -> "Lately":
        """Some of the tracks, copied."""
        return Lately(*(each[tracks] for each in self))


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a frame showed of somebody who is not believed yet.

    Attributes:
        time_s: of the frame.
        number: of the frame.
        keypoints_px: shape (view, keypoint, 2), NaN where no detection is theirs; sides put right.
        confidence: shape (view, keypoint).
        rows: shape (view,), int64: of the frame, -1 for none.
        points_m: shape (keypoint, 3).
        covariance_m2: shape (keypoint, 6).
        torso_m: shape (3,).
        log_odds: of the proposal.
        error_sigma: of the proposal.
        n_pairs: of views, that support the proposal.
        n_silent: how many views should show them, with nobody before them, and do not; asked where two views do.
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
        """How many views show them."""
        return int((self.rows >= 0).sum())


@dataclass
class Tentative:
    """Somebody who may be there.

    Attributes:
        number: to tell them apart.
        evidence: frames that showed them, oldest first.
        frames: how many frames there have been since the first.
        score: of their being there.
    """

    number: int
    evidence: list[Evidence]
    frames: int = 1
    score: float = 0.0


@dataclass(frozen=True, eq=False)
class Remembered:
    """The state of one person in one frame that is past, found when they were believed."""

    number: int
    time_s: float
    state: State
    rows: np.ndarray


@dataclass(frozen=True, eq=False)
class Person:
    """A person in one frame, as far as is known then.

    Attributes:
        name: of the person; of tentative ones a number.
        state: TENTATIVE, ACTIVE or LOST.
        points_m: shape (keypoint, 3), NaN where the body has no such point.
        covariance_m2: shape (keypoint, 6).
        rows: shape (view,), int64: the frame's detections that are theirs, -1 for none.
        used: shape (view, keypoint), bool: the keypoints that counted.
        log_odds: that they are there; another preset's score of it.
        missing_s: for how long nothing has supported them.
        nis: squared innovations of the keypoints that counted, each in its own covariance, together; NaN of who is new.
        nis_dof: their expected value, two for each keypoint and view.
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


@dataclass(frozen=True, eq=False)
class People:
    """Everybody in one frame.

    Attributes:
        number: of the frame.
        time_s: of the frame.
        people: active first, then lost, then tentative.
        events: of this frame.
    """

    number: int
    time_s: float
    people: tuple[Person, ...]
    events: tuple[Event, ...]
