"""The 3D scene: what is drawn of people, cameras and ground."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from posefuse.model.cameras import Camera, LensModel
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.report.packing import (
    MARKED_VIEWS,
    Box,
    box_of,
    by_person,
    is_measured,
    packed_marks,
    packed_points,
    packed_spreads,
)

SHOWN_FRAMES = 4000
"""A longer recording is thinned to at most this many frames for display, and the page says so."""
SHOWN_BYTES = 8_000_000
"""So is one whose scene would be larger than this."""


def stride_of(result: Reconstruction) -> int:
    """Every how many frames are drawn."""
    views = len(result.rig) if len(result.rig) <= MARKED_VIEWS else 0
    point_bytes = 6 * len(result.layers) + 7 + (1 + views + 3) // 4
    frame_bytes = max(len(result.person_ids), 1) * len(result.skeleton) * point_bytes * 4 / 3
    most = max(min(SHOWN_FRAMES, int(SHOWN_BYTES / frame_bytes)), 1)
    return max(1, -(-result.n_frames // most))


def scene_data(
    result: Reconstruction,
    parts: Iterable[Reconstruction],
    layer: LayerName,
    truth: Reconstruction | None,
    stride: int,
) -> tuple[dict[str, Any], int]:
    """What the page draws the scene from, and how many points lie too far out to be drawn.

    Args:
        result: what to show.
        parts: of it, consecutive ranges of frames.
        layer: which is shown first.
        truth: known positions, drawn where they are of the same frames and keypoints.
        stride: every how many frames are drawn.
    """
    shown, spreads, marks = _thinned(parts, layer, stride)
    box = box_of(np.concatenate([points.reshape(-1, 3) for points in shown.values()]))
    layers, strays = [], 0
    for name in sorted(shown, key=lambda name: (name != layer, name)):
        packed = [packed_points(points, box) for points in shown[name].swapaxes(0, 1)]
        layers.append({"name": name, "points": [text for text, _ in packed]})
        strays += sum(n for _, n in packed) if name == layer else 0
    scene = _still(result, box, stride) | {
        "layers": layers,
        "spreads": [packed_spreads(values) for values in spreads.swapaxes(0, 1)],
        "marks": marks,
        "markedViews": len(result.rig) <= MARKED_VIEWS,
        "truth": _truth(result, truth, box, stride),
    }
    return scene, strays


def _still(result: Reconstruction, box: Box, stride: int) -> dict[str, Any]:
    """All that does not move."""
    metric = result.unit == "m"
    timed = bool(np.isfinite(result.time_s).all())
    return {
        "people": list(result.person_ids),
        "keypoints": list(result.skeleton.keypoints),
        "edges": result.skeleton.edge_indices.tolist(),
        "sides": [_side(name) for name in result.skeleton.keypoints],
        "frames": result.frame_numbers[::stride].tolist(),
        "time": result.time_s[::stride].round(4).tolist() if timed else None,
        "stride": stride,
        "rate": (result.rate_hz or 30.0) / stride,
        "up": (result.rig.up_axis or "") if metric else "-y",
        "unit": result.unit,
        "middle": list(box.middle),
        "step": box.step,
        "cameras": _frusta(result) if metric else [],
    }


def _thinned(
    parts: Iterable[Reconstruction], layer: LayerName, stride: int
) -> tuple[dict[str, np.ndarray], np.ndarray, list[str]]:
    """Every stride-th frame: points of each layer, covariances of the shown one, and its marks."""
    points: dict[str, list[np.ndarray]] = {}
    spreads, marks = [], []
    first = 0
    for part in parts:
        places = np.arange((-first) % stride, part.n_frames, stride)
        for name, values in part.layers.items():
            points.setdefault(name, []).append(np.asarray(values.points_m[:])[places].astype(np.float32))
        spreads.append(np.asarray(part.layers[layer].covariance_m2[:])[places].astype(np.float32))
        marks.append(packed_marks(part.layers[layer], measured_in(part, layer), places))
        first += part.n_frames
    joined = {name: np.concatenate(values) for name, values in points.items()}
    return joined, np.concatenate(spreads), by_person(marks)


def measured_in(part: Reconstruction, layer: LayerName) -> np.ndarray:
    """Shape (frame, person, keypoint), bool: what was measured in its own frame, whatever layer is shown."""
    chosen: Layer = part.layers["measured" if "measured" in part.layers else layer]
    return is_measured(chosen) & is_measured(part.layers[layer])


def _truth(result: Reconstruction, truth: Reconstruction | None, box: Box, stride: int) -> list[str] | None:
    if truth is None or truth.n_frames != result.n_frames or truth.skeleton.keypoints != result.skeleton.keypoints:
        return None
    _, layer = truth.best_layer()
    points = np.asarray(layer.points_m[:])[::stride].swapaxes(0, 1)
    return [packed_points(person, box)[0] for person in points]


def _side(name: str) -> str:
    if "left" in name:
        return "left"
    return "right" if "right" in name else "middle"


def _frusta(result: Reconstruction) -> list[dict[str, Any]]:
    """The cameras, drawn as large as suits how far apart they stand."""
    centres = np.array([camera.centre_m for camera in result.rig.cameras])
    spread = float(np.median(np.linalg.norm(centres - np.median(centres, axis=0), axis=-1)))
    return [_frustum(camera, 0.1 * spread or 0.4) for camera in result.rig.cameras]


def _frustum(camera: Camera, depth_m: float) -> dict[str, Any]:
    """A camera as a pyramid, the image's corners a little in front of its centre, and all that projecting takes."""
    width, height = camera.size_px
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64)
    rays, _ = camera.rays(corners)
    if camera.lens is LensModel.FISHEYE or not np.isfinite(rays).all():
        half = np.tan(np.radians(35))
        rays = np.array([[-half, -half, 1], [half, -half, 1], [half, half, 1], [-half, half, 1]])
    points = camera.centre_m + (depth_m * rays / rays[:, 2:]) @ camera.rotation
    return {
        "name": camera.name,
        "centre": _rounded(camera.centre_m, 4),
        "corners": [_rounded(point, 4) for point in points],
        "size": [width, height],
        "matrix": _rounded(camera.matrix.ravel(), 6),
        "pose": _rounded(camera.camera_from_world[:3].ravel(), 9),
        "lens": str(camera.lens),
        "distortion": _rounded(np.array(camera.distortion), 9),
        "reach": _reach(camera),
    }


def _reach(camera: Camera) -> float | None:
    """How far from the axis the lens model holds: a radius on the plane at depth 1 (of a fisheye an angle), or None."""
    from posefuse.kernels.cameras.lens import MAX_RADIUS

    radius = float(camera.packed[MAX_RADIUS])
    return round(radius, 6) if np.isfinite(radius) else None


def _rounded(values: np.ndarray, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]
