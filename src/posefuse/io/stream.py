"""The stream's protocol, version 1: JSON lines in and out. docs/live.md specifies it."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import msgspec
import numpy as np

from posefuse.errors import DetectionsError, suggestion
from posefuse.model.detections import Detections
from posefuse.model.view_message import SeenView

PROTOCOL = 1
MOST_SECONDS = 1e11
"""Times are seconds: those of the day count 2e9 of them, milliseconds 2e12."""
MOST_PX = 1e6
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
class Refusal:
    """A line that says nothing which can be used.

    Attributes:
        fault: of which kind.
        why: a sentence, with what was expected.
        view: number of the camera, where the line says so much.
    """

    fault: Fault
    why: str
    view: int | None = None


@dataclass(frozen=True)
class Reader:
    """Reads lines that are of the cameras of one rig and the keypoints of one skeleton.

    Attributes:
        cameras: names, in the rig's order.
        n_keypoints: of the skeleton.
        max_people: in one line.
    """

    cameras: tuple[str, ...]
    n_keypoints: int
    max_people: int

    @cached_property
    def _decoder(self) -> "msgspec.json.Decoder[_Message]":
        return msgspec.json.Decoder(_Message)

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.cameras)}

    def read(self, line: bytes) -> SeenView | Refusal:
        """What a line says. Nothing is raised, whatever the bytes; nothing in them is run."""
        try:
            message = self._decoder.decode(line)
        except msgspec.ValidationError as error:
            return Refusal("wrong shape", f"{_short(error)}.")
        except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
            hint = " Missing numbers are null in JSON." if b"NaN" in line else ""
            return Refusal("not JSON", f"{_short(error)}.{hint}")
        view = self._places.get(message.camera)
        if view is None:
            meant = suggestion(message.camera[:80], self.cameras)
            return Refusal("unknown camera", f"No camera is called {message.camera[:80]!r}. {meant}")
        if not abs(message.time_s) < MOST_SECONDS:
            why = f"time_s is {message.time_s:g}; it is in seconds, less than {MOST_SECONDS:g}."
            return Refusal("impossible number", why, view)
        if len(message.people) > self.max_people:
            why = f"{len(message.people)} people in one view; at most {self.max_people} (--max-view-people)."
            return Refusal("too many people", why, view)
        return self._seen(message, view)

    def _seen(self, message: _Message, view: int) -> SeenView | Refusal:
        people, keypoints = len(message.people), self.n_keypoints
        numbers = np.full((people, keypoints, 3), np.nan)
        for p, person in enumerate(message.people):
            if len(person.keypoints) != keypoints:
                why = (
                    f"people[{p}] has {len(person.keypoints)} keypoints; the skeleton of this stream has {keypoints}. "
                    "--skeleton says which."
                )
                return Refusal("wrong keypoints", why, view)
            if not -1 <= person.track_id < 1 << 62:
                return Refusal("impossible number", f"people[{p}].track_id is {person.track_id}.", view)
            filled = [values or _MISSING for values in person.keypoints]
            lengths = set(map(len, filled))
            if not lengths <= {2, 3} or [] in person.keypoints:
                why = (
                    f"people[{p}]: a keypoint is [x, y], [x, y, confidence] or null; got one of {max(lengths)} numbers."
                )
                return Refusal("wrong keypoints", why, view)
            numbers[p] = filled if lengths == {3} else [[*values, None][:3] for values in filled]
        problem = _impossible(numbers)
        if problem is not None:
            return Refusal("impossible number", problem, view)
        ids = np.array([person.track_id for person in message.people], dtype=np.int64)
        # Half a place is none.
        numbers[np.isnan(numbers[..., 0]) | np.isnan(numbers[..., 1])] = np.nan
        return SeenView(view, message.time_s, numbers[..., :2].copy(), numbers[..., 2].copy(), ids)


def _impossible(numbers: np.ndarray) -> str | None:
    """What no detector can have meant."""
    if not numbers.size:
        return None
    least, most = np.fmin.reduce(numbers, axis=(0, 1)), np.fmax.reduce(numbers, axis=(0, 1))
    if max(most[:2].max(), -least[:2].min()) > MOST_PX:
        return f"a keypoint lies farther than {MOST_PX:g} px from the image's corner."
    if least[2] < 0.0 or most[2] > MOST_PX:
        return f"a confidence is negative or more than {MOST_PX:g}."
    return None


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:160]


def line_of(camera: str, view: SeenView) -> bytes:
    """A line as :class:`Reader` reads it, with its end; numbers as exact as they are."""
    people = []
    for keypoints, confidence, track in zip(view.keypoints_px, view.confidence, view.track_ids, strict=True):
        columns = np.column_stack([keypoints, confidence]).tolist()
        shown = [
            None if math.isnan(x) or math.isnan(y) else [x, y] if math.isnan(c) else [x, y, c] for x, y, c in columns
        ]
        people.append({"keypoints": shown} | ({"track_id": int(track)} if track >= 0 else {}))
    return encoded({"camera": camera, "time_s": view.time_s, "people": people})


def lines_of(detections: Detections, cameras: Sequence[str] | None = None) -> Iterator[tuple[float, bytes]]:
    """A recording as times and lines, frame by frame and view by view; what a view did not record is left out.

    Args:
        detections: the recording.
        cameras: what the cameras are called; by default as the views.

    Raises:
        DetectionsError: if the recording has no times.
    """
    if not (np.asarray(detections.recorded) & np.isfinite(detections.time_s)).any():
        raise DetectionsError("The keypoint files do not say how many frames a second they have. Add --rate-hz 60.")
    for chunk in detections.chunks():
        sent = np.asarray(chunk.recorded) & np.isfinite(chunk.time_s)
        for f, v in np.argwhere(sent).tolist():
            cell = f * chunk.n_views + v
            rows = slice(int(chunk.offsets[cell]), int(chunk.offsets[cell + 1]))
            time_s = float(chunk.time_s[f, v])
            seen = SeenView(
                v, time_s, np.asarray(chunk.keypoints_px[rows]), np.asarray(chunk.confidence[rows]),
                np.asarray(chunk.track_ids[rows]),
            )  # fmt: skip
            yield time_s, line_of((cameras or chunk.view_names)[v], seen)


def encoded(message: Mapping[str, Any]) -> bytes:
    """A message as one line, with its end; what is not finite is null."""
    return msgspec.json.encode(message) + b"\n"


def numbers_or_null(values: np.ndarray) -> list[list[float] | None]:
    """Rows as lists, null where a number is missing.

    Args:
        values: shape (row, number).
    """
    there = np.asarray(np.isfinite(values).all(axis=-1))
    if there.all():
        return values.tolist()
    return [row if known else None for row, known in zip(values.tolist(), there.tolist(), strict=True)]
