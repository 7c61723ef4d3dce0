"""The description of a calibration format."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from posefuse.io.formats import Format
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit


@dataclass(frozen=True, kw_only=True)
class CalibrationFormat(Format):
    """One calibration format. See :class:`posefuse.io.formats.Format` for the other attributes.

    Attributes:
        matches: Return whether a file or folder is in this format. It may raise FileError for a broken file.
        read: Read a calibration. The length unit is None if the user did not state it.
        write: Write a rig, or None if the format is not written.
        file_endings: Endings that the names of written files must have. Default: ``endings``.
    """

    matches: Callable[[Path], bool]
    read: Callable[[Path, LengthUnit | None], CameraRig]
    write: Callable[[CameraRig, Path], None] | None = None
    file_endings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Fill in the default of ``file_endings``."""
        super().__post_init__()
        object.__setattr__(self, "file_endings", self.file_endings or self.endings)

    @property
    def reads(self) -> bool:
        """Always true: every format of this kind has a reader."""
        return True

    @property
    def writes(self) -> bool:
        """Whether posefuse writes the format."""
        return self.write is not None
