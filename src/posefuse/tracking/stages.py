"""The parts of the tracker that a preset may do its own way, each by itself; everything else all presets share."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from posefuse.kernels.tracking.error_model import ErrorModel
from posefuse.kernels.tracking.records import State
from posefuse.model.frames import Frame
from posefuse.tracking.body_states import Sight
from posefuse.tracking.records import Evidence, Lately, Tentative, Track
from posefuse.tracking.settings import Settings


@dataclass(frozen=True, eq=False)
class Likeness:
    """How well detections go with people.

    Attributes:
        gain: shape (track, row): what a match is worth; -inf where there is none.
        least: what a match must be worth.
        swapped: shape (track, row, group), int8: whose sides are exchanged.
        swap_odds: shape (track, row, group): the log odds of that.
        explained: shape (row,), bool: detections of somebody who is followed, whether matched or not.
    """

    gain: np.ndarray
    least: float
    swapped: np.ndarray
    swap_odds: np.ndarray
    explained: np.ndarray


@dataclass(frozen=True, eq=False)
class Trust:
    """What an update believes of a frame's keypoints.

    Attributes:
        law: for kernels.
        confidence: shape (row, keypoint), as that law takes it.
        temper: shape (track,): as how many independent frames so many count as one.
    """

    law: ErrorModel
    confidence: np.ndarray
    temper: np.ndarray


@dataclass(frozen=True, eq=False)
class Seen:
    """What became of a frame's detections.

    Attributes:
        frame: the detections.
        time_s: of the frame.
        dt_s: since the last.
        rows: shape (track, view), int64: whose they are, -1 for none.
        labels: shape (track, view, keypoint), int64: which of a detection's keypoints is the body's.
        used: shape (track, view, keypoint), bool: which counted.
        supported: shape (track, view), bool: by which views somebody is shown.
        expected: shape (track, view), bool: by which views they should be.
    """

    frame: Frame
    time_s: float
    dt_s: float
    rows: np.ndarray
    labels: np.ndarray
    used: np.ndarray
    supported: np.ndarray
    expected: np.ndarray


class Prior(Protocol):
    """What the prediction is believed to know."""

    @property
    def smoothable(self) -> bool:
        """Whether the covariances that it leaves say how much later frames tell of earlier ones."""
        ...

    def settle(self, state: State, lately: Lately) -> None:
        """Make of what was known after the last frame, in place, what the prediction begins with."""
        ...


class Noise(Protocol):
    """How noisy keypoints are."""

    def variance_px2(self, sight: Sight, frame: Frame, lately: Lately, settings: Settings) -> np.ndarray:
        """Shape (track, row, keypoint): of each detection's keypoints, were it that person's."""
        ...

    def trust(
        self,
        frame: Frame,
        rows: np.ndarray,
        labels: np.ndarray,
        lately: Lately,
        dt_s: float,
        settings: Settings,
    ) -> Trust:
        """What the update is to believe of the matched detections."""
        ...

    def learn(self, seen: Seen, lately: Lately, state: State, settings: Settings) -> None:
        """Take into account how far off the frame was from the states after it."""
        ...


class Score(Protocol):
    """Whose a detection is, and who is there."""

    def match(self, sight: Sight, frame: Frame, lately: Lately, noise: Noise, settings: Settings) -> Likeness:
        """How well every detection goes with everybody."""
        ...

    def tentative(self, each: Tentative, time_s: float, dt_s: float, settings: Settings) -> float:
        """The score of somebody not believed yet, after a frame."""
        ...

    def promotes_from(self, settings: Settings) -> float:
        """From which of those scores on they can be believed."""
        ...

    def waits_s(self, each: Tentative, settings: Settings) -> float:
        """How old somebody not believed yet must be to be believed."""
        ...

    def active(self, seen: Seen, tracks: Sequence[Track], state: State, settings: Settings) -> np.ndarray:
        """Shape (track,): the scores of those who are followed, after a frame."""
        ...

    def begins_with(self, settings: Settings) -> float:
        """The score of somebody just believed; who is found again has no less."""
        ...

    def lost_below(self, settings: Settings) -> float:
        """With which score somebody is lost."""
        ...

    def sure_from(self, settings: Settings) -> float:
        """With which score somebody is no longer taken for a coincidence, once for all; -inf where nobody ever is."""
        ...


class Distance(Protocol):
    """How near proposals are to each other, and to people."""

    def merge(self, found: list[Evidence], settings: Settings) -> list[Evidence]:
        """Make one of the proposals of a frame that are one person."""
        ...

    def apart(self, last: Evidence, new: Evidence, settings: Settings) -> float:
        """How far a proposal is from where a tentative person was last; inf where it cannot be them."""
        ...

    def returning(
        self, tracks: list[Track], state: State, born: State, seen: Evidence, since_s: float, time_s: float,
        settings: Settings,
    ) -> tuple[int, str, str] | None:  # fmt: skip
        """Which lost person a proposal is.

        Args:
            tracks: of people known.
            state: theirs.
            born: the state of the body fitted to the proposal.
            seen: the proposal.
            since_s: when what is proposed was first seen.
            time_s: now.
            settings: of the tracker.

        Returns:
            Their place, why, and what makes that uncertain ("" where nothing does); None where it is nobody.
        """
        ...


@dataclass(frozen=True)
class Stages:
    """What a preset consists of."""

    prior: Prior
    noise: Noise
    score: Score
    distance: Distance
