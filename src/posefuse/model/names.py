"""What cameras and views are called, in files that spell it differently."""


def plain_name(name: str) -> str:
    """A camera or view name without case, punctuation and the endings that keypoint folders add."""
    plain = "".join(character for character in name.lower() if character.isalnum())
    for ending in ("keypoints", "json", "keypoints"):
        plain = plain.removesuffix(ending)
    return plain
