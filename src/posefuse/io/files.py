"""What every reader and writer needs of the file system."""

import contextlib
import os
import re
import shutil
import tomllib
import zipfile
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from posefuse.errors import FileError, PosefuseError, choices

_LARGE_BYTES = 256_000_000
_MOST_UNFOLDED = 200


def must_exist(path: Path, what: str) -> Path:
    """The path, if it exists.

    Raises:
        FileError: if not, naming what is in the nearest folder that does exist.
    """
    if path.exists() or (is_pattern(path) and files_at(path)):
        return path
    parent = next((folder for folder in path.parents if folder.is_dir()), Path())
    seen = sorted(entry.name for entry in parent.iterdir() if not entry.name.startswith("."))
    there = choices(seen) if seen else "nothing"
    raise FileError(f"No {what} at {path}. In {parent} there is: {there}.")


def read_text(path: Path) -> str:
    """The text of a file.

    Raises:
        FileError: if it cannot be read as UTF-8.
    """
    try:
        return path.read_text("utf-8")
    except UnicodeDecodeError as error:
        raise FileError(f"{path} is not a text file in UTF-8 (byte {error.start}).") from None
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}.") from None


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        FileError: if it is not TOML.
    """
    try:
        return tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise FileError(f"{path} is not TOML: {error}. Was it cut short?") from None


def parse_xml(path: Path, text: str) -> ElementTree.Element:
    """The root of an XML text. Entities are refused: a short text of them unfolds to any size.

    Raises:
        FileError: if it is not XML, or declares entities.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise FileError(f"{path} declares XML entities, which a calibration has no use for; it is not read.")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise FileError(f"{path} is not whole XML: {error}. Was it cut short?") from None


@contextlib.contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Say in a sentence that a file is broken, whatever its bytes lead a library to raise.

    Raises:
        FileError: if what is done within fails otherwise than by an error of ours.
    """
    try:
        yield
    except PosefuseError:
        raise
    except Exception as error:
        said = " ".join(str(error).split())[:160] or type(error).__name__
        raise FileError(f"{path} is not a whole {what}: {said}. Was it cut short?") from None


def must_unfold(path: Path, n_bytes: int) -> None:
    """Refuse what is small packed and enormous unpacked.

    Args:
        path: the packed file.
        n_bytes: of what is in it, unpacked.

    Raises:
        FileError: if it is a bomb: more than 256 MB, and two hundred times the file.
    """
    if n_bytes > most_unfolded(path):
        raise FileError(f"{path} ({path.stat().st_size} bytes) would unfold to {n_bytes} bytes; it is not read.")


def most_unfolded(path: Path) -> int:
    """How many bytes a packed file may unfold to: 256 MB, or two hundred times itself."""
    return max(_LARGE_BYTES, _MOST_UNFOLDED * path.stat().st_size)


def read_npz(path: Path, names: Collection[str]) -> dict[str, np.ndarray]:
    """The named arrays of an ``.npz``, those that are there; without any names all, with nothing in them.

    Raises:
        FileError: if it is cut short, unfolds to something enormous, or an array holds objects.
    """
    with reading(path, "NumPy array file"), zipfile.ZipFile(path) as packed:
        members = [member for member in packed.infolist() if member.filename.endswith(".npy")]
        held = {member.filename.removesuffix(".npy"): member for member in members}
        if not names:
            return {name: np.empty(0) for name in held}
        wanted = {name: member for name, member in held.items() if name in names}
        must_unfold(path, sum(member.file_size for member in wanted.values()))
        arrays = {}
        for name, member in wanted.items():
            with packed.open(member) as content:
                arrays[name] = np.lib.format.read_array(content, allow_pickle=False)
        return arrays


def read_npy(path: Path) -> np.ndarray:
    """The array of an ``.npy``.

    Raises:
        FileError: if it is cut short, or holds objects.
    """
    with reading(path, "NumPy array file"):
        array = np.load(path, allow_pickle=False)
        if not isinstance(array, np.ndarray):
            raise TypeError("it is an archive")
        return array


def files_at(path: Path) -> list[Path]:
    """The file; the files of a folder; or those that a pattern such as ``trial_*_dlc.csv`` in place of a name means."""
    if path.is_dir():
        found = list(path.iterdir())
    elif is_pattern(path):
        found = list(path.parent.glob(path.name))
    else:
        found = [path]
    return sorted((file for file in found if file.is_file()), key=lambda file: natural_key(file.name))


def is_pattern(path: Path) -> bool:
    """Whether a path stands for several files of a folder."""
    return "*" in path.name and path.parent.is_dir() and not path.exists()


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key that counts: ``cam_2`` before ``cam_10``."""
    return tuple((0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"(\d+)", name) if part)


_LONGEST_NAME = 200
REFUSED = re.compile(r'[\x00-\x1f\x7f/\\:*?"<>|\ud800-\udfff]')
"""Letters that some file system does not have in names."""
DEVICES = re.compile(r"(?i)(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[\d\xb9\xb2\xb3])\s*(\..*)?", re.DOTALL)
"""Names that are no files in Windows, whatever they end in."""


def file_name(name: str) -> str:
    """A name out of somebody's data, if a file or folder can be called so everywhere and stays where it is put.

    Raises:
        FileError: if not.
    """
    bad = not name or name != name.strip(" .") or REFUSED.search(name) or DEVICES.fullmatch(name)
    if bad or len(name.encode()) > _LONGEST_NAME:
        raise FileError(f"{name[:60]!r} cannot be the name of a file. Rename it in the recording.")
    return name


_NO_TEXT = re.compile(r"[\x00\ud800-\udfff]")


def must_be_texts(names: Iterable[str]) -> None:
    """Refuse names that hold a zero byte or half a letter: hardly a format can hold them.

    Raises:
        FileError: with the first that does.
    """
    for name in names:
        if _NO_TEXT.search(name):
            raise FileError(
                f"The name {name[:60]!r} holds a zero byte or half a letter, which files cannot hold. Rename it in the "
                "recording."
            )


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside ``path`` that takes its place when all went well, and goes when not."""
    temporary = path.with_name(f".{path.stem}.partial{path.suffix}")
    with _writable(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise FileError(f"{path} is a folder; give the name of a file.")
    try:
        with _writable(path):
            yield temporary
            os.replace(temporary, path)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def _writable(path: Path) -> Iterator[None]:
    """Say in a sentence why a path cannot be written."""
    try:
        yield
    except OSError as error:
        raise FileError(f"{path} cannot be written: {error.strerror or error}. Choose another place.") from None


@contextlib.contextmanager
def alone_in(held: Path, folder: Path) -> Iterator[None]:
    """Hold a folder while nobody else does; whoever is ended, however, holds nothing any more.

    The system's own lock of the folder: nothing stays behind. Where there is none (Windows, some network drives), none.

    Args:
        held: is locked.
        folder: what it is held for, as the user calls it.

    Raises:
        FileError: if another process has it.
    """
    try:
        import fcntl

        number = os.open(held, os.O_RDONLY)
    except FileNotFoundError:
        raise _busy(folder) from None
    except (ImportError, OSError):
        yield
        return
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise _busy(folder) from None
        except OSError:
            pass
        # Whoever held it may have removed it meanwhile, and somebody else have made it anew.
        if not _is_same(held, os.fstat(number)):
            raise _busy(folder)
        yield
    finally:
        os.close(number)


def _is_same(path: Path, known: os.stat_result) -> bool:
    try:
        return os.path.samestat(path.stat(), known)
    except FileNotFoundError:
        return False


def _busy(folder: Path) -> FileError:
    return FileError(
        f"--output {folder}: another posefuse is writing into it. Wait until it is done, end it, or choose another "
        "folder."
    )


RESULT_FILES = (
    "reconstruction.nc", "*.csv", "*.trc", "*.c3d", "*.bvh", "*.glb", "report.html", "evaluation.json", "debug/*.png",
    "points.parquet", "points*.npz", "points.nwb", "points3d.h5", "points_dlc.h5", "movement.nc",
    "freemocap*/output_data/*/*.npy", "freemocap*/output_data/*.*",
    "opensim/*.trc", "opensim/*.xml", "openpose/*_json/*_keypoints.json",
)  # fmt: skip


PARTS = ".parts"
"""The folder, in that of a result, of the finished parts of a long reconstruction; see :mod:`posefuse.io.checkpoints`."""


@contextlib.contextmanager
def replacing_folder(
    folder: Path,
    marker: str = RESULT_FILES[0],
    owned: tuple[str, ...] = RESULT_FILES,
    after: contextlib.ExitStack | None = None,
) -> Iterator[Path]:
    """A temporary folder whose files move into ``folder`` when all went well, and go when not.

    Files that an earlier run left in ``folder`` (``owned``) are removed then; other people's files stay.

    Args:
        folder: where the files go.
        marker: the file by which such a folder is known.
        owned: patterns of the files of such a folder.
        after: closed when the files are in their places, while nobody else can write there yet.

    Raises:
        FileError: if the folder holds files but is not such a result (it lacks ``marker``), is a file, or another
            process writes into it.
    """
    if folder.exists() and not folder.is_dir():
        raise FileError(f"--output {folder} is a file; give a folder.")
    others = sorted(entry.name for entry in folder.iterdir() if entry.name != PARTS) if folder.is_dir() else []
    # Parts are ours, and whoever was ended while files came to their places left those that had.
    ours = (folder / marker).exists() or (folder / PARTS).exists()
    if others and not ours:
        raise FileError(
            f"--output {folder} already holds other files ({choices(others, 5)}) "
            "and is no result of this command. Choose a new or an empty folder."
        )
    place = folder.resolve()
    staging = place.with_name(f".{place.name}.partial")
    with contextlib.ExitStack() as held:
        _remove_left(staging, folder)
        with _writable(folder):
            place.parent.mkdir(parents=True, exist_ok=True)
            try:
                staging.mkdir()
            except FileExistsError:
                raise _busy(folder) from None
        held.enter_context(alone_in(staging, folder))
        mine = staging.stat()

        @held.callback
        def leave() -> None:
            if _is_same(staging, mine):
                shutil.rmtree(staging, ignore_errors=True)

        yield staging
        # Where nothing can be locked, somebody else may have begun meanwhile.
        if not _is_same(staging, mine):
            raise _busy(folder)
        with _writable(folder):
            _move(staging, place, marker, owned)
        if after is not None:
            after.close()


def _remove_left(staging: Path, folder: Path) -> None:
    """Remove what somebody who was ended left."""
    if staging.is_dir():
        with alone_in(staging, folder), contextlib.suppress(OSError):
            shutil.rmtree(staging)


def _move(staging: Path, folder: Path, marker: str, owned: tuple[str, ...]) -> None:
    """Files to their places, that by which the folder is known first, in place of the old one."""
    folder.mkdir(exist_ok=True)
    first = [name for name in dict.fromkeys((marker, RESULT_FILES[0])) if (staging / name).is_file()]
    for name in first:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(staging / name, folder / name)
    for pattern in owned:
        for stale in folder.glob(pattern):
            if stale.relative_to(folder).as_posix() in first:
                continue
            stale.unlink()
            if stale.parent != folder and not any(stale.parent.iterdir()):
                stale.parent.rmdir()
    for entry in sorted(e for e in staging.rglob("*") if e.is_file()):
        target = folder / entry.relative_to(staging)
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(entry, target)
