"""Everything that stays the same while a tracker runs, packed once."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.arrays import PickledByFields, frozen
from posefuse.errors import SkeletonError
from posefuse.kernels.tracking.error_model import ErrorModel
from posefuse.kernels.tracking.records import Body
from posefuse.kinematics.initial_pose import motion_laws, widest
from posefuse.model.cameras import CameraRig
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import Tree
from posefuse.tracking.body_states import body_of

# The filter's memory of errors is the first of these longer with all views, and by the second, shared among them.
_MANY, _FEW = 0.62, 1.9
# It is by the first of these shorter where frames are very often, and grows with the time between them, s; frames
# rarer than the last, s, are as those.
_OFTEN, _FRAMES_S, _RARELY_S = 0.6, 0.068, 0.2


@dataclass(frozen=True, eq=False)
class Settings(PickledByFields):
    """What a tracker works with.

    Attributes:
        rig: cameras, in the order of the frames' views.
        skeleton: of the keypoints.
        tree: of the bodies.
        noise: of the detections.
        options: of the tracker, in proportion to the bodies.
        cameras: shape (view, COLUMNS).
        sizes_px: shape (view, 2).
        body: the tree, for kernels.
        law: of the detections, for kernels.
        decay_s, power, most: of the motion, shape (pose,).
        group_of: shape (keypoint,): which limb's sides swap together, -1 for none.
        n_groups: how many of them.
        core: shape (core,): keypoints that tell people apart.
    """

    rig: CameraRig
    skeleton: Skeleton
    tree: Tree
    noise: NoiseModel
    options: TrackerOptions
    cameras: np.ndarray
    sizes_px: np.ndarray
    body: Body
    law: ErrorModel
    decay_s: np.ndarray
    power: np.ndarray
    most: np.ndarray
    group_of: np.ndarray
    n_groups: int
    core: np.ndarray

    def __post_init__(self) -> None:
        # Frozen arrays, also of settings that were pickled: for kernels writable ones are another type.
        object.__setattr__(self, "cameras", self.rig.packed[0])
        object.__setattr__(self, "body", body_of(self.tree))
        object.__setattr__(self, "core", frozen(self.core, np.int64))

    @classmethod
    def of(cls, rig: CameraRig, skeleton: Skeleton, noise: NoiseModel, options: TrackerOptions) -> "Settings":
        """Packed from the records users know.

        Raises:
            SkeletonError: if the skeleton has no tree.
        """
        tree = skeleton.tree
        if tree is None:
            raise SkeletonError(
                f"Skeleton {skeleton.name!r} has no tree, so nobody knows how its body moves. Add a table [tree] to "
                "its TOML, or at least how large the body is, in metres, as size_m in that table; see docs/formats.md."
            )
        options = options.in_proportion(tree.scale)
        # Half of what there is to see supports somebody, where there is little.
        half = (int((tree.keypoint_nodes >= 0).sum()) + 1) // 2
        options = replace(options, min_joints=min(options.min_joints, half))
        decay, power = motion_laws(tree, options.motion)
        # Bodies stand for the detections of either side.
        cameras = rig.packed[0]
        law = ErrorModel(
            np.ascontiguousarray(noise.scale_px * noise.spread),
            float(noise.exponent),
            options.model_floor_m,
            options.nu,
            options.gate,
            options.limit_sigma,
            0.05,
        )
        group_of = _groups(skeleton)
        return cls(
            rig, skeleton, tree, noise, options, cameras,
            np.array([camera.size_px for camera in rig.cameras], dtype=np.float64),
            body_of(tree), law, decay, power, widest(tree), group_of, int(group_of.max(initial=-1)) + 1,
            skeleton.core_indices,
        )  # fmt: skip

    def variance_px2(self, confidence: np.ndarray, view: np.ndarray) -> np.ndarray:
        """How noisy keypoints are by the noise law alone.

        Args:
            confidence: shape (row, keypoint), NaN where the detector gives none.
            view: shape (row,), int64.

        Returns:
            Shape (row, keypoint): per axis.
        """
        trust = np.maximum(np.where(np.isfinite(confidence), confidence, 1.0), self.law.min_confidence)
        return (self.law.scale_px[view][:, None] * trust**-self.law.exponent) ** 2


def memory_s(n_views: np.ndarray, alone_s: np.ndarray, dt_s: np.ndarray, options: TrackerOptions) -> np.ndarray:
    """For how long the filter takes the errors of people's detections to last.

    Errors last longer than the filter looks back. The fewer views there are the less each frame says, so that it looks
    back further and lasting errors weigh more; the rarer frames are the fewer of them tell of the same moment. How far
    away somebody is whom one view alone shows follows from how large they look, which hardly changes: of that the
    filter averages so many frames that errors last as long as they do for the smoother.

    Args:
        n_views: shape (person,), int64: how many views show each.
        alone_s: shape (person,): for how long one view alone has shown them.
        dt_s: shape (person,): since the last frame.
        options: of the tracker; their ``error_memory_s`` is that of five views and 20 frames a second.

    Returns:
        Shape (person,).
    """
    few = _MANY + _FEW / np.maximum(n_views, 1)
    mine = options.error_memory_s * few * np.hypot(_OFTEN, np.minimum(dt_s, _RARELY_S) / _FRAMES_S)
    longer = np.maximum(options.smoother_error_memory_s, mine)
    return np.where(alone_s > options.weak_after_s, longer, mine)


def tempering(dt_s: np.ndarray, memory_s: float | np.ndarray) -> np.ndarray:
    """As how many independent frames so many count as one whose errors last that long, for each time between frames.

    Errors whose correlation is ``r = exp(-dt / memory)`` from a frame to the next leave ``(1 - r) / (1 + r)`` of what
    white noise would.
    """
    return 1.0 / np.tanh(0.5 * np.maximum(dt_s, 1e-6) / memory_s)


def _groups(skeleton: Skeleton) -> np.ndarray:
    """Limbs by chain; pairs of no chain are one more group each."""
    group = np.full(len(skeleton), -1, dtype=np.int64)
    n = 0
    for chain in skeleton.chains.values():
        for pair in chain:
            group[[skeleton.index(name) for name in pair]] = n
        n += 1
    for left, right in skeleton.pair_indices:
        if group[left] < 0:
            group[[left, right]] = n
            n += 1
    return group
