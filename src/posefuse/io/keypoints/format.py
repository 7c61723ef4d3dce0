"""The description of a format of 2D keypoints."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from posefuse.io.formats import Format
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections


@dataclass(frozen=True, kw_only=True)
class KeypointFormat(Format):
    """One format of 2D keypoints. See :class:`posefuse.io.formats.Format` for the other attributes.

    Attributes:
        matches: Return whether a file or folder is in this format.
        read: Read a file or folder.
        write: Write detections to a file or folder, or None if the format is not written.
        lost: Return what of the detections the written file does not hold, as phrases. None if nothing is lost.
        camera_files: Return the files of a folder with one file per camera, or None if the format has another layout.
        trials_in: Return the paths of the trials in a folder that holds several, or None if folders hold one.
        input_files: Return every file that is read. Default: ``camera_files``.
    """

    matches: Callable[[Path], bool]
    read: Callable[[Path, Request], Detections]
    write: Callable[[Detections, Path], None] | None = None
    lost: Callable[[Detections, Path], tuple[str, ...]] | None = None
    camera_files: Callable[[Path], list[Path]] | None = None
    trials_in: Callable[[Path], list[Path]] | None = None
    input_files: Callable[[Path], list[Path]] | None = None

    def __post_init__(self) -> None:
        """Fill in the default of ``input_files``."""
        super().__post_init__()
        object.__setattr__(self, "input_files", self.input_files or self.camera_files)

    @property
    def reads(self) -> bool:
        """Always true: every format of this kind has a reader."""
        return True

    @property
    def writes(self) -> bool:
        """Whether posefuse writes the format."""
        return self.write is not None
