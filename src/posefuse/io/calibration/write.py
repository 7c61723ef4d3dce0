"""Write a calibration in the format that another one is in."""

from pathlib import Path

from posefuse.errors import FileError
from posefuse.io.calibration import anipose
from posefuse.io.calibration.read import find_format
from posefuse.model.cameras import CameraRig


def write_like(rig: CameraRig, path: Path, original: Path) -> str:
    """Write a rig in the format that it was read from, or in Anipose's where that one is not written or cannot hold it.

    Args:
        rig: the cameras, in metres.
        path: the file to write.
        original: the calibration that it was read from.

    Returns:
        In which format, in words, and if it is another one why.

    Raises:
        FileError: if a lens does not fit Anipose's format either.
    """
    form = find_format(original)
    why = ""
    if form is not None and form.writes and form.name != "anipose":
        try:
            form.load().write(rig, path)
        except FileError as error:
            why = f": {error}"
        else:
            return f"in {form.name}'s format, as {original.name} is"
    elif form is not None and form.name != "anipose":
        why = f": {form.name}'s is not written"
    anipose.write(rig, path)
    return f"in anipose's format{why}"
