"""Names that files and their parts can have, made of names that people and keypoints have."""

import unicodedata
from collections.abc import Sequence

from posefuse.io.files import DEVICE_NAMES, FORBIDDEN_CHARACTERS

_LONGEST_BYTES = 100


def safe_names(names: Sequence[str]) -> tuple[str, ...]:
    """A name for each that is one on every file system and leads nowhere else.

    All are different, also to whoever ignores case or how accents are spelt.

    What is safe already stays as it is, unless somebody before has it.
    """
    taken: set[str] = set()
    found = []
    for name in names:
        stem = _safe(name)
        candidate, number = stem, 1
        while _told_apart(candidate) in taken:
            number += 1
            candidate = f"{stem}_{number}"
        taken.add(_told_apart(candidate))
        found.append(candidate)
    return tuple(found)


def _safe(name: str) -> str:
    clean = FORBIDDEN_CHARACTERS.sub("_", name).strip(" .")
    clean = clean.encode("utf-8", "replace")[:_LONGEST_BYTES].decode("utf-8", "ignore").strip(" .")
    return f"_{clean}" if not clean or DEVICE_NAMES.fullmatch(clean) else clean


def _told_apart(name: str) -> str:
    """What of a name every file system tells from others."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())
