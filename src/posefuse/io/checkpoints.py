"""Store finished parts of a long reconstruction in a folder, so that the same command can resume.

``manifest.json`` holds a digest of everything the parts depend on: contents of the inputs, options and versions. Every
other file is one part, written to a temporary file and renamed when it is complete. A part starts with a line of JSON:
the digest of the manifest, the part's own digest, and its sizes. Parts of other inputs, of another layout, or damaged
ones are not used. Spools (``*.spool``) are append-only files; each part records their length when it was saved. A
finished result (``whole.file``), with a part that holds its digest, finally replaces all other parts.
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
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, Self

from posefuse.arguments import checked
from posefuse.errors import FileError
from posefuse.io.part_content import Packed, compressed, copied, loaded, packed, unpacked

_MANIFEST = "manifest.json"
_LAYOUT = 6
_WHOLE = "whole"


def digest_of(values: Mapping[str, Any]) -> str:
    """Return a digest of what parts depend on, given as JSON values."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


@contextlib.contextmanager
def _explain_write_errors(path: Path) -> Iterator[None]:
    """Turn an operating system error into a sentence.

    Raises:
        FileError: if writing fails.
    """
    try:
        yield
    except OSError as error:
        raise FileError(
            f"{path} cannot be written: {error.strerror or error}. Finished parts of long recordings are stored "
            "there until the result is complete, and are kept. Free some space and run the command again to resume."
        ) from None


@checked
class CheckpointFolder:
    """Stores parts in a folder; implements :class:`posefuse.checkpoint.Checkpoint`.

    The folder is created with the first part.

    Args:
        folder: folder that holds parts only.
        key: digest of what the parts depend on, from :func:`digest_of`.
    """

    enabled = True

    def __init__(self, folder: Path, key: str) -> None:
        self.folder, self.key = folder, key

    @classmethod
    def opened(cls, folder: Path, key: str) -> tuple[Self, int]:
        """Open a folder, and remove parts of another key.

        Returns:
            The checkpoint, and the number of parts removed.

        Raises:
            FileError: if the folder holds other files, or is a file.
        """
        others = 0
        if folder.is_dir() and any(folder.iterdir()):
            if key_in(folder) != key:
                others = sum(1 for file in folder.rglob("*") if file.suffix == ".part")
                remove_parts(folder)
        elif folder.exists() and not folder.is_dir():
            raise FileError(f"{folder} is a file, but finished parts need a folder of this name. Move the file away.")
        return cls(folder, key), others

    def contains(self, name: str) -> bool:
        """Return whether a part of this name is stored."""
        return self._path(name).is_file()

    def load(self, name: str) -> Any:
        """Return the part of this name; None if it is absent, damaged or of another key.

        Spools of the part are truncated to their length when it was saved.

        Raises:
            FileError: if it holds objects that parts never hold.
        """
        try:
            with self._path(name).open("rb") as file:
                head, content = Packed.read(file)
            if head["key"] != self.key:
                return None
        except (OSError, ValueError, KeyError, TypeError):
            return None
        for spool, size in head["spools"].items():
            if not self._spool_path(spool).is_file() or self._spool_path(spool).stat().st_size < size:
                # The spool may grow beyond this size again, with other values.
                self._path(name).unlink(missing_ok=True)
                return None
            os.truncate(self._spool_path(spool), size)
        try:
            return content.unpacked()
        except pickle.UnpicklingError as error:
            raise FileError(f"{self._path(name)}: {error}. Its origin is unknown; remove {self.folder}.") from None

    def save(self, name: str, value: Any) -> Any:
        """Store a part, replacing one of the same name, and return it as :meth:`load` would.

        What is returned shares the memory of the value's arrays.
        """
        content, kept = compressed(value)
        self._store(name, content)
        return kept

    def begin_save(self, name: str, value: Any, thread: Executor) -> tuple[Any, Callable[[], None]]:
        """Store a part in a thread; return it as :meth:`load` would, and a function that waits until it is stored.

        Until then, only the thread may append to the part's spools, after the part is stored.
        """
        content, kept = copied(value)
        return kept, thread.submit(lambda: self._store(name, Packed.of(content))).result

    def discard(self, name: str) -> None:
        """Remove the part of this name, if it is stored."""
        self._path(name).unlink(missing_ok=True)

    def _store(self, name: str, content: Packed) -> None:
        spools = {each: size for each, size in self._spool_sizes().items() if each.startswith(f"{name}.")}
        self.begin()
        with _explain_write_errors(self.folder):
            for each in spools:
                with self._spool_path(each).open("rb+") as file:
                    os.fsync(file.fileno())
            self._write(name, {"key": self.key, "spools": spools}, content)

    def _write(self, name: str, head: Mapping[str, Any], content: Packed) -> None:
        # Another process, possibly on another machine, may write the same part.
        number, made = tempfile.mkstemp(".partial", f"{name}.", self.folder)
        temporary = Path(made)
        try:
            with os.fdopen(number, "wb") as file:
                content.write(file, head)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, self._path(name))
        finally:
            temporary.unlink(missing_ok=True)

    def spool(self, name: str) -> "FileSpool":
        """Open the spool of a name; it belongs to the part named before the first dot."""
        self.begin()
        return FileSpool(self._spool_path(name))

    def child(self, name: str) -> "CheckpointFolder":
        """Return a checkpoint in a subfolder."""
        return CheckpointFolder(self.folder / name, self.key)

    def begin(self) -> None:
        """Create the folder and its manifest if they do not exist."""
        if (self.folder / _MANIFEST).exists():
            return
        with _explain_write_errors(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            temporary = self.folder / f"{_MANIFEST}.partial"
            temporary.write_text(json.dumps({"layout": _LAYOUT, "key": self.key}) + "\n", "utf-8")
            os.replace(temporary, self.folder / _MANIFEST)

    def save_file(self, file: Path, warnings: tuple[str, ...] = ()) -> None:
        """Store a finished file as a hard link in place of all parts, with the warnings given while it was made.

        Where the file system has no hard links, the parts are kept instead.
        """
        self.begin()
        kept = self._file_path()
        kept.unlink(missing_ok=True)
        try:
            os.link(file, kept)
        except OSError:
            return
        with _explain_write_errors(kept), kept.open("rb+") as opened:
            os.fsync(opened.fileno())
            self.save(_WHOLE, (hashlib.file_digest(opened, "sha256").hexdigest(), warnings))
        _remove_except(self.folder, (kept, self._path(_WHOLE), self.folder / _MANIFEST))

    def load_file(self, target: Path) -> tuple[str, ...] | None:
        """Restore the stored file at a path.

        Returns:
            The warnings given while it was made; None if no intact file is stored.
        """
        stored, kept = self.load(_WHOLE), self._file_path()
        if stored is None or not kept.is_file():
            return None
        digest, warnings = stored
        with kept.open("rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != digest:
                return None
        try:
            os.link(kept, target)
        except OSError:
            shutil.copyfile(kept, target)
        return warnings

    def remove(self) -> None:
        """Remove the folder."""
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
    """Remove a folder of parts, the manifest last, so that an interrupted removal leaves a recognizable folder."""
    _remove_except(folder, (folder / _MANIFEST,))
    shutil.rmtree(folder, ignore_errors=True)


def _remove_except(folder: Path, kept: tuple[Path, ...]) -> None:
    for entry in folder.iterdir() if folder.is_dir() else ():
        if entry.is_dir():
            shutil.rmtree(entry, ignore_errors=True)
        elif entry not in kept:
            with contextlib.suppress(OSError):
                entry.unlink()


def key_in(folder: Path) -> str:
    """Return the key of the parts in a folder; empty if it cannot be read.

    Raises:
        FileError: if the folder has other files and no manifest.
    """
    manifest = _manifest_in(folder)
    if manifest is None and any(file.is_file() and file.suffix != ".partial" for file in folder.rglob("*")):
        raise FileError(f"{folder} contains files that are not parts of a reconstruction. Move it away.")
    try:
        content = json.loads(manifest.read_text("utf-8")) if manifest is not None else {}
    except (OSError, ValueError):
        return ""
    return str(content.get("key")) if content.get("layout") == _LAYOUT else ""


def holds_parts(folder: Path) -> bool:
    """Return whether a folder has a manifest, which is written before the first part."""
    return _manifest_in(folder) is not None


def _manifest_in(folder: Path) -> Path | None:
    return next((file for file in (folder / _MANIFEST, *folder.glob(f"*/{_MANIFEST}")) if file.is_file()), None)


class FileSpool:
    """Appends values to a file; implements :class:`posefuse.checkpoint.Spool`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        path.touch()

    def add(self, value: Any) -> int:
        """Append a value and return its position."""
        content = pickle.dumps(value, protocol=5)
        small = packed(memoryview(content))
        with _explain_write_errors(self._path), self._path.open("ab") as file:
            place = file.tell()
            sizes = _SIZES.pack(len(small), len(content))
            file.write(sizes + zlib.crc32(small, zlib.crc32(sizes)).to_bytes(4, "little") + small)
        return place

    def read(self, place: int) -> Any:
        """Return the value at a position.

        Raises:
            FileError: if the file is damaged there.
        """
        with self._path.open("rb") as file:
            file.seek(place)
            sizes, check = file.read(_SIZES.size), file.read(4)
            length, size = _SIZES.unpack(sizes) if check else (0, 0)
            small = file.read(min(length, self._path.stat().st_size))
        if not check or zlib.crc32(small, zlib.crc32(sizes)).to_bytes(4, "little") != check:
            folder = self._path.parent
            raise FileError(f"{self._path} is damaged at byte {place}. Remove {folder} and start again.")
        return loaded(bytes(unpacked(small, size)))


_SIZES = struct.Struct("<QQ")
"""Header of a value in a spool: its packed and unpacked sizes. A checksum and the value follow."""
