"""Errors a user can act on.

::

    PosefuseError
    ├── FileError          a file or folder is missing, truncated, or not what its format says
    ├── RecordingError     a folder holds no recording, or more than one
    ├── CameraError        a camera or rig that cannot be
    ├── DetectionsError    2D keypoints that cannot be
    ├── SkeletonError      keypoint names that do not fit
    ├── MatchError         cameras and views that do not belong together
    ├── OptionsError       an option that does not exist, or a value it cannot take
    ├── CalibrationError   cameras that what was seen does not determine
    ├── StreamError        a live stream's source cannot be listened to or reached
    ├── EditError          an edit of a result that cannot be done
    └── ResultError        a result that cannot be, or that a format cannot hold

Every message says what is wrong, where, what was expected and what was found, and what to do about it.
"""

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any


class PosefuseError(Exception):
    """The base of every error posefuse raises on purpose."""


class FileError(PosefuseError):
    """A file or folder is missing, truncated, or not what its format says."""


class RecordingError(PosefuseError):
    """A folder holds no recording, or more than one."""


class CameraError(PosefuseError):
    """A camera or rig that cannot be."""


class DetectionsError(PosefuseError):
    """2D keypoints that cannot be."""


class SkeletonError(PosefuseError):
    """Keypoint names that do not fit a skeleton."""


class MatchError(PosefuseError):
    """Cameras and views that do not belong together."""


class OptionsError(PosefuseError):
    """An option that does not exist, or a value it cannot take."""


class CalibrationError(PosefuseError):
    """Cameras that what was seen does not determine."""


class StreamError(PosefuseError):
    """A live stream's source cannot be listened to or reached."""


class EditError(PosefuseError):
    """An edit of a result that cannot be done."""


class ResultError(PosefuseError):
    """A result that cannot be, or that a format cannot hold."""


class PosefuseWarning(UserWarning):
    """Something was done that the user may not expect; said once, never once a frame."""


@contextmanager
def handle_warnings(handle: Callable[[str], None]) -> Iterator[None]:
    """Pass each distinct :class:`PosefuseWarning` to a function, once; show all other warnings as usual.

    Args:
        handle: receives the text of a warning.
    """
    seen: set[str] = set()
    with warnings.catch_warnings():
        warnings.simplefilter("always", PosefuseWarning)
        default = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *rest: Any, **named: Any) -> None:
            if not issubclass(category, PosefuseWarning):
                default(message, category, *rest, **named)
            elif str(message) not in seen:
                seen.add(str(message))
                handle(str(message))

        warnings.showwarning = show
        yield


def choices(names: Iterable[str], most: int = 12) -> str:
    """A readable list of the valid names, cut when long."""
    listed = [str(name) for name in names]
    shown = ", ".join(listed[:most]) or "none"
    return shown if len(listed) <= most else f"{shown}, ... ({len(listed)} in all)"


def suggestion(name: str, names: Iterable[str]) -> str:
    """What was probably meant, or what there is: the end of an error message."""
    listed = [str(candidate) for candidate in names]
    close = get_close_matches(name.lower(), [candidate.lower() for candidate in listed], n=1, cutoff=0.6)
    if close:
        meant = next(candidate for candidate in listed if candidate.lower() == close[0])
        return f"Did you mean {meant!r}?"
    return f"Choose one of: {choices(listed)}."
