"""Identify the markers in images of which neither the dictionary, the colors nor the sides are known."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posefuse.detection.boards.library import dictionary_of, import_opencv
from posefuse.model.board import APRILTAG_DICTIONARIES, ARUCO_DICTIONARIES, marker_count

MARKER_FAMILIES = (
    tuple(name for name in ARUCO_DICTIONARIES if name.endswith(("_1000", "ORIGINAL"))) + APRILTAG_DICTIONARIES
)
"""The largest dictionary of each family, which begins with the markers of the smaller ones."""
MOST_MARKERS = 100
"""Number of markers of a dictionary that are tried; a board of 14 x 14 squares has 98."""
_MIN_MARKERS = 3
_CERTAIN_MARKERS, _CERTAIN_FACTOR = 6, 4
"""Markers of one kind in two images, and their ratio to those of the next, that end the search."""
_MOST_NUMBERED = 4
"""Number of images in which the markers of the identified family are numbered."""


@dataclass(frozen=True)
class MarkersFound:
    """Markers that images contain instead of those expected.

    Attributes:
        dictionary: name of the smallest dictionary with the markers.
        n_markers: number of different markers found.
        highest: largest number of a marker.
        inverted: whether black and white are swapped.
        mirrored: whether the images are mirrored.
        images: indices of images with these markers, the most first.
    """

    dictionary: str
    n_markers: int
    highest: int
    inverted: bool
    mirrored: bool
    images: tuple[int, ...] = ()


def identify_markers(grays: Sequence[np.ndarray]) -> MarkersFound | None:
    """Return which markers some images contain, tried over all dictionaries; None if there are no markers.

    Each image is searched once for the first markers of all dictionaries and their mirror images, and once more with
    black and white swapped. The search ends when one dictionary explains the images.

    Args:
        grays: images, each of shape (height, width), uint8.
    """
    families = [dictionary_of(name, MOST_MARKERS) for name in MARKER_FAMILIES]
    detector = import_opencv().aruco.ArucoDetector([*families, *(_mirrored(family) for family in families)])
    seen: dict[tuple[int, bool], dict[int, set[int]]] = {}
    for k, gray in enumerate(grays):
        for inverted in (False, True):
            for kind, numbers in _numbers(detector, gray, inverted=inverted).items():
                seen.setdefault((kind, inverted), {})[k] = numbers
        if _is_certain(seen):
            break
    if not seen:
        return None
    kind, inverted = max(seen, key=lambda each: len(_union(seen[each])))
    own = seen[kind, inverted]
    if len(_union(own)) < _MIN_MARKERS:
        return None
    most = sorted(own, key=lambda k: -len(own[k]))
    mirrored, name = kind >= len(MARKER_FAMILIES), MARKER_FAMILIES[kind % len(MARKER_FAMILIES)]
    every = _mirrored(dictionary_of(name)) if mirrored else dictionary_of(name)
    numbering = import_opencv().aruco.ArucoDetector([every])
    numbers = [_numbers(numbering, grays[k], inverted=inverted).get(0, set()) for k in most[:_MOST_NUMBERED]]
    found = _repeated(numbers) or _union(own)
    highest = max(found)
    return MarkersFound(smallest_dictionary(name, highest), len(found), highest, inverted, mirrored, tuple(most))


def smallest_dictionary(name: str, highest: int) -> str:
    """Return the smallest dictionary of a family that has a marker; small ones begin the large ones."""
    family = name.rsplit("_", 1)[0]
    sizes = [each for each in ARUCO_DICTIONARIES if each.startswith(f"{family}_") and name in ARUCO_DICTIONARIES]
    return next((each for each in sizes if marker_count(each) > highest), name)


def _numbers(detector: Any, gray: np.ndarray, *, inverted: bool) -> dict[int, set[int]]:
    """Return the numbers of the markers in an image by the index of their dictionary."""
    _, numbers, _, kinds = detector.detectMarkersMultiDict(255 - gray if inverted else gray)
    found: dict[int, set[int]] = {}
    if numbers is not None:
        for kind, number in zip(np.ravel(kinds).tolist(), np.ravel(numbers).tolist(), strict=True):
            found.setdefault(kind, set()).add(number)
    return found


def _is_certain(seen: dict[tuple[int, bool], dict[int, set[int]]]) -> bool:
    """Return whether the markers found belong to one dictionary without doubt."""
    counts = sorted(((len(_union(each)), len(each)) for each in seen.values()), reverse=True)
    if not counts or counts[0][1] < 2:
        return False
    return counts[0][0] >= max([_CERTAIN_MARKERS, *(_CERTAIN_FACTOR * n for n, _ in counts[1:2])])


def _union(numbers: dict[int, set[int]]) -> set[int]:
    """Return the numbers of the markers of several images."""
    return set().union(*numbers.values())


def _repeated(sets: list[set[int]]) -> set[int]:
    """Return the numbers that occur more than once, or all if none does; patterns of a room rarely repeat."""
    every = [number for numbers in sets for number in numbers]
    repeated = {number for number in every if every.count(number) > 1}
    return repeated or set(every)


def _mirrored(dictionary: Any) -> Any:
    """Return a dictionary of mirrored markers."""
    kind = import_opencv().aruco.Dictionary
    size = dictionary.markerSize
    bits = [kind.getBitsFromByteList(code[None], size) for code in dictionary.bytesList]
    codes = [kind.getByteListFromBits(np.ascontiguousarray(each[:, ::-1])) for each in bits]
    return kind(np.concatenate(codes), size, dictionary.maxCorrectionBits)
