"""Reading of 2D keypoints in any format."""

from pathlib import Path

from posefuse.errors import FileError, choices
from posefuse.io.files import must_exist
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.registry import KEYPOINTS
from posefuse.io.keypoints.request import Request
from posefuse.io.keypoints.timing import with_common_frames
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton, find_skeleton


def find_format(path: Path) -> KeypointFormat | None:
    """Return the keypoint format of a file or folder, or None if it is in none."""
    return next((form for form in KEYPOINTS if form.matches(path)), None)


def read_keypoints(path: Path, request: Request) -> Detections:
    """Read keypoints in any format and align their views by time if times are available.

    Raises:
        FileError: If the path does not exist or is in no known format.
        PosefuseError: Any error of the reader, or if timestamps do not match the views.
    """
    must_exist(path, "keypoints")
    form = find_format(path)
    if form is None:
        formats = choices(f"{form.name} ({form.files})" for form in KEYPOINTS)
        raise FileError(f"{path} contains no keypoints in a known format. Formats: {formats}.")
    return with_common_frames(form.read(path, request), request)


def read_detections(path: str | Path, skeleton: str | Path | Skeleton | None = None) -> Detections:
    """Read 2D keypoints in any format.

    Args:
        path: File or folder.
        skeleton: Skeleton of the keypoints: a shipped name, the path of a TOML file, or a skeleton. Default: the one
            stated by the files, or inferred from the number of keypoints.

    Returns:
        The detections, in px. If the files state no frame rate, times are NaN: see ``Detections.with_rate``.

    Raises:
        FileError: If the path does not exist, is in no known format, or a file is broken.
        SkeletonError: If the keypoints do not match the skeleton, or the skeleton cannot be inferred.
        DetectionsError: If the keypoints are invalid.
    """
    return read_keypoints(Path(path), Request(None if skeleton is None else find_skeleton(skeleton)))
