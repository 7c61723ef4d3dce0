"""States of tracked bodies, as arrays with one entry per body."""

from dataclasses import dataclass

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.tracking.frame_statistics import count_observations
from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.records import Body, ProjectedKeypoints, State
from posefuse.skeleton.trees import Tree


def body_of(tree: Tree) -> Body:
    """Return a tree in the form that kernels take."""
    # Freeze the array also if the tree was pickled: kernels compile writable arrays as another type.
    arrays = (*tree.packed, frozen(tree.keypoint_nodes, np.int64), *tree.packed_limits)
    return Body._make(arrays)


def empty_state(tree: Tree) -> State:
    """Return the state of no bodies."""
    n, h = tree.n_pose, tree.n_shape
    return State(
        root=np.empty((0, 3)),
        turns=np.empty((0, len(tree.segments), 3, 3)),
        bones=np.empty((0, len(tree.bones), 3, 3)),
        shape=np.empty((0, h)),
        velocity=np.empty((0, n)),
        covariance=np.empty((0, 2 * n + h, 2 * n + h)),
        free=np.empty(0, dtype=np.int64),
    )


def join_states(first: State, second: State) -> State:
    """Return the bodies of both states."""
    return State(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))


def select_states(state: State, bodies: np.ndarray | list[int]) -> State:
    """Return a copy of some bodies, given by index or by mask."""
    index = np.asarray(bodies)
    index = index if index.dtype == bool else index.astype(np.int64)
    return State(*(np.ascontiguousarray(each[index]) for each in state))


def set_state(state: State, body: int, other: State, other_body: int = 0) -> None:
    """Overwrite the state of one body with that of a body of another state."""
    for mine, theirs in zip(state, other, strict=True):
        mine[body] = theirs[other_body]


def free_columns(n_pose: int, n_shape: int, free: bool) -> np.ndarray:
    """Return the columns of pose, shape and velocity that are uncertain; a fixed shape is certain."""
    everything = np.arange(2 * n_pose + n_shape)
    return everything if free else np.delete(everything, np.s_[n_pose : n_pose + n_shape])


def fix_shape_covariance(state: State, body: int, n_pose: int, n_shape: int) -> None:
    """Make the shape of one body certain, in place: its rows and columns of the covariance become zero."""
    state.free[body] = 0
    state.covariance[body, n_pose : n_pose + n_shape] = 0.0
    state.covariance[body, :, n_pose : n_pose + n_shape] = 0.0


def shape_block(state: State, body: int, tree: Tree) -> np.ndarray:
    """Return the covariance of the shape of one body, a view of the state, shape (shape, shape)."""
    n, h = tree.n_pose, tree.n_shape
    return state.covariance[body, n : n + h, n : n + h]


@dataclass(frozen=True)
class ProjectedBodies:
    """Keypoints of bodies in space and in the views.

    Attributes:
        points_m: shape (person, keypoint, 3), NaN where the tree has no such point.
        covariance_m2: shape (person, keypoint, 6).
        pixels: shape (person, view, keypoint, 2), NaN where the view cannot see the point.
        pixel_covariance_px2: shape (person, view, keypoint, 3): covariance of each projection from that of the state.
        px_per_m: shape (person, view, keypoint): image scale at the point.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    pixels: np.ndarray
    pixel_covariance_px2: np.ndarray
    px_per_m: np.ndarray

    @classmethod
    def allocate(cls, people: int, views: int, keypoints: int) -> "ProjectedBodies":
        """Return uninitialized arrays."""
        return cls(
            np.empty((people, keypoints, 3)),
            np.empty((people, keypoints, 6)),
            np.empty((people, views, keypoints, 2)),
            np.empty((people, views, keypoints, 3)),
            np.empty((people, views, keypoints)),
        )

    @classmethod
    def of(cls, state: State, cameras: np.ndarray, body: Body) -> "ProjectedBodies":
        """Project bodies into some cameras, or into none.

        Args:
            state: State of the bodies.
            cameras: shape (view, COLUMNS).
            body: Tree of the bodies.
        """
        projected = cls.allocate(len(state.root), len(cameras), len(body.keypoint_nodes))
        project_people(cameras, body, state, projected.arrays)
        return projected

    @property
    def arrays(self) -> ProjectedKeypoints:
        """The arrays as kernels take them."""
        return ProjectedKeypoints(
            self.points_m, self.covariance_m2, self.pixels, self.pixel_covariance_px2, self.px_per_m
        )


@dataclass(frozen=True, eq=False)
class KeypointUses:
    """Counts of used and rejected keypoints in one frame.

    Attributes:
        of_view: shape (person, view), int64: number of used keypoints per view.
        used: shape (person, keypoint), int64: number of views in which a keypoint was used.
        gated: shape (person, keypoint), int64: number of views in which a keypoint was rejected as too far off.
    """

    of_view: np.ndarray
    used: np.ndarray
    gated: np.ndarray

    @classmethod
    def of(cls, use: np.ndarray) -> "KeypointUses":
        """Count the codes that ``update_people`` writes, shape (person, view, keypoint)."""
        people, views, keypoints = use.shape
        shapes = ((people, views), (people, keypoints), (people, keypoints))
        counted = cls(*(np.empty(shape, dtype=np.int64) for shape in shapes))
        count_observations(use, counted.of_view, counted.used, counted.gated)
        return counted
