"""The description of a format of 3D results."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from posefuse.errors import ResultError
from posefuse.io.formats import Format
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.stored_points import StoredPoints
from posefuse.skeleton.skeletons import Skeleton

LayerWriter = Callable[[Reconstruction, Path, LayerName], None]
PersonWriter = Callable[[Reconstruction, str, Path, LayerName], None]
FigureWriter = Callable[[Reconstruction, str, Path], list[str]]
ResultWriter = Callable[[Reconstruction, Sequence[str], Path, LayerName], list[str]]


@dataclass(frozen=True, eq=False)
class ResultFacts:
    """What is known of a result before it is made, and decides whether a format can hold it.

    Attributes:
        unit: ``m``, or ``px`` for a single camera.
        skeleton: skeleton of the points.
        cameras: names of the cameras.
        frame_numbers: shape (frame,), increasing.
        time_s: shape (frame,), NaN if unknown.
        rate_hz: frame rate, or None if unknown.
        has_identities: False for unrelated frames, whose people are numbered in each frame.
    """

    unit: str
    skeleton: Skeleton
    cameras: tuple[str, ...]
    frame_numbers: np.ndarray
    time_s: np.ndarray
    rate_hz: float | None
    has_identities: bool = True

    @classmethod
    def of(cls, result: Reconstruction) -> "ResultFacts":
        """Return the facts of a result."""
        return cls(
            result.unit, result.skeleton, result.rig.names, result.frame_numbers, result.time_s, result.rate_hz,
            result.has_identities,
        )  # fmt: skip

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.frame_numbers)

    def require_meters(self, form: str) -> None:
        """Refuse points in the image plane of a single camera.

        Raises:
            ResultError: if the points are not in meters.
        """
        if self.unit != "m":
            raise ResultError(
                f"{form} needs 3D points; those of a single camera are in its image plane, in {self.unit}. parquet, "
                "movement, sleap, deeplabcut and nwb can hold them."
            )


@dataclass(frozen=True, kw_only=True)
class ResultFormat(Format):
    """One format of 3D results. See :class:`posefuse.io.formats.Format` for the other attributes.

    A format has at most one of the four writers; its notes are sentences about what the file does not hold.

    Attributes:
        matches: Return whether a path is in this format; None if the format cannot be read as points.
        read: Read one layer of 3D points; None if the format cannot be read as points.
        read_result: Read a whole reconstruction; None if the format does not hold one.
        write_layer: Write one layer of all people to a file.
        write_person: Write one layer of one person to a file.
        write_figure: Write the articulated body of one person to a file. Returns notes.
        write_result: Write the people of a result, with every field that the format can hold. Returns notes.
        holds_every_layer: Whether a file holds all layers.
        holds_stills: Whether it holds people of unrelated frames, who have no identities.
        holds_measured_layer: Whether a file of another layer also holds the measured layer.
        is_folder: Whether a result is a folder.
        name_words: Words of a file name that select this format among those with the same ending. Without any,
            the ending alone selects it.
        lacks: Fields of a layer that the format cannot hold. Empty if it holds all of them.
        complete_endings: Endings of files for which ``lacks`` does not apply.
        require: Raise a ResultError if the format cannot hold a result with these facts; None if it can hold any.
        remarks: Return notes on what a file states about a result by default; None without any.
        additional_name: Name of the file or folder that ``--also`` writes into the folder of a result. Empty if
            ``--also`` does not offer the format.
    """

    matches: Callable[[Path], bool] | None = None
    read: Callable[[Path], StoredPoints] | None = None
    read_result: Callable[[Path], Reconstruction] | None = None
    write_layer: LayerWriter | None = None
    write_person: PersonWriter | None = None
    write_figure: FigureWriter | None = None
    write_result: ResultWriter | None = None
    holds_every_layer: bool = False
    holds_stills: bool = False
    holds_measured_layer: bool = False
    is_folder: bool = False
    name_words: tuple[str, ...] = ()
    lacks: str = ""
    complete_endings: tuple[str, ...] = ()
    require: Callable[[ResultFacts], None] | None = None
    remarks: Callable[[Reconstruction], tuple[str, ...]] | None = None
    additional_name: str = ""

    @property
    def reads(self) -> bool:
        """Whether posefuse reads the format."""
        return (self.read or self.read_result) is not None

    @property
    def writes(self) -> bool:
        """Whether posefuse writes the format."""
        return (self.write_layer or self.write_person or self.write_figure or self.write_result) is not None
