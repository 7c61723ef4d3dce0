"""Small results and videos for tests of images."""

from pathlib import Path

import numpy as np

from posefuse.io.videos.reader import open_video
from posefuse.io.videos.writer import write_video
from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.tracks import Tracks, TrackState
from posefuse.skeleton.skeletons import Skeleton
from posefuse.synthetic.rigs import look_at

SIZE_PX = (320, 240)
RATE_HZ = 25.0
N_FRAMES = 12
STICK = Skeleton("stick", ("left_end", "middle", "right_end"), (("left_end", "middle"), ("middle", "right_end")),
                 pairs=(("left_end", "right_end"),))  # fmt: skip
BARREL = (-0.25, 0.0, 1e-3, 5e-4, 0.0)


def small_rig(size_px: tuple[int, int] = SIZE_PX) -> CameraRig:
    """Two cameras with barrel distortion that face each other across the origin."""
    focal = 0.7 * size_px[0]
    matrix = np.array([[focal, 0, (size_px[0] - 1) / 2], [0, focal, (size_px[1] - 1) / 2], [0, 0, 1]])
    poses = [look_at(np.array(place), np.array([0.0, 0.0, 1.0])) for place in ((4.0, 0.0, 1.0), (-4.0, 0.5, 1.2))]
    cameras = [Camera(f"cam{i}", size_px, matrix, pose, LensModel.BROWN, BARREL) for i, pose in enumerate(poses)]
    return CameraRig(tuple(cameras), up_axis="z")


def moving_sticks(rig: CameraRig | None = None, n_frames: int = N_FRAMES, people: int = 2) -> Reconstruction:
    """People of three points: horizontal sticks that move sideways by 10 cm per frame."""
    rig = rig or small_rig()
    points = np.empty((n_frames, people, 3, 3))
    for f in range(n_frames):
        for p in range(people):
            y = np.array([-0.2, 0.0, 0.2]) - 0.6 + 0.1 * f
            points[f, p] = np.stack([np.zeros(3), y, np.full(3, 0.7 + 0.6 * p)], axis=1)
    shape = points.shape[:3]
    layer = Layer(
        points_m=points,
        covariance_m2=np.zeros((*shape, 6)),
        status=np.full(shape, PointStatus.TWO_VIEWS, dtype=np.int8),
        source=np.full(shape, Source.MEASURED, dtype=np.int8),
        reprojection_error_px=np.full(shape, 0.5),
        view_status=np.full((*shape, len(rig)), ViewStatus.USED, dtype=np.int8),
        view_error_px=np.full((*shape, len(rig)), 0.5, dtype=np.float32),
    )
    names = tuple(f"person_{p + 1}" for p in range(people))
    assigned = np.tile(np.arange(people, dtype=np.int32)[None, :, None], (n_frames, 1, len(rig)))
    state = np.full((n_frames, people), TrackState.ACTIVE, dtype=np.int8)
    numbers = np.arange(n_frames)
    return Reconstruction(
        rig,
        STICK,
        names,
        numbers,
        numbers / RATE_HZ,
        {"measured": layer},
        Tracks(names, assigned, state),
        rate_hz=RATE_HZ,
    )


def exact_detections(result: Reconstruction) -> Detections:
    """Return the exact projections of a result as detections."""
    n_frames, people, keypoints, _ = result.layers["measured"].points_m.shape
    views = len(result.rig)
    pixels = result.rig.project(np.asarray(result.layers["measured"].points_m))
    rows = n_frames * views * people
    return Detections(
        STICK,
        result.rig.names,
        result.frame_numbers,
        np.tile(result.time_s[:, None], (1, views)),
        np.arange(n_frames * views + 1) * people,
        pixels.reshape(rows, keypoints, 2),
        np.ones((rows, keypoints)),
        np.ones((n_frames, views), dtype=bool),
        np.full(rows, -1),
        rate_hz=RATE_HZ,
    )


def coded_video(
    path: Path, n_frames: int = N_FRAMES, rate_hz: float = RATE_HZ, size_px: tuple[int, int] = SIZE_PX
) -> Path:
    """Write a video whose images are uniformly gray: 20 plus 10 times their number."""
    with write_video(path, size_px, rate_hz) as writer:
        for f in range(n_frames):
            writer.add(np.full((size_px[1], size_px[0], 3), 20 + 10 * f, dtype=np.uint8), f / rate_hz)
    return path


def images_of(path: Path) -> list[np.ndarray]:
    """Return all images of a video."""
    return [image.rgb for image in open_video(path).images()]


def codes_of(pictures: list[np.ndarray]) -> list[int]:
    """Return the numbers encoded in the gray values of images."""
    return [round((float(np.median(picture)) - 20) / 10) for picture in pictures]
