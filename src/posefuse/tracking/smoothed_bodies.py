"""Smoothed bodies: poses, keypoints and their uncertainties over consecutive frames."""

from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.records import ProjectedKeypoints, State
from posefuse.kernels.tracking.smoothing import add_information
from posefuse.kinematics.angle_sds import axes_covariance, joint_angle_sds
from posefuse.kinematics.joint_angles import angle_names
from posefuse.model.cameras import up_vector
from posefuse.tracking.backward_pass import CHUNK_FRAMES
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.settings import TrackerSettings


@dataclass(frozen=True, eq=False)
class SmoothedBodies:
    """One person over consecutive frames.

    Attributes:
        root_m: shape (frame, 3).
        turns: shape (frame, segment, 3, 3): world from segment.
        bones: shape (frame, bone, 3, 3): the third axis is the bone's direction.
        shape_m: shape (frame, shape).
        shape_sd_m: shape (frame, shape): 0 where the shape is fixed.
        velocity: shape (frame, pose).
        points_m: shape (frame, keypoint, 3), NaN where the body has no such point.
        covariance_m2: shape (frame, keypoint, 6): xx xy xz yy yz zz.
        angle_sd_deg: shape (frame, angle): standard deviations of joint angles, NaN where an angle is unknown.
        root_turn: shape (frame, 3, 3): covariance of a small turn of the root about its own axes, rad^2; 0 for a root
            that does not turn.
        holds_deg2: shape (frame, part, 3, 3): covariance of the axes that hold each part, in degrees^2.
    """

    root_m: np.ndarray
    turns: np.ndarray
    bones: np.ndarray
    shape_m: np.ndarray
    shape_sd_m: np.ndarray
    velocity: np.ndarray
    points_m: np.ndarray
    covariance_m2: np.ndarray
    angle_sd_deg: np.ndarray
    root_turn: np.ndarray
    holds_deg2: np.ndarray

    def __len__(self) -> int:
        return len(self.root_m)

    @property
    def directions(self) -> np.ndarray:
        """Unit vectors from the near to the far end of each bone, shape (frame, bone, 3)."""
        return self.bones[..., 2]

    def frames(self, start: int, stop: int) -> "SmoothedBodies":
        """Return the frames ``start`` to ``stop``."""
        return SmoothedBodies(**{name: each[start:stop] for name, each in vars(self).items()})


def describe_bodies(state: State, information: np.ndarray | None, settings: TrackerSettings) -> SmoothedBodies:
    """Return poses, keypoints and uncertainties of smoothed states.

    The smoother assumes white noise with the power that the correlated errors have in the long run; within the few
    frames over which it averages their power is lower. So a share of each frame's untempered information is added.

    Args:
        state: State with one entry per frame.
        information: shape (frame, pose + shape, pose + shape): untempered information of each frame; None if the states
            were not tempered for smoothing.
        settings: Settings of the tracker.
    """
    frames, n, h = len(state.root), settings.tree.n_pose, settings.tree.n_shape
    projected = ProjectedBodies.allocate(frames, 0, len(settings.skeleton))
    shape_sd_m = np.zeros((frames, h))
    pose = np.zeros((frames, n, n))
    for start in range(0, frames, CHUNK_FRAMES):
        to = slice(start, min(start + CHUNK_FRAMES, frames))
        covariance = state.covariance[to].copy()
        if information is not None:
            _add_independent_information(covariance, information[to], state.free[to], settings)
        part = State(*(each[to] for each in state))._replace(covariance=covariance)
        out = ProjectedKeypoints(*(each[to] for each in projected.arrays))
        project_people(settings.cameras[:0], settings.body, part, out)
        variances = np.diagonal(covariance, axis1=1, axis2=2)[:, n : n + h]
        shape_sd_m[to] = np.sqrt(np.maximum(variances, 0.0))
        pose[to] = covariance[:, :n, :n]
    return SmoothedBodies(
        state.root, state.turns, state.bones, state.shape, shape_sd_m, state.velocity, projected.points_m,
        projected.covariance_m2, *_turn_uncertainties(state.turns, state.bones, pose, settings),
    )  # fmt: skip


def describe_points(state: State, settings: TrackerSettings) -> SmoothedBodies:
    """Return poses and keypoints of smoothed states; all uncertainties are NaN.

    Args:
        state: State with one entry per frame; its covariance is not read.
        settings: Settings of the tracker.
    """
    frames, n, h = len(state.root), settings.tree.n_pose, settings.tree.n_shape
    certain = state._replace(covariance=np.zeros((frames, n, n)), free=np.zeros(frames, dtype=np.int64))
    points_m = ProjectedBodies.of(certain, settings.cameras[:0], settings.body).points_m
    points, angles, parts = len(settings.skeleton), len(angle_names(settings.tree)), len(settings.skeleton.parts)
    sizes = ((h,), (points, 6), (angles,), (3, 3), (parts, 3, 3))
    shape_sd_m, *others = (np.broadcast_to(np.nan, (frames, *size)) for size in sizes)
    return SmoothedBodies(
        state.root, state.turns, state.bones, state.shape, shape_sd_m, state.velocity, points_m, *others
    )


def _add_independent_information(
    covariance: np.ndarray, information: np.ndarray, free: np.ndarray, settings: TrackerSettings
) -> None:
    """Add a share of each frame's untempered information to covariances, in place."""
    n, size, share = settings.tree.n_pose, information.shape[1], settings.options.smoother_independent_share
    done = add_information(information, share, free, n, covariance)
    while done < len(free):
        prior = covariance[done, :size, :size]
        posterior = prior @ np.linalg.inv(np.eye(size) + share * information[done] @ prior)
        if (np.diag(posterior) >= 0.0).all():
            covariance[done, :size, :size] = posterior
        done += 1
        done += add_information(information[done:], share, free[done:], n, covariance[done:])


def _turn_uncertainties(
    turns: np.ndarray, bones: np.ndarray, covariance: np.ndarray, settings: TrackerSettings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return standard deviations of joint angles, and covariances of the root's turn and of the parts' axes.

    Args:
        turns: shape (frame, segment, 3, 3).
        bones: shape (frame, bone, 3, 3).
        covariance: shape (frame, pose, pose).
        settings: Settings of the tracker.
    """
    tree, frames = settings.tree, len(turns)
    sds = joint_angle_sds(tree, turns, bones, covariance, up_vector(settings.rig.up_axis or "z"))
    root = covariance[:, 3:6, 3:6].copy() if tree.segments else np.zeros((frames, 3, 3))
    holds = np.empty((frames, len(settings.skeleton.parts), 3, 3))
    for i, part in enumerate(settings.skeleton.parts):
        holds[:, i] = axes_covariance(tree, int(tree.keypoint_nodes[part.at]), turns, bones, covariance)
    return sds, root, holds
