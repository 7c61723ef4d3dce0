"""Write a calibration: in a format, or in the one that another is in."""

from pathlib import Path

from posefuse.errors import FileError, choices
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.read import find_format
from posefuse.io.calibration.registry import CALIBRATIONS
from posefuse.model.cameras import CameraRig

_USUAL = "anipose"


def write_as(form: CalibrationFormat, rig: CameraRig, path: Path) -> None:
    """Write a rig in a format.

    Raises:
        FileError: if the file would not be known by its name, or the format cannot hold the rig.
    """
    if form.write is None:
        raise FileError(f"Calibrations are not written in {form.name}'s format.")
    endings = form.file_endings
    if not path.name.endswith(endings):
        raise FileError(f"{path}: names of {form.name}'s files end in {choices(endings)}; name it so.")
    form.write(rig, path)


def must_be_named(path: Path, original: Path) -> None:
    """Refuse a name by which a file of :func:`write_like` would not be known.

    Raises:
        FileError: if it ends neither as Anipose's files do, nor as those of the original's format, if that is written.
    """
    endings = [ending for form in _formats(original) for ending in form.file_endings]
    if not path.name.endswith(tuple(endings)):
        raise FileError(f"{path}: end the name of the calibration to write in {choices(dict.fromkeys(endings))}.")


def _formats(original: Path) -> list[CalibrationFormat]:
    """The original's format, if it is written, and Anipose's."""
    form, usual = find_format(original), CALIBRATIONS.find(_USUAL)
    assert usual is not None
    return [usual] if form is None or not form.writes or form.name == _USUAL else [form, usual]


def write_like(rig: CameraRig, path: Path, original: Path) -> str:
    """Write a rig in the format that it was read from, or in Anipose's where that one is not written or cannot hold it.

    Args:
        rig: the cameras, in metres.
        path: the file to write; its name's ending chooses where the original's format has another than Anipose's.
        original: the calibration that it was read from.

    Returns:
        In which format, in words, and if it is another one why.

    Raises:
        FileError: if the name fits neither, or a lens does not fit Anipose's format either.
    """
    must_be_named(path, original)
    *own, usual = _formats(original)
    why = ""
    for form in own:
        try:
            write_as(form, rig, path)
        except FileError as error:
            why = f": {error}"
        else:
            return f"in {form.name}'s format, as {original.name} is"
    found = find_format(original)
    if not own and found is not None and found.name != _USUAL:
        why = f": {found.name}'s is not written"
    try:
        write_as(usual, rig, path)
    except FileError as error:
        raise FileError(f"{error} {why.removeprefix(': ')}".strip()) from None
    return f"in {_USUAL}'s format{why}"
