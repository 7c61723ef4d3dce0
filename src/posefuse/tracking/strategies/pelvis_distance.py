"""Distances of the specification: d_prop between proposals and tentative tracks, and C_reacq to lost tracks.

See docs/methods/specification.md.
"""

import math
from dataclasses import replace

import numpy as np

from posefuse.association.proposal_distance import CorePoses, core_poses, proposal_distance
from posefuse.kernels.tracking.records import State
from posefuse.model.graphs import connected_components
from posefuse.model.tracks import TrackState
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.records import Observation, TentativeTrack, Track
from posefuse.tracking.reidentification import Reidentification
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategies.tentative_state import buffer_of, tentative_state


class PelvisDistance:
    """Squared normalized distances between pelvises, and between core keypoints relative to them."""

    def merge(self, observations: list[Observation], settings: TrackerSettings) -> list[Observation]:
        """Merge each cluster of proposals, by single linkage, into its centroid; clusters of pairs are merged."""
        o = settings.options.specification
        if len(observations) < 2 or o.pair_proposals:
            return observations
        poses = _poses(observations, settings)
        near = proposal_distance(poses.select(np.s_[:, None]), poses.select(None), o) <= o.cluster_gate
        labels = connected_components(near)
        return [
            _centroid([observations[i] for i in np.flatnonzero(labels == n)]) for n in dict.fromkeys(labels.tolist())
        ]

    def distance(self, track: TentativeTrack, new: Observation, settings: TrackerSettings) -> float:
        """Return d_prop from the tentative track's prediction; inf beyond the gate."""
        o = settings.options.specification
        state = tentative_state(buffer_of(track, settings), new.time_s, settings)
        distance = float(proposal_distance(state.poses, _poses([new], settings).select(0), o))
        return distance if distance <= o.cluster_gate else math.inf

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
        """Find the lost track with the smallest C_reacq between its prediction and the proposal."""
        lost = [p for p, track in enumerate(tracks) if track.state == TrackState.LOST]
        cost = reacquisition_cost(state, lost, [observation], settings)
        if not lost or not cost.min() <= settings.options.specification.reacquire_gate:
            return None
        best = int(np.argmin(cost[:, 0]))
        return Reidentification(lost[best], _reason(float(cost[best, 0]), tracks[lost[best]], time_s))

    def find_reacquired(
        self, tracks: list[Track], state: State, tentative: list[TentativeTrack], settings: TrackerSettings
    ) -> list[tuple[Reidentification, TentativeTrack]]:
        """Find pairs of a lost track and a proposal, those with the smallest C_reacq first, each at most once."""
        o, observations = settings.options.specification, [each.observations[-1] for each in tentative]
        lost = [p for p, track in enumerate(tracks) if track.state == TrackState.LOST]
        if not o.same_frame_reacquisition or not lost or not observations:
            return []
        cost = reacquisition_cost(state, lost, observations, settings)
        found = []
        for i, j in zip(*np.unravel_index(np.argsort(cost, axis=None, kind="stable"), cost.shape), strict=True):
            best = float(cost[i, j])
            if not best <= o.reacquire_gate:
                break
            if best == np.nanmin(cost[i]) and best == np.nanmin(cost[:, j]):
                reason = _reason(best, tracks[lost[i]], observations[j].time_s)
                # The specification continues a track by the proposal of one frame.
                found.append((Reidentification(lost[i], reason), TentativeTrack(0, [observations[j]])))
                cost[i], cost[:, j] = np.inf, np.inf
        return found


def reacquisition_cost(
    state: State, lost: list[int], observations: list[Observation], settings: TrackerSettings
) -> np.ndarray:
    """Return C_reacq between predicted lost tracks and proposals, shape (lost, observation).

    It has the scales tau_r and tau_Z alone: with the covariance of a track that was lost for long, any proposal would
    be close to it.
    """
    options = replace(settings.options.specification, normalized_distance=False)
    bodies = ProjectedBodies.of(state, settings.cameras[:0], settings.body)
    poses = core_poses(bodies.points_m[lost], bodies.covariance_m2[lost], settings.skeleton)
    return proposal_distance(poses.select(np.s_[:, None]), _poses(observations, settings).select(None), options)


def _poses(observations: list[Observation], settings: TrackerSettings) -> CorePoses:
    points = np.stack([each.points_m for each in observations])
    return core_poses(points, np.stack([each.covariance_m2 for each in observations]), settings.skeleton)


def _reason(cost: float, track: Track, time_s: float) -> str:
    return f"C_reacq {cost:.1f} from the predicted position after {time_s - track.last_seen_s:.1f} s"


def _centroid(proposals: list[Observation]) -> Observation:
    """Return the most likely proposal of a cluster, at the mean position and with the pairs of all."""
    best = max(proposals, key=lambda each: each.log_odds)
    if len(proposals) == 1:
        return best
    points = np.stack([each.points_m for each in proposals])
    finite = np.isfinite(points)
    mean = np.where(finite, points, 0.0).sum(axis=0) / np.maximum(finite.sum(axis=0), 1)
    return replace(
        best,
        points_m=np.where(finite.any(axis=0), mean, np.nan),
        torso_m=np.mean([each.torso_m for each in proposals], axis=0),
        n_pairs=sum(each.n_pairs for each in proposals),
    )
