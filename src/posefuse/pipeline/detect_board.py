"""Detect the corners of a board in the images of all cameras, each camera in a thread of its own.

Long videos get a quick look first, and are then examined where the board shows something new
(:mod:`posefuse.calibration.boards.choose_frames`). Corners are kept in the cache, so that the same images and board are
not examined twice.
"""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np

from posefuse.calibration.boards.choose_frames import (
    MAX_IMAGES,
    QuickLook,
    choose_periods,
    numbers_in_periods,
    quick_numbers,
)
from posefuse.detection.boards import detector as detector_module
from posefuse.detection.boards.detector import BoardDetector
from posefuse.detection.boards.layout import Layout, find_layout
from posefuse.detection.boards.search import BoardSearch
from posefuse.errors import CalibrationError
from posefuse.io.board_images import ImageReader, ViewImages, image_count
from posefuse.io.cache import read_cached, write_cached
from posefuse.io.checkpoints import digest_of
from posefuse.io.open_recording import digest_path
from posefuse.io.videos.frame_index import read_frame_index
from posefuse.model.board import Board
from posefuse.pipeline.wrong_board import explain_missing_board, require_stated_board
from posefuse.progress import Progress, Silent

_CACHE = "boards"
_PROGRAMS = ("detector.py", "layout.py", "search.py")
_ARRAYS = ("size_px", "numbers", "time_s", "corners_px")


@dataclass(frozen=True, eq=False)
class ViewCorners:
    """Corners in the images of one camera.

    Attributes:
        name: name of the camera.
        size_px: width and height of its images.
        numbers: shape (image,), int64: indices of the images in the video or folder.
        time_s: shape (image,): times since the first image; NaN for pictures.
        corners_px: shape (image, corner, 2), NaN where not found.
        labels: names of the images: those of pictures, empty for a video.
        notes: sentences for the user, such as that a video breaks off.
        other_size: size of the board in the image with the most corners, if it is not the stated one.
    """

    name: str
    size_px: tuple[int, int]
    numbers: np.ndarray
    time_s: np.ndarray
    corners_px: np.ndarray
    labels: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    other_size: Layout | None = None

    @property
    def n_found(self) -> int:
        """Number of images that show the board."""
        return int(np.isfinite(self.corners_px[:, :, 0]).any(axis=1).sum())


def detect_board(
    views: Sequence[ViewImages],
    board: Board,
    *,
    every: int | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> tuple[ViewCorners, ...]:
    """Detect the corners of a board.

    Args:
        views: images of each camera.
        board: the board.
        every: interval of the images of a video that are examined; None for all images of short videos, and the most
            informative periods of long ones.
        jobs: number of threads; None for one per core.
        progress: receives the progress.

    Raises:
        CalibrationError: if no camera shows the board, or another one; the message names the markers that the images
            contain instead.
        FileError: if an image cannot be read, or OpenCV is not installed.
    """
    progress = progress or Silent()
    detector = BoardDetector(board, thorough=not views[0].is_video)
    run = partial(_detect_views, detector=detector, jobs=jobs, progress=progress)
    counts = [image_count(view) for view in views]
    if every is not None or not views[0].is_video or max(counts) <= MAX_IMAGES:
        step = (every or 1) if views[0].is_video else 1
        found = run(views, [np.arange(0, n, step) for n in counts], name="detecting the board")
    else:
        quick = run(views, [quick_numbers(n) for n in counts], name="looking for the board")
        if not any(view.n_found for view in quick):
            raise CalibrationError(explain_missing_board(views, board))
        starts_s = choose_periods([QuickLook(view.time_s, view.corners_px, view.size_px) for view in quick])
        wanted = [numbers_in_periods(read_frame_index(view.files[0]).time_s, starts_s) for view in views]
        found = run(views, wanted, name="detecting the board")
    if not any(view.n_found for view in found):
        raise CalibrationError(explain_missing_board(views, board))
    require_stated_board([view.other_size for view in found], board)
    return found


def _detect_views(
    views: Sequence[ViewImages],
    wanted: Sequence[np.ndarray],
    *,
    detector: BoardDetector,
    jobs: int | None,
    progress: Progress,
    name: str,
) -> tuple[ViewCorners, ...]:
    """Return the corners in the wanted images of all cameras, each camera in a thread of its own.

    OpenCV and the video decoder release the interpreter's lock, so threads run side by side.
    """
    progress.start(name, len(views))
    found: list[ViewCorners] = []
    with ThreadPoolExecutor(min(jobs or os.cpu_count() or 1, len(views))) as pool:
        futures = [
            pool.submit(_detect_view, view, detector, numbers) for view, numbers in zip(views, wanted, strict=True)
        ]
        for future in futures:
            found.append(future.result())
            progress.advance(1)
    progress.finish()
    return tuple(found)


def _detect_view(view: ViewImages, detector: BoardDetector, wanted: np.ndarray) -> ViewCorners:
    """Return the corners in some images of one camera, from the cache if they are there."""
    labels = () if view.is_video else tuple(file.name for file in view.files)
    key = _key(view, detector, wanted)
    cached = read_cached(_CACHE, key, (*_ARRAYS, "notes", "other_size"))
    if cached is not None:
        width, height = cached["size_px"].tolist()
        # Names of cameras are those of the files, which the content does not determine.
        notes = tuple(str(note).format(name=view.name) for note in cached["notes"])
        arrays = {name: cached[name] for name in _ARRAYS[1:]}
        other = Layout(*cached["other_size"].tolist()) if len(cached["other_size"]) else None
        return ViewCorners(view.name, (width, height), **arrays, labels=labels, notes=notes, other_size=other)
    found = _examine(view, detector, wanted, labels)
    notes = np.array([note.replace(repr(view.name), "{name!r}") for note in found.notes], dtype=np.str_)
    other = np.array([] if found.other_size is None else astuple(found.other_size), dtype=np.int64)
    arrays = {name: np.asarray(getattr(found, name)) for name in _ARRAYS}
    write_cached(_CACHE, key, arrays | {"notes": notes, "other_size": other})
    return found


def _key(view: ViewImages, detector: BoardDetector, wanted: np.ndarray) -> str:
    """Return a digest of everything that the corners depend on: contents, but no path or time."""
    return digest_of(
        {
            "images": [digest_path(file) for file in view.files],
            "wanted": wanted.tolist(),
            "board": [str(each) for each in astuple(detector.board)],
            "thorough": detector.thorough,
            "versions": [version("posefuse"), version("av"), detector.library_version],
            # The cache outlives changes of the program.
            "programs": [digest_path(Path(detector_module.__file__).with_name(name)) for name in _PROGRAMS],
        }
    )


def _examine(view: ViewImages, detector: BoardDetector, wanted: np.ndarray, labels: tuple[str, ...]) -> ViewCorners:
    """Return the corners in some images of one camera."""
    read, corners = _ReadImages(ImageReader(view), wanted), []
    if view.is_video:
        examined = BoardSearch(detector).corners_of(read.images())
    else:
        examined = ((gray, detector.corners_px(gray)) for _, gray in read.images())
    most, best = 0, None
    for gray, found in examined:
        corners.append(found)
        n_found = int(np.isfinite(found[:, 0]).sum())
        if n_found > most:
            most, best = n_found, gray
    return ViewCorners(
        view.name,
        read.size_px,
        np.array(read.numbers, dtype=np.int64),
        np.array(read.times_s),
        np.array(corners).reshape(len(corners), -1, 2),
        labels,
        tuple(read.reader.notes),
        None if best is None else find_layout(detector.board, best),
    )


@dataclass
class _ReadImages:
    """Some images of one camera, being read: their numbers, times and size."""

    reader: ImageReader
    wanted: np.ndarray
    size_px: tuple[int, int] = (0, 0)
    numbers: list[int] = field(default_factory=list)
    times_s: list[float] = field(default_factory=list)

    def images(self) -> Iterator[tuple[float, np.ndarray]]:
        """Yield the times and images."""
        for image in self.reader.images(frozenset(self.wanted.tolist()).__contains__):
            shape, before = (image.gray.shape[1], image.gray.shape[0]), self.size_px
            if before not in ((0, 0), shape):
                raise CalibrationError(
                    f"Camera {self.reader.view.name!r} has images of different sizes: {before[0]} x {before[1]} and "
                    f"{shape[0]} x {shape[1]} px. Use the images of one camera and one resolution."
                )
            self.size_px = shape
            self.numbers.append(image.number)
            self.times_s.append(image.time_s)
            yield image.time_s, image.gray
