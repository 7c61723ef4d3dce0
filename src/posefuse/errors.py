"""Errors and warnings of posefuse.

::

    PosefuseError
    ├── FileError          a file or folder is missing, truncated, or does not match its format
    │   ├── OutputExistsError  an output exists, and the caller does not ask to replace it
    │   └── StoreError         an object store does not answer, or denies access
    ├── RecordingError     a folder holds no recording, or several
    ├── CameraError        a camera or rig is invalid
    ├── DetectionsError    2D keypoints are invalid
    ├── DetectorError      a detector is unknown, is not installed, or fails
    ├── SkeletonError      keypoint names do not match a skeleton
    ├── MatchError         cameras and views do not match
    ├── OptionsError       an option does not exist, or its value is invalid
    ├── CalibrationError   the observations do not determine the cameras
    ├── StreamError        the source of a live stream cannot be opened or reached
    ├── EditError          an edit cannot be applied to a result
    ├── ArgumentError      an argument of a public function has the wrong type or shape (also a TypeError)
    └── ResultError        a result is invalid, or a format cannot hold it
        └── LayerError     a result does not have a layer (also a KeyError)

Every message states what is wrong, where, what was expected, what was found, and what to do about it. Messages and
notes name arguments and options as Python does, in backticks (`` `rate_hz` ``, `` `pick='largest'` ``), and public
functions with their module (`` `posefuse.measure_sync` ``); the command line shows them as its flags and commands
(:mod:`posefuse.model.options.flags`).
"""

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any


class PosefuseError(Exception):
    """Base class of all errors that posefuse raises on purpose."""


class FileError(PosefuseError):
    """A file or folder is missing, truncated, or does not match its format."""


class OutputExistsError(FileError):
    """An output exists, and the caller does not ask to replace it."""


class StoreError(FileError):
    """An object store does not answer, or denies access.

    Attributes:
        transient: whether the same request may succeed later.
    """

    def __init__(self, message: str, *, transient: bool = False) -> None:
        super().__init__(message)
        self.transient = transient


class RecordingError(PosefuseError):
    """A folder holds no recording, or several."""


class CameraError(PosefuseError):
    """A camera or rig is invalid."""


class DetectionsError(PosefuseError):
    """2D keypoints are invalid."""


class DetectorError(PosefuseError):
    """A detector is unknown, is not installed, or fails."""


class SkeletonError(PosefuseError):
    """Keypoint names do not match a skeleton."""


class MatchError(PosefuseError):
    """Cameras and views do not match."""


class OptionsError(PosefuseError):
    """An option does not exist, or its value is invalid."""


class CalibrationError(PosefuseError):
    """The observations do not determine the cameras."""


class StreamError(PosefuseError):
    """The source of a live stream cannot be opened or reached."""


class EditError(PosefuseError):
    """An edit cannot be applied to a result."""


class ResultError(PosefuseError):
    """A result is invalid, or a format cannot hold it."""


class ArgumentError(PosefuseError, TypeError):
    """An argument of a public function has the wrong type or shape."""


class LayerError(ResultError, KeyError):
    """A result does not have a layer."""

    __str__ = Exception.__str__


class PosefuseWarning(UserWarning):
    """Something happened that the user may not expect; issued once, never once per frame."""


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
    """Return a list of names for a message, such as ``a, b, c``.

    Args:
        names: Valid names; none gives ``none``.
        most: Number of names after which a long list is cut, with the total count.
    """
    listed = [str(name) for name in names]
    shown = ", ".join(listed[:most]) or "none"
    return shown if len(listed) <= most else f"{shown}, ... ({len(listed)} in all)"


def suggestion(name: str, names: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: the closest valid name, or the list of valid names.

    Args:
        name: Unknown name; case is ignored.
        names: Valid names.
    """
    listed = [str(candidate) for candidate in names]
    close = get_close_matches(name.lower(), [candidate.lower() for candidate in listed], n=1, cutoff=0.6)
    if close:
        match = next(candidate for candidate in listed if candidate.lower() == close[0])
        return f"Did you mean {match!r}?"
    return f"Choose one of: {choices(listed)}."
