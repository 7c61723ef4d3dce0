"""Matching of camera and view names with different spellings."""

import re
from collections.abc import Iterable


def plain_name(name: str) -> str:
    """Return a name in lower case, without punctuation and without the endings of keypoint folders."""
    plain = "".join(character for character in name.lower() if character.isalnum())
    for ending in ("keypoints", "json", "keypoints"):
        plain = plain.removesuffix(ending)
    return plain


def has_name(view: str, camera: str) -> bool:
    """Return whether a camera's name is a word of the view's name, with or without the prefix ``cam``."""
    plain = plain_name(camera)
    words = {word for word in re.split(r"[^a-z0-9]+", view.lower()) if word}
    return plain in words or f"cam{plain}" in words


def matching_name(view: str, names: Iterable[str]) -> str | None:
    """Return the name that means a view: the same, the same but for punctuation or ``cam``, or a word of it."""
    names = list(names)
    plain = plain_name(view)
    same = [name for name in names if name == view]
    near = [name for name in names if plain_name(name) == plain or f"cam{plain_name(name)}" == plain]
    found = same or near or [name for name in names if has_name(view, name)]
    return found[0] if len(found) == 1 else None
