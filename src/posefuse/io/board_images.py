"""Images of a calibration board: one video per camera, or one folder of pictures per camera."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from posefuse.errors import FileError, RecordingError
from posefuse.io.files import must_exist, natural_key
from posefuse.io.videos.frame_index import read_frame_index
from posefuse.io.videos.library import import_pyav
from posefuse.io.videos.reader import VIDEO_ENDINGS, open_video

PICTURE_ENDINGS = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp")
_MAX_DEPTH = 3
_MAX_LEVELS = 3
_BOARD_FOLDERS = ("calib", "board", "charuco", "checkerboard")


@dataclass(frozen=True)
class ViewImages:
    """The images of one camera.

    Attributes:
        name: name of the camera: that of the video without its ending, or of the folder of pictures.
        files: the video, or the pictures in natural order.
        is_video: whether there is one video.
    """

    name: str
    files: tuple[Path, ...]
    is_video: bool


@dataclass(frozen=True, eq=False)
class GrayImage:
    """One image.

    Attributes:
        number: index of the image in its video or folder.
        time_s: time since the first image of the video; NaN for a picture.
        gray: shape (height, width), uint8.
    """

    number: int
    time_s: float
    gray: np.ndarray


def find_images(folder: Path) -> tuple[ViewImages, ...]:
    """Return the images of each camera below a folder, ordered by name.

    Raises:
        FileError: if the folder does not exist.
        RecordingError: if there are no images, or several sets of them.
    """
    must_exist(folder, "folder of images")
    if folder.is_file():
        return (ViewImages(folder.stem, (folder,), is_video=folder.suffix.lower() in VIDEO_ENDINGS),)
    sets = find_sets(folder)
    if len(sets) == 1:
        return sets[0][1]
    if not sets:
        raise RecordingError(
            f"{folder} has neither videos ({', '.join(VIDEO_ENDINGS)}) nor folders of pictures, one per camera. Give "
            "the folder that holds one video of the board per camera."
        )
    listed = "".join(f"\n  {place}  ({_count(views)})" for place, views in sets)
    raise RecordingError(f"{folder} has {len(sets)} sets of images. Give the folder of one:{listed}")


def find_sets(folder: Path) -> list[tuple[Path, tuple[ViewImages, ...]]]:
    """Return the sets of images in a folder and below it, with the folder of each."""
    sets: list[tuple[Path, tuple[ViewImages, ...]]] = []
    for place in _folders(folder):
        videos = _files(place, VIDEO_ENDINGS)
        if videos:
            sets.append((place, tuple(ViewImages(file.stem, (file,), is_video=True) for file in videos)))
        pictures = [(inside, _files(inside, PICTURE_ENDINGS)) for inside in _subfolders(place)]
        views = tuple(ViewImages(inside.name, files, is_video=False) for inside, files in pictures if files)
        if views:
            sets.append((place, views))
    return sets


def find_board_folder(recording: Path) -> Path | None:
    """Return the folder with images of a board that belong to a recording, or None.

    Its name starts with calib, or, in the recording, with board, charuco or checkerboard. A folder up to two levels
    above the recording serves all recordings of a session.

    Args:
        recording: folder or file of the recording.
    """
    start = recording.resolve()
    for level in [start, *start.parents][:_MAX_LEVELS]:
        if level.is_dir():
            with contextlib.suppress(OSError):
                for inside in _subfolders(level):
                    if is_board_folder(inside.name, alone=level != start) and find_sets(inside):
                        return inside
    return None


def is_board_folder(name: str, *, alone: bool = False) -> bool:
    """Return whether a folder is named like one with images of a board; ``alone``: also outside of a recording."""
    return name.lower().startswith(_BOARD_FOLDERS[:1] if alone else _BOARD_FOLDERS)


def pictures_in(folder: Path) -> tuple[Path, ...]:
    """Return the pictures in a folder in natural order."""
    return _files(folder, PICTURE_ENDINGS)


def _count(views: tuple[ViewImages, ...]) -> str:
    one, several = ("video", "videos") if views[0].is_video else ("folder of pictures", "folders of pictures")
    return f"{len(views)} {one if len(views) == 1 else several}"


def _folders(folder: Path, depth: int = 0) -> Iterator[Path]:
    """Yield a folder and those inside it."""
    yield folder
    if depth < _MAX_DEPTH:
        for inside in _subfolders(folder):
            yield from _folders(inside, depth + 1)


def _subfolders(folder: Path) -> list[Path]:
    inside = [path for path in folder.iterdir() if path.is_dir() and not path.name.startswith(".")]
    return sorted(inside, key=lambda path: natural_key(path.name))


def _files(folder: Path, endings: tuple[str, ...]) -> tuple[Path, ...]:
    files = [path for path in folder.iterdir() if path.suffix.lower() in endings and path.is_file()]
    return tuple(sorted(files, key=lambda path: natural_key(path.name)))


@dataclass(frozen=True)
class ImageReader:
    """The images of one camera, being read.

    Attributes:
        view: the camera's images.
        notes: a sentence if a video breaks off, once it was read.
    """

    view: ViewImages
    notes: list[str] = field(default_factory=list)

    def images(self, only: Callable[[int], bool] | None = None) -> Iterator[GrayImage]:
        """Yield the images in order; those of a video that breaks off up to there.

        Args:
            only: whether the image of a number is wanted; None for all.

        Raises:
            FileError: if a picture, or the first image of a video, cannot be read.
        """
        view = self.view
        if not view.is_video:
            for number, file in enumerate(view.files):
                if only is None or only(number):
                    yield GrayImage(number, float("nan"), _first_image(file))
            return
        reader = open_video(view.files[0])
        for image in reader.images(pixel_format="gray", only=only):
            yield GrayImage(image.number, image.time_s, image.rgb)
        if reader.error:
            self.notes.append(
                f"The video of camera {view.name!r} breaks off after {reader.n_read} images ({reader.error}); the "
                "images before that are used."
            )


def image_count(view: ViewImages) -> int:
    """Return the number of images of a camera, counted without decoding a video.

    Raises:
        FileError: if a video cannot be read.
    """
    return read_frame_index(view.files[0]).n_images if view.is_video else len(view.files)


def _first_image(file: Path) -> np.ndarray:
    """Return a picture, shape (height, width), uint8."""
    av = import_pyav()
    try:
        with av.open(str(file)) as container:
            for frame in container.decode(video=0):
                return frame.to_ndarray(format="gray")
    except av.error.FFmpegError as error:
        raise FileError(f"{file} cannot be read as a picture ({error.strerror}).") from None
    raise FileError(f"{file} contains no picture.")
