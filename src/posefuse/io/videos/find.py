"""The videos of a recording's folder, by view."""

from collections.abc import Sequence
from pathlib import Path

from posefuse.io.files import natural_key
from posefuse.io.videos.reader import VIDEO_ENDINGS
from posefuse.model.view_names import matching_name

_DEPTH = 2
_SKIPPED_FOLDERS = ("calib", "intrinsic", "extrinsic", "board", "overlay", "pose")
_SKIPPED_FILES = ("_overlay", "_pose")


def find_videos(folder: Path) -> tuple[Path, ...]:
    """Return the videos of the first folder that has any, searched two levels deep; not those of boards or overlays."""
    level = [folder] if folder.is_dir() else []
    for _ in range(_DEPTH + 1):
        for place in level:
            found = [entry for entry in _entries(place) if _is_video(entry)]
            if found:
                return tuple(found)
        level = [entry for place in level for entry in _entries(place) if entry.is_dir() and not _is_skipped(entry)]
    return ()


def videos_of_views(folder: Path, views: Sequence[str]) -> dict[str, Path]:
    """Return the video of each view, for the views whose name one video of the folder has."""
    names: dict[str, list[Path]] = {}
    for path in find_videos(folder):
        name = matching_name(path.stem, views)
        if name is not None:
            names.setdefault(name, []).append(path)
    return {name: names[name][0] for name in views if len(names.get(name, ())) == 1}


def _entries(folder: Path) -> list[Path]:
    try:
        entries = [entry for entry in folder.iterdir() if not entry.name.startswith(".")]
    except OSError:
        return []
    return sorted(entries, key=lambda entry: natural_key(entry.name))


def _is_video(path: Path) -> bool:
    return path.suffix.lower() in VIDEO_ENDINGS and path.is_file() and not path.stem.endswith(_SKIPPED_FILES)


def _is_skipped(folder: Path) -> bool:
    return folder.name.lower().startswith(_SKIPPED_FOLDERS)
