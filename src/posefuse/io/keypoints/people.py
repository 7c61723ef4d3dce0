"""What readers of lists of people share: from people, frame by frame, to the columns of a view and to detections."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from posefuse.errors import FileError
from posefuse.io.keypoints.columns import ViewColumns, assemble
from posefuse.io.keypoints.infer_skeleton import guess_skeleton
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections

_LARGEST_FRAME = 2**40
_MOST_FRAMES = 20_000_000


@dataclass(frozen=True)
class Person:
    """A person in a frame of a view.

    Attributes:
        frame: its number.
        values: x, y, confidence of each keypoint, flat or in rows, as the file has them.
        track: its number in the file, -1 where there is none.
    """

    frame: int
    values: Any
    track: int = -1


def view_columns(name: str, recorded: Iterable[int] | None, people: Sequence[Person], where: str) -> ViewColumns:
    """One view's people in columns, ordered by frame; who has no keypoint is nobody.

    Keypoints at 0, 0 or with a confidence of 0 are missing.

    Args:
        name: of the view.
        recorded: numbers of its frames; None where the file leaves out frames without people: then all from 0 (or the
            first) to the last are taken to have been recorded.
        people: in any order.
        where: the file, for messages.

    Raises:
        FileError: if people have different numbers of keypoints, or something is no number.
    """
    ordered = sorted(people, key=lambda person: person.frame)
    rows = [rows_of(person, where) for person in ordered]
    lengths = Counter(len(row) for row in rows)
    if len(lengths) > 1:
        usual = lengths.most_common(1)[0][0]
        person, row = next((p, r) for p, r in zip(ordered, rows, strict=True) if len(r) != usual)
        raise FileError(
            f"{where}, frame {person.frame}: a person has {len(row)} keypoints, others have {usual}; one recording has "
            "one skeleton. Was the file cut short?"
        )
    keypoints = without_missing(np.array(rows).reshape(len(rows), next(iter(lengths), 0), 3))
    frames = np.array([person.frame for person in ordered], dtype=np.int64)
    tracks = np.array([p.track if abs(p.track) < _LARGEST_FRAME else -1 for p in ordered], dtype=np.int64)
    if recorded is None:
        recorded = _all_frames(frames, where)
    seen = np.isfinite(keypoints[..., 0]).any(axis=1)
    return ViewColumns(name, np.array(sorted(recorded), dtype=np.int64), frames[seen], keypoints[seen], tracks[seen])


def _all_frames(frames: np.ndarray, where: str) -> np.ndarray:
    if not len(frames):
        return frames
    first, last = min(0, int(frames[0])), int(frames[-1])
    if last - first > _MOST_FRAMES:
        raise FileError(
            f"{where}: frames are numbered up to {last}, more than any recording has. Are they numbers of images in a "
            "data set, or is a file of another recording among them?"
        )
    return np.arange(first, last + 1)


def without_missing(keypoints: np.ndarray) -> np.ndarray:
    """People with NaN where a keypoint is at 0, 0, has a confidence of 0, or lacks a place.

    Args:
        keypoints: shape (person, keypoint, 3): x, y, confidence; changed.
    """
    missing = (keypoints[..., 2] == 0) | ((keypoints[..., 0] == 0) & (keypoints[..., 1] == 0))
    keypoints[missing | ~np.isfinite(keypoints[..., :2]).all(axis=-1)] = np.nan
    return keypoints


def rows_of(person: Person, where: str) -> np.ndarray:
    """Shape (keypoint, 3): x, y, confidence of a person.

    Raises:
        FileError: if they are not all numbers, or not three a keypoint.
    """
    try:
        values = np.array(person.values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise FileError(f"{where}, frame {person.frame}: a person's keypoints are not all numbers.") from None
    if values.size % 3 or (values.ndim == 2 and values.shape[1] != 3):
        raise FileError(
            f"{where}, frame {person.frame}: a person has {values.size} numbers, expected x, y, confidence for each "
            "keypoint."
        )
    return values.reshape(-1, 3)


def joined(pixels: Any, scores: Any, where: str, frame: int) -> np.ndarray:
    """Positions and scores that a file keeps apart, as rows of x, y, confidence.

    Raises:
        FileError: if there are not as many of one as of the other.
    """
    try:
        places = np.array(pixels, dtype=np.float64).reshape(len(pixels), -1)[:, :2]
        confidence = np.array(scores, dtype=np.float64).reshape(-1, 1)
        return np.concatenate([places, confidence], axis=1)
    except (TypeError, ValueError, OverflowError):
        raise FileError(f"{where}, frame {frame}: keypoints and scores of a person do not fit each other.") from None


def whole(value: Any, what: str, where: str) -> int:
    """A whole number.

    Raises:
        FileError: if it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int) or abs(value) > _LARGEST_FRAME:
        raise FileError(f"{where}: {what} should be a whole number, got {str(value)[:40]!r}.")
    return value


def whole_number(value: float, what: str, where: str) -> int:
    """A whole number that was read as a float.

    Raises:
        FileError: if it is none.
    """
    if not abs(value) < _LARGEST_FRAME or value != round(value):
        raise FileError(f"{where}: {what} should be a whole number, got {value}.")
    return int(value)


def last_number(name: str, where: str) -> int:
    """The frame number in an image's name: the last number in it.

    Raises:
        FileError: if there is none.
    """
    match = re.search(r"(\d{1,12})\D*$", Path(name).stem)
    if match is None:
        raise FileError(f"{where}: no frame number in the name {name[:60]!r}.")
    return int(match.group(1))


def detections_of(
    path: Path, views: Sequence[ViewColumns], request: Request, notes: tuple[str, ...] = (), *, sparse: bool = False
) -> Detections:
    """The detections of a recording's views.

    Args:
        path: for messages.
        views: in order.
        request: what the user said.
        notes: what is worth saying.
        sparse: whether only frames that some view has count, far apart as they may be.

    Raises:
        FileError: if views have different keypoints, or nobody was detected and nothing tells the skeleton.
        SkeletonError: if the number of keypoints does not tell the skeleton.
    """
    lengths = {view.keypoints.shape[1]: view.name for view in views if len(view.keypoints)}
    if len(lengths) > 1:
        parts = ", ".join(f"{name}: {n}" for n, name in sorted(lengths.items()))
        raise FileError(f"{path}: views have different numbers of keypoints ({parts}); one recording has one skeleton.")
    count = next(iter(lengths), 0)
    skeleton = request.skeleton
    if skeleton is None and count:
        people = np.concatenate([view.keypoints[..., :2] for view in views if len(view.keypoints)])
        skeleton, said = guess_skeleton(count, people, str(path))
        notes = (*notes, *said)
    if skeleton is None:
        raise FileError(f"{path}: nobody was detected in any view, so nothing tells the skeleton. Add --skeleton.")
    if count and count != len(skeleton):
        raise FileError(
            f"{path} has {count} keypoints a person, skeleton {skeleton.name} has {len(skeleton)}. Choose another with "
            "--skeleton, or leave it out to have it told from the files."
        )
    filled = [view if len(view.keypoints) else _nobody(view, len(skeleton)) for view in views]
    return assemble(path, filled, skeleton, request.rate_hz, notes, sparse=sparse)


def _nobody(view: ViewColumns, count: int) -> ViewColumns:
    nobody = np.empty(0, np.int64)
    return ViewColumns(view.name, view.recorded, nobody, np.empty((0, count, 3)), nobody, time_s=view.time_s)


def decode(file: Path, kind: Any) -> Any:
    """What a JSON file holds, as the kind that the format says.

    Raises:
        FileError: if it is not whole, or something else.
    """
    try:
        return msgspec.json.decode(file.read_bytes(), type=kind)
    except msgspec.ValidationError as error:
        raise FileError(f"{file} is not of the format it seems to be: {error}.") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileError(
            f"{file} is not whole JSON ({file.stat().st_size} bytes): {error}. Is the file truncated?"
        ) from None
    except OSError as error:
        raise FileError(f"{file} cannot be read: {error.strerror}.") from None


def beginning(file: Path, size: int = 4096) -> bytes:
    """The first bytes of a file, without white space; none of one that cannot be read."""
    try:
        with file.open("rb") as content:
            return b"".join(content.read(size).split())
    except OSError:
        return b""
