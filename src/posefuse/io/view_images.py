"""The images of a recording's views: one video per view, or one folder of pictures per view."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from posefuse.errors import FileError, RecordingError, choices
from posefuse.io.board_images import PICTURE_ENDINGS, ViewImages, find_sets, is_board_folder, pictures_in
from posefuse.io.files import must_exist
from posefuse.io.open_recording import digest_path
from posefuse.io.videos.decoder import VideoDecoder
from posefuse.io.videos.frame_index import FrameIndex, read_frame_index
from posefuse.io.videos.library import import_pyav
from posefuse.io.videos.reader import VIDEO_ENDINGS, upright

OUTPUT_MARKERS = ("detection.json", "reconstruction.nc")
"""Files that identify the output folders of ``detect`` and ``reconstruct``."""


class ImageReader(Protocol):
    """Reads ranges of a view's images."""

    def images(
        self, start: int, stop: int, wanted: Callable[[int], bool] | None = None
    ) -> Iterator[tuple[int, np.ndarray]]:
        """Yield number and image, shape (height, width, 3), uint8, RGB, of the readable images of a range."""
        ...

    def close(self) -> None:
        """Close the files."""
        ...


@dataclass(frozen=True, eq=False)
class ImageSource:
    """The images of a view.

    Attributes:
        view: its name and files.
        size_px: width and height for display.
        time_s: shape (image,): times since the first image of the video; NaN for pictures.
        starts: shape (start,), int64, ascending: images at which decoding can start.
        index: the index of the video; None for pictures.
    """

    view: ViewImages
    size_px: tuple[int, int]
    time_s: np.ndarray
    starts: np.ndarray
    index: FrameIndex | None = None

    @property
    def name(self) -> str:
        """Name of the view."""
        return self.view.name

    @property
    def n_images(self) -> int:
        """Number of images."""
        return len(self.time_s)

    @property
    def note(self) -> str:
        """A sentence if the video breaks off; otherwise empty."""
        return "" if self.index is None else self.index.note

    def open(self, threads: int = 1) -> ImageReader:
        """Return a reader of the images.

        Args:
            threads: number of threads of a video's decoder.
        """
        return _PictureReader(self) if self.index is None else VideoDecoder(self.index, threads)

    def digest(self) -> str:
        """Return the SHA-256 of the video, or of the names and contents of the pictures."""
        folder = self.view.files[0] if self.view.is_video else self.view.files[0].parent
        return digest_path(folder)


@dataclass(frozen=True)
class _PictureReader:
    source: ImageSource

    def images(
        self, start: int, stop: int, wanted: Callable[[int], bool] | None = None
    ) -> Iterator[tuple[int, np.ndarray]]:
        """Yield number and picture.

        Raises:
            FileError: if a picture cannot be read, or has another size than the first one.
        """
        for number in range(start, min(stop, self.source.n_images)):
            if wanted is None or wanted(number):
                file, expected = self.source.view.files[number], self.source.size_px
                rgb = _picture(file)
                if (rgb.shape[1], rgb.shape[0]) != expected:
                    raise FileError(
                        f"{file} has {rgb.shape[1]} x {rgb.shape[0]} px, but the first picture of view "
                        f"{self.source.name!r} has {expected[0]} x {expected[1]}. A camera has one image size."
                    )
                yield number, rgb

    def close(self) -> None:
        """Do nothing: each picture is closed when it was read."""


def open_source(view: ViewImages) -> ImageSource:
    """Return the images of a view.

    Raises:
        FileError: if the video, or the first picture, cannot be read.
    """
    if view.is_video:
        index = read_frame_index(view.files[0])
        return ImageSource(view, index.info.size_px, index.time_s, index.starts, index)
    first, n = _picture(view.files[0]), len(view.files)
    return ImageSource(view, (first.shape[1], first.shape[0]), np.full(n, np.nan), np.arange(n))


def _picture(file: Path) -> np.ndarray:
    """Return a picture for display, shape (height, width, 3), uint8, RGB."""
    av = import_pyav()
    try:
        with av.open(str(file)) as container:
            for frame in container.decode(video=0):
                return upright(frame)
    except (av.error.FFmpegError, EOFError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(f"{file} cannot be read as a picture ({reason}).") from None
    raise FileError(f"{file} contains no picture.")


def find_views(videos: Path | Iterable[Path] | Mapping[str, Path]) -> tuple[ViewImages, ...]:
    """Return the views of a recording.

    Args:
        videos: a folder of videos or of folders of pictures, one per view; several videos or folders of pictures; or
            these by the name of the view. Folders below a folder are searched if it has neither; those with images of
            a board (``calib*``) are left out.

    Raises:
        FileError: if a path does not exist or is neither a video nor a folder of pictures.
        RecordingError: if there are no videos, several sets of them, or two for one view.
    """
    if isinstance(videos, Mapping):
        return _distinct([_view(str(name), Path(path)) for name, path in videos.items()])
    paths = [videos] if isinstance(videos, Path) else list(videos)
    if not paths:
        raise RecordingError("There are no videos. Give a folder of videos, or the videos, one per camera.")
    found = [view for path in paths for view in _views_at(path)]
    if len({view.name for view in found}) < len(found):
        # Names such as cam1/video.mp4 and cam2/video.mp4.
        found = [ViewImages(view.files[0].parent.name, view.files, view.is_video) for view in found]
    return _distinct(found)


def _view(name: str, path: Path) -> ViewImages:
    """Return a video or a folder of pictures as a view."""
    must_exist(path, "video")
    if path.is_file():
        return ViewImages(name, (path,), is_video=True)
    pictures = pictures_in(path)
    if not pictures:
        raise FileError(
            f"{path} is a folder without pictures ({', '.join(PICTURE_ENDINGS)}). The view {name!r} needs a video or a "
            "folder of pictures."
        )
    return ViewImages(name, pictures, is_video=False)


def _views_at(path: Path) -> tuple[ViewImages, ...]:
    """Return the views at a path: one video, one folder of pictures, or those of a folder."""
    must_exist(path, "video or folder of videos")
    if path.is_file():
        return (_view(path.stem, path),)
    sets = [(place, views) for place, views in find_sets(path) if not _is_left_out(place, path)]
    # What lies below a folder of videos, such as cut-outs of them, is not asked for.
    sets = [each for each in sets if each[0] == path] or sets
    if len(sets) == 1:
        return sets[0][1]
    if len(sets) > 1 and all(len(views) == 1 and place.parent == path for place, views in sets):
        return tuple(ViewImages(place.name, views[0].files, views[0].is_video) for place, views in sets)
    if not sets:
        pictures = pictures_in(path)
        if pictures:
            return (ViewImages(path.name, pictures, is_video=False),)
        raise RecordingError(
            f"{path} has neither videos ({', '.join(VIDEO_ENDINGS)}) nor folders of pictures, one per camera."
        )
    listed = "".join(f"\n  {place}  ({choices([view.name for view in views], 4)})" for place, views in sets)
    raise RecordingError(f"{path} has {len(sets)} sets of images. Give the folder of one:{listed}")


def _is_left_out(place: Path, top: Path) -> bool:
    """Return whether a folder below another one is for images of a board, or was written by this program."""
    below = [place, *place.parents][: len(place.relative_to(top).parts)]
    return any(is_board_folder(each.name) or any((each / name).exists() for name in OUTPUT_MARKERS) for each in below)


def _distinct(views: list[ViewImages]) -> tuple[ViewImages, ...]:
    names = [view.name for view in views]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        files = choices([str(view.files[0]) for view in views if view.name == repeated[0]])
        raise RecordingError(f"Two views are called {repeated[0]!r}: {files}. Name them: CAMERA=FILE.")
    if len({view.is_video for view in views}) > 1:
        raise RecordingError(
            "Some views are videos and others pictures: "
            f"{choices([view.name for view in views if not view.is_video])} have no times. Use one kind."
        )
    return tuple(views)
