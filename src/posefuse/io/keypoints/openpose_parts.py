"""Where OpenPose's files keep hands and faces: in lists of their own, joined to the body's as skeleton openpose_137.

``hand_left_keypoints_2d`` and ``hand_right_keypoints_2d`` have 21 keypoints each, ``face_keypoints_2d`` 70. They are
empty where OpenPose did not look for them, and 0 0 0 where it did not find one. With BODY_25 they are 137 keypoints.
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
class Part:
    """A list of keypoints beside the body's.

    Attributes:
        key: what the files call it.
        name: of the part, for messages.
        start: place of its first keypoint in the skeleton.
        stop: of the one after its last.
    """

    key: str
    name: str
    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


PARTS = (
    Part("hand_left_keypoints_2d", "left hands", 25, 46),
    Part("hand_right_keypoints_2d", "right hands", 46, 67),
    Part("face_keypoints_2d", "faces", 67, 137),
)
N_BODY, N_WHOLE = PARTS[0].start, PARTS[-1].stop


def has_parts(skeleton: Skeleton) -> bool:
    """Whether a skeleton's keypoints are OpenPose's body, hands and face, in this order."""
    return len(skeleton) == N_WHOLE and skeleton.keypoints == shipped_skeleton(WHOLE).keypoints


def lists_of(skeleton: Skeleton, values: np.ndarray) -> dict[str, list[float]]:
    """A person's lists as OpenPose's files have them: all in the body's, or hands and face in their own.

    Args:
        skeleton: of the keypoints.
        values: shape (keypoint, 3): x, y, confidence; 0 0 0 where missing.
    """
    if not has_parts(skeleton):
        return {"pose_keypoints_2d": values.ravel().tolist()}
    parts = {part.key: values[part.start : part.stop].ravel().tolist() for part in PARTS}
    return {"pose_keypoints_2d": values[:N_BODY].ravel().tolist(), **parts}


def said_of(where: tuple[Path, str, int]) -> str:
    """A person's place, in words: made only where something is wrong with one of millions."""
    folder, name, place = where
    return f"{folder / name}, person {place}"


@dataclass(frozen=True)
class PartRows:
    """The parts of one view's people, as they are read.

    Attributes:
        numbers: of each of :data:`PARTS` x, y, confidence of one person after another, who has it.
        rows: of each part, the people's places among the view's people.
    """

    numbers: tuple["array[float]", ...] = field(default_factory=lambda: tuple(array("d") for _ in PARTS))
    rows: tuple[list[int], ...] = field(default_factory=lambda: tuple([] for _ in PARTS))

    def add(self, row: int, values: Sequence[Sequence[float]], where: tuple[Path, str, int]) -> None:
        """Add a person's parts, those that are not empty.

        Args:
            row: the person's place among the view's people.
            values: of each of :data:`PARTS`.
            where: folder, file, and place in the file.

        Raises:
            FileError: if a part has another number of keypoints.
        """
        for i, (part, given) in enumerate(zip(PARTS, values, strict=True)):
            if not given:
                continue
            if len(given) != 3 * len(part):
                raise FileError(
                    f"{said_of(where)}: {part.key} holds {len(given)} numbers, expected x, y, confidence for each of "
                    f"{len(part)} keypoints."
                )
            self.numbers[i].extend(given)
            self.rows[i].append(row)

    @property
    def any(self) -> bool:
        """Whether somebody has a part."""
        return any(self.rows)


def joined(body: np.ndarray, parts: PartRows) -> np.ndarray:
    """The whole people: shape (row, 137, 3), NaN where something is missing.

    Args:
        body: shape (row, 25, 3).
        parts: of the same people.
    """
    whole = np.full((len(body), N_WHOLE, 3), np.nan)
    whole[:, :N_BODY] = body
    for part, numbers, rows in zip(PARTS, parts.numbers, parts.rows, strict=True):
        whole[rows, part.start : part.stop] = np.array(numbers, dtype=np.float64).reshape(len(rows), len(part), 3)
    return whole


def missing_parts(views: Sequence[PartRows], n_people: int) -> tuple[str, ...]:
    """What is said of parts that some people in the files have and others have not."""
    said = []
    for i, part in enumerate(PARTS):
        there = sum(len(view.rows[i]) for view in views)
        if there == 0:
            said.append(f"no {part.name}")
        elif there < n_people:
            said.append(f"{part.name} of {there} of {n_people} detected people")
    if not said:
        return ()
    return (f"These files have {', '.join(said)}: the other keypoints of {WHOLE} are missing.",)
