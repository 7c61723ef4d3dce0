"""Data of the report's 3D scene: people, cameras and ground."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.report.bodies import body_shapes
from posefuse.report.packing import (
    MARKED_VIEWS,
    PackingGrid,
    encode_per_person,
    fit_grid,
    is_measured,
    pack_covariances,
    pack_marks,
    pack_points,
)

SHOWN_FRAMES = 4000
"""Largest number of frames in the scene; longer recordings are subsampled, and the page states it."""
SHOWN_BYTES = 8_000_000
"""Largest size of the scene's data; larger scenes are subsampled, too."""


def display_stride(result: Reconstruction) -> int:
    """Return n such that every n-th frame is drawn."""
    views = len(result.rig) if len(result.rig) <= MARKED_VIEWS else 0
    point_bytes = 6 * len(result.layers) + 7 + (1 + views + 3) // 4
    frame_bytes = max(len(result.person_ids), 1) * len(result.skeleton) * point_bytes * 4 / 3
    max_frames = max(min(SHOWN_FRAMES, int(SHOWN_BYTES / frame_bytes)), 1)
    return max(1, -(-result.n_frames // max_frames))


def scene_data(
    result: Reconstruction,
    parts: Iterable[Reconstruction],
    layer: LayerName,
    truth_m: np.ndarray | None,
    stride: int,
) -> tuple[dict[str, Any], int]:
    """Return the JSON data of the scene, and the number of points too far away to be drawn.

    Args:
        result: the result to show.
        parts: its consecutive ranges of frames.
        layer: the layer shown first.
        truth_m: ground truth, shape (frame, person, keypoint, 3), NaN where unknown, or None.
        stride: the scene has every n-th frame.
    """
    shown, covariances, marks = _subsample(parts, layer, stride)
    grid = fit_grid(np.concatenate([points.reshape(-1, 3) for points in shown.values()]))
    layers, n_outside = [], 0
    for name in sorted(shown, key=lambda name: (name != layer, name)):
        packed = [pack_points(points, grid) for points in shown[name].swapaxes(0, 1)]
        layers.append({"name": name, "points": [text for text, _ in packed]})
        n_outside += sum(n for _, n in packed) if name == layer else 0
    scene = _static_data(result, grid, stride) | {
        "layers": layers,
        "covariances": [pack_covariances(values) for values in covariances.swapaxes(0, 1)],
        "marks": marks,
        "markedViews": len(result.rig) <= MARKED_VIEWS,
        "truth": _pack_truth(truth_m, grid, stride),
        "bodies": body_shapes(shown[layer], result.skeleton),
    }
    return scene, n_outside


def _static_data(result: Reconstruction, grid: PackingGrid, stride: int) -> dict[str, Any]:
    """Return what does not change from frame to frame."""
    metric = result.unit == "m"
    timed = bool(np.isfinite(result.time_s).all())
    return {
        "people": list(result.person_ids),
        "keypoints": list(result.skeleton.keypoints),
        "edges": result.skeleton.edge_indices.tolist(),
        "sides": [side_of(name) for name in result.skeleton.keypoints],
        "frames": result.frame_numbers[::stride].tolist(),
        "time": result.time_s[::stride].round(4).tolist() if timed else None,
        "stride": stride,
        "rate": (result.rate_hz or 30.0) / stride,
        "up": (result.rig.up_axis or "") if metric else "-y",
        "unit": result.unit,
        "origin": list(grid.origin),
        "step": grid.step,
        "cameras": frusta(result.rig, _depths_m(result.rig)) if metric else [],
    }


def _subsample(
    parts: Iterable[Reconstruction], layer: LayerName, stride: int
) -> tuple[dict[str, np.ndarray], np.ndarray, list[str]]:
    """Return every ``stride``-th frame: points of each layer, and covariances and marks of ``layer``."""
    points: dict[str, list[np.ndarray]] = {}
    covariances, marks = [], []
    first = 0
    for part in parts:
        indices = np.arange((-first) % stride, part.n_frames, stride)
        for name, values in part.layers.items():
            points.setdefault(name, []).append(np.asarray(values.points_m[:])[indices].astype(np.float32))
        covariances.append(np.asarray(part.layers[layer].covariance_m2[:])[indices].astype(np.float32))
        marks.append(pack_marks(part.layers[layer], measured_mask(part, layer), indices))
        first += part.n_frames
    joined = {name: np.concatenate(values) for name, values in points.items()}
    return joined, np.concatenate(covariances), encode_per_person(marks)


def measured_mask(part: Reconstruction, layer: LayerName) -> np.ndarray:
    """Return where points were measured in their own frame, for any layer; shape (frame, person, keypoint), bool."""
    chosen: Layer = part.layers["measured" if "measured" in part.layers else layer]
    return is_measured(chosen) & is_measured(part.layers[layer])


def _pack_truth(truth_m: np.ndarray | None, grid: PackingGrid, stride: int) -> list[str] | None:
    if truth_m is None:
        return None
    return [pack_points(person, grid)[0] for person in truth_m[::stride].swapaxes(0, 1)]


def side_of(name: str) -> str:
    """Return the side that the name of a keypoint states: left, right or middle."""
    if "left" in name:
        return "left"
    return "right" if "right" in name else "middle"


def _depths_m(rig: CameraRig) -> list[float]:
    """Return the depths of the pyramids that show cameras, by the distances between the cameras."""
    centers = np.array([camera.center_m for camera in rig.cameras])
    distance = float(np.median(np.linalg.norm(centers - np.median(centers, axis=0), axis=-1)))
    return [0.1 * distance or 0.4] * len(rig)


def frusta(rig: CameraRig, depths_m: Sequence[float]) -> list[dict[str, Any]]:
    """Return the cameras as pyramids of given depths."""
    return [_frustum(camera, depth) for camera, depth in zip(rig.cameras, depths_m, strict=True)]


def _frustum(camera: Camera, depth_m: float) -> dict[str, Any]:
    """Return a camera as a pyramid from its center to the image corners, with the parameters for projection."""
    width, height = camera.size_px
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64)
    rays, _ = camera.rays(corners)
    if camera.lens is LensModel.FISHEYE or not np.isfinite(rays).all():
        half = np.tan(np.radians(35))
        rays = np.array([[-half, -half, 1], [half, -half, 1], [half, half, 1], [-half, half, 1]])
    points = camera.center_m + (depth_m * rays / rays[:, 2:]) @ camera.rotation
    return {
        "name": camera.name,
        "center": _rounded(camera.center_m, 4),
        "corners": [_rounded(point, 4) for point in points],
        "size": [width, height],
        "matrix": _rounded(camera.matrix.ravel(), 6),
        "pose": _rounded(camera.camera_from_world[:3].ravel(), 9),
        "lens": str(camera.lens),
        "distortion": _rounded(np.array(camera.distortion), 9),
        "maxRadius": _max_radius(camera),
    }


def _max_radius(camera: Camera) -> float | None:
    """Return the radius up to which the lens model is valid, on the plane at depth 1 (angle for a fisheye), or None."""
    from posefuse.kernels.cameras.lens import MAX_RADIUS

    radius = float(camera.packed[MAX_RADIUS])
    return round(radius, 6) if np.isfinite(radius) else None


def _rounded(values: np.ndarray, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]
