"""Reading of 2D keypoints in any format."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import FileError, choices
from posefuse.io.files import must_exist
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.frame_rates import find_frame_rate
from posefuse.io.keypoints.registry import KEYPOINTS
from posefuse.io.keypoints.request import Request
from posefuse.io.keypoints.timing import replace_mismatched_timestamps, with_common_frames
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.skeleton.skeletons import Skeleton, find_skeleton

DETECTED_FILE = "keypoints.parquet"
"""File of keypoints in a folder that ``posefuse detect`` writes."""


def find_format(path: Path) -> KeypointFormat | None:
    """Return the keypoint format of a file or folder, or None if it is in none."""
    return next((form for form in KEYPOINTS if form.matches(path)), None)


def detected_keypoints(path: Path) -> Path:
    """Return the file of keypoints in a folder that ``posefuse detect`` wrote; any other path unchanged."""
    return file if (file := path / DETECTED_FILE).is_file() else path


def read_keypoints(path: Path, request: Request) -> Detections:
    """Read keypoints in any format and align their views by time if times are available.

    Raises:
        FileError: If the path does not exist or is in no known format.
        PosefuseError: Any error of the reader, or if timestamps do not match the views.
    """
    path = detected_keypoints(must_exist(path, "keypoints"))
    form = find_format(path)
    if form is None:
        formats = choices(f"{form.name} ({form.files})" for form in KEYPOINTS)
        raise FileError(f"{path} contains no keypoints in a known format. Formats: {formats}.")
    detections = form.read(path, request)
    if request.nearby is not None and not (request.rate_hz or request.view_rates_hz or has_times(detections)):
        detections, request = replace_mismatched_timestamps(detections, request, find_frame_rate(path))
    return with_common_frames(_with_stated_rate(detections, path, request), request)


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


@checked
def read_detections(
    path: str | Path, skeleton: str | Path | Skeleton | None = None, *, options: Options | None = None
) -> Detections:
    """Read 2D keypoints in any format.

    Args:
        path: File or folder.
        skeleton: Skeleton of the keypoints: a shipped name, the path of a TOML file, or a skeleton. Default: the one
            stated by the files, or inferred from the number of keypoints.
        options: what the files do not state: ``rate_hz``, ``view_rates_hz``, ``reference_view``, ``third_channel``,
            ``image_size`` and ``skeleton`` are used.

    Returns:
        The detections, in px. If neither the files nor files beside them state a frame rate, times are NaN: see
        ``Detections.with_rate``.

    Raises:
        FileError: If the path does not exist, is in no known format, or a file is broken.
        SkeletonError: If the keypoints do not match the skeleton, or the skeleton cannot be inferred.
        DetectionsError: If the keypoints are invalid.
    """
    request = Request.of(options or Options())
    if skeleton is not None:
        request = replace(request, skeleton=find_skeleton(skeleton))
    return read_keypoints(Path(path), request)
