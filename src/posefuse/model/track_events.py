"""Events of tracks and cameras, and poses of articulated bodies over time."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from posefuse.arrays import check_shape, same
from posefuse.errors import ResultError, choices

EventKind = Literal[
    "confirmed", "lost", "reacquired", "reidentified", "terminated", "possible_identity_switch", "identities_swapped",
    "limb_reinitialized", "lengths_reestimated", "camera_rejected", "camera_restored", "camera_silent", "camera_back",
    "heel_strike", "toe_off", "jump", "squat", "sit_to_stand",
]  # fmt: skip

EVENT_KINDS: dict[EventKind, str] = {
    "confirmed": "A tentative track became a confirmed track.",
    "lost": "Too few cameras show the person.",
    "reacquired": "The detections of a lost track continue.",
    "reidentified": "A new track was re-identified as a lost one.",
    "terminated": "The track ended and can no longer be re-acquired.",
    "possible_identity_switch": "The identity may have changed; check these frames.",
    "identities_swapped": "Two identities were swapped; the names were corrected.",
    "limb_reinitialized": "A limb was reinitialized where most cameras show it.",
    "lengths_reestimated": "The cameras contradicted the bone lengths, which were estimated again from then on.",
    "camera_rejected": "A camera contradicts the others and is not used to find new people.",
    "camera_restored": "A rejected camera agrees with the others again.",
    "camera_silent": "A camera delivers no frames, or shows no person where other cameras show people.",
    "camera_back": "A silent camera delivers frames and detections again.",
    "heel_strike": "A foot touches the ground in a bout of gait.",
    "toe_off": "A foot leaves the ground in a bout of gait.",
    "jump": "Both feet leave the ground at once.",
    "squat": "The pelvis begins to sink and later rises again.",
    "sit_to_stand": "The person begins to rise from a seat.",
}
"""Kinds of events with one sentence each, in the order in which reports list them."""

_FORMER_KINDS: dict[str, EventKind] = {
    "born": "confirmed", "found": "reacquired", "returned": "reidentified", "forgotten": "terminated",
    "identity uncertain": "possible_identity_switch", "identities exchanged": "identities_swapped",
    "limb set": "limb_reinitialized", "camera refused": "camera_rejected", "camera trusted": "camera_restored",
    "camera silent": "camera_silent", "camera heard again": "camera_back",
}  # fmt: skip
"""Beginnings of former names of kinds. Stored results that use them are still read."""


def current_event_kind(name: str) -> str:
    """Return the current name of a kind of event that a stored result names."""
    return next((kind for former, kind in _FORMER_KINDS.items() if name.startswith(former)), name)


@dataclass(frozen=True)
class Event:
    """An event of a track, a camera or a movement.

    Attributes:
        number: Number of the frame.
        time_s: Time of the frame, in seconds.
        person: Name of the person, or of the camera.
        what: Kind of the event, one of :data:`EVENT_KINDS`.
        why: Reason, as a clause.

    Raises:
        ResultError: If there is no such kind of event.
    """

    number: int
    time_s: float
    person: str
    what: EventKind
    why: str

    def __post_init__(self) -> None:
        if self.what not in EVENT_KINDS:
            raise ResultError(f"Unknown event kind {self.what!r}. Valid kinds: {choices(EVENT_KINDS, 20)}.")


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of articulated bodies over time.

    Attributes:
        segments: Names of the tree's segments.
        bones: Names of the bones' distal ends.
        shape_names: Names of the lengths of a body.
        angles: Names of the joint angles.
        turns: shape (frame, person, segment, 3, 3): world from segment; NaN where a person is not tracked.
        directions: shape (frame, person, bone, 3): unit vectors; NaN where a person is not tracked.
        angle_sd_deg: shape (frame, person, angle): standard deviations of joint angles, NaN where an angle is unknown.
        root_turn_rad2: shape (frame, person, 6): covariance of a small turn of the root segment about its own axes, as
            xx xy xz yy yz zz, independent of the world; NaN where a person is not tracked or has no root segment.
        nis: shape (frame, person): normalized innovation squared, summed over the keypoints that the filter used; NaN
            where it used none.
        nis_dof: shape (frame, person), int32: expected value of ``nis`` for consistent covariances.
        shape_m: shape (person, shape): lengths.
        shape_sd_m: shape (person, shape): standard deviations of the lengths.

    Raises:
        ResultError: If the shapes of the arrays are inconsistent.
    """

    segments: tuple[str, ...]
    bones: tuple[str, ...]
    shape_names: tuple[str, ...]
    angles: tuple[str, ...]
    turns: np.ndarray
    directions: np.ndarray
    angle_sd_deg: np.ndarray
    root_turn_rad2: np.ndarray
    nis: np.ndarray
    nis_dof: np.ndarray
    shape_m: np.ndarray
    shape_sd_m: np.ndarray

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
        check_shape(ResultError, "Poses", "root_turn_rad2", self.root_turn_rad2, frame=n_frames, person=people, entry=6)
        for name in ("nis", "nis_dof"):
            check_shape(ResultError, "Poses", name, getattr(self, name), frame=n_frames, person=people)
        for name in ("shape_m", "shape_sd_m"):
            check_shape(ResultError, "Poses", name, getattr(self, name), person=people, shape=shape)

    def frames(self, start: int, stop: int) -> "Poses":
        """Return the frames ``start`` to ``stop``, in memory."""
        cut = {name: np.asarray(getattr(self, name)[start:stop]) for name in OVER_TIME}
        return replace(self, **cut, shape_m=np.asarray(self.shape_m[:]), shape_sd_m=np.asarray(self.shape_sd_m[:]))

    @classmethod
    def concatenate(cls, parts: Sequence["Poses"]) -> "Poses":
        """Return consecutive ranges of frames as one."""
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


OVER_TIME = ("turns", "directions", "angle_sd_deg", "root_turn_rad2", "nis", "nis_dof")
"""Names of the arrays of :class:`Poses` that have one entry per frame."""
