"""Log a result to rerun: cameras, people, detections of each camera, time series.

Entities::

    world                                      the up axis
    world/inferred_up                          the up direction, if it was inferred from people
    world/cameras/<camera>                     pose and pinhole
    world/cameras/<camera>/video               the video, if given
    world/cameras/<camera>/detected/<label>    2D keypoints, if given: used, swapped, rejected, not_used, unassigned
    world/cameras/<camera>/reprojected/<layer>/<person>, .../bones    the best layer, with lens distortion
    world/fields/<camera>                      field of view of a lens with distortion
    world/people/<layer>/<person>, .../bones   in 3D
    series/error_px/<person>, series/views/<person>, series/speed_m_s/<person>

The timelines are ``frame`` (frame numbers of the recording) and ``time`` (seconds).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posefuse.errors import ResultError
from posefuse.model.cameras import Camera, LensModel
from posefuse.model.detections import Detections
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import LAYERS, Reconstruction
from posefuse.progress import Progress, Silent, report_ranges
from posefuse.skeleton.skeletons import Skeleton
from posefuse.visualize.colors import PAPER, REJECTED, UNASSIGNED, person_color
from posefuse.visualize.detection_labels import DetectionLabel, label_detections
from posefuse.visualize.frame_times import FrameTimes
from posefuse.visualize.viewer.library import import_rerun
from posefuse.visualize.viewer.series import speeds_m_s

_CHUNK_FRAMES = 512
_LAYER_OPACITY: Mapping[LayerName, int] = {"measured": 110, "solved": 180, "model": 255}
_LABEL_COLORS = {
    DetectionLabel.UNASSIGNED: UNASSIGNED,
    DetectionLabel.SWAPPED: PAPER,
    DetectionLabel.REJECTED: REJECTED,
    DetectionLabel.NOT_USED: UNASSIGNED,
}
_BORDER_STEPS = 24


@dataclass(frozen=True, eq=False)
class ViewerVideo:
    """A camera's video for the viewer.

    Attributes:
        content: content of an MP4 file.
        image_times_s: shape (image,): when each is shown, since the first, ascending.
        offset_s: the result's time at which it begins.
        by_number: whether the n-th image belongs to frame number n.
        first_s: time stamp of the first image in the file.
    """

    content: bytes
    image_times_s: np.ndarray
    offset_s: float = 0.0
    by_number: bool = False
    first_s: float = 0.0


def log_scene(
    recording: Any,
    result: Reconstruction,
    detections: Detections | None = None,
    videos: Mapping[str, ViewerVideo] | None = None,
    progress: Progress | None = None,
) -> None:
    """Log a result, one range of frames at a time.

    Args:
        recording: rerun's ``RecordingStream``.
        result: the result to show.
        detections: detections of the result's skeleton, with views in the order of its cameras.
        videos: videos by camera name.
        progress: receives the progress.

    Raises:
        ResultError: if the result comes from a single camera.
    """
    if result.unit != "m":
        raise ResultError(
            f"This result is in {result.unit}, in the image plane of a single camera. It has no 3D points to view."
        )
    frame_times = FrameTimes.of(result)
    _log_world(recording, result)
    for name, video in (videos or {}).items():
        _log_video(recording, name, video, frame_times)
    detections_frame_of = {} if detections is None else {n: i for i, n in enumerate(detections.frame_numbers.tolist())}
    first, before = 0, None
    for part in report_ranges(result.chunks(_CHUNK_FRAMES), result.n_frames, "logging", progress or Silent()):
        span = slice(first, first + part.n_frames)
        times = _time_columns(frame_times.numbers[span], frame_times.time_s[span])
        layers: list[LayerName] = [name for name in LAYERS if name in part.layers]
        for layer in layers:
            _log_people(recording, part, layer, times)
        _log_reprojections(recording, part, result.best_layer(result.options.layer)[0], times)
        if detections is not None:
            _log_detections(recording, part, detections, detections_frame_of, times)
        before = _log_series(recording, part, frame_times.time_s[span], times, before)
        first += part.n_frames


def person_path(name: str) -> str:
    """Return a name as one part of an entity path, without slashes."""
    return name.replace("/", "_").replace("\\", "_") or "_"


def _log_world(recording: Any, result: Reconstruction) -> None:
    rr = import_rerun()
    axes = {"x": (rr.ViewCoordinates.RIGHT_HAND_X_UP, rr.ViewCoordinates.RIGHT_HAND_X_DOWN),
            "y": (rr.ViewCoordinates.RIGHT_HAND_Y_UP, rr.ViewCoordinates.RIGHT_HAND_Y_DOWN),
            "z": (rr.ViewCoordinates.RIGHT_HAND_Z_UP, rr.ViewCoordinates.RIGHT_HAND_Z_DOWN)}  # fmt: skip
    up = result.rig.up_axis
    if up is not None:
        recording.log("world", axes[up[-1]][up.startswith("-")], static=True)
    if result.rig.inferred_up is not None:
        arrow = rr.Arrows3D(vectors=[result.rig.inferred_up.direction], labels=[f"up: {result.rig.up_text}"])
        recording.log("world/inferred_up", arrow, static=True)
    names = list(enumerate(result.skeleton.keypoints))
    people = [((p, person, person_color(p)), names) for p, person in enumerate(result.person_ids)]
    classes = [rr.ClassDescription(info=info, keypoint_annotations=keypoints) for info, keypoints in people]
    if classes:
        recording.log("world", rr.AnnotationContext(classes), static=True)
    depth_m = _frustum_m(result.rig.cameras)
    for camera in result.rig.cameras:
        path = f"world/cameras/{person_path(camera.name)}"
        pose = np.linalg.inv(camera.camera_from_world)
        recording.log(path, rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]), static=True)
        pinhole = rr.Pinhole(
            image_from_camera=camera.matrix, resolution=camera.size_px, image_plane_distance=depth_m,
            camera_xyz=rr.ViewCoordinates.RDF,
        )  # fmt: skip
        recording.log(path, pinhole, static=True)
        if camera.lens is not LensModel.PINHOLE:
            strips = [_field_m(camera, depth_m)]
            recording.log(
                f"world/fields/{person_path(camera.name)}", rr.LineStrips3D(strips, colors=[UNASSIGNED]), static=True
            )


def _frustum_m(cameras: Sequence[Camera]) -> float:
    centers = np.array([camera.center_m for camera in cameras])
    return 0.15 * float(np.median(np.linalg.norm(centers - np.median(centers, axis=0), axis=-1))) or 0.3


def _field_m(camera: Camera, depth_m: float) -> np.ndarray:
    """Return the border of the image, with lens distortion, on a sphere around the camera; shape (point, 3)."""
    width, height = camera.size_px
    along = np.linspace(0.0, 1.0, _BORDER_STEPS, endpoint=False)
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=float)
    ends = np.roll(corners, -1, axis=0)
    border = np.concatenate([a + along[:, None] * (b - a) for a, b in zip(corners, ends, strict=True)])
    rays, _ = camera.rays(np.concatenate([border, border[:1]]))
    rays = rays[np.isfinite(rays).all(axis=-1)]
    return camera.center_m + depth_m * rays @ camera.rotation


def _log_video(recording: Any, name: str, video: ViewerVideo, frame_times: FrameTimes) -> None:
    """Log the video file and the assignment of its images to frames."""
    rr = import_rerun()
    path = f"world/cameras/{person_path(name)}/video"
    recording.log(path, rr.AssetVideo(contents=video.content, media_type="video/mp4"), static=True)
    if video.by_number:
        wanted = np.round(frame_times.numbers + video.offset_s / frame_times.period_s).astype(np.int64)
        present = (wanted >= 0) & (wanted < len(video.image_times_s))
    else:
        wanted_s = frame_times.time_s - video.offset_s
        midpoints = (video.image_times_s[1:] + video.image_times_s[:-1]) / 2
        wanted = np.searchsorted(midpoints, wanted_s)
        present = np.abs(video.image_times_s[wanted] - wanted_s) <= 0.51 * max(
            frame_times.period_s, _step_s(video.image_times_s)
        )
    if not present.any():
        return
    shown_s = video.image_times_s[wanted[present]] + video.first_s
    columns = rr.VideoFrameReference.columns_nanos(np.round(shown_s * 1e9).astype(np.int64))
    recording.send_columns(path, _time_columns(frame_times.numbers[present], frame_times.time_s[present]), columns)


def _step_s(times_s: np.ndarray) -> float:
    return float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0


def _time_columns(numbers: np.ndarray, time_s: np.ndarray) -> list[Any]:
    rr = import_rerun()
    return [rr.TimeColumn("frame", sequence=numbers), rr.TimeColumn("time", duration=time_s)]


def _log_people(recording: Any, part: Reconstruction, layer: LayerName, times: list[Any]) -> None:
    rr = import_rerun()
    points = np.asarray(part.layers[layer].points_m)
    radius_m = 0.012 * _extent_m(points)
    for p, person in enumerate(part.person_ids):
        color = (*person_color(p), _LAYER_OPACITY[layer])
        path = f"world/people/{layer}/{person_path(person)}"
        style = {"colors": [color], "radii": [radius_m]}
        _send(recording, path, (rr.Points3D, rr.LineStrips3D), points[:, p], p, part.skeleton, times, style)


def _log_reprojections(recording: Any, part: Reconstruction, layer: LayerName, times: list[Any]) -> None:
    rr = import_rerun()
    points = np.asarray(part.layers[layer].points_m)
    for camera in part.rig.cameras:
        width, height = camera.size_px
        pixels = camera.project(points)[0]
        # Points far outside the image would make the view zoom out too far.
        near = np.all((pixels > [-width, -height]) & (pixels < [2 * width, 2 * height]), axis=-1, keepdims=True)
        pixels = np.where(near, pixels, np.nan)
        for p, person in enumerate(part.person_ids):
            path = f"world/cameras/{person_path(camera.name)}/reprojected/{layer}/{person_path(person)}"
            style = {"colors": [person_color(p)], "radii": [max(width, height) / 600]}
            _send(recording, path, (rr.Points2D, rr.LineStrips2D), pixels[:, p], p, part.skeleton, times, style)


def _extent_m(points: np.ndarray) -> float:
    """Return the size of people: the median largest side of their bounding boxes; 1 if there are no points."""
    present = np.isfinite(points).all(axis=-1)
    if not present.any():
        return 1.0
    some = np.isfinite(points).all(axis=-1).any(axis=-1)
    boxes = np.nanmax(points[some], axis=1) - np.nanmin(points[some], axis=1)
    return float(np.median(boxes.max(axis=-1))) or 1.0


def _send(
    recording: Any,
    path: str,
    kinds: tuple[Any, Any],
    points: np.ndarray,
    person: int,
    skeleton: Skeleton,
    times: list[Any],
    style: dict[str, list[Any]],
) -> None:
    """Send points of shape (frame, keypoint, n) and the lines between them; frames without points are sent empty."""
    dots, strips = kinds
    present = np.all(np.isfinite(points), axis=-1)
    if not present.any():
        return
    keypoints = np.broadcast_to(np.arange(len(skeleton)), present.shape)[present]
    recording.log(path, dots.from_fields(**style, class_ids=[person], show_labels=False), static=True)
    columns = dots.columns(positions=points[present], keypoint_ids=keypoints)
    recording.send_columns(path, times, columns.partition(present.sum(axis=1)))
    edges = skeleton.edge_indices
    if not len(edges):
        return
    joined = present[:, edges].all(axis=-1)
    lines = points[:, edges][joined]
    thin = {"colors": style["colors"], "radii": [style["radii"][0] / 2]}
    recording.log(f"{path}/bones", strips.from_fields(**thin), static=True)
    recording.send_columns(f"{path}/bones", times, strips.columns(strips=lines).partition(joined.sum(axis=1)))


def _log_detections(
    recording: Any,
    part: Reconstruction,
    detections: Detections,
    detections_frame_of: Mapping[int, int],
    times: list[Any],
) -> None:
    rr = import_rerun()
    label_layer: LayerName = "measured" if "measured" in part.layers else part.best_layer()[0]
    status = np.asarray(part.layers[label_layer].view_status)
    detections_frames = [detections_frame_of.get(number) for number in part.frame_numbers.tolist()]
    for v, camera in enumerate(part.rig.cameras):
        labeled = [
            None
            if detections_frame is None
            else label_detections(part, f, v, status[f, :, :, v], detections, detections_frame)
            for f, detections_frame in enumerate(detections_frames)
        ]
        for label in DetectionLabel:
            rows = [
                np.empty(0, dtype=np.int64) if each is None else np.flatnonzero(each.label == label) for each in labeled
            ]
            counts = [len(row) for row in rows]
            if not sum(counts):
                continue
            selected = [(each, row) for each, row in zip(labeled, rows, strict=True) if each is not None]
            pixels = np.concatenate([each.pixels[row] for each, row in selected])
            people = np.concatenate([each.person[row] for each, row in selected])
            colors = np.array(
                [_LABEL_COLORS.get(label, person_color(max(p, 0))) for p in people.tolist()], dtype=np.uint8
            )
            path = f"world/cameras/{person_path(camera.name)}/detected/{label.name.lower()}"
            radius_px = max(camera.size_px) / 450
            recording.log(path, rr.Points2D.from_fields(radii=[radius_px], draw_order=40.0), static=True)
            columns = rr.Points2D.columns(positions=pixels, colors=colors)
            recording.send_columns(path, times, columns.partition(counts))


def _log_series(
    recording: Any, part: Reconstruction, time_s: np.ndarray, times: list[Any], before: Any
) -> tuple[np.ndarray, float]:
    """Send the time series of each person of the best layer. Return the last points and time, for the next range."""
    rr = import_rerun()
    _, layer = part.best_layer()
    points = np.asarray(layer.points_m)
    errors = _mean(np.asarray(layer.reprojection_error_px), np.isfinite(np.asarray(layer.reprojection_error_px)))
    views = _mean(layer.n_views.astype(float), layer.has_point)
    speeds, after = speeds_m_s(points, time_s, before)
    for p, person in enumerate(part.person_ids):
        for what, values in (("error_px", errors), ("views", views), ("speed_m_s", speeds)):
            path = f"series/{what}/{person_path(person)}"
            recording.log(path, rr.SeriesLines(colors=[person_color(p)], names=[person]), static=True)
            recording.send_columns(path, times, rr.Scalars.columns(scalars=values[:, p]))
    return after


def _mean(values: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Return the mean over the keypoints that are present, NaN if there are none."""
    count = present.sum(axis=-1)
    return np.where(count > 0, np.where(present, values, 0.0).sum(axis=-1) / np.maximum(count, 1), np.nan)
