"""Animation skeletons: hierarchies of rotating joints with the constant lengths of one person."""

from dataclasses import dataclass

import numpy as np

from posefuse.arrays import PickledByFields, check_shape, frozen
from posefuse.errors import ResultError


@dataclass(frozen=True)
class Joint:
    """A joint of an animation skeleton, or a point fixed to one.

    Attributes:
        name: name, unique in the skeleton.
        parent: index of the parent joint, -1 for the root.
        offset_m: forward, left, up: offset from the parent in the rest pose, in meters.
        turns: whether it rotates; otherwise it is a point fixed to its parent.
    """

    name: str
    parent: int
    offset_m: tuple[float, float, float]
    turns: bool


@dataclass(frozen=True, eq=False)
class Figure(PickledByFields):
    """The animation skeleton of a person. In the rest pose all rotations are the identity; axes: forward, left, up.

    Attributes:
        person: name of the person.
        joints: parents before children; the first is the root.
        keypoint_joints: shape (keypoint,), int64: joint at each keypoint, -1 without one.

    Raises:
        ResultError: if a joint precedes its parent.
    """

    person: str
    joints: tuple[Joint, ...]
    keypoint_joints: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", tuple(self.joints))
        object.__setattr__(self, "keypoint_joints", frozen(self.keypoint_joints, np.int64))
        for j, joint in enumerate(self.joints):
            if not (joint.parent < j and (joint.parent >= 0) == (j > 0)):
                raise ResultError(
                    f"Figure of {self.person}: joint {joint.name!r} has the parent {joint.parent}, which must come "
                    "before it."
                )

    @property
    def parents(self) -> np.ndarray:
        """Shape (joint,), int64: parent of each joint."""
        return np.array([joint.parent for joint in self.joints], dtype=np.int64)

    @property
    def offsets_m(self) -> np.ndarray:
        """Shape (joint, 3): offset from the parent in the rest pose."""
        return np.array([joint.offset_m for joint in self.joints])

    @property
    def rest_m(self) -> np.ndarray:
        """Shape (joint, 3): position relative to the root in the rest pose."""
        out = self.offsets_m.copy()
        for j, joint in enumerate(self.joints[1:], 1):
            out[j] += out[joint.parent]
        return out - self.offsets_m[0]

    @property
    def turning(self) -> tuple[int, ...]:
        """Indices of the rotating joints."""
        return tuple(j for j, joint in enumerate(self.joints) if joint.turns)

    def children(self, joint: int) -> tuple[int, ...]:
        """Return the children of a joint."""
        return tuple(j for j, other in enumerate(self.joints) if other.parent == joint)


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of an animation skeleton in a range of frames.

    Attributes:
        root_m: shape (frame, 3): root position in the world, in meters; NaN while the person is not tracked.
        turns: shape (frame, joint, 3, 3): rotation of each joint relative to its parent, of the root relative to the
            world; the identity for fixed points, NaN if unknown.
        off_m: shape (frame,): largest distance of a keypoint from that of the model layer, in meters.

    Raises:
        ResultError: if the arrays do not match.
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
        """Shape (frame,), bool: whether the person is tracked."""
        return np.isfinite(self.root_m.sum(axis=1))
