"""The protocol of live streams, version 1: JSON lines in and out. ``docs/live.md`` specifies it."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import msgspec
import numpy as np

from posefuse.errors import DetectionsError, suggestion
from posefuse.model.detections import Detections
from posefuse.model.view_message import ViewMessage

PROTOCOL = 1
MAX_TIME_S = 1e11
"""Largest time in seconds. Seconds since 1970 are about 2e9; milliseconds would be 2e12."""
MAX_PX = 1e6
_MISSING: list[float | None] = [None, None, None]

Fault = Literal[
    "not JSON", "wrong shape", "wrong keypoints", "unknown camera", "impossible number", "too many people"
]  # fmt: skip


class _Person(msgspec.Struct):
    keypoints: list[list[float | None] | None]
    track_id: int = -1


class _Message(msgspec.Struct):
    camera: str
    time_s: float
    people: list[_Person]


@dataclass(frozen=True)
class RejectedLine:
    """A line that cannot be used.

    Attributes:
        fault: Kind of error.
        reason: One sentence with the expected and the actual content.
        view: Index of the camera if the line names one, otherwise None.
    """

    fault: Fault
    reason: str
    view: int | None = None


@dataclass(frozen=True)
class LineReader:
    """Reader of lines with detections of one rig and one skeleton.

    Attributes:
        cameras: Names of the cameras, in the order of the rig.
        n_keypoints: Number of keypoints of the skeleton.
        max_people: Largest number of people in one line.
    """

    cameras: tuple[str, ...]
    n_keypoints: int
    max_people: int

    @cached_property
    def _decoder(self) -> "msgspec.json.Decoder[_Message]":
        return msgspec.json.Decoder(_Message)

    @cached_property
    def _view_of(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.cameras)}

    def read(self, line: bytes) -> ViewMessage | RejectedLine:
        """Return the content of a line, or why it is rejected. No input raises an exception or executes code."""
        try:
            message = self._decoder.decode(line)
        except msgspec.ValidationError as error:
            return RejectedLine("wrong shape", f"{_short(error)}.")
        except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
            hint = " Write missing numbers as null." if b"NaN" in line else ""
            return RejectedLine("not JSON", f"{_short(error)}.{hint}")
        view = self._view_of.get(message.camera)
        if view is None:
            hint = suggestion(message.camera[:80], self.cameras)
            return RejectedLine("unknown camera", f"No camera is called {message.camera[:80]!r}. {hint}")
        if not abs(message.time_s) < MAX_TIME_S:
            reason = f"time_s is {message.time_s:g}; expected seconds below {MAX_TIME_S:g}."
            return RejectedLine("impossible number", reason, view)
        if len(message.people) > self.max_people:
            reason = (
                f"one view has {len(message.people)} people; at most {self.max_people} are allowed (`max_view_people`)."
            )
            return RejectedLine("too many people", reason, view)
        return self._detections(message, view)

    def _detections(self, message: _Message, view: int) -> ViewMessage | RejectedLine:
        people, keypoints = len(message.people), self.n_keypoints
        numbers = np.full((people, keypoints, 3), np.nan)
        for p, person in enumerate(message.people):
            if len(person.keypoints) != keypoints:
                reason = (
                    f"people[{p}] has {len(person.keypoints)} keypoints; the skeleton of this stream has {keypoints}. "
                    "Choose the skeleton with `skeleton`."
                )
                return RejectedLine("wrong keypoints", reason, view)
            if not -1 <= person.track_id < 1 << 62:
                return RejectedLine("impossible number", f"people[{p}].track_id is {person.track_id}.", view)
            filled = [values or _MISSING for values in person.keypoints]
            lengths = set(map(len, filled))
            if not lengths <= {2, 3} or [] in person.keypoints:
                reason = (
                    f"people[{p}]: a keypoint is [x, y], [x, y, confidence] or null; got one with {max(lengths)} "
                    "numbers."
                )
                return RejectedLine("wrong keypoints", reason, view)
            numbers[p] = filled if lengths == {3} else [[*values, None][:3] for values in filled]
        problem = _impossible(numbers)
        if problem is not None:
            return RejectedLine("impossible number", problem, view)
        ids = np.array([person.track_id for person in message.people], dtype=np.int64)
        # One coordinate alone is not a detection.
        numbers[np.isnan(numbers[..., 0]) | np.isnan(numbers[..., 1])] = np.nan
        return ViewMessage(view, message.time_s, numbers[..., :2].copy(), numbers[..., 2].copy(), ids)


def _impossible(numbers: np.ndarray) -> str | None:
    """Return what is wrong with coordinates or confidences that no detector outputs, or None.

    Args:
        numbers: Shape (person, keypoint, 3): x, y, confidence.
    """
    if not numbers.size:
        return None
    lowest, highest = np.fmin.reduce(numbers, axis=(0, 1)), np.fmax.reduce(numbers, axis=(0, 1))
    if max(highest[:2].max(), -lowest[:2].min()) > MAX_PX:
        return f"a keypoint is more than {MAX_PX:g} px from the corner of the image."
    if lowest[2] < 0.0 or highest[2] > MAX_PX:
        return f"a confidence is negative or greater than {MAX_PX:g}."
    return None


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:160]


def line_of(camera: str, view: ViewMessage) -> bytes:
    """Return one view as a line for :class:`LineReader`, with a line break. Numbers keep their full precision."""
    people = []
    for keypoints, confidence, track in zip(view.keypoints_px, view.confidence, view.track_ids, strict=True):
        columns = np.column_stack([keypoints, confidence]).tolist()
        rows = [
            None if math.isnan(x) or math.isnan(y) else [x, y] if math.isnan(c) else [x, y, c] for x, y, c in columns
        ]
        people.append({"keypoints": rows} | ({"track_id": int(track)} if track >= 0 else {}))
    return encoded({"camera": camera, "time_s": view.time_s, "people": people})


def lines_of(detections: Detections, cameras: Sequence[str] | None = None) -> Iterator[tuple[float, bytes]]:
    """Yield a recording as times in seconds and lines, frame by frame and view by view.

    Frames that a view did not record are omitted.

    Args:
        detections: The recording.
        cameras: Names of the cameras. Default: the names of the views.

    Raises:
        DetectionsError: If the recording has no times.
    """
    if not (np.asarray(detections.recorded) & np.isfinite(detections.time_s)).any():
        raise DetectionsError("The keypoint files do not specify the frame rate. Add it, such as `rate_hz=60`.")
    for chunk in detections.chunks():
        sent = np.asarray(chunk.recorded) & np.isfinite(chunk.time_s)
        for f, v in np.argwhere(sent).tolist():
            cell = f * chunk.n_views + v
            rows = slice(int(chunk.offsets[cell]), int(chunk.offsets[cell + 1]))
            time_s = float(chunk.time_s[f, v])
            seen = ViewMessage(
                v, time_s, np.asarray(chunk.keypoints_px[rows]), np.asarray(chunk.confidence[rows]),
                np.asarray(chunk.track_ids[rows]),
            )  # fmt: skip
            yield time_s, line_of((cameras or chunk.view_names)[v], seen)


def encoded(message: Mapping[str, Any]) -> bytes:
    """Return a message as one line of JSON with a line break. Numbers that are not finite become null."""
    return msgspec.json.encode(message) + b"\n"


def numbers_or_null(values: np.ndarray) -> list[list[float] | None]:
    """Return rows as lists, or None for rows with a number that is not finite.

    Args:
        values: Shape (row, number).
    """
    finite = np.asarray(np.isfinite(values).all(axis=-1))
    if finite.all():
        return values.tolist()
    return [row if is_finite else None for row, is_finite in zip(values.tolist(), finite.tolist(), strict=True)]
