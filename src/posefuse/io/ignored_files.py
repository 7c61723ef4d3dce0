"""What lies in a recording's folder and is not read, and why."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from posefuse.errors import PosefuseError
from posefuse.io import timestamps
from posefuse.io.files import natural_key
from posefuse.io.keypoints.read import find_format

_MEDIA = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".mp4", ".avi", ".mov", ".mkv", ".webm")
_THREE_D = (".trc", ".c3d", ".bvh", ".fbx", ".glb", ".blend", ".mot", ".osim")
_READ = (
    ".toml",
    ".yml",
    ".yaml",
    ".xml",
    ".xcp",
    ".json",
    ".csv",
    ".h5",
    ".npy",
    ".npz",
    ".mat",
    ".parquet",
    ".nc",
    ".slp",
)
_MEDIA_WHY = "images and videos; 2D keypoints are read, not found in images"
_THREE_D_WHY = "3D results; 2D keypoints are read"
_SETTINGS_WHY = "settings: its frame rate and pose model count for keypoints below it"
_LENS_WHY = "lenses only: nothing says where the cameras stand"
_RESULT_WHY = "a result of posefuse"
_PICKLE_WHY = "pickled: may run anything; only the numbers of OpenCap's calibrations and *_pp.pkl are read"
_NETWORK_WHY = "a network's own file; export its predictions"
_OTHER_WHY = "neither a calibration nor 2D keypoints"
_UNKNOWN_WHY = "no calibration or 2D keypoints in a known format"
_MOST = 20_000


@dataclass(frozen=True)
class Ignored:
    """Files that were not read for one reason.

    Attributes:
        why: in words.
        names: of the files, from the searched folder on, in order.
    """

    why: str
    names: tuple[str, ...]


def find_ignored(folder: Path, used: Iterable[Path], depth: int) -> tuple[Ignored, ...]:
    """The files of a folder that nobody reads, by reason.

    Args:
        folder: that was searched.
        used: files and folders that are read.
        depth: how deep to look.
    """
    taken = {path.resolve() for path in used}
    names: dict[str, list[str]] = {}
    for n, file in enumerate(_files(folder, taken, depth)):
        if n == _MOST:
            break
        names.setdefault(_why(file), []).append(file.relative_to(folder).as_posix())
    return tuple(Ignored(why, tuple(sorted(each, key=natural_key))) for why, each in names.items())


def _files(folder: Path, taken: set[Path], depth: int) -> Iterator[Path]:
    try:
        entries = sorted(folder.iterdir(), key=lambda entry: natural_key(entry.name))
    except OSError:
        return
    if any(entry.name == "reconstruction.nc" for entry in entries):
        entries = [entry for entry in entries if entry.name == "reconstruction.nc"]
    for entry in entries:
        if entry.name.startswith(".") or entry.resolve() in taken:
            continue
        if entry.is_dir():
            if depth > 0:
                yield from _files(entry, taken, depth - 1)
        elif entry.is_file():
            yield entry


def _why(file: Path) -> str:
    suffix = file.suffix.lower()
    for suffixes, why in (
        (_MEDIA, _MEDIA_WHY),
        (_THREE_D, _THREE_D_WHY),
        ((".pkl", ".pickle"), _PICKLE_WHY),
        ((".pt", ".pth", ".onnx"), _NETWORK_WHY),
    ):
        if suffix in suffixes:
            return why
    if file.name == "reconstruction.nc":
        return _RESULT_WHY
    if file.name == "Config.toml":
        return _SETTINGS_WHY
    if suffix == ".csv" and _safely(timestamps.matches, file):
        return "timestamps that are not beside the keypoints: --timestamps"
    form = _form(file) if suffix in _READ else None
    if form is not None:
        return f"{form} beside or below what is read already: --keypoints, --calibration"
    beginning = _beginning(file) if suffix in _READ else b""
    return _of_content(file, beginning) or (_UNKNOWN_WHY if suffix in _READ else _OTHER_WHY)


def _of_content(file: Path, beginning: bytes) -> str | None:
    """Why a file of a suffix that might be read is not, by what its first bytes say."""
    first_line = beginning.split(b"\n", 1)[0].lower()
    if file.suffix == ".csv" and b"focal_length" in first_line:
        return _LENS_WHY
    if b"z_coord" in first_line or (file.suffix == ".csv" and b"z_m" in first_line):
        return _THREE_D_WHY
    if b'"joints19"' in beginning or "3d" in file.stem.lower():
        return _THREE_D_WHY
    if file.suffix == ".npz" and any(name in beginning for name in (b"poses.npy", b"points3d.npy")):
        return _THREE_D_WHY
    if b"intri" in file.name.lower().encode() and file.suffix in (".xml", ".yml", ".yaml"):
        return _LENS_WHY
    return None


def _beginning(file: Path) -> bytes:
    try:
        with file.open("rb") as content:
            return content.read(65_536)
    except OSError:
        return b""


def _safely(matches: Callable[[Path], bool], file: Path) -> bool:
    try:
        return matches(file)
    except PosefuseError:
        return False


def _form(file: Path) -> str | None:
    """What the file would be if it were asked for by itself; arrays may be anything."""
    try:
        form = find_format(file)
    except (PosefuseError, OSError):
        return None
    return None if form is None or form.name == "arrays" else f"{form.name} keypoints"
