"""Shared parts of readers of JSON lists of people: conversion to the columns of a view and to detections."""

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
from posefuse.io.keypoints.infer_skeleton import infer_skeleton, no_skeleton, wrong_skeleton
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections

_MAX_FRAME = 2**40
_MAX_FRAMES = 20_000_000


@dataclass(frozen=True)
class Person:
    """A person in a frame of a view.

    Attributes:
        frame: Number of the frame.
        values: x, y, confidence of each keypoint, flat or in rows, as stored in the file.
        track: Identity of the person in the file, -1 without one.
    """

    frame: int
    values: Any
    track: int = -1


def view_columns(name: str, recorded: Iterable[int] | None, people: Sequence[Person], where: str) -> ViewColumns:
    """Return the people of a view as columns, ordered by frame.

    Keypoints at (0, 0) or with confidence 0 are missing. People without any keypoint are dropped.

    Args:
        name: Name of the view.
        recorded: Numbers of its frames. None if the file omits frames without people: then all frames from 0 (or the
            first, if negative) to the last are assumed to have been recorded.
        people: People in any order.
        where: The file, for messages.

    Raises:
        FileError: If people have different numbers of keypoints, or a value is not a number.
    """
    ordered = sorted(people, key=lambda person: person.frame)
    rows = [rows_of(person, where) for person in ordered]
    lengths = Counter(len(row) for row in rows)
    if len(lengths) > 1:
        common = lengths.most_common(1)[0][0]
        person, row = next((p, r) for p, r in zip(ordered, rows, strict=True) if len(r) != common)
        raise FileError(
            f"{where}, frame {person.frame}: a person has {len(row)} keypoints, but others have {common}. All people "
            "must have the same keypoints. Is the file truncated?"
        )
    keypoints = without_missing(np.array(rows).reshape(len(rows), next(iter(lengths), 0), 3))
    frames = np.array([person.frame for person in ordered], dtype=np.int64)
    tracks = np.array([p.track if abs(p.track) < _MAX_FRAME else -1 for p in ordered], dtype=np.int64)
    if recorded is None:
        recorded = _all_frames(frames, where)
    valid = np.isfinite(keypoints[..., 0]).any(axis=1)
    return ViewColumns(name, np.array(sorted(recorded), dtype=np.int64), frames[valid], keypoints[valid], tracks[valid])


def _all_frames(frames: np.ndarray, where: str) -> np.ndarray:
    if not len(frames):
        return frames
    first, last = min(0, int(frames[0])), int(frames[-1])
    if last - first > _MAX_FRAMES:
        raise FileError(
            f"{where}: frames are numbered up to {last}, which is not plausible for a recording. Are they image IDs of "
            "a data set, or does a file belong to another recording?"
        )
    return np.arange(first, last + 1)


def without_missing(keypoints: np.ndarray) -> np.ndarray:
    """Set keypoints to NaN that are at (0, 0), have confidence 0, or lack a coordinate.

    Args:
        keypoints: Shape (person, keypoint, 3): x, y, confidence. Modified in place and returned.
    """
    missing = (keypoints[..., 2] == 0) | ((keypoints[..., 0] == 0) & (keypoints[..., 1] == 0))
    keypoints[missing | ~np.isfinite(keypoints[..., :2]).all(axis=-1)] = np.nan
    return keypoints


def rows_of(person: Person, where: str) -> np.ndarray:
    """Return the keypoints of a person, shape (keypoint, 3): x, y, confidence.

    Raises:
        FileError: If a value is not a number, or there are not three per keypoint.
    """
    try:
        values = np.array(person.values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise FileError(f"{where}, frame {person.frame}: a keypoint of a person is not a number.") from None
    if values.size % 3 or (values.ndim == 2 and values.shape[1] != 3):
        raise FileError(
            f"{where}, frame {person.frame}: a person has {values.size} numbers; expected x, y, confidence for each "
            "keypoint."
        )
    return values.reshape(-1, 3)


def joined(pixels: Any, scores: Any, where: str, frame: int) -> np.ndarray:
    """Join separate positions and scores to rows of x, y, confidence.

    Raises:
        FileError: If their numbers differ, or a value is not a number.
    """
    try:
        positions = np.array(pixels, dtype=np.float64).reshape(len(pixels), -1)[:, :2]
        confidence = np.array(scores, dtype=np.float64).reshape(-1, 1)
        return np.concatenate([positions, confidence], axis=1)
    except (TypeError, ValueError, OverflowError):
        raise FileError(f"{where}, frame {frame}: the keypoints and scores of a person do not match.") from None


def checked_integer(value: Any, what: str, where: str) -> int:
    """Return the value if it is an integer of plausible size.

    Raises:
        FileError: If it is not.
    """
    if isinstance(value, bool) or not isinstance(value, int) or abs(value) > _MAX_FRAME:
        raise FileError(f"{where}: expected an integer for {what}, got {str(value)[:40]!r}.")
    return value


def integer_from_float(value: float, what: str, where: str) -> int:
    """Return an integer that was read as a float.

    Raises:
        FileError: If the value is not an integer of plausible size.
    """
    if not abs(value) < _MAX_FRAME or value != round(value):
        raise FileError(f"{where}: expected an integer for {what}, got {value}.")
    return int(value)


def last_number(name: str, where: str) -> int:
    """Return the frame number in the name of an image: the last number in the name.

    Raises:
        FileError: If the name contains no number.
    """
    match = re.search(r"(\d{1,12})\D*$", Path(name).stem)
    if match is None:
        raise FileError(f"{where}: the file name {name[:60]!r} contains no frame number.")
    return int(match.group(1))


def detections_of(
    path: Path, views: Sequence[ViewColumns], request: Request, notes: tuple[str, ...] = (), *, sparse: bool = False
) -> Detections:
    """Return the detections of a recording's views.

    Args:
        path: The recording, for messages.
        views: Views in order.
        request: How to read the files.
        notes: Notes for the user.
        sparse: Whether to keep only the frames that a view has, as in manually labeled data.

    Raises:
        FileError: If views have different keypoints, or no person was detected and no skeleton is given.
        SkeletonError: If the number of keypoints does not identify a skeleton.
    """
    lengths = {view.keypoints.shape[1]: view.name for view in views if len(view.keypoints)}
    if len(lengths) > 1:
        parts = ", ".join(f"{name}: {n}" for n, name in sorted(lengths.items()))
        raise FileError(
            f"{path}: views have different numbers of keypoints ({parts}). All must have the same skeleton."
        )
    count = next(iter(lengths), 0)
    skeleton = request.skeleton
    if skeleton is None and count:
        people = np.concatenate([view.keypoints[..., :2] for view in views if len(view.keypoints)])
        skeleton, guess_notes = infer_skeleton(count, people, str(path))
        notes = (*notes, *guess_notes)
    if skeleton is None:
        raise no_skeleton(path)
    if count and count != len(skeleton):
        raise wrong_skeleton(path, count, skeleton)
    filled = [view if len(view.keypoints) else _without_people(view, len(skeleton)) for view in views]
    return assemble(path, filled, skeleton, request.rate_hz, notes, sparse=sparse)


def _without_people(view: ViewColumns, count: int) -> ViewColumns:
    empty = np.empty(0, np.int64)
    return ViewColumns(view.name, view.recorded, empty, np.empty((0, count, 3)), empty, time_s=view.time_s)


def decode(file: Path, kind: Any) -> Any:
    """Return the content of a JSON file, converted to the type that the format requires.

    Raises:
        FileError: If the file is not complete JSON, or has other content.
    """
    try:
        return msgspec.json.decode(file.read_bytes(), type=kind)
    except msgspec.ValidationError as error:
        raise FileError(f"{file} violates its format: {error}.") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileError(
            f"{file} is not complete JSON ({file.stat().st_size} bytes): {error}. Is the file truncated?"
        ) from None
    except OSError as error:
        raise FileError(f"{file} cannot be read: {error.strerror}.") from None


def beginning(file: Path, size: int = 4096) -> bytes:
    """Return the first bytes of a file without white space, or none if it cannot be read."""
    try:
        with file.open("rb") as content:
            return b"".join(content.read(size).split())
    except OSError:
        return b""
