"""Safe file names from the names of people and keypoints."""

import unicodedata
from collections.abc import Sequence

from posefuse.io.files import DEVICE_NAMES, FORBIDDEN_CHARACTERS

_LONGEST_BYTES = 100


def safe_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return a file name for each name that is valid on every file system and stays in its folder.

    The file names differ even if case and the encoding of accents are ignored. Safe names are unchanged unless an
    earlier name already uses them.
    """
    used: set[str] = set()
    file_names = []
    for name in names:
        stem = _safe(name)
        candidate, number = stem, 1
        while _canonical(candidate) in used:
            number += 1
            candidate = f"{stem}_{number}"
        used.add(_canonical(candidate))
        file_names.append(candidate)
    return tuple(file_names)


def _safe(name: str) -> str:
    clean = FORBIDDEN_CHARACTERS.sub("_", name).strip(" .")
    clean = clean.encode("utf-8", "replace")[:_LONGEST_BYTES].decode("utf-8", "ignore").strip(" .")
    return f"_{clean}" if not clean or DEVICE_NAMES.fullmatch(clean) else clean


def _canonical(name: str) -> str:
    """Return a form of a name that is equal for names that some file system cannot distinguish."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())
