"""3D points of one layer, as files of other programs hold them."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import check_shape, frozen, same
from posefuse.errors import ResultError
from posefuse.model.cameras import Camera, CameraRig, UpAxis
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import LAYERS, Layer, Reconstruction
from posefuse.model.status import PointStatus, Source
from posefuse.skeleton.skeletons import Skeleton


@checked
@dataclass(frozen=True, eq=False)
class StoredPoints:
    """One layer of 3D points, in the axes and the world of the file. Absent information is None.

    Attributes:
        keypoints: names, in the order of the keypoint axes.
        person_ids: names, in the order of the person axes.
        frame_numbers: shape (frame,), int64; from 0 if the file has no frame numbers.
        time_s: shape (frame,), NaN if unknown.
        points_m: shape (frame, person, keypoint, 3), NaN where missing; in ``unit``.
        unit: ``m``; ``px`` for one flattened camera; empty if unknown.
        layer: ``measured``, ``solved`` or ``model``; empty if unknown.
        rate_hz: frames per second.
        covariance_m2: shape (frame, person, keypoint, 6): xx, xy, xz, yy, yz, zz.
        sd_m: shape (frame, person, keypoint, 3): standard deviations along the axes.
        status: shape (frame, person, keypoint), int8: :class:`posefuse.PointStatus`.
        source: shape (frame, person, keypoint), int8: :class:`posefuse.Source`.
        n_views: shape (frame, person, keypoint), int64: views used.
        reprojection_error_px: shape (frame, person, keypoint): mean over the used views.
        view_names: names of the view axis.
        view_status: shape (frame, person, keypoint, view), int8: :class:`posefuse.ViewStatus`.
        view_error_px: shape (frame, person, keypoint, view), float32.

    Raises:
        ResultError: if the arrays do not match.
    """

    keypoints: tuple[str, ...]
    person_ids: tuple[str, ...]
    frame_numbers: np.ndarray
    time_s: np.ndarray
    points_m: np.ndarray
    unit: str = ""
    layer: str = ""
    rate_hz: float | None = None
    covariance_m2: np.ndarray | None = None
    sd_m: np.ndarray | None = None
    status: np.ndarray | None = None
    source: np.ndarray | None = None
    n_views: np.ndarray | None = None
    reprojection_error_px: np.ndarray | None = None
    view_names: tuple[str, ...] | None = None
    view_status: np.ndarray | None = None
    view_error_px: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name, kind in _KINDS.items():
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen(getattr(self, name), kind))
        frames, people, keypoints = len(self.frame_numbers), len(self.person_ids), len(self.keypoints)
        for owner, names in (("keypoints", self.keypoints), ("people", self.person_ids)):
            if len(set(names)) != len(names):
                raise ResultError(f"StoredPoints: names of {owner} are repeated: {list(names)[:20]}.")
        points: dict[str, int | None] = {"frame": frames, "person": people, "keypoint": keypoints}
        views: dict[str, int | None] = {"view": len(self.view_names or ())}
        axes = dict.fromkeys(_KINDS, points)
        axes |= {"frame_numbers": {"frame": frames}, "time_s": {"frame": frames}}
        axes |= {"points_m": {**points, "xyz": 3}, "sd_m": {**points, "xyz": 3}}
        axes |= {"covariance_m2": {**points, "entry": 6}}
        axes |= {name: {**points, **views} for name in ("view_status", "view_error_px")}
        for name, lengths in axes.items():
            if getattr(self, name) is not None:
                check_shape(ResultError, "StoredPoints", name, getattr(self, name), **lengths)

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.frame_numbers)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, StoredPoints) and all(
            same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]


_KINDS = {
    "frame_numbers": np.int64,
    "time_s": np.float64,
    "points_m": np.float64,
    "covariance_m2": np.float64,
    "sd_m": np.float64,
    "status": np.int8,
    "source": np.int8,
    "n_views": np.int64,
    "reprojection_error_px": np.float64,
    "view_status": np.int8,
    "view_error_px": np.float32,
}
"""Array fields with their dtypes."""


@dataclass(frozen=True)
class NoCameras(CameraRig):
    """The world of points whose cameras are unknown, such as those in another program's file."""

    cameras: tuple[Camera, ...] = ()
    min_cameras: ClassVar[int] = 0


def reconstruction_of(points: StoredPoints, skeleton: Skeleton, up_axis: UpAxis | None, source: str) -> Reconstruction:
    """Return stored points as a reconstruction without cameras, for comparisons.

    Args:
        points: points in meters.
        skeleton: skeleton with the keypoints of the points, in their order.
        up_axis: up axis of the file's world, None if unknown.
        source: name of the file.
    """
    shape = points.points_m.shape[:3]
    present = np.isfinite(points.points_m).all(axis=-1)
    status = np.where(present, PointStatus.OK, PointStatus.NOT_SEEN).astype(np.int8)
    sources = np.where(present, Source.MEASURED, Source.NONE).astype(np.int8)
    layer = Layer(
        points_m=points.points_m,
        covariance_m2=_covariance_of(points),
        status=status if points.status is None else points.status,
        source=sources if points.source is None else points.source,
        reprojection_error_px=np.full(shape, np.nan),
        view_status=np.empty((*shape, 0), np.int8),
        view_error_px=np.empty((*shape, 0), np.float32),
    )
    name = points.layer if points.layer in LAYERS else "measured"
    return Reconstruction(
        rig=NoCameras(up_axis=up_axis, source=source),
        skeleton=skeleton,
        person_ids=points.person_ids,
        frame_numbers=points.frame_numbers,
        time_s=points.time_s,
        layers={name: layer},
        rate_hz=points.rate_hz,
    )


def _covariance_of(points: StoredPoints) -> np.ndarray:
    """Return the stored covariances, or NaN if the file has none."""
    if points.covariance_m2 is None:
        return np.full((*points.points_m.shape[:3], 6), np.nan)
    return points.covariance_m2


def stored_points(result: Reconstruction, layer: LayerName, people: Sequence[str] | None = None) -> StoredPoints:
    """Return one layer of a reconstruction with everything that files can hold.

    Args:
        result: reconstruction.
        layer: layer name.
        people: names of the people; default: all.

    Raises:
        ResultError: if the layer does not exist.
    """
    _, found = result.best_layer(layer)
    wanted = result.person_ids if people is None else tuple(people)
    index = [result.person_ids.index(name) for name in wanted]
    return StoredPoints(
        keypoints=result.skeleton.keypoints,
        person_ids=wanted,
        frame_numbers=result.frame_numbers,
        time_s=result.time_s,
        points_m=np.asarray(found.points_m[:])[:, index],
        unit=result.unit,
        layer=layer,
        rate_hz=result.rate_hz,
        covariance_m2=np.asarray(found.covariance_m2[:])[:, index],
        sd_m=found.sd_m[:, index],
        status=np.asarray(found.status[:])[:, index],
        source=np.asarray(found.source[:])[:, index],
        n_views=found.n_views[:, index],
        reprojection_error_px=np.asarray(found.reprojection_error_px[:])[:, index],
        view_names=result.rig.names,
        view_status=np.asarray(found.view_status[:])[:, index],
        view_error_px=np.asarray(found.view_error_px[:])[:, index],
    )
