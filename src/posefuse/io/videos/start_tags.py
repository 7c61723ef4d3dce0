"""When a video started, by the tags that cameras and phones write: a timecode, or the time of creation."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from posefuse.errors import FileError
from posefuse.io.files import must_exist
from posefuse.io.videos.library import import_pyav

StartKind = Literal["timecode", "creation time"]

_TIMECODE = re.compile(r"(\d\d):(\d\d):(\d\d)[:;.](\d\d+)")
_CREATION = ("com.apple.quicktime.creationdate", "creation_time")
_EARLIEST = datetime(1990, 1, 1, tzinfo=UTC)
"""Cameras without a clock write the beginning of 1904 or 1970."""


@dataclass(frozen=True)
class StartTags:
    """The tags of one video.

    Attributes:
        timecode_s: timecode of the first image, since midnight; None without one.
        created_s: time of creation, since 1970; None without one.
        duration_s: length of the video; 0 if unknown.
    """

    timecode_s: float | None = None
    created_s: float | None = None
    duration_s: float = 0.0

    def of_kind(self, kind: StartKind) -> float | None:
        """Return the time of one kind of tag."""
        return self.timecode_s if kind == "timecode" else self.created_s


def read_start_tags(path: Path) -> StartTags:
    """Read the tags of a video; tags that are no times are ignored.

    Raises:
        FileError: if the file cannot be read.
    """
    av = import_pyav()
    must_exist(path, "video")
    try:
        with av.open(str(path)) as container:
            tables = [_lower(each.metadata) for each in (container, *container.streams)]
            rate = container.streams.video[0].average_rate if container.streams.video else None
            duration_s = container.duration / av.time_base if container.duration else 0.0
    except (av.error.FFmpegError, EOFError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(f"{path} cannot be read as a video ({reason}). Is it truncated or not a video?") from None
    return StartTags(
        _timecode_s(_first(tables, ("timecode",)), rate), _created_s(_first(tables, _CREATION)), duration_s
    )


def _lower(table: Mapping[str, str]) -> dict[str, str]:
    """Return tags with names in lower case; Matroska writes them in upper case."""
    return {name.lower(): text for name, text in table.items()}


def _first(tables: list[dict[str, str]], names: tuple[str, ...]) -> str:
    """Return the first of some tags."""
    return next((table[name] for name in names for table in tables if table.get(name)), "")


def _timecode_s(text: str, rate: Any) -> float | None:
    match = _TIMECODE.fullmatch(text.strip())
    if match is None or not rate:
        return None
    hours, minutes, seconds, frames = (int(each) for each in match.groups())
    return 3600.0 * hours + 60.0 * minutes + seconds + frames / float(rate)


def _created_s(text: str) -> float | None:
    try:
        when = datetime.fromisoformat(text.strip())
    except ValueError:
        return None
    when = when if when.tzinfo else when.replace(tzinfo=UTC)
    return when.timestamp() if when > _EARLIEST else None
