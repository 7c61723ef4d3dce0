"""Inputs of a calibration by people: 2D keypoints of a recording, and what is known of the lenses."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from posefuse.errors import CalibrationError, PosefuseError, RecordingError, choices
from posefuse.io.files import must_exist
from posefuse.io.keypoints.read import read_keypoints
from posefuse.io.open_recording import keypoint_request
from posefuse.io.recording import choose_keypoints, find_recording
from posefuse.io.videos.reader import VIDEO_ENDINGS, open_video
from posefuse.io.videos_only import videos_only
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.calibration import PeopleOptions
from posefuse.model.options.options import Options
from posefuse.model.view_names import matching_name
from posefuse.progress import Progress

_FOCAL_SHARE = 0.9
"""Guess of the focal length as a share of the image's longer side: a field of view of 58 degrees."""


def read_people(
    recording: Path, keypoints: Path | None, timestamps: Path | None, options: PeopleOptions, progress: Progress
) -> Detections:
    """Return the 2D keypoints of a recording, whose calibration, if any, is not read.

    Args:
        recording: folder of the recording, or file of keypoints.
        keypoints: file or folder of keypoints; None to search the recording.
        timestamps: table or folder of frame times; None to use those beside the keypoints.
        options: skeleton and frame rates.
        progress: receives the progress.

    Raises:
        PosefuseError: if there are no keypoints, or several sets, or they cannot be read.
    """
    path = keypoints or _find_keypoints(recording)
    reading = Options(
        skeleton=options.skeleton,
        rate_hz=options.rate_hz,
        view_rates_hz=options.view_rates_hz,
        image_size=options.image_size,
    )
    return read_keypoints(path, keypoint_request(recording, path, reading, progress, timestamps))


def _find_keypoints(recording: Path) -> Path:
    """Return the only keypoints of a recording."""
    must_exist(recording, "recording")
    found = find_recording(recording)
    if not found.keypoints:
        advice = videos_only(recording)
        if advice is not None:
            raise RecordingError(
                f"{advice} For videos of a board, add `board`; for points of known position, `scene_points`."
            )
        raise RecordingError(
            f"{recording} has no 2D keypoints to calibrate by. For images of a board, add `board`; for points of known "
            "position, `scene_points`; for keypoints elsewhere, `keypoints`."
        )
    return choose_keypoints(found)


def cameras_of(
    names: tuple[str, ...],
    known: CameraRig | None,
    recording: Path | None,
    options: PeopleOptions,
    image_sizes: Mapping[str, tuple[int, int]] = MappingProxyType({}),
) -> tuple[tuple[Camera, ...], tuple[bool, ...]]:
    """Return the lens of each view, and whether its focal length is known.

    A camera of a known lens has the name that it has there. One of unknown lens has the name of the view,
    no distortion, its principal point at the center of the image, and a guessed focal length.

    Args:
        names: names of the views.
        known: cameras with known lenses.
        recording: folder that may hold the videos of the views, from which image sizes are read.
        options: image size.
        image_sizes: width and height of the images of views, where known.

    Raises:
        CalibrationError: if the size of an image is unknown; the message names all such views.
    """
    lenses: dict[str, Camera] = {}
    for name in names:
        match = None if known is None else matching_name(name, known.names)
        if match is not None and known is not None:
            lenses[name] = replace(known[match], camera_from_world=np.eye(4))
    missing = [name for name in names if name not in lenses]
    sizes = {**_sizes([name for name in missing if name not in image_sizes], recording, options), **image_sizes}
    unsized = [name for name in missing if name not in sizes]
    if unsized:
        raise CalibrationError(
            f"The image size of {choices(unsized)} is unknown, which a calibration without known lenses needs. Set "
            "`image_size`, or `intrinsics` to a calibration with these cameras."
        )
    guessed = {name: _guess(name, sizes[name]) for name in missing}
    return tuple(lenses.get(name) or guessed[name] for name in names), tuple(name in lenses for name in names)


def _guess(name: str, size: tuple[int, int]) -> Camera:
    width, height = size
    focal_px = _FOCAL_SHARE * max(size)
    matrix = np.array([[focal_px, 0.0, 0.5 * (width - 1)], [0.0, focal_px, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    return Camera(name, (width, height), matrix, np.eye(4))


def _sizes(names: list[str], recording: Path | None, options: PeopleOptions) -> Mapping[str, tuple[int, int]]:
    """Return the image sizes of views, as given or as in the videos of the recording."""
    if options.image_size:
        width, height = options.image_size
        return dict.fromkeys(names, (width, height))
    if recording is None or not names or not recording.is_dir():
        return {}
    videos = {p.stem: p for p in sorted(recording.rglob("*")) if p.suffix.lower() in VIDEO_ENDINGS}
    out: dict[str, tuple[int, int]] = {}
    for name in names:
        match = matching_name(name, tuple(videos))
        if match is None:
            continue
        try:
            out[name] = open_video(videos[match]).info.size_px
        except PosefuseError:
            continue
    return out
