"""Detect the corners of a board in the images of all cameras, in parallel processes."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import islice
from multiprocessing import get_context

import numpy as np

from posefuse.detection.boards.detector import BoardDetector, MarkersFound, identify_markers
from posefuse.errors import CalibrationError
from posefuse.io.board_images import GrayImage, ViewImages, gray_images
from posefuse.model.board import Board
from posefuse.progress import Progress, Silent

_BATCH = 16
_N_EXAMPLES = 4


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
    """

    name: str
    size_px: tuple[int, int]
    numbers: np.ndarray
    time_s: np.ndarray
    corners_px: np.ndarray
    labels: tuple[str, ...] = ()

    @property
    def n_found(self) -> int:
        """Number of images that show the board."""
        return int(np.isfinite(self.corners_px[:, :, 0]).any(axis=1).sum())


def detect_board(
    views: Sequence[ViewImages],
    board: Board,
    *,
    every: int = 1,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> tuple[ViewCorners, ...]:
    """Detect the corners of a board.

    Args:
        views: images of each camera.
        board: the board.
        every: interval of the images of a video that are examined.
        jobs: number of processes; None for one per core.
        progress: receives the progress.

    Raises:
        CalibrationError: if no camera shows the board; the message names the markers that the images contain instead.
        FileError: if an image cannot be read, or OpenCV is not installed.
    """
    progress = progress or Silent()
    detector = BoardDetector(board, thorough=not views[0].is_video)
    workers = min(jobs or os.cpu_count() or 1, len(views))
    progress.start("detecting the board", len(views))
    found: list[ViewCorners] = []
    if workers == 1:
        for view in views:
            found.append(_detect_view(view, detector, every))
            progress.advance(1)
    else:
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            futures = [pool.submit(_detect_view, view, detector, every) for view in views]
            for future in futures:
                found.append(future.result())
                progress.advance(1)
    progress.finish()
    if not any(view.n_found for view in found):
        raise CalibrationError(_not_found(views, board, every))
    return tuple(found)


def _detect_view(view: ViewImages, detector: BoardDetector, every: int) -> ViewCorners:
    """Return the corners in the images of one camera."""
    numbers, times, corners = [], [], []
    size = (0, 0)
    for image in gray_images(view, every):
        shape = image.gray.shape[1], image.gray.shape[0]
        if size not in ((0, 0), shape):
            raise CalibrationError(
                f"Camera {view.name!r} has images of different sizes: {size[0]} x {size[1]} and {shape[0]} x "
                f"{shape[1]} px. Use the images of one camera and one resolution."
            )
        size = shape
        numbers.append(image.number)
        times.append(image.time_s)
        corners.append(detector.corners_px(image.gray))
    labels = () if view.is_video else tuple(file.name for file in view.files)
    pixels = np.array(corners).reshape(len(corners), -1, 2)
    return ViewCorners(view.name, size, np.array(numbers, dtype=np.int64), np.array(times), pixels, labels)


def _examples(view: ViewImages, every: int) -> Iterator[GrayImage]:
    """Yield some images of a camera, spread over the first of them."""
    return islice(gray_images(view, every * _BATCH if view.is_video else 1), _N_EXAMPLES)


def _not_found(views: Sequence[ViewImages], board: Board, every: int) -> str:
    """Return why no image shows the board, from the markers that the images contain."""
    text = f"No image shows the board {board}."
    examples = [image.gray for view in views for image in _examples(view, every)]
    other = identify_markers(examples) if board.kind != "checkerboard" else None
    if other is None:
        return (
            f"{text} Check its numbers of columns and rows"
            f"{'' if board.kind == 'checkerboard' else ' and its dictionary'}, and that it is flat, sharp and well lit."
        )
    return f"{text} {_difference(other, board)}"


def _difference(other: MarkersFound, board: Board) -> str:
    """Return how the markers of the images differ from those of the board."""
    if other.mirrored:
        return "The images are mirrored: turn off the mirroring of the camera and film the board again."
    if other.dictionary != board.dictionary:
        return f"The images contain markers of the dictionary {other.dictionary}: write dict={other.dictionary}."
    if other.inverted != board.inverted:
        return "Black and white are swapped in the images: " + (
            "add inverted to the board." if other.inverted else "remove inverted from the board."
        )
    return (
        f"The images contain {other.n_markers} markers of its dictionary, up to number {other.highest}: check the "
        "numbers of columns and rows, and whether the pattern is legacy."
    )
