"""Cameras and the poses of a board that they observe, as the model of a bundle adjustment.

A moving board is observed by a camera whose clock is offset at another place: a corner is projected from where it is at
the time of the image. Velocity and acceleration of the board come from the poses before and after, and are held fixed
during an adjustment.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from posefuse.calibration.boards.observations import CornerObservations
from posefuse.calibration.boards.parameters import (
    LENS,
    N_PARAMETERS,
    OFFSET,
    POSE,
    LensPrior,
    changed,
    lens_values,
)
from posefuse.calibration.boards.shape import N_SHAPE, shape_directions
from posefuse.calibration.normal_equations import Prior, ResidualRows, residual_rows
from posefuse.model.board import Board
from posefuse.model.cameras import Camera, CameraRig

_MAX_GAP_S = 0.5
_CORNER_PX = 0.2


@dataclass(frozen=True, eq=False)
class BoardModel:
    """Cameras, and the poses of a board.

    Attributes:
        rig: the cameras.
        offset_s: shape (view,): time offset of each view; its images show the board that much later.
        rotations: shape (pose, 3, 3): of the board, world from board.
        origins_m: shape (pose, 3): origin of the board in the world.
        motion: of the board at each pose.
        board: the board.
        observations: of its corners.
        priors: of the lenses, one per camera; none for lenses that are fixed.
        shape: shape (5,): how the board differs from its description, see :mod:`posefuse.calibration.boards.shape`.
    """

    rig: CameraRig
    offset_s: np.ndarray
    rotations: np.ndarray
    origins_m: np.ndarray
    motion: "Motion"
    board: Board
    observations: CornerObservations
    priors: tuple[LensPrior, ...] = ()
    shape: np.ndarray = field(default_factory=lambda: np.zeros(N_SHAPE))

    @classmethod
    def at_rest(
        cls,
        rig: CameraRig,
        rotations: np.ndarray,
        origins_m: np.ndarray,
        board: Board,
        observations: CornerObservations,
        priors: tuple[LensPrior, ...] = (),
    ) -> "BoardModel":
        """Return a model with synchronized cameras and a board that does not move."""
        at_rest = Motion.zero(len(rotations))
        return cls(rig, np.zeros(len(rig)), rotations, origins_m, at_rest, board, observations, priors)

    @property
    def n_views(self) -> int:
        """Number of cameras."""
        return len(self.rig)

    @property
    def corners_m(self) -> np.ndarray:
        """Corners on the board, shape (corner, 3)."""
        return self.board.points_m + shape_directions(self.board) @ self.shape

    def _lag_s(self) -> np.ndarray:
        """Return the time of each observation's image minus that of the pose, shape (observation,)."""
        return self.observations.delay_s + self.offset_s[self.observations.view]

    def image_rotations(self) -> np.ndarray:
        """Return rotations of the board at the times of the images, world from board, shape (observation, 3, 3)."""
        point, lag = self.observations.point, self._lag_s()[:, None]
        motion = self.motion.at(point)
        turns = Rotation.from_rotvec((motion.spin + 0.5 * motion.spin_rate * lag) * lag)
        return turns.as_matrix() @ self.rotations[point]

    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return arms from the origin of the board to the observed corners, the corners, and their velocities.

        All are at the times of the images, in the world, of shape (observation, 3).
        """
        seen = self.observations
        lag, motion = self._lag_s()[:, None], self.motion.at(seen.point)
        arms = (self.image_rotations() @ self.corners_m[seen.corner][:, :, None])[:, :, 0]
        places = self.origins_m[seen.point] + arms + (motion.velocity + 0.5 * motion.acceleration * lag) * lag
        moves = np.cross(motion.spin + motion.spin_rate * lag, arms) + motion.velocity + motion.acceleration * lag
        return arms, places, moves

    def rows(self, scale: np.ndarray) -> ResidualRows:
        """Return residuals and derivatives at noise factors of shape (view,)."""
        arms, places, moves = self._places()
        weight = 1.0 / (_CORNER_PX * scale[self.observations.view])
        parts = residual_rows(self.rig, self.observations.view, self.observations.pixels, places, weight)
        by_camera = np.empty((len(places), 2, N_PARAMETERS))
        by_camera[:, :, POSE] = parts.by_pose
        by_camera[:, :, LENS] = parts.by_lens
        by_camera[:, :, OFFSET] = (parts.by_point @ moves[:, :, None])[:, :, 0]
        # The board turns about its origin: d(exp(w) arm)/dw = -[arm]x.
        by_turn = np.cross(arms[:, None], parts.by_point)
        by_pose = np.concatenate([by_turn, parts.by_point], axis=2)
        return ResidualRows(parts.residual, by_camera, by_pose, parts.squared, self._prior())

    def _prior(self) -> Prior | None:
        """Return the prior of the lenses at the current values."""
        if not self.priors:
            return None
        distances = [lens_values(c) - p.mean for c, p in zip(self.rig.cameras, self.priors, strict=True)]
        matrices = np.array([prior.matrix(away) for prior, away in zip(self.priors, distances, strict=True)])
        cost = sum(prior.cost(away) for prior, away in zip(self.priors, distances, strict=True))
        return Prior(np.einsum("vij,vj->vi", matrices, np.array(distances)), matrices, cost)

    def moved(self, change: np.ndarray, step: np.ndarray) -> "BoardModel":
        """Return the model after changes of the cameras (view, 19) and of the poses (pose, 6)."""
        cameras = tuple(changed(camera, row) for camera, row in zip(self.rig.cameras, change, strict=True))
        turns = Rotation.from_rotvec(step[:, :3]).as_matrix()
        return replace(
            self,
            rig=replace(self.rig, cameras=cameras),
            offset_s=self.offset_s + change[:, OFFSET],
            rotations=turns @ self.rotations,
            origins_m=self.origins_m + step[:, 3:],
        )

    def moving(self) -> "BoardModel":
        """Return the model with the motion that follows from the poses before and after, where both are close in time.

        Images are assigned to the pose closest to them in time, and poses are those at the mean time of their images:
        otherwise, one that a single view observes would depend on its own velocity, and diverge when this is repeated.
        """
        seen, used = self.observations.closest(self.offset_s)
        motion, later_s = self.motion.at(used), (seen.time_s - self.observations.time_s[used])[:, None]
        turns = Rotation.from_rotvec((motion.spin + 0.5 * motion.spin_rate * later_s) * later_s)
        rotations = turns.as_matrix() @ self.rotations[used]
        origins = self.origins_m[used] + (motion.velocity + 0.5 * motion.acceleration * later_s) * later_s
        motion = Motion.of(rotations, origins, seen.time_s)
        return replace(self, rotations=rotations, origins_m=origins, motion=motion, observations=seen)

    def select_poses(self, chosen: np.ndarray) -> "BoardModel":
        """Return the model of some poses, which keep their motion; ``chosen`` has shape (pose,), bool."""
        return replace(
            self,
            rotations=self.rotations[chosen],
            origins_m=self.origins_m[chosen],
            motion=self.motion.at(np.flatnonzero(chosen)),
            observations=self.observations.select_poses(chosen),
        )

    def corner_places(self) -> np.ndarray:
        """Return all corners at the times of the poses, shape (pose, corner, 3), in the world."""
        return self.corners_m @ self.rotations.transpose(0, 2, 1) + self.origins_m[:, None]

    def point_rows(self, change_m: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals and derivatives by the observed points of corners that need not lie on the board.

        Args:
            change_m: shape (observation, 3): distance of the corner from its place on the board.
            scale: shape (view,): noise factors.
        """
        places = self._places()[1] + change_m
        weight = 1.0 / (_CORNER_PX * scale[self.observations.view])
        parts = residual_rows(self.rig, self.observations.view, self.observations.pixels, places, weight)
        return parts.residual, parts.by_point

    def errors_px(self) -> np.ndarray:
        """Return distances between projected and detected corners, shape (observation,)."""
        rows = self.rows(np.ones(self.n_views))
        return _CORNER_PX * np.sqrt(rows.squared)

    def residuals_px(self) -> np.ndarray:
        """Return projected minus detected corners, shape (observation, 2)."""
        return _CORNER_PX * self.rows(np.ones(self.n_views)).residual


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of a board at each of its poses; 0 where it is unknown.

    Attributes:
        spin: shape (pose, 3): angular velocity about the axes of the world, in rad/s.
        spin_rate: shape (pose, 3): its derivative, in rad/s^2.
        velocity: shape (pose, 3): of the origin, in m/s.
        acceleration: shape (pose, 3): of the origin, in m/s^2.
    """

    spin: np.ndarray
    spin_rate: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    @classmethod
    def zero(cls, n: int) -> "Motion":
        """Return the motion of a board at rest."""
        return cls(*(np.zeros((n, 3)) for _ in range(4)))

    @classmethod
    def of(cls, rotations: np.ndarray, origins_m: np.ndarray, time_s: np.ndarray) -> "Motion":
        """Return the motion through each pose and its neighbors, by a parabola."""
        out = cls.zero(len(time_s))
        if len(time_s) < 3:
            return out
        steps_s = np.diff(time_s)
        turns = Rotation.from_matrix(rotations[1:] @ rotations[:-1].transpose(0, 2, 1)).as_rotvec()
        with np.errstate(divide="ignore", invalid="ignore"):
            spins, speeds = turns / steps_s[:, None], np.diff(origins_m, axis=0) / steps_s[:, None]
        before, after = steps_s[:-1, None], steps_s[1:, None]
        close = ((before > 0.0) & (after > 0.0) & (before + after <= _MAX_GAP_S))[:, 0]
        for rate, value, change in (
            (spins, out.spin, out.spin_rate),
            (speeds, out.velocity, out.acceleration),
        ):
            with np.errstate(invalid="ignore"):
                mean = (rate[:-1] * after + rate[1:] * before) / (before + after)
                slope = 2.0 * (rate[1:] - rate[:-1]) / (before + after)
            value[1:-1][close] = mean[close]
            change[1:-1][close] = slope[close]
            _extrapolate(value, change, time_s, np.concatenate([[False], close, [False]]))
        return out

    def at(self, pose: np.ndarray) -> "Motion":
        """Return the motion of some poses."""
        return Motion(self.spin[pose], self.spin_rate[pose], self.velocity[pose], self.acceleration[pose])


def _extrapolate(value: np.ndarray, change: np.ndarray, time_s: np.ndarray, known: np.ndarray) -> None:
    """Continue the parabola of a pose to its unknown neighbors, which are at the ends of periods with the board."""
    for k in np.flatnonzero(~known):
        for other in (k + 1, k - 1):
            if 0 <= other < len(known) and known[other] and abs(time_s[k] - time_s[other]) <= _MAX_GAP_S / 2:
                value[k] = value[other] + change[other] * (time_s[k] - time_s[other])
                change[k] = change[other]
                break


def single(camera: Camera) -> CameraRig:
    """Return a rig of one camera at the origin."""
    return CameraRig((replace(camera, camera_from_world=np.eye(4)),))
