"""Simulated images of calibration boards."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from posefuse.io.board_specs import read_board_spec
from posefuse.io.videos.writer import write_video
from posefuse.model.board import Board
from posefuse.model.cameras import Camera, CameraRig, LensModel, rotation_from_vector
from posefuse.model.detections import Detections
from posefuse.synthetic.rigs import look_at
from posefuse.visualize.board_sheet import black_squares

BOARD = Board("charuco", 6, 5, 0.04)
SIZE_PX = (1280, 720)
RATE_HZ = 10.0
SPEC = "charuco:6x5,square=80mm"
RENDERED_PX_PER_M, MARGIN_PX = 1000.0, 60
N_FRAMES = 16
SMALL_PX = (960, 540)
LENSES = {
    LensModel.BROWN: (-0.2, 0.05, 1e-3, -5e-4, 0.01),
    LensModel.RATIONAL: (0.1, -0.05, 1e-3, -5e-4, 0.01, 0.2, -0.05, 0.01),
    LensModel.FISHEYE: (0.05, -0.02, 0.01, -0.002),
}


def board_rig(n: int = 3, lens: LensModel = LensModel.BROWN) -> CameraRig:
    """Cameras on an arc that look at the same place from 1.2 m."""
    cameras = []
    for v in range(n):
        angle = np.radians(-35.0 + 70.0 * v / max(n - 1, 1))
        pose = look_at(np.array([1.2 * np.sin(angle), -1.2 * np.cos(angle), 0.3 + 0.1 * v]), np.zeros(3))
        focal = 800.0 + 40.0 * v
        matrix = np.array([[focal, 0.0, 630.0 + 5 * v], [0.0, focal + 2.0, 365.0 - 4 * v], [0.0, 0.0, 1.0]])
        cameras.append(Camera(f"cam_{v}", SIZE_PX, matrix, pose, lens, LENSES[lens]))
    return CameraRig(tuple(cameras))


def board_poses(times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (time, 3, 3), world from board, and origins (time, 3) of a board that is carried about."""
    t = np.asarray(times_s)[:, None]
    turns = np.concatenate([0.6 * np.sin(0.9 * t), 0.5 * np.sin(1.3 * t + 1.0), 0.8 * np.sin(0.5 * t)], axis=1)
    # The board faces the cameras, which are at negative y.
    facing = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    rotations = np.array([rotation_from_vector(turn) @ facing for turn in turns])
    centers = np.concatenate([0.3 * np.sin(0.7 * t), 0.2 * np.sin(1.1 * t), 0.2 * np.cos(0.6 * t)], axis=1)
    middle = BOARD.points_m.mean(axis=0)
    return rotations, centers - rotations @ middle


def board_detections(
    rig: CameraRig,
    *,
    n_frames: int = 60,
    noise_px: float = 0.2,
    offset_s: tuple[float, ...] = (),
    missing: float = 0.1,
    seed: int = 0,
) -> Detections:
    """Corners of a moving board with noise; a corner is missing by chance, or outside of the image."""
    rng = np.random.default_rng(seed)
    times = np.arange(n_frames) / RATE_HZ
    pixels = np.full((n_frames, len(rig), len(BOARD.points_m), 2), np.nan)
    for v, camera in enumerate(rig.cameras):
        rotations, origins = board_poses(times + (offset_s[v] if offset_s else 0.0))
        places = BOARD.points_m @ rotations.transpose(0, 2, 1) + origins[:, None]
        seen = camera.project(places)[0] + rng.normal(0.0, noise_px, (*places.shape[:2], 2))
        inside = ((seen > 0) & (seen < np.array(camera.size_px) - 1)).all(axis=-1)
        inside &= rng.random(inside.shape) >= missing
        pixels[:, v] = np.where(inside[..., None], seen, np.nan)
    return Detections.from_dense(BOARD.skeleton, rig.names, pixels, rate_hz=RATE_HZ)


def unplaced(rig: CameraRig) -> dict[str, Camera]:
    """The cameras without their poses."""
    return {camera.name: replace(camera, camera_from_world=np.eye(4)) for camera in rig.cameras}


def picture(board: Board, px_per_m: float = 4000.0, margin_px: int = 60) -> np.ndarray:
    """Draw a board from the front, shape (height, width), uint8."""
    width, height = board.size_m
    shape = round(height * px_per_m) + 2 * margin_px, round(width * px_per_m) + 2 * margin_px
    image = np.full(shape, 255, dtype=np.uint8)
    for x, y, w, h in black_squares(board):
        rows = [margin_px + round(value * px_per_m) for value in (y, y + h)]
        columns = [margin_px + round(value * px_per_m) for value in (x, x + w)]
        image[slice(*rows), slice(*columns)] = 0
    blurred = gaussian_filter(image.astype(np.float64), 1.0).round().astype(np.uint8)
    return 255 - blurred if board.inverted else blurred


def small_rig(n: int = 2) -> CameraRig:
    """Pinhole cameras with small images, which a homography renders exactly."""
    cameras = []
    for camera in board_rig(n).cameras:
        matrix = camera.matrix * 0.75
        matrix[2, 2] = 1.0
        cameras.append(Camera(camera.name, SMALL_PX, matrix, camera.camera_from_world))
    return CameraRig(tuple(cameras))


def render(rig: CameraRig, folder: Path, spec: str = SPEC, *, mirrored: bool = False) -> None:
    """Write one video per camera of a board that is carried about."""
    drawn = picture(read_board_spec(spec), RENDERED_PX_PER_M, MARGIN_PX)
    times = 0.6 * np.arange(N_FRAMES)
    rotations, origins = board_poses(times)
    board_from_picture = np.array(
        [
            [1 / RENDERED_PX_PER_M, 0.0, (0.5 - MARGIN_PX) / RENDERED_PX_PER_M],
            [0.0, 1 / RENDERED_PX_PER_M, (0.5 - MARGIN_PX) / RENDERED_PX_PER_M],
            [0.0, 0.0, 1.0],
        ]
    )
    folder.mkdir()
    for camera in rig.cameras:
        with write_video(folder / f"{camera.name}.mp4", camera.size_px, RATE_HZ) as video:
            for k in range(N_FRAMES):
                rotation = camera.rotation @ rotations[k]
                place = camera.rotation @ origins[k] + camera.translation_m
                plane = camera.matrix @ np.stack([rotation[:, 0], rotation[:, 1], place], axis=1)
                image = cv2.warpPerspective(
                    drawn, plane @ board_from_picture, camera.size_px, flags=cv2.INTER_AREA, borderValue=127
                )
                image = image[:, ::-1] if mirrored else image
                video.add(np.repeat(image[:, :, None], 3, axis=2), k / RATE_HZ)
