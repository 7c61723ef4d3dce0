"""Bodies of one frame, to which hands and faces are anchored."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.model.frames import Frame
from posefuse.skeleton.skeletons import Skeleton
from posefuse.tracking.body_states import ProjectedBodies


@dataclass(frozen=True, eq=False)
class BodyFrame:
    """Bodies of one frame, to which parts are anchored.

    Attributes:
        number: Number of the frame.
        time_s: Time of the frame, in seconds.
        dt_s: Time since the last frame, in seconds.
        names: Names of the people, in the order of the tracker.
        numbers: Numbers of their tracks.
        swapped: Names of people whose identities were swapped in this frame.
        rows: shape (person, view), int64: assigned detections of the frame, -1 for none.
        exchanged: shape (person, view, part), bool: whether a detection shows a part where its mirror image is.
        points_m: shape (person, part, 3): keypoints to which the parts are attached.
        covariance_m2: shape (person, part, 6).
        turns: shape (person, segment, 3, 3).
        turn_covariance: shape (person, segment, 3, 3): in the segments' own axes, in rad^2.
    """

    number: int
    time_s: float
    dt_s: float
    names: tuple[str, ...]
    numbers: tuple[int, ...]
    swapped: frozenset[str]
    rows: np.ndarray
    exchanged: np.ndarray
    points_m: np.ndarray
    covariance_m2: np.ndarray
    turns: np.ndarray
    turn_covariance: np.ndarray


def mirror_images(skeleton: Skeleton) -> list[int | None]:
    """Return the index of the part that mirrors each part, None for a part without a mirror image."""
    parts = skeleton.parts

    def image(i: int) -> int | None:
        mirrored = skeleton.mirror[parts[i].keypoints]
        return next((j for j, other in enumerate(parts) if j != i and np.array_equal(mirrored, other.keypoints)), None)

    return [image(i) for i in range(len(parts))]


def anchors_of(projected: ProjectedBodies, skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Return the keypoints to which parts are attached, and their covariances, as a BodyFrame holds them."""
    at = [part.at for part in skeleton.parts]
    return projected.points_m[:, at], projected.covariance_m2[:, at]


def turns_of(state: State) -> tuple[np.ndarray, np.ndarray]:
    """Return copies of the turns of bodies' segments, and their covariances, shape (person, segment, 3, 3) each."""
    segments = state.turns.shape[1]
    blocks = [state.covariance[:, c : c + 3, c : c + 3] for c in range(3, 3 + 3 * segments, 3)]
    return state.turns.copy(), np.stack(blocks, axis=1)


def find_exchanged(
    frame: Frame,
    rows: np.ndarray,
    projected: ProjectedBodies,
    skeleton: Skeleton,
    images: Sequence[int | None],
    margin_m: float,
) -> np.ndarray:
    """Find the hands of detections that are clearly closer to each other's wrists than to their own.

    Args:
        frame: The detections.
        rows: shape (person, view): assigned detections, -1 for none.
        projected: Projected bodies.
        skeleton: The skeleton.
        images: The result of :func:`mirror_images`.
        margin_m: Distance by which they must be closer, in meters.

    Returns:
        Shape (person, view, part), bool.
    """
    exchanged = np.zeros((*rows.shape, len(images)), dtype=bool)
    assigned = np.nonzero(rows >= 0)
    seen, pixels = frame.keypoints_px[rows[assigned]], projected.pixels[assigned]
    for i, j in enumerate(images):
        if j is None or j < i:
            continue
        pair = skeleton.parts[i], skeleton.parts[j]
        roots = [pixels[:, part.at] for part in pair]
        means = [_mean_pixel(seen[:, part.keypoints]) for part in pair]
        own = _distance(means[0], roots[0]) + _distance(means[1], roots[1])
        other = _distance(means[0], roots[1]) + _distance(means[1], roots[0])
        are = other + margin_m * projected.px_per_m[assigned][:, pair[0].at] < own
        exchanged[*assigned, i] = exchanged[*assigned, j] = are
    return exchanged


def _mean_pixel(pixels: np.ndarray) -> np.ndarray:
    """Return the mean over the finite points, shape (row, 2); NaN where there are none."""
    finite = np.isfinite(pixels)
    count = finite.sum(axis=1)
    return np.where(finite, pixels, 0.0).sum(axis=1) / np.where(count > 0, count, np.nan)


def _distance(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the distance between pixels, shape (row,); 0 where one of them is unknown."""
    distance = np.linalg.norm(one - other, axis=1)
    return np.where(np.isfinite(distance), distance, 0.0)
