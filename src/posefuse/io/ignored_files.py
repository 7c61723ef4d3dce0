"""Files in a recording's folder that are not read, with the reason."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from posefuse.errors import PosefuseError
from posefuse.io import timestamps
from posefuse.io.files import natural_key
from posefuse.io.keypoints.read import find_format

_MEDIA = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".mp4", ".avi", ".mov", ".mkv", ".webm")
_THREE_D = (".trc", ".c3d", ".bvh", ".fbx", ".glb", ".blend", ".mot", ".osim")
_READ_SUFFIXES = (
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
_MEDIA_REASON = "images and videos; posefuse run detects people in videos"
_THREE_D_REASON = "3D results; 2D keypoints are read"
_SETTINGS_REASON = "settings: a frame rate and a pose model in them apply to keypoints below this folder"
_LENS_REASON = "intrinsics only: camera poses are missing"
_RESULT_REASON = "a posefuse result"
_OWN_REASON = "written by posefuse beside its results"
_OWN_FILES = (
    "calibration.html",
    "detection.json",
    "people.html",
    "posefuse.toml",
    "report.html",
    "run.json",
    "sync.toml",
)
_PICKLE_REASON = "pickle files can run code; only the numbers of OpenCap's calibrations and keypoints are read"
_NETWORK_REASON = "network weights; export the predictions instead"
_OTHER_REASON = "neither a calibration nor 2D keypoints"
_UNKNOWN_REASON = "no calibration or 2D keypoints in a known format"
_MAX_FILES = 20_000


@dataclass(frozen=True)
class Ignored:
    """Files that are not read for one reason.

    Attributes:
        reason: Why they are not read.
        names: Paths relative to the searched folder, in natural order.
    """

    reason: str
    names: tuple[str, ...]


def find_ignored(folder: Path, used: Iterable[Path], depth: int) -> tuple[Ignored, ...]:
    """Return the files of a folder that are not read, grouped by reason.

    Args:
        folder: Folder to search.
        used: Files and folders that are read.
        depth: Number of folder levels to search.
    """
    read = {path.resolve() for path in used}
    names: dict[str, list[str]] = {}
    for n, file in enumerate(_files(folder, read, depth)):
        if n == _MAX_FILES:
            break
        names.setdefault(_reason(file), []).append(file.relative_to(folder).as_posix())
    return tuple(Ignored(reason, tuple(sorted(each, key=natural_key))) for reason, each in names.items())


def _files(folder: Path, read: set[Path], depth: int) -> Iterator[Path]:
    try:
        entries = sorted(folder.iterdir(), key=lambda entry: natural_key(entry.name))
    except OSError:
        return
    if any(entry.name == "reconstruction.nc" for entry in entries):
        entries = [entry for entry in entries if entry.name == "reconstruction.nc"]
    for entry in entries:
        if entry.name.startswith(".") or entry.resolve() in read:
            continue
        if entry.is_dir():
            if depth > 0:
                yield from _files(entry, read, depth - 1)
        elif entry.is_file():
            yield entry


def _reason(file: Path) -> str:
    """Return why a file is not read."""
    suffix = file.suffix.lower()
    for suffixes, reason in (
        (_MEDIA, _MEDIA_REASON),
        (_THREE_D, _THREE_D_REASON),
        ((".pkl", ".pickle"), _PICKLE_REASON),
        ((".pt", ".pth", ".onnx"), _NETWORK_REASON),
    ):
        if suffix in suffixes:
            return reason
    if file.name == "reconstruction.nc":
        return _RESULT_REASON
    if file.name == "Config.toml":
        return _SETTINGS_REASON
    if suffix == ".csv" and _safely(timestamps.matches, file):
        return "timestamps that are not beside the keypoints; use `timestamps`"
    name = _format_name(file) if suffix in _READ_SUFFIXES else None
    if name is not None:
        return f"{name} keypoints beside or below other input; use `keypoints` or `calibration`"
    if file.name in _OWN_FILES:
        return _OWN_REASON
    beginning = _beginning(file) if suffix in _READ_SUFFIXES else b""
    return _content_reason(file, beginning) or (_UNKNOWN_REASON if suffix in _READ_SUFFIXES else _OTHER_REASON)


def _content_reason(file: Path, beginning: bytes) -> str | None:
    """Return why a file with a readable suffix is not read, judged by its first bytes and name, or None."""
    first_line = beginning.split(b"\n", 1)[0].lower()
    if file.suffix == ".csv" and b"focal_length" in first_line:
        return _LENS_REASON
    if b"z_coord" in first_line or (file.suffix == ".csv" and b"z_m" in first_line):
        return _THREE_D_REASON
    if b'"joints19"' in beginning or "3d" in file.stem.lower():
        return _THREE_D_REASON
    if file.suffix == ".npz" and any(name in beginning for name in (b"poses.npy", b"points3d.npy")):
        return _THREE_D_REASON
    if b"intri" in file.name.lower().encode() and file.suffix in (".xml", ".yml", ".yaml"):
        return _LENS_REASON
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


def _format_name(file: Path) -> str | None:
    """Return the format of keypoints that a file alone is in, or None. Plain arrays may hold anything."""
    try:
        form = find_format(file)
    except (PosefuseError, OSError):
        return None
    return None if form is None or form.name == "arrays" else form.name
