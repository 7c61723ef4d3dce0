"""Figures: people as animation programs know them, joints that turn and carry each other, of one person's lengths."""

from dataclasses import dataclass

import numpy as np

from posefuse.arrays import Rebuilt, check_shape, frozen
from posefuse.errors import ResultError


@dataclass(frozen=True)
class Joint:
    """A joint of a figure, or a point that rides on one.

    Attributes:
        name: unique in the figure.
        parent: number of the joint that carries it, -1 for the root.
        offset_m: forward, left, up: from its parent when the figure stands at rest.
        turns: whether it turns by itself; what does not is a point that rides on its parent.
    """

    name: str
    parent: int
    offset_m: tuple[float, float, float]
    turns: bool


@dataclass(frozen=True, eq=False)
class Figure(Rebuilt):
    """The joints of a person. At rest nothing is turned: axes are forward, left and up.

    Attributes:
        person: name.
        joints: parents before children; the first is the root.
        keypoint_joints: shape (keypoint,), int64: the joint that is where each keypoint is, -1 where none is.

    Raises:
        ResultError: where a joint stands before what carries it.
    """

    person: str
    joints: tuple[Joint, ...]
    keypoint_joints: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", tuple(self.joints))
        object.__setattr__(self, "keypoint_joints", frozen(self.keypoint_joints, np.int64))
        for j, joint in enumerate(self.joints):
            if not (joint.parent < j and (joint.parent >= 0) == (j > 0)):
                raise ResultError(f"Figure of {self.person}: joint {joint.name!r} hangs on number {joint.parent}.")

    @property
    def parents(self) -> np.ndarray:
        """Shape (joint,), int64."""
        return np.array([joint.parent for joint in self.joints], dtype=np.int64)

    @property
    def offsets_m(self) -> np.ndarray:
        """Shape (joint, 3): forward, left, up from the parent at rest."""
        return np.array([joint.offset_m for joint in self.joints])

    @property
    def rest_m(self) -> np.ndarray:
        """Shape (joint, 3): forward, left, up from the root at rest."""
        out = self.offsets_m.copy()
        for j, joint in enumerate(self.joints[1:], 1):
            out[j] += out[joint.parent]
        return out - self.offsets_m[0]

    @property
    def turning(self) -> tuple[int, ...]:
        """The joints that turn by themselves."""
        return tuple(j for j, joint in enumerate(self.joints) if joint.turns)

    def children(self, joint: int) -> tuple[int, ...]:
        """The joints that a joint carries itself."""
        return tuple(j for j, other in enumerate(self.joints) if other.parent == joint)


@dataclass(frozen=True, eq=False)
class Motion:
    """How a figure stands in a range of frames.

    Attributes:
        root_m: shape (frame, 3): where the root is in the world; NaN while the person is not followed.
        turns: shape (frame, joint, 3, 3): of each joint in the axes of what carries it, of the root in the world; the
            identity where a joint does not turn, NaN where it is not known.
        off_m: shape (frame,): the largest distance of a keypoint of the figure from that of the model layer.

    Raises:
        ResultError: where the arrays do not fit each other.
    """

    root_m: np.ndarray
    turns: np.ndarray
    off_m: np.ndarray

    def __post_init__(self) -> None:
        frames = self.root_m.shape[0]
        check_shape(ResultError, "Motion", "root_m", self.root_m, frame=frames, xyz=3)
        check_shape(ResultError, "Motion", "turns", self.turns, frame=frames, joint=None, row=3, column=3)
        check_shape(ResultError, "Motion", "off_m", self.off_m, frame=frames)

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.root_m)

    @property
    def there(self) -> np.ndarray:
        """Shape (frame,), bool: whether the person is followed."""
        return np.isfinite(self.root_m.sum(axis=1))
