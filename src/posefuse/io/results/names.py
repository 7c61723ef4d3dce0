"""Names that files and their parts can have, made of names that people and keypoints have."""

import re
from collections.abc import Sequence

_REFUSED = re.compile(r'[\x00-\x1f\x7f/\\:*?"<>|]')
_DEVICES = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")
_LONGEST_BYTES = 100


def safe_names(names: Sequence[str]) -> tuple[str, ...]:
    """A name for each that is one on every file system and leads nowhere else; all different, also to who ignores case.

    What is safe already stays as it is, unless somebody before has it.
    """
    taken: set[str] = set()
    found = []
    for name in names:
        stem = _safe(name)
        candidate, number = stem, 1
        while candidate.casefold() in taken:
            number += 1
            candidate = f"{stem}_{number}"
        taken.add(candidate.casefold())
        found.append(candidate)
    return tuple(found)


def _safe(name: str) -> str:
    clean = _REFUSED.sub("_", name).strip(" .")
    clean = clean.encode("utf-8", "replace")[:_LONGEST_BYTES].decode("utf-8", "ignore").strip(" .")
    return f"_{clean}" if not clean or _DEVICES.fullmatch(clean) else clean
