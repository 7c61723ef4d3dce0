"""What files of several views and animals are called, and what their keypoints are."""

import glob
import re
from collections.abc import Collection, Sequence
from itertools import takewhile
from pathlib import Path

from posefuse.errors import FileError, choices
from posefuse.io.files import natural_key
from posefuse.model.view_names import plain_name
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton, shipped_skeletons

_SEPARATORS = "_. "


def view_names(files: Sequence[Path]) -> list[str]:
    """The view of each file: its folder's name where every file has its own, else the part of its name that differs.

    ``trial_Cam-A_dlc.csv`` and ``trial_Cam-B_dlc.csv`` are the views Cam-A and Cam-B: the part ends at an underscore,
    a dot or a space.

    Raises:
        FileError: if the names are of more than one trial.
    """
    if len({file.parent for file in files}) == len(files) > 1:
        return [file.parent.name for file in files]
    stems = [file.name.split(".csv")[0].split(".analysis")[0].removesuffix(".h5") for file in files]
    if len(stems) == 1:
        return stems
    start = _at_separator(_common_start(stems))
    # Of cam_1 and cam_2 the names are not 1 and 2.
    word = re.search(r"(cam|camera|view)[_. ]$", stems[0][:start], re.IGNORECASE)
    start = word.start() if word and not any(stem[start:].lower().startswith("cam") for stem in stems) else start
    end = _at_separator(_common_start([stem[start:][::-1] for stem in stems]))
    names = [stem[start : len(stem) - end] for stem in stems]
    if any(not name or set(_SEPARATORS) & set(name[word.end() - word.start() if word else 0 :]) for name in names):
        several = "".join(f"\n  --keypoints '{files[0].parent / pattern}'" for pattern in recordings_in(files))
        raise FileError(
            f"{files[0].parent} holds files whose names differ in more than the camera: {choices(stems)}. "
            + (f"Choose one of the recordings:{several}" if several else "Keep one file a camera in a folder.")
        )
    return names


def recordings_in(files: Sequence[Path], cameras: Collection[str] = ()) -> list[str]:
    """Patterns of the names of each recording's files, where a folder holds several recordings of the same cameras.

    Names are cut at ``_ . -`` and spaces. If their parts differ in one place, that is the camera: one recording. If
    they differ in more, the camera is where all parts are cameras' names, or say ``cam`` or follow such a word.

    Args:
        files: of one folder.
        cameras: names of the calibrated cameras, as far as they are known.

    Returns:
        A pattern a recording, with ``*`` in the camera's place; none where the names do not tell.
    """
    cut = [re.split(r"([_.\- ]+)", file.name) for file in files]
    if len({len(parts) for parts in cut}) != 1:
        return []
    differ = [i for i in range(0, len(cut[0]), 2) if len({parts[i] for parts in cut}) > 1]
    if len(differ) > 1:
        known = {_plain(camera) for camera in cameras}
        named = [i for i in differ if all(_plain(parts[i]) in known for parts in cut)]
        said = [i for i in differ if all("cam" in _with_before(parts, i).lower() for parts in cut)]
        differ = named or said
    if len(differ) != 1:
        return []
    at = differ[0]
    patterns = {"".join("*" if i == at else glob.escape(part) for i, part in enumerate(parts)) for parts in cut}
    return sorted(patterns, key=natural_key)


def _with_before(parts: Sequence[str], at: int) -> str:
    """A part of a name, after the one before it."""
    return "".join(parts[max(at - 2, 0) : at + 1])


def _plain(word: str) -> str:
    return plain_name(word).removeprefix("cam")


def _common_start(texts: Sequence[str]) -> str:
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*texts, strict=False))
    return "".join(letters[0] for letters in alike)


def _at_separator(common: str) -> int:
    """How much of what is common belongs to no name: up to the last separator."""
    return max(common.rfind(separator) for separator in _SEPARATORS) + 1


def skeleton_of(name: str, keypoints: Sequence[str], edges: Sequence[tuple[str, str]] = ()) -> Skeleton:
    """A skeleton of keypoints as a file names them; left and right are told by the names."""
    lower = {keypoint.lower(): keypoint for keypoint in keypoints}
    pairs = []
    for keypoint in keypoints:
        partner = _other_side(keypoint.lower())
        if partner in lower:
            pairs.append((keypoint, lower[partner]))
    return Skeleton(name, tuple(keypoints), edges=tuple(edges), pairs=tuple(pairs))


def skeleton_named(name: str, keypoints: Sequence[str]) -> Skeleton:
    """The shipped skeleton of exactly these keypoints in this order; where there is none, one of their own."""
    for shipped in map(shipped_skeleton, shipped_skeletons()):
        if shipped.keypoints == tuple(keypoints):
            return shipped
    return skeleton_of(name, keypoints)


def _other_side(name: str) -> str | None:
    """The right keypoint's name of a left one's, in lower case; None of one that is not on the left."""
    for pattern, other in ((r"(^|_)left(_|$)", r"\1right\2"), (r"(^|_)l(_|$)", r"\1r\2")):
        if re.search(pattern, name):
            return re.sub(pattern, other, name)
    return None
