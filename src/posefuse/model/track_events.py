"""What happened to people, and how their bodies stood: what a tracker knows beside where keypoints are."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

import numpy as np

from posefuse.arrays import ArraySource, check_shape, same
from posefuse.errors import ResultError, choices

Happening = Literal[
    "born", "lost", "found", "returned", "forgotten", "identity uncertain", "identities exchanged", "limb set anew",
    "camera refused", "camera trusted", "camera silent", "camera heard again",
]  # fmt: skip
HAPPENINGS: tuple[Happening, ...] = get_args(Happening)


@dataclass(frozen=True)
class Event:
    """Something that happened to a person.

    Attributes:
        number: of the frame.
        time_s: of the frame.
        person: name; of what happens to a camera, its name.
        what: one of :data:`HAPPENINGS`.
        why: a clause.
    """

    number: int
    time_s: float
    person: str
    what: Happening
    why: str

    def __post_init__(self) -> None:
        if self.what not in HAPPENINGS:
            raise ResultError(f"No event is called {self.what!r}; there are {choices(HAPPENINGS, 20)}.")


@dataclass(frozen=True, eq=False)
class Poses:
    """How articulated bodies stand over time.

    Attributes:
        segments: names, of the tree.
        bones: names of their far ends.
        shape_names: what each number of a shape is.
        angles: names of joint angles.
        turns: shape (frame, person, segment, 3, 3): world from segment; NaN where a person is not followed.
        directions: shape (frame, person, bone, 3): unit vectors; NaN likewise.
        angle_sd_deg: shape (frame, person, angle): how well joint angles are known, NaN where these are not.
        nis: shape (frame, person): squared innovations of the keypoints that the filter used, each in its own
            covariance, together; NaN where there are none.
        nis_dof: shape (frame, person), int32: what that is on average, if all is known as well as it says.
        shape_m: shape (person, shape): lengths.
        shape_sd_m: shape (person, shape).

    Raises:
        ResultError: where the arrays do not fit each other.
    """

    segments: tuple[str, ...]
    bones: tuple[str, ...]
    shape_names: tuple[str, ...]
    angles: tuple[str, ...]
    turns: ArraySource
    directions: ArraySource
    angle_sd_deg: ArraySource
    nis: ArraySource
    nis_dof: ArraySource
    shape_m: ArraySource
    shape_sd_m: ArraySource

    def __post_init__(self) -> None:
        for name in ("segments", "bones", "shape_names", "angles"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        n_frames, people = self.turns.shape[:2]
        segments, bones, shape = len(self.segments), len(self.bones), len(self.shape_names)
        angles = {"frame": n_frames, "person": people, "angle": len(self.angles)}
        check_shape(ResultError, "Poses", "angle_sd_deg", self.angle_sd_deg, **angles)
        check_shape(
            ResultError, "Poses", "turns", self.turns, frame=n_frames, person=people, segment=segments, row=3, column=3
        )
        check_shape(
            ResultError, "Poses", "directions", self.directions, frame=n_frames, person=people, bone=bones, xyz=3
        )
        for name in ("nis", "nis_dof"):
            check_shape(ResultError, "Poses", name, getattr(self, name), frame=n_frames, person=people)
        for name in ("shape_m", "shape_sd_m"):
            check_shape(ResultError, "Poses", name, getattr(self, name), person=people, shape=shape)

    def frames(self, start: int, stop: int) -> "Poses":
        """The frames ``start`` to ``stop``, in memory."""
        cut = {name: np.asarray(getattr(self, name)[start:stop]) for name in OVER_TIME}
        return replace(self, **cut, shape_m=np.asarray(self.shape_m[:]), shape_sd_m=np.asarray(self.shape_sd_m[:]))

    @classmethod
    def concatenate(cls, parts: Sequence["Poses"]) -> "Poses":
        """Consecutive ranges of frames as one."""
        whole = {name: np.concatenate([getattr(part, name)[:] for part in parts]) for name in OVER_TIME}
        return replace(parts[0], **whole)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Poses) and all(
            same(
                value if isinstance(value := getattr(self, f.name), tuple) else np.asarray(value[:]),
                theirs if isinstance(theirs := getattr(other, f.name), tuple) else np.asarray(theirs[:]),
            )
            for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]


OVER_TIME = ("turns", "directions", "angle_sd_deg", "nis", "nis_dof")
"""What poses hold of each frame."""
