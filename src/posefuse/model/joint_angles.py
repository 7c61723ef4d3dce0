"""Joint angles of people over time, with standard deviations and the reasons why some are missing."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import IntEnum

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import ArrayRange, check_shape, same
from posefuse.described import Described, Description, count
from posefuse.errors import ResultError

OPENSIM, ISB, KEYPOINTS = "opensim", "isb", "keypoints"
"""Conventions: coordinates of OpenSim models, the recommendations of the ISB, and angles between lines of keypoints."""
WITHIN_95 = 1.959964
"""Standard deviations on both sides of an estimate that contain the truth in 95 % of cases."""


class AngleStatus(IntEnum):
    """What an angle rests on.

    Attributes:
        OK: the points determine the angle.
        PRIOR: what is known of human movement determines the angle more than the points do.
        NOT_OBSERVED: no point shows the angle, such as the rotation of a straight limb; no value.
        NO_VERTICAL: the angle refers to the vertical, which is unknown; no value.
        ABSENT: the person has too few points in this frame; no value.
    """

    OK = 0
    PRIOR = 1
    NOT_OBSERVED = 2
    NO_VERTICAL = 3
    ABSENT = 4

    @property
    def label(self) -> str:
        """The word in files."""
        return self.name.lower()


ANGLE_STATUSES: dict[AngleStatus, str] = {
    AngleStatus.OK: "The points determine the angle.",
    AngleStatus.PRIOR: "What is known of human movement determines the angle more than the points do.",
    AngleStatus.NOT_OBSERVED: "No point shows the angle, such as the rotation of a straight limb; no value.",
    AngleStatus.NO_VERTICAL: "The angle refers to the vertical, which is unknown; no value.",
    AngleStatus.ABSENT: "The person has too few points in this frame; no value.",
}
"""Statuses with one sentence each."""


@checked
@dataclass(frozen=True, eq=False, repr=False)
class JointAngles(Described):
    """Joint angles of all people. The page "Joint angles" defines every angle and its sign.

    Attributes:
        names: names of the angles, such as ``knee_angle_r`` (opensim) and ``knee_flexion_r`` (isb), positive in
            flexion; unique within a convention, so :meth:`index` takes both.
        conventions: convention of each angle: ``opensim``, ``isb`` or ``keypoints``.
        layer: Layer whose points the angles describe.
        degrees: shape (frame, person, angle), NaN where missing.
        sd_deg: shape (frame, person, angle): standard deviations, NaN where unknown.
        status: shape (frame, person, angle), int8: :class:`AngleStatus`.
        pelvis_m: shape (frame, person, 3): origin of the model's pelvis in the world, NaN where missing.

    Raises:
        ResultError: If the shapes of the arrays are inconsistent.
    """

    names: tuple[str, ...]
    conventions: tuple[str, ...]
    layer: str
    degrees: np.ndarray
    sd_deg: np.ndarray
    status: np.ndarray
    pelvis_m: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "conventions", tuple(self.conventions))
        if len(self.names) != len(self.conventions):
            raise ResultError(
                f"JointAngles.conventions: expected {len(self.names)}, one per angle, got {len(self.conventions)}."
            )
        frame, person = self.degrees.shape[:2]
        for name in ("degrees", "sd_deg", "status"):
            check_shape(
                ResultError, "JointAngles", name, getattr(self, name), frame=frame, person=person, angle=len(self.names)
            )
        check_shape(ResultError, "JointAngles", "pelvis_m", self.pelvis_m, frame=frame, person=person, xyz=3)

    def _description(self) -> Description:
        frames, people, angles = self.degrees.shape
        shape = f"{count(angles, 'angle')}, {count(frames, 'frame')}, {count(people, 'subject')}"
        by_convention: dict[str, list[str]] = {}
        for name, convention in zip(self.names, self.conventions, strict=True):
            by_convention.setdefault(convention, []).append(name)
        rows = tuple((convention, ", ".join(names)) for convention, names in by_convention.items())
        return Description(f"JointAngles: {shape}, from the layer {self.layer}", rows)

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return self.degrees.shape[0]

    def index(self, name: str, convention: str | None = None) -> int:
        """Return the index of an angle; without a convention, of the first one of this name.

        Raises:
            ResultError: If there is no such angle.
        """
        for i, each in enumerate(zip(self.names, self.conventions, strict=True)):
            if each[0] == name and convention in (None, each[1]):
                return i
        raise ResultError(f"There is no joint angle {name!r}{f' ({convention})' if convention else ''}.")

    def sides(self, convention: str) -> dict[str, tuple[int, int]]:
        """Return the indices of the left and the right angle of one convention by their common name.

        The name of an OpenSim coordinate ends in ``_l`` or ``_r``, and that of any other begins with ``left_`` or
        ``right_``; angles of the trunk and the pelvis have the same index for both sides.
        """
        of = {name: i for i, name in enumerate(self.names) if self.conventions[i] == convention}
        found: dict[str, tuple[int, int]] = {}
        for name, i in of.items():
            common = re.sub(r"^(left|right)_|_[lr]$", "", name)
            left, right = (
                next((of[each] for each in (f"{common}_{word[0]}", f"{word}_{common}") if each in of), -1)
                for word in ("left", "right")
            )
            found[common] = (i, i) if name == common else (left, right)
        return found

    def frames(self, start: int, stop: int) -> "JointAngles":
        """Return the frames ``start`` to ``stop``, in memory."""
        return replace(self, **{name: np.asarray(getattr(self, name)[start:stop]) for name in ANGLES_OVER_TIME})

    def window(self, start: int, stop: int) -> "JointAngles":
        """Return the frames ``start`` to ``stop``, with arrays that are read on first access."""
        return replace(self, **{name: ArrayRange(getattr(self, name), start, stop) for name in ANGLES_OVER_TIME})

    @classmethod
    def concatenate(cls, parts: Sequence["JointAngles"]) -> "JointAngles":
        """Return consecutive ranges of frames as one."""
        whole = {name: np.concatenate([getattr(part, name)[:] for part in parts]) for name in ANGLES_OVER_TIME}
        return replace(parts[0], **whole)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, JointAngles) and all(
            same(
                value if isinstance(value := getattr(self, f.name), tuple | str) else np.asarray(value[:]),
                theirs if isinstance(theirs := getattr(other, f.name), tuple | str) else np.asarray(theirs[:]),
            )
            for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]


ANGLES_OVER_TIME = ("degrees", "sd_deg", "status", "pelvis_m")
"""Names of the arrays of :class:`JointAngles` that have one entry per frame."""
