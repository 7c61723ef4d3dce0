"""Settings of a tracker, packed once."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posefuse.arrays import PickledByFields, frozen, kernel_array
from posefuse.errors import SkeletonError
from posefuse.kernels.tracking.error_model import ErrorModel
from posefuse.kernels.tracking.records import Body, KeypointGraph, MotionModel, SideGroups
from posefuse.kinematics.initial_pose import max_variances, motion_parameters
from posefuse.model.cameras import CameraRig, up_vector
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import Tree
from posefuse.tracking.body_states import body_of

MIN_MEMORY_S = 1e-9
"""Correlation time that stands for white noise, where it is a divisor."""

# Correlation time of errors for the filter, relative to ``error_memory_s``: a limit for many views and a part that is
# inversely proportional to the number of views.
_MANY_VIEWS, _PER_VIEW = 0.62, 1.9
# Its limit for frequent frames, the time between frames at which it grows, and the time beyond which it does not, in
# seconds.
_FREQUENT_FRAMES, _FRAME_TIME_S, _MAX_FRAME_TIME_S = 0.6, 0.068, 0.2


@dataclass(frozen=True, eq=False)
class TrackerSettings(PickledByFields):
    """Everything that a tracker needs to know about a recording.

    Attributes:
        rig: Cameras, in the order of the frames' views.
        skeleton: Skeleton of the keypoints.
        tree: Tree of the bodies.
        noise: Noise model of the detections.
        options: Options of the tracker, in proportion to the bodies.
        cameras: shape (view, COLUMNS).
        sizes_px: shape (view, 2).
        body: The tree in the form that kernels take.
        law: Noise model in the form that kernels take.
        decay_s, power, most: Motion model, shape (pose,): decay times, spectral densities and initial variances.
        group_of: shape (keypoint,): limb whose sides swap together, -1 for none.
        n_groups: Number of these limbs.
        core: shape (core,): keypoints that distinguish people.
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
        # Freeze the arrays also if the settings were pickled: kernels compile writable arrays as another type.
        object.__setattr__(self, "cameras", self.rig.packed)
        object.__setattr__(self, "body", body_of(self.tree))
        object.__setattr__(self, "core", frozen(self.core, np.int64))

    @classmethod
    def of(cls, rig: CameraRig, skeleton: Skeleton, noise: NoiseModel, options: TrackerOptions) -> "TrackerSettings":
        """Pack cameras, skeleton, noise model and options.

        Raises:
            SkeletonError: If the skeleton has no tree.
        """
        tree = skeleton.tree
        if tree is None:
            raise SkeletonError(
                f"Skeleton {skeleton.name!r} has no kinematic tree. Add a [tree] table with at least size_m "
                "(the size of the body in meters) to its TOML file; see docs/formats.md."
            )
        options = options.in_proportion(tree.scale)
        # Half of the keypoints support a person if the skeleton has few.
        half = (int((tree.keypoint_nodes >= 0).sum()) + 1) // 2
        options = replace(
            options,
            min_joints=min(options.min_joints, half),
            model_floor_m=options.model_floor_m * tree.offset_factor,
        )
        decay, power = motion_parameters(tree, options.motion)
        # The spread makes the filter expect the tails of accepted errors as well.
        cameras = rig.packed
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
            body_of(tree), law, decay, power, max_variances(tree), group_of, int(group_of.max(initial=-1)) + 1,
            skeleton.core_indices,
        )  # fmt: skip

    @cached_property
    def node_keypoints(self) -> np.ndarray:
        """The keypoints that the body has, shape (node keypoint,), int64."""
        return np.flatnonzero(self.body.keypoint_nodes >= 0)

    @cached_property
    def frozen_groups(self) -> np.ndarray:
        """``group_of`` as kernels take it, shape (keypoint,), int64."""
        return kernel_array(self.group_of, np.int64)

    @cached_property
    def turning_motions(self) -> tuple[tuple[float, float, float], ...]:
        """Spectral density, decay time and largest variance of the turns of segments and of those of bones."""
        # All segments share one motion model, and so do all bones: one of each follows the root, the other is last.
        return tuple(
            (float(self.power[i]), float(self.decay_s[i]), float(self.most[i])) for i in (3, self.tree.n_pose - 1)
        )

    @cached_property
    def up(self) -> np.ndarray | None:
        """Unit vector of the up axis, shape (3,); None if it is unknown."""
        return None if self.rig.up_axis is None else np.array(up_vector(self.rig.up_axis))

    @cached_property
    def core_edges(self) -> np.ndarray:
        """The edges between core keypoints, shape (edge, 2), int64."""
        edges = self.skeleton.edge_indices
        return edges[np.isin(edges, self.core).all(axis=1)]

    @cached_property
    def node_body(self) -> Body:
        """The tree in the form that kernels take, with the keypoints of the body only."""
        return self.body._replace(keypoint_nodes=frozen(self.body.keypoint_nodes[self.node_keypoints], np.int64))

    @cached_property
    def motion(self) -> MotionModel:
        """The motion model in the form that kernels take."""
        return MotionModel(self.decay_s, self.power, self.most, float(self.options.motion.shape_walk))

    @cached_property
    def sides(self) -> SideGroups:
        """The limbs whose sides swap together, in the form that kernels take."""
        return SideGroups(self.skeleton.mirror, self.group_of, self.n_groups)

    @cached_property
    def keypoint_graph(self) -> KeypointGraph:
        """A spanning tree of the skeleton's edges, and the core keypoints."""
        order, parents = _spanning_tree(self.skeleton)
        return KeypointGraph(order, parents, self.core)

    def variance_px2(self, confidence: np.ndarray, view: np.ndarray) -> np.ndarray:
        """Return the noise variance per axis of keypoints by the noise model alone, shape (row, keypoint).

        Args:
            confidence: shape (row, keypoint), NaN where the detector gives none.
            view: shape (row,), int64.
        """
        trust = np.maximum(np.where(np.isfinite(confidence), confidence, 1.0), self.law.min_confidence)
        return (self.law.scale_px[view][:, None] * trust**-self.law.exponent) ** 2


def filter_memory_s(
    n_views: np.ndarray, single_view_s: np.ndarray, dt_s: np.ndarray, options: TrackerOptions
) -> np.ndarray:
    """Return the correlation time of detection errors for the filter, in seconds, shape (track,).

    Errors last longer than the filter looks back. With fewer views each frame carries less information, so the
    filter looks back farther and correlated errors weigh more; with longer times between frames fewer frames share an
    error. The distance of a person in a single view follows from the apparent size, which hardly changes: over that the
    filter averages as many frames as the smoother, and needs the smoother's correlation time.

    Args:
        n_views: shape (track,), int64: number of views that show each person.
        single_view_s: shape (track,): time for which a single view has shown each person, in seconds.
        dt_s: shape (track,): time since the last frame, in seconds.
        options: Options of the tracker; ``error_memory_s`` holds for five views and 20 frames per second.
    """
    views = _MANY_VIEWS + _PER_VIEW / np.maximum(n_views, 1)
    frames = np.hypot(_FREQUENT_FRAMES, np.minimum(dt_s, _MAX_FRAME_TIME_S) / _FRAME_TIME_S)
    memory = options.error_memory_s * views * frames
    longer = np.maximum(options.smoother_error_memory_s, memory)
    return np.where(single_view_s > options.single_view_after_s, longer, memory)


def tempering_factor(dt_s: np.ndarray, memory_s: float | np.ndarray) -> np.ndarray:
    """Return the number of correlated frames that count as one independent frame, for each time between frames.

    Errors with the correlation ``r = exp(-dt / memory)`` between consecutive frames leave ``(1 - r) / (1 + r)`` of the
    information of white noise.

    Args:
        dt_s: Times between frames, in seconds.
        memory_s: Correlation time of the errors, in seconds; 0 for white noise.
    """
    return 1.0 / np.tanh(0.5 * np.maximum(dt_s, 1e-6) / np.maximum(memory_s, MIN_MEMORY_S))


def correlation_factor(observed_s: float, options: TrackerOptions) -> float:
    """Return the factor by which the variance of lengths exceeds that of the filter, whose error memory is too short.

    An observation over time T of errors with correlation time m holds 1 + T / 2m independent errors. The filter assumes
    ``error_memory_s``; ``smoother_error_memory_s`` is the actual correlation time.
    """
    assumed, actual = (
        1.0 + 0.5 * observed_s / max(m, MIN_MEMORY_S) for m in (options.error_memory_s, options.smoother_error_memory_s)
    )  # fmt: skip
    return max(assumed / actual, 1.0)


def _spanning_tree(skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Return the keypoints, each after its parent in a spanning tree of the edges, and the parents, -1 for none."""
    neighbors: list[list[int]] = [[] for _ in skeleton.keypoints]
    for a, b in skeleton.edge_indices.tolist():
        neighbors[a].append(b)
        neighbors[b].append(a)
    order: list[int] = []
    parents = np.full(len(skeleton), -1)
    for first in range(len(skeleton)):
        waiting = [] if first in order else [first]
        while waiting:
            k = waiting.pop(0)
            order.append(k)
            for other in neighbors[k]:
                if other not in order and other not in waiting:
                    parents[other] = k
                    waiting.append(other)
    return frozen(np.array(order), np.int64), frozen(parents, np.int64)


def _groups(skeleton: Skeleton) -> np.ndarray:
    """Return the limb of each keypoint by chain; a pair outside all chains is a group of its own."""
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
