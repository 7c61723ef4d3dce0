"""The anatomical model with a skeleton's keypoints as markers."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.biomechanics.anatomy.anatomy import Anatomy, read_anatomy
from posefuse.biomechanics.placements import arrays_of, mirrored, placements_of
from posefuse.kernels.biomechanics.inverse_kinematics import Markers
from posefuse.skeleton.skeletons import Skeleton

_NEEDED = ("left_hip", "right_hip", "left_knee", "right_knee")


@dataclass(frozen=True, eq=False)
class MarkerModel:
    """The anatomical model of a person, with keypoints as markers.

    Attributes:
        anatomy: bodies, joints and coordinates.
        keypoints: names of the keypoints.
        columns: shape (keypoint,): indices of the keypoints in the skeleton.
        twins: shape (keypoint,): indices of the keypoints' mirror images.
        sd_m: shape (keypoint, 3): standard deviations of the locations.
        scales: shape (body, 3): scale factors.
        markers: bodies and locations of the keypoints.
    """

    anatomy: Anatomy
    keypoints: tuple[str, ...]
    columns: np.ndarray
    twins: np.ndarray
    sd_m: np.ndarray
    scales: np.ndarray
    markers: Markers

    @property
    def kernel_model(self) -> tuple:
        """The arguments of kernels: chain, scale factors, markers."""
        return self.anatomy.chain, self.scales, self.markers

    def with_parameters(self, scales: np.ndarray, locations_m: np.ndarray) -> "MarkerModel":
        """Return the model of a person."""
        return replace(
            self,
            scales=np.ascontiguousarray(scales),
            markers=self.markers._replace(locations_m=np.ascontiguousarray(locations_m)),
        )


def is_human(skeleton: Skeleton) -> bool:
    """Return whether a skeleton is one of a human body."""
    return set(_NEEDED) <= set(skeleton.keypoints)


def marker_model(skeleton: Skeleton) -> MarkerModel | None:
    """Return the unscaled model of a skeleton, or None if the skeleton is not one of a human body."""
    if not is_human(skeleton):
        return None
    anatomy, placements = read_anatomy(), placements_of(skeleton)
    names = tuple(each.keypoint for each in placements)
    bodies = np.array([anatomy.body_index(each.body) for each in placements], dtype=np.int64)
    locations_m, sd_m = arrays_of(placements)
    return MarkerModel(
        anatomy,
        names,
        np.array([skeleton.index(name) for name in names]),
        np.array([names.index(mirrored(name)) for name in names]),
        sd_m,
        anatomy.unscaled(),
        Markers(bodies, locations_m, _ancestors(anatomy, bodies)),
    )


def coordinates_of(anatomy: Anatomy, body: int) -> list[int]:
    """Return the indices of the coordinates that move a body, ascending."""
    found: set[int] = set()
    while body >= 0:
        found |= {int(c) for c in anatomy.chain.coordinate[body] if c >= 0}
        body = int(anatomy.chain.parent[body])
    return sorted(found)


def _ancestors(anatomy: Anatomy, bodies: np.ndarray) -> np.ndarray:
    lists = [coordinates_of(anatomy, int(body)) for body in bodies]
    out = np.full((len(lists), max(map(len, lists))), -1, dtype=np.int64)
    for row, found in zip(out, lists, strict=True):
        row[: len(found)] = found
    return out
