"""Result of a calibration by people."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posefuse.model.board import Board
from posefuse.model.cameras import CameraRig
from posefuse.skeleton.skeletons import Skeleton


@dataclass(frozen=True)
class PeopleCameraReport:
    """How well one camera is calibrated.

    Attributes:
        name: name of the camera.
        n_observations: number of keypoints observed together with other cameras.
        error_px: median distance between projected and detected keypoints.
        held_out_px: median distance between detected keypoints and those that the other cameras predict.
        rotation_sd_deg: standard deviation of the rotation relative to the first camera, in the worst direction.
        center_sd_m: standard deviation of the position, in the worst direction, without that of the scale.
        focal_sd_px: standard deviation of the focal length; 0 if it is given.
        offset_s: time offset: true time minus timestamp, relative to the first camera.
        offset_sd_s: standard deviation of the time offset; NaN if people do not determine it.
        rate: true seconds per second of its timestamps; 1 unless its frame rate is wrong.
        lens_given: whether the lens was given.
    """

    name: str
    n_observations: int
    error_px: float
    held_out_px: float
    rotation_sd_deg: float
    center_sd_m: float
    focal_sd_px: float
    offset_s: float
    offset_sd_s: float
    rate: float
    lens_given: bool


@dataclass(frozen=True)
class BoardShare:
    """What a board tells about one camera of a calibration by a board and people, before the people.

    Attributes:
        name: name of the camera.
        n_images: number of images of the board in the adjustment; 0 if it never sees the board with another camera.
        error_px: root mean square distance between projected and detected corners.
        rotation_sd_deg: standard deviation of the rotation relative to ``reference``, in the worst direction.
        center_sd_m: standard deviation of the position, in the worst direction.
        reference: name of the camera that they are relative to.
        lens: whether the board gives the lens.
    """

    name: str
    n_images: int = 0
    error_px: float = float("nan")
    rotation_sd_deg: float = float("nan")
    center_sd_m: float = float("nan")
    reference: str = ""
    lens: bool = False


@dataclass(frozen=True, eq=False)
class PeopleCalibration:
    """Result of a calibration by people.

    Attributes:
        rig: the related cameras. The world is the floor with z up if people show it, else the first camera.
        cameras: one report per camera, in the order of the rig.
        covariance: shape (view * 10, view * 10): of three rotations about the camera's own axes in rad, three shifts of
            its center in m, time offset in s, clock drift in s/s, logarithm of the focal length, and first coefficient
            of radial distortion; relative to the first camera and without the error of a scale by people.
        lens_covariance: shape (view, 18, view, 18): the same by rotation, center, fx, fy, cx, cy in px and eight
            distortion coefficients.
        scale_sd: relative standard deviation of all lengths; NaN if the scale is unknown, 0 if a board or an earlier
            calibration defines it.
        error_px: median distance between projected and detected keypoints of all views.
        held_out_px: median distance between detected keypoints and those that the other cameras predict.
        skeleton: of the keypoints.
        points_m: shape (frame, person, keypoint, 3): the people in the world, NaN where unknown.
        keypoints_px: shape (frame, view, person, keypoint, 2): what the cameras observed at these times, NaN where
            nothing was detected.
        time_s: shape (frame,): their times.
        left_out: name and reason of each camera that could not be related to the others.
        notes: what was assumed and corrected, in sentences.
        board: the board that is in the same estimate, if any.
        board_shares: what it tells about each camera, in the order of the rig.
    """

    rig: CameraRig
    cameras: tuple[PeopleCameraReport, ...]
    covariance: np.ndarray
    lens_covariance: np.ndarray
    scale_sd: float
    error_px: float
    held_out_px: float
    skeleton: Skeleton
    points_m: np.ndarray
    keypoints_px: np.ndarray
    time_s: np.ndarray
    left_out: Mapping[str, str]
    notes: tuple[str, ...] = ()
    board: Board | None = None
    board_shares: tuple[BoardShare, ...] = ()
