"""What the subjects of a skeleton are called in messages and reports."""

import re

from posefuse.skeleton.skeletons import Skeleton

_ANIMAL_PARTS = ("tail", "paw", "hoof", "claw", "haunch", "snout", "beak", "wing", "antenna", "fetlock")
"""Beginnings of words in the names of keypoints that only animals have."""
_HUMAN = "left_hip"


def subject_words(skeleton: Skeleton) -> tuple[str, str]:
    """Return the words for one subject and for several: person and people, animal and animals, subject and subjects.

    Keypoints named like parts of animals make an animal; other skeletons without human hips may be objects.
    """
    names = [name.lower() for name in skeleton.keypoints]
    words = [word for name in names for word in re.split(r"[^a-z]+", name)]
    if any(word.startswith(_ANIMAL_PARTS) for word in words):
        return "animal", "animals"
    return ("person", "people") if _HUMAN in names else ("subject", "subjects")


def count_subjects(n: int, skeleton: Skeleton) -> str:
    """Return a number of subjects, such as ``2 animals``."""
    one, several = subject_words(skeleton)
    return f"{n} {one if n == 1 else several}"


def subject_heading(skeleton: Skeleton) -> str:
    """Return the word for one subject as the heading of a column."""
    return subject_words(skeleton)[0].capitalize()
