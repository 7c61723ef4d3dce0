"""The confirmed tracks of a tracker, with their states and recent histories in the same order."""

from dataclasses import dataclass, field

import numpy as np

from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.records import State
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import ProjectedBodies, empty_state, join_states, select_states
from posefuse.tracking.records import DoubtfulIdentity, RecentHistory, TentativeTrack, Track
from posefuse.tracking.settings import TrackerSettings


def new_history(n_tracks: int, settings: TrackerSettings) -> RecentHistory:
    """Return the recent history of tracks that were just confirmed."""
    movers = len(settings.tree.segments) + len(settings.tree.bones)
    views, keypoints = len(settings.rig), len(settings.skeleton)
    return RecentHistory.new(n_tracks, views, settings.n_groups, keypoints, movers)


def advance_state(state: State, dt_s: float, settings: TrackerSettings) -> None:
    """Predict states by a time, in place; a negative time counts as zero."""
    dt = np.full(len(state.root), max(dt_s, 0.0))
    predict_people(dt, settings.motion, state)


@dataclass(eq=False)
class TrackSet:
    """Confirmed tracks.

    Attributes:
        tracks: The tracks.
        state: States of their bodies.
        recent: Their recent histories.
        n_created: Number of tracks created so far.
    """

    tracks: list[Track]
    state: State
    recent: RecentHistory
    n_created: int = 0

    @classmethod
    def empty(cls, settings: TrackerSettings) -> "TrackSet":
        """Return a set without tracks."""
        return cls([], empty_state(settings.tree), new_history(0, settings))

    def __len__(self) -> int:
        return len(self.tracks)

    def is_in_state(self, state: TrackState) -> np.ndarray:
        """Return which tracks are in a state, shape (track,), bool."""
        return np.array([track.state == state for track in self.tracks], dtype=bool)

    @property
    def active(self) -> list[int]:
        """Indices of the active tracks."""
        return [p for p, track in enumerate(self.tracks) if track.state == TrackState.ACTIVE]

    def keep(self, indices: list[int]) -> None:
        """Drop all tracks but some."""
        self.tracks = [self.tracks[p] for p in indices]
        self.state, self.recent = select_states(self.state, indices), self.recent.select(indices)

    def append(self, track: Track, state: State, settings: TrackerSettings) -> None:
        """Add a track with the state of its body."""
        self.tracks.append(track)
        self.state, self.recent = join_states(self.state, state), self.recent.joined(new_history(1, settings))

    def reset_history(self, index: int, settings: TrackerSettings) -> None:
        """Replace the recent history of a track by that of a new one."""
        for mine, new in zip(self.recent, new_history(1, settings), strict=True):
            mine[index] = new[0]

    def projected(self, cameras: np.ndarray, settings: TrackerSettings) -> ProjectedBodies:
        """Return the keypoints of all bodies in space and in some cameras, or in none."""
        return ProjectedBodies.of(self.state, cameras, settings.body)


@dataclass(eq=False)
class TentativePool:
    """Tracks that are not confirmed yet, and identities that may be wrong.

    Attributes:
        tracks: The tentative tracks.
        n_created: Number of tentative tracks created so far.
        doubts: Doubtful identities by the name of the lost person.
    """

    tracks: list[TentativeTrack] = field(default_factory=list)
    n_created: int = 0
    doubts: dict[str, DoubtfulIdentity] = field(default_factory=dict)
