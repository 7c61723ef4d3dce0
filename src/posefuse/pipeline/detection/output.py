"""The folder that a detection writes: keypoints, a description of how they were made, and parts of unfinished work."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from posefuse.detection.detector import Detector
from posefuse.errors import RecordingError
from posefuse.io.checkpoints import digest_of
from posefuse.io.files import replacing
from posefuse.io.keypoints.read import DETECTED_FILE
from posefuse.io.netcdf import skeleton_text
from posefuse.io.outputs import exists_error
from posefuse.io.view_images import OUTPUT_MARKERS, ImageSource
from posefuse.model.options.detection import DetectOptions

DESCRIPTION_FILE = OUTPUT_MARKERS[0]
PARTS_FOLDER = ".parts"
OVERLAY_FOLDER = "overlay"
_NOT_COMPARED = ("jobs", "overlay", "detector", "detector_python", "weights")
"""Options without effect on the detections, or on nothing but the detector, which states its version."""


@dataclass(frozen=True)
class DetectedView:
    """What was found in a view.

    Attributes:
        name: name of the view.
        n_images: number of images that were examined.
        n_with_people: number of images with a detection.
        most_people: most detections in one image.
        n_tracks: number of 2D tracks.
        rate_hz: frame rate of the video; None for pictures.
    """

    name: str
    n_images: int
    n_with_people: int
    most_people: int
    n_tracks: int
    rate_hz: float | None


def describe_videos(sources: Sequence[ImageSource]) -> dict[str, Any]:
    """Return the videos of the views, as JSON values by the name of the view.

    Raises:
        RecordingError: if two views have the same content.
    """
    videos: dict[str, Any] = {}
    known: dict[str, str] = {}
    for source in sources:
        digest = source.digest()
        if digest in known:
            raise RecordingError(
                f"The views {known[digest]!r} and {source.name!r} have the same content ({source.view.files[0]}). "
                "Remove one of them."
            )
        known[digest] = source.name
        codec = {} if source.index is None else {"codec": source.index.info.codec}
        files = [source.view.files[0].name] if source.index else [file.name for file in source.view.files]
        videos[source.name] = {
            "files": files, "sha256": digest, "size_px": source.size_px, "images": source.n_images, **codec,
        }  # fmt: skip
    return videos


def describe_inputs(
    videos: Mapping[str, Any], detector: Detector, identity: str, options: DetectOptions
) -> dict[str, Any]:
    """Return everything that the detections depend on, as JSON values.

    Args:
        videos: from :func:`describe_videos`.
        detector: the detector.
        identity: what identifies the detector beyond its name and version, such as the code of a function.
        options: options of the detection.
    """
    return {
        "posefuse": version("posefuse"),
        "av": version("av"),
        "detector": {"name": detector.name, "version": detector.version, "identity": identity},
        "skeleton": digest_of({"skeleton": skeleton_text(detector.skeleton)}),
        "options": {name: value for name, value in asdict(options).items() if name not in _NOT_COMPARED},
        "videos": dict(videos),
    }


@dataclass(frozen=True)
class OutputFolder:
    """The output of a detection.

    Attributes:
        folder: the folder.
        key: digest of everything that the detections depend on.
    """

    folder: Path
    key: str

    @property
    def keypoints(self) -> Path:
        """The file of keypoints."""
        return self.folder / DETECTED_FILE

    @property
    def parts(self) -> Path:
        """Folder of finished chunks."""
        return self.folder / PARTS_FOLDER

    def finished_views(self) -> tuple[DetectedView, ...] | None:
        """Return what an earlier run with the same key found; None if there is none, or it did not finish."""
        description = read_description(self.folder)
        if description.get("key") != self.key or not self.keypoints.is_file():
            return None
        return tuple(DetectedView(**view) for view in description["views"])

    def check_new(self, *, overwrite: bool) -> None:
        """Refuse to replace the keypoints of another run.

        Raises:
            OutputExistsError: if there are some, and ``overwrite`` is False.
        """
        if not overwrite and self.keypoints.is_file() and read_description(self.folder).get("key") != self.key:
            raise exists_error(f"{self.keypoints} already exists, of other videos, options or versions")

    def finish(self, inputs: Mapping[str, Any], views: tuple[DetectedView, ...]) -> None:
        """Write the description, which marks the detections as complete.

        Raises:
            FileError: if it cannot be written.
        """
        content = {"key": self.key, **inputs, "views": [asdict(view) for view in views]}
        with replacing(self.folder / DESCRIPTION_FILE) as temporary:
            temporary.write_text(json.dumps(content, indent=1) + "\n", "utf-8")


def read_description(folder: Path) -> dict[str, Any]:
    """Return the description of a detection's output; empty if there is none."""
    try:
        content = json.loads((folder / DESCRIPTION_FILE).read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
