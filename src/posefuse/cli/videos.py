"""Parameters that assign videos to cameras."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.errors import FileError, MatchError, OptionsError, choices
from posefuse.io.videos.reader import VIDEO_ENDINGS
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction

Videos = Annotated[
    tuple[str, ...],
    Parameter(help="Videos as CAMERA=FILE, or a folder of videos named like the cameras."),
]
Offsets = Annotated[
    tuple[str, ...],
    Parameter(help="Start time of each video in the result's time, as CAMERA=SECONDS; 0 by default."),
]


def videos_by_camera(rig: CameraRig, given: Sequence[str]) -> dict[str, Path]:
    """Return the video of each camera.

    Args:
        rig: Rig of the result.
        given: Entries CAMERA=FILE, or folders.

    Raises:
        OptionsError: if an entry is neither, or a camera has two videos.
        FileError: if a folder holds no video that is named like a camera.
    """
    videos: dict[str, Path] = {}
    for text in given:
        name, mark, path = text.partition("=")
        # The path of a folder may contain an equals sign.
        pairs = _of_folder(rig, Path(text)) if not mark or Path(text).is_dir() else {name: Path(path)}
        for camera, file in pairs.items():
            if camera in videos:
                raise OptionsError(f"--video names two videos of camera {camera!r}: {videos[camera]} and {file}.")
            videos[camera] = file
    return videos


def files_by_name(given: Sequence[str]) -> dict[str, Path]:
    """Return the videos that entries CAMERA=FILE name; the videos of a folder are named after their files.

    Raises:
        OptionsError: if an entry is neither, or a camera has two videos.
    """
    from posefuse.io.videos.find import find_videos

    videos: dict[str, Path] = {}
    for text in given:
        name, mark, path = text.partition("=")
        if Path(text).is_dir():
            pairs = {file.stem: file for file in find_videos(Path(text))}
        elif mark:
            pairs = {name: Path(path)}
        else:
            raise OptionsError(f"--video {text}: expected CAMERA=FILE, such as cam1={text}, or a folder of videos.")
        for camera, file in pairs.items():
            if camera in videos:
                raise OptionsError(f"--video names two videos of camera {camera!r}: {videos[camera]} and {file}.")
            videos[camera] = file
    return videos


def _of_folder(rig: CameraRig, folder: Path) -> dict[str, Path]:
    from posefuse.model.view_names import plain_name

    if not folder.is_dir():
        raise OptionsError(
            f"--video {folder}: expected CAMERA=FILE, such as {rig.names[0]}={folder}, or a folder of videos. "
            f"The cameras are {choices(rig.names, 30)}."
        )
    files = sorted(entry for entry in folder.iterdir() if entry.suffix.lower() in VIDEO_ENDINGS)
    by_name: dict[str, list[Path]] = {}
    for file in files:
        by_name.setdefault(plain_name(file.stem), []).append(file)
    found = {name: by_name[plain_name(name)] for name in rig.names if plain_name(name) in by_name}
    if not found:
        raise FileError(
            f"{folder} contains no video named after a camera. Videos: {choices(file.name for file in files)}. "
            f"Cameras: {choices(rig.names, 30)}. Specify them: --video {rig.names[0]}=FILE."
        )
    for name, several in found.items():
        if len(several) > 1:
            raise MatchError(
                f"Several videos in {folder} match camera {name!r}: {choices(file.name for file in several)}. Specify "
                f"one: --video {name}=FILE."
            )
    return {name: several[0] for name, several in found.items()}


def offsets_by_camera(given: Sequence[str]) -> dict[str, float]:
    """Return the start time of each camera's video in s.

    Raises:
        OptionsError: if an entry is not CAMERA=SECONDS, or a camera has two.
    """
    offsets: dict[str, float] = {}
    for text in given:
        name, _, number = text.rpartition("=")
        try:
            seconds = float(number)
        except ValueError:
            seconds = float("nan")
        if not name or seconds != seconds or abs(seconds) == float("inf"):
            raise OptionsError(f"--offset-s {text}: expected CAMERA=SECONDS, such as cam1=0.02.")
        if name in offsets:
            raise OptionsError(f"--offset-s names camera {name!r} twice.")
        offsets[name] = seconds
    return offsets


def detections_in(result: Reconstruction, recording: Path | None, keypoints: Path | None) -> Detections | None:
    """Return the given 2D keypoints, or those in a recording's folder, or None if neither is given."""
    from posefuse.cli.explain import detections_for

    return None if recording is None and keypoints is None else detections_for(result, recording, keypoints, None)


def layer_of(result: Reconstruction, layer: LayerName | None) -> LayerName:
    """Return the layer to show: the named one, that of the result's options, or the best one.

    Raises:
        ResultError: if the result has no such layer.
    """
    return result.best_layer(layer or result.options.layer)[0]
