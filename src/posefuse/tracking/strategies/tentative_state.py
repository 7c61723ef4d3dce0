"""State of a tentative track: root, core pose, their velocities and covariances, from the buffer of observations.

Source: the specification of the articulated tracker, which names the state and leaves its update open. Here positions
and velocities are the weighted least-squares line through the buffer, with a prior on the velocities; see
docs/methods/specification.md.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.association.proposal_distance import CorePoses, core_poses
from posefuse.tracking.frame_clock import TIME_TOLERANCE_S
from posefuse.tracking.records import Observation, TentativeTrack
from posefuse.tracking.settings import TrackerSettings

_MIN_VARIANCE_M2 = 1e-8
"""Smallest variance of a point, so that its weight is finite."""


@dataclass(frozen=True, eq=False)
class TentativeState:
    """Root-centered core pose of a tentative track at one time.

    Attributes:
        poses: Root r and core keypoints Z relative to it, with their covariances.
        root_velocity_m_s: shape (3,).
        core_velocity_m_s: shape (core, 3), of Z; NaN where a keypoint was not observed.
    """

    poses: CorePoses
    root_velocity_m_s: np.ndarray
    core_velocity_m_s: np.ndarray


def buffer_of(track: TentativeTrack, settings: TrackerSettings) -> list[Observation]:
    """Return the latest observations of a tentative track, those within ``buffer_s`` of the last one."""
    since_s = track.observations[-1].time_s - settings.options.specification.buffer_s - TIME_TOLERANCE_S
    return [each for each in track.observations if each.time_s >= since_s]


def tentative_state(observations: list[Observation], time_s: float, settings: TrackerSettings) -> TentativeState:
    """Return the state of a tentative track, predicted to a time.

    Without ``tentative_motion``, it is the last observation at rest.

    Args:
        observations: Buffer of the track, oldest first.
        time_s: Time of the state, in seconds.
        settings: Settings of the tracker.
    """
    options = settings.options.specification
    poses = core_poses(
        np.stack([each.points_m for each in observations]),
        np.stack([each.covariance_m2 for each in observations]),
        settings.skeleton,
    )
    if not options.tentative_motion:
        at_rest = np.zeros_like(poses.core_m[-1])
        return TentativeState(poses.select(-1), np.zeros(3), np.where(np.isfinite(poses.core_m[-1]), at_rest, np.nan))
    since_s = np.array([each.time_s for each in observations]) - time_s
    speed_m_s = options.tentative_speed_m_s
    root, root_velocity, root_spread = _line(since_s, poses.root_m, poses.root_covariance_m2, speed_m_s)
    core, core_velocity, core_spread = _line(since_s, poses.core_m, poses.core_covariance_m2, speed_m_s)
    return TentativeState(CorePoses(root, root_spread, core, core_spread), root_velocity, core_velocity)


def _line(
    since_s: np.ndarray, points_m: np.ndarray, covariance_m2: np.ndarray, speed_m_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return position, velocity and covariance of the position at time 0, by weighted least squares.

    Args:
        since_s: shape (observation,): times.
        points_m: shape (observation, ..., 3), NaN where missing.
        covariance_m2: shape (observation, ..., 3, 3).
        speed_m_s: Standard deviation of the prior of the velocity.
    """
    known = np.asarray(np.isfinite(points_m).all(axis=-1) & np.isfinite(covariance_m2).all(axis=(-2, -1)))
    spread = np.where(known[..., None, None], covariance_m2, np.eye(3)) + _MIN_VARIANCE_M2 * np.eye(3)
    weight = np.where(known[..., None, None], np.linalg.inv(spread), 0.0)
    pull = np.einsum("t...ij,t...j->t...i", weight, np.where(known[..., None], points_m, 0.0))
    steps = since_s.reshape(-1, *(1,) * (points_m.ndim - 1))
    information = np.zeros((*points_m.shape[1:-1], 6, 6))
    information[..., :3, :3] = weight.sum(axis=0)
    information[..., :3, 3:] = (steps[..., None] * weight).sum(axis=0)
    information[..., 3:, :3] = information[..., :3, 3:]
    information[..., 3:, 3:] = (steps[..., None] ** 2 * weight).sum(axis=0) + np.eye(3) / speed_m_s**2
    right = np.concatenate([pull.sum(axis=0), (steps * pull).sum(axis=0)], axis=-1)
    seen = np.asarray(known.any(axis=0))
    covariance = np.linalg.inv(np.where(seen[..., None, None], information, np.eye(6)))
    solved = np.where(seen[..., None], np.einsum("...ij,...j->...i", covariance, right), np.nan)
    return solved[..., :3], solved[..., 3:], np.where(seen[..., None, None], covariance[..., :3, :3], np.nan)
