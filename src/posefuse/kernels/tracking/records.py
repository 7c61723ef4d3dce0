"""Records of articulated bodies: trees, states, and the use of observations.

The state of a person consists of a pose (see :mod:`posefuse.kernels.tracking.body_kinematics`), a shape, and the
velocity of the pose; its covariance has the order pose, shape, velocity.
"""

from collections import namedtuple

Body = namedtuple(
    "Body", "parents carriers is_bone offsets shape_of signs starts columns keypoint_nodes limits limit_axes"
)
"""Arrays of a tree as kernels take them: ``Tree.packed``, the node of each keypoint, and ``Tree.packed_limits``."""


State = namedtuple("State", "root turns bones shape velocity covariance free")
"""State of all people: root, shape (person, 3); segment rotations ``turns``, (person, segment, 3, 3); bone frames,
(person, bone, 3, 3); shape, (person, shape); pose velocity, (person, pose); covariance, (person, pose + shape + pose,
the same); and ``free``, (person,), int64: whether the shape is still estimated.
"""


USED = 0


GATED = 1


UNOBSERVED = 2
