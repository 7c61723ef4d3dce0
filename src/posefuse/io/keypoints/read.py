"""Read any 2D keypoints."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.files import must_exist
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.frame_rates import find_frame_rate
from posefuse.io.keypoints.registry import KEYPOINTS
from posefuse.io.keypoints.request import Request
from posefuse.io.keypoints.timing import on_one_line
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton, find_skeleton


def find_format(path: Path) -> KeypointFormat | None:
    """The format that a file or folder of keypoints is in, or None where it is none."""
    return next((form for form in KEYPOINTS if form.matches(path)), None)


def read_keypoints(path: Path, request: Request) -> Detections:
    """Read keypoints, whatever their format, their views put together by time where times are known.

    Raises:
        FileError: if there is nothing there, or no reader knows it.
        PosefuseError: what the format's reader raises, and what times that do not fit do.
    """
    must_exist(path, "keypoints")
    form = find_format(path)
    if form is None:
        known = choices(f"{form.name} ({form.files})" for form in KEYPOINTS)
        raise FileError(f"{path} holds no keypoints in a known format. Known: {known}.")
    return on_one_line(_with_stated_rate(form.read(path, request), path, request), request)


def _with_stated_rate(detections: Detections, path: Path, request: Request) -> Detections:
    """Return detections with the frame rate of files beside them, if neither they nor the request have times."""
    requested = request.rate_hz is not None or request.timestamps is not None or request.nearby is not None
    if requested or request.view_rates_hz or has_times(detections):
        return detections
    stated = find_frame_rate(path)
    if stated is None:
        return detections
    note = f"Frame rate {stated.rate_hz:g} Hz read from {stated.source}."
    return replace(detections.with_rate(stated.rate_hz), notes=(*detections.notes, note))


def has_times(detections: Detections) -> bool:
    """Return whether the times of frames are known."""
    return detections.rate_hz is not None or bool(np.isfinite(detections.time_s).any())


def read_detections(path: str | Path, skeleton: str | Path | Skeleton | None = None) -> Detections:
    """Read 2D keypoints, whatever their format.

    Args:
        path: a file or folder.
        skeleton: what the keypoints are: a shipped name, the path of a skeleton's TOML file, or a skeleton. By default
            what the files say, or their number allows.

    Returns:
        The detections. Where the files give no frame rate, times are NaN: see ``Detections.with_rate``.

    Raises:
        FileError: if there is nothing there, no reader knows it, or a file is broken.
        SkeletonError: if the keypoints do not fit the skeleton, or do not tell which it is.
        DetectionsError: if the keypoints cannot be.
    """
    return read_keypoints(Path(path), Request(None if skeleton is None else find_skeleton(skeleton)))
