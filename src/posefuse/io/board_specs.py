"""Descriptions of calibration boards: one line of text, or a file.

* Text: ``charuco:4x5,square=54mm,marker=0.75,dict=4X4_1000,inverted``.
* TOML with the table ``[board]`` and the attributes of :class:`~posefuse.model.board.Board`.
* Caliscope's ``charuco.toml``: ``columns, rows, dictionary, aruco_scale, square_size_override_cm, inverted``; in its
  older ``config.toml``, the table ``[charuco]``.
* Anipose's ``config.toml``: the table ``[calibration]`` with ``board_type, board_size, board_square_side_length``.
* Pose2Sim's ``Config.toml``: ``intrinsics_corners_nb, intrinsics_square_size`` of ``[calibration.calculate]``.
* FreeMoCap's calibration: the table ``[metadata.board]`` with ``squares_x, squares_y, square_length_mm``.
* sleap-anipose's ``board.toml``: ``board_x, board_y, square_length, marker_length, marker_bits, dict_size``.
"""

import contextlib
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from posefuse.errors import CalibrationError, FileError, PosefuseError, choices, suggestion
from posefuse.io.files import must_exist, reading
from posefuse.model.board import APRILTAG_DICTIONARIES, ARUCO_DICTIONARIES, BOARD_KINDS, Board

EXAMPLE = "charuco:7x5,square=30mm,marker=0.75,dict=4X4_50"

_UNITS_M = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "inch": 0.0254}
_LENGTH = re.compile(r"([0-9]+(?:\.[0-9]*)?(?:[eE][-+]?[0-9]+)?)\s*(mm|cm|m|inch|in)")
_SIZE = re.compile(r"(\d+)x(\d+)")
_PROJECT_FILES = ("board.toml", "charuco.toml", "Config.toml", "config.toml")
"""Names of files that describe the board of a whole project, one or two folders above its recordings."""
_WORDS = ("square", "marker", "gap", "dict", "inverted", "legacy")


def read_board_spec(spec: str | Path) -> Board:
    """Read the description of a board.

    Args:
        spec: a description in text, or the path of a TOML file of posefuse, Caliscope, Anipose, Pose2Sim,
            FreeMoCap or sleap-anipose.

    Raises:
        CalibrationError: if the description is not valid.
        FileError: if the file does not exist or describes no board.
    """
    text = str(spec)
    if ":" in text and text.split(":")[0] in BOARD_KINDS:
        return _from_text(text)
    if isinstance(spec, Path) or text.endswith(".toml") or Path(text).exists():
        return _from_file(Path(spec))
    kind = text.split(":")[0].split(",")[0]
    if kind in BOARD_KINDS:
        raise CalibrationError(f"The board {text!r} needs its columns and rows, and the side of a square: {EXAMPLE!r}.")
    raise CalibrationError(
        f"{text!r} describes no board. {suggestion(kind, BOARD_KINDS)} Give it as {EXAMPLE!r}, or name a TOML file."
    )


def find_board_spec(folders: Iterable[Path], above: Iterable[Path] = ()) -> Path | None:
    """Return the first TOML file that describes a board, or None.

    Args:
        folders: folders whose TOML files are all read.
        above: folders of a project, where only files with the names of known settings are read.
    """
    files = [file for folder in folders for file in sorted(folder.glob("*.toml"))]
    files += [folder / name for folder in above for name in _PROJECT_FILES if (folder / name).is_file()]
    for file in files:
        with contextlib.suppress(PosefuseError):
            _from_file(file)
            return file
    return None


def _from_text(text: str) -> Board:
    """Return the board of a description in text."""
    kind, _, rest = text.partition(":")
    size, *words = [word.strip() for word in rest.split(",")]
    match = _SIZE.fullmatch(size)
    if match is None:
        raise CalibrationError(f"The board {text!r} needs a size such as 7x5 after the colon, got {size!r}.")
    given: dict[str, Any] = {}
    for word in words:
        name, _, value = word.partition("=")
        if name not in _WORDS:
            raise CalibrationError(f"A board has no property {name!r}. {suggestion(name, _WORDS)}")
        given[name] = value if value else True
    if "square" not in given:
        raise CalibrationError(f"The board {text!r} needs the side of a square or marker, such as square=30mm.")
    return Board(
        kind,  # type: ignore[arg-type]
        int(match[1]),
        int(match[2]),
        _length_m("square", given["square"]),
        marker=_share("marker", given.get("marker", 0.75)),
        gap=_share("gap", given.get("gap", 0.2)),
        dictionary=str(given.get("dict", "")),
        inverted="inverted" in given,
        legacy="legacy" in given,
    )


def _length_m(name: str, value: object) -> float:
    """Return a length with its unit in meters."""
    match = _LENGTH.fullmatch(str(value).strip())
    if match is None:
        raise CalibrationError(
            f"{name} of a board must be a positive length with its unit, such as 54mm, got {value!r}."
        )
    return float(match[1]) * _UNITS_M[match[2]]


def _share(name: str, value: object) -> float:
    """Return a share."""
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise CalibrationError(f"{name} of a board must be a share such as 0.75, got {value!r}.") from None


def _from_file(path: Path) -> Board:
    """Return the board of a file."""
    must_exist(path, "description of a board")
    if path.is_dir():
        raise FileError(f"{path} is a folder. Describe the board as {EXAMPLE!r}, or name its TOML file.")
    with reading(path, "description of a board"):
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        for matches, read in _READERS:
            if matches(content):
                return read(content)
    raise FileError(
        f"{path} describes no board. Supported are the table [board] with {choices(f.name for f in fields(Board))}, "
        "Caliscope's charuco.toml, Anipose's config.toml, Pose2Sim's Config.toml, FreeMoCap's calibration and "
        "sleap-anipose's board.toml."
    )


def _from_posefuse(content: Mapping[str, Any]) -> Board:
    given = dict(content["board"])
    names = [field.name for field in fields(Board)]
    unknown = [name for name in given if name not in names]
    if unknown:
        raise CalibrationError(f"A board has no attribute {unknown[0]!r}. {suggestion(unknown[0], names)}")
    return Board(**given)


def _from_caliscope(content: Mapping[str, Any]) -> Board:
    override = content.get("square_size_override_cm") or content.get("square_size_overide_cm")
    if override:
        square_m = float(override) / 100.0
    else:
        unit = _UNITS_M[content.get("units", "cm")]
        square_m = min(content["board_width"] / content["columns"], content["board_height"] / content["rows"]) * unit
    return Board(
        "charuco",
        int(content["columns"]),
        int(content["rows"]),
        square_m,
        marker=float(content.get("aruco_scale", 0.75)),
        dictionary=content["dictionary"],
        inverted=bool(content.get("inverted", False)),
        legacy=bool(content.get("legacy_pattern", False)),
    )


def _from_anipose(content: Mapping[str, Any]) -> Board:
    table = content["calibration"]
    kind, (columns, rows) = str(table["board_type"]), table["board_size"]
    square_m = float(table["board_square_side_length"]) / 1000.0
    marker_m = float(table.get("board_marker_length", 0.75 * square_m * 1000.0)) / 1000.0
    bits, size = table.get("board_marker_bits", 4), table.get("board_marker_dict_number", 50)
    if kind == "checkerboard":
        return Board("checkerboard", int(columns), int(rows), square_m)
    if kind == "aruco":
        gap = float(table.get("board_marker_separation_length", 0.2 * marker_m * 1000.0)) / 1000.0 / marker_m
        return Board("aruco", int(columns), int(rows), marker_m, gap=gap, dictionary=f"{bits}X{bits}_{size}")
    return Board(
        "charuco",
        int(columns),
        int(rows),
        square_m,
        marker_m / square_m,
        dictionary=f"{bits}X{bits}_{size}",
        legacy=True,
    )


def _from_pose2sim(content: Mapping[str, Any]) -> Board:
    table = _pose2sim_table(content)
    rows, columns = table["intrinsics_corners_nb"]
    return Board("checkerboard", int(columns), int(rows), float(table["intrinsics_square_size"]) / 1000.0)


def _pose2sim_table(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return Pose2Sim's settings of intrinsics; empty in other files."""
    table: Any = content
    for name in ("calibration", "calculate", "intrinsics"):
        table = table.get(name) if isinstance(table, dict) else None
    return table if isinstance(table, dict) else {}


def _freemocap_table(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the board in FreeMoCap's calibration; empty in other files."""
    metadata = content.get("metadata")
    board = metadata.get("board") if isinstance(metadata, dict) else None
    return board if isinstance(board, dict) else {}


def _from_freemocap(content: Mapping[str, Any]) -> Board:
    table = _freemocap_table(content)
    square_mm = float(table["square_length_mm"])
    return Board(
        "charuco",
        int(table["squares_x"]),
        int(table["squares_y"]),
        square_mm / 1000.0,
        float(table["marker_length_mm"]) / square_mm,
        # OpenCV's numbers of dictionaries are in the order of their names.
        dictionary=(*ARUCO_DICTIONARIES, *APRILTAG_DICTIONARIES)[int(table["aruco_dictionary_enum"])],
    )


def _from_sleap_anipose(content: Mapping[str, Any]) -> Board:
    columns, rows, square = int(content["board_x"]), int(content["board_y"]), float(content["square_length"])
    if "marker_length" not in content:
        return Board("checkerboard", columns, rows, square / 1000.0)
    bits, size = content.get("marker_bits", 4), content.get("dict_size", 50)
    return Board(
        "charuco",
        columns,
        rows,
        square / 1000.0,
        float(content["marker_length"]) / square,
        dictionary=f"{bits}X{bits}_{size}",
        legacy=True,
    )


_READERS = (
    (lambda content: isinstance(content.get("board"), dict), _from_posefuse),
    (lambda content: {"columns", "rows", "dictionary"} <= content.keys(), _from_caliscope),
    (lambda content: isinstance(content.get("charuco"), dict), lambda content: _from_caliscope(content["charuco"])),
    (lambda content: "board_type" in content.get("calibration", {}), _from_anipose),
    (lambda content: "intrinsics_corners_nb" in _pose2sim_table(content), _from_pose2sim),
    (lambda content: "squares_x" in _freemocap_table(content), _from_freemocap),
    (lambda content: {"board_x", "board_y", "square_length"} <= content.keys(), _from_sleap_anipose),
)
