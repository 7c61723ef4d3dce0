"""What a folder of a recording contains: videos of people or of a board, calibrations, keypoints, times, settings.

Images of a board are recognized by the names of their folders or files; where these leave a choice, by what they show.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from posefuse.errors import RecordingError, choices
from posefuse.io import timestamps
from posefuse.io.board_images import ViewImages, find_board_folder, find_sets, is_board_folder
from posefuse.io.board_specs import find_board_spec
from posefuse.io.files import RUN_FILE, files_at, must_exist, natural_key
from posefuse.io.recording import Recording, find_recording
from posefuse.model.view_names import matching_name

_BOARD_WORDS = frozenset(
    ("board", "boards", "calib", "calibration", "charuco", "checkerboard", "chessboard", "extrinsics", "intrinsics")
)
_LENS_FOLDERS = ("intrinsic", "int_")
"""Beginnings of the names of folders in which each camera saw a board alone, for its lens."""
_OTHER_FOLDERS = ("annotated", "overlay", "extrinsic", "background", *_LENS_FOLDERS)
"""Beginnings of the names of folders whose videos are not those of a recording."""
_LEVELS_ABOVE = 2
_PREFERRED = "synchronized_videos"
"""Folder that FreeMoCap writes beside the raw videos."""
_SETTINGS = ("Config.toml", "config.toml", "recording_parameters.json", "recording_info.json", "settings.toml")

_OUTPUT_FILES = (RUN_FILE, "detection.json", "reconstruction.nc")
"""Files that identify what posefuse wrote."""


@dataclass(frozen=True)
class Session:
    """The content of a folder.

    Attributes:
        folder: the folder.
        recording: calibrations and keypoints.
        views: the images of people, one per camera; empty without any.
        board_views: the images of a board that several cameras see together, one per camera, by the names of their
            folders or files; empty without any.
        lens_views: the images of a board that each camera sees alone, for its lens; empty without any.
        others: further sets of images, which names do not explain.
        board: file that describes the board, or None.
        timestamps: tables or folders of frame times.
        settings: names of other programs' settings.
    """

    folder: Path
    recording: Recording
    views: tuple[ViewImages, ...] = ()
    board_views: tuple[ViewImages, ...] = ()
    lens_views: tuple[ViewImages, ...] = ()
    others: tuple[tuple[ViewImages, ...], ...] = ()
    board: Path | None = None
    timestamps: tuple[Path, ...] = ()
    settings: tuple[str, ...] = ()


def locate(text: str, folder: Path) -> Path:
    """Return a path, or a pattern of names, that is relative to a folder or to the current one.

    Raises:
        FileError: if it does not exist.
    """
    inside = folder / text
    found = inside.exists() or ("*" in inside.name and inside.parent.is_dir() and bool(files_at(inside)))
    return inside if found else must_exist(Path(text), "file")


def place_of(views: Sequence[ViewImages], folder: Path) -> str:
    """Return the folder that holds the videos, or the folders of pictures or of one video, of some views."""
    parents = {view.files[0].parent for view in views}
    place = views[0].files[0].parent
    return relative(place if views[0].is_video and len(parents) == 1 else place.parent, folder)


ImageSet = tuple[Path, tuple[ViewImages, ...]]
"""A folder, and the images of each camera in it."""


@dataclass
class _Sorted:
    """Images by what they show."""

    people: list[ImageSet] = field(default_factory=list)
    board: list[ImageSet] = field(default_factory=list)
    lenses: list[ImageSet] = field(default_factory=list)


def find_session(
    folder: Path,
    given: Mapping[str, Path] | None = None,
    is_of_board: Callable[[tuple[ViewImages, ...]], bool] = lambda _: False,
) -> Session:
    """Find out what a folder contains.

    Args:
        folder: the folder.
        given: videos of people by the name of the view; None to search for them.
        is_of_board: whether images show a board, asked where names leave several recordings.

    Raises:
        FileError: if the folder does not exist.
        RecordingError: if it is a file, or has several sets of videos.
    """
    must_exist(folder, "recording")
    if not folder.is_dir():
        raise RecordingError(f"{folder} is a file. Specify the folder of the recording.")
    found = _sort(folder)
    views = _given(given) if given is not None else _choose(folder, found, is_of_board)
    boards = [views for _, views in found.board if len(views) > 1]
    board = boards[0] if len(boards) == 1 else () if found.board else _board_above(folder)
    places = [folder, *{view.files[0].parent for view in (*board, *views)}]
    places += [] if not board else [board[0].files[0].parent.parent]
    lenses = _named_after(views, _lens_views(found.lenses))
    used = {file for view in (*views, *board) for file in view.files}
    return Session(
        folder,
        find_recording(folder),
        views,
        board,
        lenses,
        tuple(views for _, views in found.people if not any(file in used for view in views for file in view.files)),
        find_board_spec(
            dict.fromkeys(place for place in places if place.is_dir()), list(folder.resolve().parents)[:_LEVELS_ABOVE]
        ),
        timestamps.find([folder, *{view.files[0].parent for view in views}]),
        tuple(name for name in _SETTINGS if (folder / name).is_file()),
    )


def relative(path: Path, folder: Path) -> str:
    """Return a path relative to a folder if it lies in it, else the absolute path."""
    try:
        return path.resolve().relative_to(folder.resolve()).as_posix()
    except ValueError:
        return str(path.resolve())


def _sort(folder: Path) -> _Sorted:
    """Return the sets of images in a folder by what their names say."""
    found = _Sorted()
    for place, views in find_sets(folder):
        below = [each for each in (place, *place.parents) if each != folder and folder in each.parents]
        if any((each / name).exists() for each in below for name in _OUTPUT_FILES):
            continue
        if any(each.name.lower().startswith(_LENS_FOLDERS) for each in below):
            found.lenses.append((place, views))
            continue
        if any(is_board_folder(each.name) for each in below):
            found.board.append((place, views))
            continue
        if any(each.name.lower().startswith(_OTHER_FOLDERS) for each in below):
            continue
        board = tuple(view for view in views if _is_named_board(view.name))
        people = tuple(view for view in views if view not in board)
        if board and people:
            named = sorted((_without_board_words(view) for view in board), key=lambda view: natural_key(view.name))
            found.board.append((place, tuple(named)))
        found.people.append((place, people or board))
    return found


def _words(name: str) -> list[str]:
    return [word for word in re.split(r"[^a-z0-9]+", name.lower()) if word]


def _is_named_board(name: str) -> bool:
    return not _BOARD_WORDS.isdisjoint(_words(name))


def _without_board_words(view: ViewImages) -> ViewImages:
    """Return a view named like its camera: ``calib_cam1`` becomes ``cam1``."""
    words = [word for word in re.split(r"[^A-Za-z0-9]+", view.name) if word and word.lower() not in _BOARD_WORDS]
    return ViewImages("_".join(words) or view.name, view.files, view.is_video)


def _choose(
    folder: Path, found: _Sorted, is_of_board: Callable[[tuple[ViewImages, ...]], bool]
) -> tuple[ViewImages, ...]:
    """Return the views of the recording; sets of images that show a board are moved to those of a board.

    Raises:
        RecordingError: if there are several sets.
    """
    sets = _likely(folder, found.people)
    if len(sets) > 1 and not _is_one_per_camera(sets):
        boards = [each for each in sets if is_of_board(each[1])]
        if 0 < len(boards) < len(sets):
            found.board += boards
            found.people = [each for each in found.people if each not in boards]
            sets = [each for each in sets if each not in boards]
    if not sets:
        return ()
    if len(sets) == 1:
        return sets[0][1]
    if _is_one_per_camera(sets):
        return tuple(ViewImages(place.name, views[0].files, views[0].is_video) for place, views in sets)
    listed = "".join(f"\n  {place}  ({choices([view.name for view in views], 4)})" for place, views in sets)
    raise RecordingError(f"{folder} has {len(sets)} recordings. Give the folder of one:{listed}")


def _likely(folder: Path, sets: list[ImageSet]) -> list[ImageSet]:
    """Return the sets that may be the recording, by their places and names."""
    # What lies below a folder of videos, such as cut-outs of them, is not the recording.
    top = [each for each in sets if each[0] == folder]
    sets = top or sets
    preferred = [each for each in sets if each[0].name == _PREFERRED]
    sets = preferred if len(preferred) == 1 else sets
    with_videos = [each for each in sets if each[1][0].is_video]
    return with_videos or sets


def _is_one_per_camera(sets: list[ImageSet]) -> bool:
    """Return whether there is one folder per camera, such as cam1/video.mp4."""
    return len(sets) > 1 and len({place.parent for place, _ in sets}) == 1 and all(len(each) == 1 for _, each in sets)


def _lens_views(sets: list[ImageSet]) -> tuple[ViewImages, ...]:
    """Return the images for lenses: one folder per camera, of pictures or of one video."""
    if _is_one_per_camera(sets):
        return tuple(ViewImages(place.name, views[0].files, views[0].is_video) for place, views in sets)
    return sets[0][1] if len(sets) == 1 else ()


def _named_after(views: Sequence[ViewImages], lenses: tuple[ViewImages, ...]) -> tuple[ViewImages, ...]:
    """Return images for lenses with the names of the views: ``int_cam01_img`` becomes ``cam01``."""
    names = [view.name for view in views]
    plain = [re.sub(r"^int[_-]|[_-]img$", "", lens.name) for lens in lenses]
    return tuple(
        replace(lens, name=matching_name(name, names) or name) for lens, name in zip(lenses, plain, strict=True)
    )


def _given(videos: Mapping[str, Path]) -> tuple[ViewImages, ...]:
    """Return views that are named one by one."""
    for path in videos.values():
        must_exist(path, "video")
    return tuple(ViewImages(name, (path,), is_video=True) for name, path in videos.items())


def _board_above(folder: Path) -> tuple[ViewImages, ...]:
    """Return the images of a board that serve all recordings of a session."""
    above = find_board_folder(folder)
    sets: Sequence[tuple[Path, tuple[ViewImages, ...]]] = [] if above is None else find_sets(above)
    return sets[0][1] if len(sets) == 1 else ()
