"""What a report of a calibration shows, whatever the cameras were calibrated with."""

from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from posefuse.model.cameras import CameraRig

CalibrationTarget = Literal["board", "people", "points"]


@dataclass(frozen=True, eq=False)
class CameraSummary:
    """How well one camera is calibrated.

    Attributes:
        pixels: shape (observation, 2): detected points that the calibration uses.
        residual_px: shape (observation, 2): projected minus detected points.
        image: shape (observation,), int64: index of the image of each point; errors in one image are correlated.
        rotation_sd_deg: standard deviation of the rotation, in the worst direction; 0 for the reference camera, if any.
        center_sd_m: standard deviation of the position, in the worst direction; 0 for the reference camera, if any.
        focal_sd_px: standard deviation of the focal length; 0 if it is fixed.
        lens_given: whether the lens was given and not estimated.
        offset_s: time offset: its images show the target that much later than those of the reference camera.
        offset_sd_s: its standard deviation; 0 for the reference camera, NaN if it was not estimated.
        held_out_px: root mean square error of points that the calibration did not use, NaN if unknown.
    """

    pixels: np.ndarray
    residual_px: np.ndarray
    image: np.ndarray
    rotation_sd_deg: float
    center_sd_m: float
    focal_sd_px: float
    lens_given: bool
    offset_s: float = 0.0
    offset_sd_s: float = float("nan")
    held_out_px: float = float("nan")

    @property
    def n_images(self) -> int:
        """Number of images with detected points."""
        return len(np.unique(self.image))

    @property
    def error_px(self) -> float:
        """Root mean square distance between projected and detected points."""
        return float(np.sqrt(np.mean(np.sum(self.residual_px**2, axis=1)))) if len(self.residual_px) else float("nan")

    def counts(self, size_px: tuple[int, int], columns: int, rows: int) -> np.ndarray:
        """Return the number of detected points in each cell of the image, shape (rows, columns), int64."""
        return np.bincount(self.cells(size_px, columns, rows), minlength=rows * columns).reshape(rows, columns)

    def cells(self, size_px: tuple[int, int], columns: int, rows: int) -> np.ndarray:
        """Return the index, row by row, of the cell of the image that holds each point, shape (observation,)."""
        shares = (self.pixels + 0.5) / np.array(size_px)
        cells = np.clip((shares * (columns, rows)).astype(np.int64), 0, (columns - 1, rows - 1))
        return cells[:, 1] * columns + cells[:, 0]


@dataclass(frozen=True, eq=False)
class VolumeAccuracy:
    """Accuracy of triangulated points in the filmed volume, from the covariance of the cameras alone.

    Attributes:
        middle_m: shape (3,): middle of the volume.
        middle_sd_m: standard deviation of a point in the middle, in the coordinates of the reference camera and in the
            worst direction.
        relative_sd_m: root mean square of ``sd_m``.
        length_sd: standard deviation of a length as a share of it, the largest along the three axes of the volume.
        distance_m: median distance of the cameras from the middle.
        points_m: shape (point, 3): points of a grid over the volume that at least two cameras see.
        sd_m: shape (point,): their standard deviations in the worst direction, relative to the whole volume: without
            the translation and rotation that all points share, which change no distance or angle.
        n_views: shape (point,), int64: number of cameras that see each point.
    """

    middle_m: np.ndarray
    middle_sd_m: float
    relative_sd_m: float
    length_sd: float
    distance_m: float
    points_m: np.ndarray
    sd_m: np.ndarray
    n_views: np.ndarray

    def moved(self, other_from_world: np.ndarray) -> Self:
        """Return the same accuracy with points in another world, ``other_from_world`` of shape (4, 4), rigid."""
        rotation, shift_m = other_from_world[:3, :3], other_from_world[:3, 3]
        points_m = self.points_m @ rotation.T + shift_m
        return replace(self, middle_m=rotation @ self.middle_m + shift_m, points_m=points_m)


@dataclass(frozen=True)
class LengthCheck:
    """Known lengths, compared with those that the calibrated cameras measure.

    Attributes:
        name: what was measured, such as ``distances on the board``.
        error: median of measured over true lengths, minus 1.
        spread: median absolute deviation of this share.
        n: number of lengths.
    """

    name: str
    error: float
    spread: float
    n: int


@dataclass(frozen=True, eq=False)
class KnownPoints:
    """How points of known position fit their places in the images.

    Attributes:
        points_m: shape (point, 3).
        error_px: shape (view, point): distances between projected and measured places, NaN where not shown.
        held_out_px: shape (view, point): the same for the prediction from the other points of the camera, NaN where
            they do not determine its pose.
        held_out_sds: shape (view, point): these distances in their standard deviations.
    """

    points_m: np.ndarray
    error_px: np.ndarray
    held_out_px: np.ndarray
    held_out_sds: np.ndarray


@dataclass(frozen=True, eq=False)
class CalibrationSummary:
    """Summary of a calibration.

    Attributes:
        rig: the calibrated cameras.
        target: what the cameras filmed.
        source: what was filmed in words, such as the description of the board.
        cameras: one summary per camera, in the order of the rig.
        shared: shape (view, view), int64: number of frames in which two cameras see the target.
        frames: shape (pose,), int64: frame number of each pose of the target.
        points_m: shape (pose, subject, point, 3): corners of the board, or keypoints of people, NaN where unknown.
        edges: shape (edge, 2), int64: pairs of points that a line connects.
        volume: accuracy in the filmed volume.
        lengths: comparisons with known lengths.
        scale_sd: standard deviation of the scale, as a share; 0 if a board defines it.
        point_names: names of the points; empty for a board.
        known_points: how points of known position fit, if the cameras were calibrated by them.
        left_out: name and reason of cameras that could not be calibrated.
    """

    rig: CameraRig
    target: CalibrationTarget
    source: str
    cameras: tuple[CameraSummary, ...]
    shared: np.ndarray
    frames: np.ndarray
    points_m: np.ndarray
    edges: np.ndarray
    volume: VolumeAccuracy
    lengths: tuple[LengthCheck, ...] = ()
    scale_sd: float = 0.0
    point_names: tuple[str, ...] = ()
    known_points: KnownPoints | None = None
    left_out: tuple[tuple[str, str], ...] = ()

    @property
    def error_px(self) -> float:
        """Root mean square distance between projected and detected points of all cameras."""
        squared = np.concatenate([np.sum(camera.residual_px**2, axis=1) for camera in self.cameras])
        return float(np.sqrt(squared.mean())) if len(squared) else float("nan")

    @property
    def n_observations(self) -> int:
        """Number of detected points."""
        return sum(len(camera.pixels) for camera in self.cameras)


AssessmentLevel = Literal["good", "note", "check", "bad"]


@dataclass(frozen=True)
class Advice:
    """One weakness of a calibration, and what to do about it.

    Attributes:
        level: how much it matters: ``note``, ``check`` or ``bad``.
        camera: name of the camera, empty if it concerns all.
        sentence: the weakness.
        remedy: what to film or change; empty if nothing helps.
    """

    level: AssessmentLevel
    camera: str
    sentence: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.sentence} {self.remedy}".strip()


@dataclass(frozen=True)
class Assessment:
    """Verdict on a calibration.

    Attributes:
        level: good, check (usable, look at the advice) or bad (do not use).
        sentence: the verdict in one sentence.
        advice: weaknesses, the worst first.
    """

    level: AssessmentLevel
    sentence: str
    advice: tuple[Advice, ...]
