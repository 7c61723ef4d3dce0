"""What cameras and views are called, in files that spell it differently."""

import re


def plain_name(name: str) -> str:
    """A camera or view name without case, punctuation and the endings that keypoint folders add."""
    plain = "".join(character for character in name.lower() if character.isalnum())
    for ending in ("keypoints", "json", "keypoints"):
        plain = plain.removesuffix(ending)
    return plain


def has_name(view: str, camera: str) -> bool:
    """Whether a camera's name is one of the words of a view's name, with or without ``cam`` before it."""
    plain = plain_name(camera)
    words = {word for word in re.split(r"[^a-z0-9]+", view.lower()) if word}
    return plain in words or f"cam{plain}" in words
