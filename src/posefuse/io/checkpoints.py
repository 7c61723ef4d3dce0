"""Finished parts of a long reconstruction in a folder, from which the same command goes on after it was ended.

``manifest.json`` says what the parts are of: a digest of all that they depend on, contents of the input, options
and versions. Every other file is one part, written beside and moved to its place when it is whole, which begins with a
line of JSON: that digest, the part's own, and its size. Of other input, of another layout, or damaged, it is not used.
Spools (``*.spool``) are files at whose end values are added; a part that is kept says how long they were then.
In the end one file (``whole.file``), with a part that says its digest, takes the place of them all.
"""

import contextlib
import hashlib
import json
import os
import pickle
import shutil
import struct
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, Self

from posefuse.errors import FileError

_MANIFEST = "manifest.json"
_LAYOUT = 2
_WHOLE = "whole"
_OURS = (
    "posefuse.model.",
    "posefuse.skeleton.",
    "posefuse.kinematics.",
    "posefuse.tracking.",
    "posefuse.pipeline.people.",
    "posefuse.kernels.",
)
_FOREIGN = {
    ("array", "array"),
    ("array", "_array_reconstructor"),
    ("collections", "OrderedDict"),
    ("functools", "partial"),
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy._core.numeric", "_frombuffer"),
}
_FUNCTIONS = {("posefuse.pipeline.people.initial_noise", "propose_people")}


def digest_of(told: Mapping[str, Any]) -> str:
    """A digest of what parts depend on; values are those of JSON."""
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


@contextlib.contextmanager
def _keeping(path: Path) -> Iterator[None]:
    """Say in a sentence why something cannot be kept."""
    try:
        yield
    except OSError as error:
        raise FileError(
            f"{path} cannot be written: {error.strerror or error}. Finished parts of long recordings are kept there "
            "until the result is complete. Free disk space and run the same command again; finished parts are reused."
        ) from None


class CheckpointFolder:
    """Keeps parts in a folder, which is made with the first of them; see :class:`posefuse.checkpoint.Checkpoint`.

    Args:
        folder: of parts alone.
        key: what they depend on, from :func:`digest_of`.
    """

    enabled = True

    def __init__(self, folder: Path, key: str) -> None:
        self.folder, self.key = folder, key

    @classmethod
    def opened(cls, folder: Path, key: str) -> tuple[Self, int]:
        """The parts in a folder, and how many others were in it, of other input or options: those are removed.

        Raises:
            FileError: if the folder is no such folder.
        """
        others = 0
        if folder.is_dir() and any(folder.iterdir()):
            if _key_in(folder) != key:
                others = sum(1 for file in folder.rglob("*") if file.suffix == ".part")
                remove_parts(folder)
        elif folder.exists() and not folder.is_dir():
            raise FileError(f"{folder} is a file, and finished parts go into a folder of that name. Move it away.")
        return cls(folder, key), others

    def contains(self, name: str) -> bool:
        """Whether a part of that name was kept."""
        return self._path(name).is_file()

    def load(self, name: str) -> Any:
        """The part of that name; None where there is none that is whole and of the same work.

        Raises:
            FileError: if it holds what no part does.
        """
        try:
            with self._path(name).open("rb") as file:
                head, packed = json.loads(file.readline()), file.read()
            if head["key"] != self.key or head["sha256"] != _digest(head, packed):
                return None
        except (OSError, ValueError, KeyError, TypeError):
            return None
        for spool, size in head["spools"].items():
            if not self._spool_path(spool).is_file() or self._spool_path(spool).stat().st_size < size:
                return None
            os.truncate(self._spool_path(spool), size)
        try:
            return _loaded(_unpacked(packed, head["size"]))
        except pickle.UnpicklingError as error:
            raise FileError(f"{self._path(name)}: {error}. Where is it from? Remove {self.folder}.") from None

    def save(self, name: str, value: Any) -> Any:
        """Keep a part, in place of one of that name; the part as :meth:`load` gives it."""
        content = pickle.dumps(value, protocol=5)
        packed = _packed(content)
        spools = {each: size for each, size in self._spool_sizes().items() if each.startswith(f"{name}.")}
        head = {"key": self.key, "size": len(content), "spools": spools}
        self.begin()
        with _keeping(self.folder):
            for each in spools:
                with self._spool_path(each).open("rb+") as file:
                    os.fsync(file.fileno())
            self._write(name, {**head, "sha256": _digest(head, packed)}, packed)
        return _loaded(content)

    def _write(self, name: str, head: Mapping[str, Any], packed: bytes) -> None:
        # Another process, possibly on another machine, may write the same part.
        number, made = tempfile.mkstemp(".partial", f"{name}.", self.folder)
        temporary = Path(made)
        try:
            with os.fdopen(number, "wb") as file:
                file.write(json.dumps(head, sort_keys=True).encode() + b"\n")
                file.write(packed)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, self._path(name))
        finally:
            temporary.unlink(missing_ok=True)

    def spool(self, name: str) -> "FileSpool":
        """A file at whose end values are added, of the part whose name is that before the first dot."""
        self.begin()
        return FileSpool(self._spool_path(name))

    def child(self, name: str) -> "CheckpointFolder":
        """Parts in a folder of their own."""
        return CheckpointFolder(self.folder / name, self.key)

    def begin(self) -> None:
        """Make the folder, which says what it is of, if it is not there."""
        if (self.folder / _MANIFEST).exists():
            return
        with _keeping(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            temporary = self.folder / f"{_MANIFEST}.partial"
            temporary.write_text(json.dumps({"layout": _LAYOUT, "key": self.key}) + "\n", "utf-8")
            os.replace(temporary, self.folder / _MANIFEST)

    def save_file(self, file: Path, said: tuple[str, ...] = ()) -> None:
        """Keep a finished file instead of all parts, which takes no room, and what was said while it was made.

        Where a file cannot have a second name, the parts stay.
        """
        self.begin()
        kept = self._file_path()
        kept.unlink(missing_ok=True)
        try:
            os.link(file, kept)
        except OSError:
            return
        with _keeping(kept), kept.open("rb+") as opened:
            os.fsync(opened.fileno())
            self.save(_WHOLE, (hashlib.file_digest(opened, "sha256").hexdigest(), said))
        _remove_but(self.folder, (kept, self._path(_WHOLE), self.folder / _MANIFEST))

    def load_file(self, target: Path) -> tuple[str, ...] | None:
        """Put the file that is kept at a place; what was said while it was made, None if none is there and whole."""
        known, kept = self.load(_WHOLE), self._file_path()
        if known is None or not kept.is_file():
            return None
        digest, said = known
        with kept.open("rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != digest:
                return None
        try:
            os.link(kept, target)
        except OSError:
            shutil.copyfile(kept, target)
        return said

    def remove(self) -> None:
        """Remove all parts."""
        remove_parts(self.folder)

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.part"

    def _file_path(self) -> Path:
        return self.folder / f"{_WHOLE}.file"

    def _spool_path(self, name: str) -> Path:
        return self.folder / f"{name}.spool"

    def _spool_sizes(self) -> dict[str, int]:
        return {file.stem: file.stat().st_size for file in sorted(self.folder.glob("*.spool"))}


def remove_parts(folder: Path) -> None:
    """Remove a folder of parts; the manifest goes last, so that an interrupted removal can be recognized."""
    _remove_but(folder, (folder / _MANIFEST,))
    shutil.rmtree(folder, ignore_errors=True)


def _remove_but(folder: Path, kept: tuple[Path, ...]) -> None:
    for entry in folder.iterdir() if folder.is_dir() else ():
        if entry.is_dir():
            shutil.rmtree(entry, ignore_errors=True)
        elif entry not in kept:
            with contextlib.suppress(OSError):
                entry.unlink()


def _key_in(folder: Path) -> str:
    """What the parts in a folder depend on.

    Raises:
        FileError: if it has other files, and no manifest.
    """
    manifest = next((file for file in (folder / _MANIFEST, *folder.glob(f"*/{_MANIFEST}")) if file.is_file()), None)
    if manifest is None and any(file.is_file() and file.suffix != ".partial" for file in folder.rglob("*")):
        raise FileError(f"{folder} holds files that are no parts of a reconstruction. Move it away.")
    try:
        told = json.loads(manifest.read_text("utf-8")) if manifest is not None else {}
    except (OSError, ValueError):
        return ""
    return str(told.get("key")) if told.get("layout") == _LAYOUT else ""


class FileSpool:
    """Values one after the other in a file; see :class:`posefuse.checkpoint.Spool`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        path.touch()

    def add(self, value: Any) -> int:
        """Take a value; where in the file it begins."""
        content = pickle.dumps(value, protocol=5)
        packed = _packed(content)
        with _keeping(self._path), self._path.open("ab") as file:
            place = file.tell()
            sizes = _SIZES.pack(len(packed), len(content))
            file.write(sizes + zlib.crc32(packed, zlib.crc32(sizes)).to_bytes(4, "little") + packed)
        return place

    def read(self, place: int) -> Any:
        """The value that begins there.

        Raises:
            FileError: if it is not what was written.
        """
        with self._path.open("rb") as file:
            file.seek(place)
            sizes, check = file.read(_SIZES.size), file.read(4)
            length, size = _SIZES.unpack(sizes) if check else (0, 0)
            packed = file.read(min(length, self._path.stat().st_size))
        if not check or zlib.crc32(packed, zlib.crc32(sizes)).to_bytes(4, "little") != check:
            folder = self._path.parent
            raise FileError(f"{self._path} is damaged at byte {place}. Remove {folder} and run the command again.")
        return _loaded(_unpacked(packed, size))


_SIZES = struct.Struct("<QQ")
"""Of a value in a spool: its bytes there, and those that it unfolds to; then comes a check sum, then the value."""


def _digest(head: Mapping[str, Any], packed: bytes) -> str:
    """Return the digest of a part and its header."""
    told = json.dumps([head["key"], head["size"], sorted(head["spools"].items())])
    return hashlib.sha256(told.encode() + packed).hexdigest()


def _packed(content: bytes) -> bytes:
    import pyarrow as pa

    return pa.Codec("zstd", compression_level=1).compress(content, asbytes=True)


def _unpacked(packed: bytes, size: int) -> bytes:
    import pyarrow as pa

    return pa.Codec("zstd").decompress(packed, decompressed_size=size, asbytes=True)


class _Unpickler(pickle.Unpickler):
    """Unpickle arrays and the data types of posefuse only; a folder of parts may come from an unknown source."""

    def find_class(self, module: str, name: str) -> Any:
        """A class that parts are made of.

        Raises:
            pickle.UnpicklingError: of any other.
        """
        if (module, name) in _FOREIGN:
            return super().find_class(module, name)
        if module.startswith(_OURS):
            found = super().find_class(module, name)
            if (module, name) in _FUNCTIONS or (isinstance(found, type) and found.__module__ == module):
                return found
        raise pickle.UnpicklingError(f"a part of a reconstruction has no {module}.{name}")


def _loaded(content: bytes) -> Any:
    return _Unpickler(BytesIO(content)).load()
