"""The states of all people who are followed, side by side in arrays."""

from dataclasses import dataclass

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.tracking.frame_statistics import count_observations
from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.records import Body, State
from posefuse.skeleton.trees import Tree


def body_of(tree: Tree) -> Body:
    """A tree as kernels take it."""
    # Frozen also where the tree was pickled: for kernels a writable array is another type, to be compiled for anew.
    arrays = (*tree.packed, frozen(tree.keypoint_nodes, np.int64), *tree.packed_limits)
    return Body._make(arrays)


def nobody(tree: Tree) -> State:
    """States of no people."""
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


def joined(first: State, second: State) -> State:
    """The people of both."""
    return State(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))


def chosen(state: State, people: np.ndarray | list[int]) -> State:
    """Some of the people, copied, by number or by mask."""
    index = np.asarray(people)
    index = index if index.dtype == bool else index.astype(np.int64)
    return State(*(np.ascontiguousarray(each[index]) for each in state))


def put(state: State, person: int, other: State, of: int = 0) -> None:
    """Give a person the state of another."""
    for mine, theirs in zip(state, other, strict=True):
        mine[person] = theirs[of]


def uncertain(n_pose: int, n_shape: int, free: bool) -> np.ndarray:
    """Which of pose, shape and velocity, by number, are not known for certain: the shape is where it is kept."""
    everything = np.arange(2 * n_pose + n_shape)
    return everything if free else np.delete(everything, np.s_[n_pose : n_pose + n_shape])


@dataclass(frozen=True)
class Sight:
    """Where views should see people.

    Attributes:
        points_m: shape (person, keypoint, 3), NaN where the tree has no such point.
        covariance_m2: shape (person, keypoint, 6).
        pixels: shape (person, view, keypoint, 2), NaN where the view cannot see it.
        spread: shape (person, view, keypoint, 3): by how much the pixel is not known, px^2.
        size_px: shape (person, view, keypoint): how many px a metre is there.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    pixels: np.ndarray
    spread: np.ndarray
    size_px: np.ndarray

    @classmethod
    def room(cls, people: int, views: int, keypoints: int) -> "Sight":
        """Arrays to be written."""
        return cls(
            np.empty((people, keypoints, 3)),
            np.empty((people, keypoints, 6)),
            np.empty((people, views, keypoints, 2)),
            np.empty((people, views, keypoints, 3)),
            np.empty((people, views, keypoints)),
        )

    @classmethod
    def of(cls, state: State, cameras: np.ndarray, body: Body) -> "Sight":
        """Where these cameras, none or some, should see people in these states."""
        sight = cls.room(len(state.root), len(cameras), len(body.keypoint_nodes))
        project_people(cameras, body, state, *sight.arrays)
        return sight

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """In the order of ``project_people``."""
        return self.points_m, self.covariance_m2, self.pixels, self.spread, self.size_px


@dataclass(frozen=True, eq=False)
class Uses:
    """What became of the keypoints of a frame, counted.

    Attributes:
        of_view: shape (person, view), int64: how many keypoints of a view counted.
        used: shape (person, keypoint), int64: in how many views a keypoint counted.
        gated: shape (person, keypoint), int64: in how many views it was too far off to count.
    """

    of_view: np.ndarray
    used: np.ndarray
    gated: np.ndarray

    @classmethod
    def of(cls, use: np.ndarray) -> "Uses":
        """Counted of what ``update_people`` writes, shape (person, view, keypoint)."""
        people, views, keypoints = use.shape
        shapes = ((people, views), (people, keypoints), (people, keypoints))
        counted = cls(*(np.empty(shape, dtype=np.int64) for shape in shapes))
        count_observations(use, counted.of_view, counted.used, counted.gated)
        return counted
