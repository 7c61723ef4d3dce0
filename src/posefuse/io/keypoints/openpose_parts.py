"""Hands and faces of OpenPose files: separate lists, joined to the body as skeleton openpose_137.

``hand_left_keypoints_2d`` and ``hand_right_keypoints_2d`` have 21 keypoints each, ``face_keypoints_2d`` 70. The lists
are empty if the detection of hands or faces was off, and 0 0 0 for missing keypoints. With BODY_25 there are 137.
"""

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton

WHOLE = "openpose_137"
BODY = "body_25"


@dataclass(frozen=True)
class KeypointList:
    """A list of keypoints in addition to that of the body.

    Attributes:
        key: Key of the list in the files.
        name: Name for messages, plural.
        start: Index of its first keypoint in the skeleton.
        stop: Index after its last keypoint.
    """

    key: str
    name: str
    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


HAND_AND_FACE_LISTS = (
    KeypointList("hand_left_keypoints_2d", "left hands", 25, 46),
    KeypointList("hand_right_keypoints_2d", "right hands", 46, 67),
    KeypointList("face_keypoints_2d", "faces", 67, 137),
)
N_BODY, N_WHOLE = HAND_AND_FACE_LISTS[0].start, HAND_AND_FACE_LISTS[-1].stop


def has_parts(skeleton: Skeleton) -> bool:
    """Return whether a skeleton consists of OpenPose's body, hands and face in this order."""
    return len(skeleton) == N_WHOLE and skeleton.keypoints == shipped_skeleton(WHOLE).keypoints


def lists_of(skeleton: Skeleton, values: np.ndarray) -> dict[str, list[float]]:
    """Return the lists of a person in an OpenPose file: only the body, or body, hands and face.

    Args:
        skeleton: Skeleton of the keypoints.
        values: Shape (keypoint, 3): x, y, confidence, 0 0 0 where missing.
    """
    if not has_parts(skeleton):
        return {"pose_keypoints_2d": values.ravel().tolist()}
    parts = {part.key: values[part.start : part.stop].ravel().tolist() for part in HAND_AND_FACE_LISTS}
    return {"pose_keypoints_2d": values[:N_BODY].ravel().tolist(), **parts}


def describe_person(where: tuple[Path, str, int]) -> str:
    """Return the file and index of a person for a message. Called only on errors, as there may be millions."""
    folder, name, place = where
    return f"{folder / name}, person {place}"


@dataclass(frozen=True)
class PartRows:
    """Hands and faces of the people of one view, collected while reading.

    Attributes:
        numbers: For each of :data:`HAND_AND_FACE_LISTS`, x, y, confidence of the people who have the list.
        rows: For each of these lists, the rows of those people among the people of the view.
    """

    numbers: tuple["array[float]", ...] = field(default_factory=lambda: tuple(array("d") for _ in HAND_AND_FACE_LISTS))
    rows: tuple[list[int], ...] = field(default_factory=lambda: tuple([] for _ in HAND_AND_FACE_LISTS))

    def add(self, row: int, values: Sequence[Sequence[float]], where: tuple[Path, str, int]) -> None:
        """Add the hands and face of a person. Empty lists are skipped.

        Args:
            row: Row of the person among the people of the view.
            values: Numbers of each of :data:`HAND_AND_FACE_LISTS`.
            where: Folder, file, and index in the file.

        Raises:
            FileError: If a list has the wrong number of keypoints.
        """
        for i, (part, numbers) in enumerate(zip(HAND_AND_FACE_LISTS, values, strict=True)):
            if not numbers:
                continue
            if len(numbers) != 3 * len(part):
                raise FileError(
                    f"{describe_person(where)}: {part.key} has {len(numbers)} numbers; expected x, y, confidence for "
                    f"each of {len(part)} keypoints."
                )
            self.numbers[i].extend(numbers)
            self.rows[i].append(row)

    @property
    def any(self) -> bool:
        """Whether any person has a hand or face."""
        return any(self.rows)


def join_parts(body: np.ndarray, parts: PartRows) -> np.ndarray:
    """Return people with body, hands and face, shape (row, 137, 3), NaN where missing.

    Args:
        body: Shape (row, 25, 3).
        parts: Hands and faces of the same people.
    """
    whole = np.full((len(body), N_WHOLE, 3), np.nan)
    whole[:, :N_BODY] = body
    for part, numbers, rows in zip(HAND_AND_FACE_LISTS, parts.numbers, parts.rows, strict=True):
        whole[rows, part.start : part.stop] = np.array(numbers, dtype=np.float64).reshape(len(rows), len(part), 3)
    return whole


def missing_parts(views: Sequence[PartRows], n_people: int) -> tuple[str, ...]:
    """Return a note on hands and faces that only some or none of the people have."""
    available = []
    for i, part in enumerate(HAND_AND_FACE_LISTS):
        count = sum(len(view.rows[i]) for view in views)
        if count == 0:
            available.append(f"no {part.name}")
        elif count < n_people:
            available.append(f"{part.name} of {count} of {n_people} detected people")
    if not available:
        return ()
    return (f"These files have {', '.join(available)}. The other keypoints of {WHOLE} are missing.",)
