"""Write calibrations, in a given format or in the format of another calibration."""

from pathlib import Path

from posefuse.arguments import checked
from posefuse.errors import FileError, choices
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.read import find_format
from posefuse.io.calibration.registry import CALIBRATIONS
from posefuse.model.cameras import CameraRig

_FALLBACK_FORMAT = "anipose"


def write_as(form: CalibrationFormat, rig: CameraRig, path: Path) -> None:
    """Write a rig in a format.

    Raises:
        FileError: if the ending of the name does not match the format, or the format cannot represent the rig.
    """
    if form.write is None:
        raise FileError(f"Calibrations cannot be written in the format {form.name}.")
    endings = form.file_endings
    if not path.name.endswith(endings):
        raise FileError(f"{path}: the name of a file in the format {form.name} must end in {choices(endings)}.")
    form.write(rig, path)


@checked
def write_cameras(rig: CameraRig, path: str | Path, form: str = "") -> None:
    """Write calibrated cameras to a file.

    Args:
        rig: the cameras, in meters.
        path: the file to write.
        form: name of the format, such as ``anipose``, ``pose2sim`` or ``qualisys``; by default the first one whose
            ending fits the name of the file.

    Raises:
        FileError: if there is no such format, the ending does not fit, or the format cannot represent the cameras.
    """
    path = Path(path)
    able = CALIBRATIONS.written()
    chosen = [each for each in able if (each.name == form if form else path.name.endswith(each.file_endings))]
    if not chosen:
        fitting = {each.name: choices(each.file_endings) for each in able}
        raise FileError(
            f"{path}: no format to write cameras {f'is named {form!r}' if form else 'has this ending'}. Formats: "
            + "; ".join(f"{name} ({endings})" for name, endings in fitting.items())
            + "."
        )
    write_as(chosen[0], rig, path)


def check_name(path: Path, original: Path) -> None:
    """Check that the ending of a name matches a format of :func:`write_like`.

    Raises:
        FileError: if it matches neither Anipose's format nor the original's format.
    """
    endings = [ending for form in _formats(original) for ending in form.file_endings]
    if not path.name.endswith(tuple(endings)):
        raise FileError(f"{path}: the name of the calibration must end in {choices(dict.fromkeys(endings))}.")


def _formats(original: Path) -> list[CalibrationFormat]:
    """Return the original's format, if it can be written, and Anipose's."""
    form, fallback = find_format(original), CALIBRATIONS.find(_FALLBACK_FORMAT)
    assert fallback is not None
    return [fallback] if form is None or not form.writes or form.name == _FALLBACK_FORMAT else [form, fallback]


def write_like(rig: CameraRig, path: Path, original: Path) -> str:
    """Write a rig in the format of the original, or in Anipose's if the former cannot be written or represent the rig.

    Args:
        rig: the cameras, in meters.
        path: the file to write; the ending selects the format if the endings of the two formats differ.
        original: the calibration that the rig was read from.

    Returns:
        The format in words, with the reason if it differs from the original's.

    Raises:
        FileError: if the ending matches neither format, or neither can represent the rig.
    """
    check_name(path, original)
    *own, fallback = _formats(original)
    reason = ""
    for form in own:
        try:
            write_as(form, rig, path)
        except FileError as error:
            reason = str(error).removesuffix(".")
        else:
            return f"in the format {form.name} of {original.name}"
    found = find_format(original)
    if not own and found is not None and found.name != _FALLBACK_FORMAT:
        reason = f"{found.name} cannot be written"
    try:
        write_as(fallback, rig, path)
    except FileError as error:
        raise FileError(f"{error} {reason}{'.' if reason else ''}".strip()) from None
    return f"in the format {_FALLBACK_FORMAT}" + (f" ({reason})" if reason else "")
