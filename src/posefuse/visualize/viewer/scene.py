"""A result as a recording of rerun's viewer: cameras, people, what each camera saw, numbers over time.

Entities::

    world                                      the up axis
    world/cameras/<camera>                     pose and pinhole
    world/cameras/<camera>/video               the video, if given
    world/cameras/<camera>/detected/<fate>     2D keypoints, if given: used, swapped, rejected, not_used, nobody
    world/cameras/<camera>/reprojected/<layer>/<person>, .../bones    the best layer, through the true lens
    world/fields/<camera>                      what the true lens sees, where it is distorted
    world/people/<layer>/<person>, .../bones   in 3D
    series/error_px/<person>, series/views/<person>, series/speed_m_s/<person>

Timelines are ``frame`` (the recording's numbers) and ``time`` (seconds).
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
from posefuse.visualize.clock import Clock
from posefuse.visualize.colors import NOBODY, PAPER, REJECTED, colour_of
from posefuse.visualize.detection_labels import Fate, sightings
from posefuse.visualize.viewer.library import rerun
from posefuse.visualize.viewer.series import speeds_m_s

_CHUNK_FRAMES = 512
_LAYER_OPACITY: Mapping[LayerName, int] = {"measured": 110, "solved": 180, "model": 255}
_FATE_COLOURS = {Fate.NOBODY: NOBODY, Fate.SWAPPED: PAPER, Fate.REJECTED: REJECTED, Fate.NOT_USED: NOBODY}
_BORDER_STEPS = 24


@dataclass(frozen=True, eq=False)
class Footage:
    """A camera's video as the viewer plays it.

    Attributes:
        content: of an mp4 file.
        picture_s: shape (picture,): when each is shown, since the first, ascending.
        offset_s: the result's time at which it begins.
        by_number: whether the n-th picture belongs to frame number n.
        first_s: time stamp of the first picture in the file.
    """

    content: bytes
    picture_s: np.ndarray
    offset_s: float = 0.0
    by_number: bool = False
    first_s: float = 0.0


def log_scene(
    recording: Any,
    result: Reconstruction,
    detections: Detections | None = None,
    footage: Mapping[str, Footage] | None = None,
    progress: Progress | None = None,
) -> None:
    """Log all of a result, a range of frames at a time.

    Args:
        recording: rerun's ``RecordingStream``.
        result: to look at.
        detections: of the result's skeleton, views in the order of its cameras.
        footage: camera to its video.
        progress: told how far the work is.

    Raises:
        ResultError: if the result is of one flattened camera.
    """
    if result.unit != "m":
        raise ResultError(
            f"This result is in {result.unit}, one camera's image plane: it has no points in the world to view."
        )
    clock = Clock.of(result)
    _log_world(recording, result)
    for name, video in (footage or {}).items():
        _log_video(recording, name, video, clock)
    place_of = {} if detections is None else {n: i for i, n in enumerate(detections.frame_numbers.tolist())}
    first, before = 0, None
    for part in report_ranges(result.chunks(_CHUNK_FRAMES), result.n_frames, "logging", progress or Silent()):
        span = slice(first, first + part.n_frames)
        when = _when(clock.numbers[span], clock.time_s[span])
        layers: list[LayerName] = [name for name in LAYERS if name in part.layers]
        for layer in layers:
            _log_people(recording, part, layer, when)
        _log_reprojections(recording, part, result.best_layer(result.options.layer)[0], when)
        if detections is not None:
            _log_detections(recording, part, detections, place_of, when)
        before = _log_series(recording, part, clock.time_s[span], when, before)
        first += part.n_frames


def person_path(name: str) -> str:
    """A person or camera as a part of an entity's path: a slash would be a step down."""
    return name.replace("/", "_").replace("\\", "_") or "_"


def _log_world(recording: Any, result: Reconstruction) -> None:
    rr = rerun()
    axes = {"x": (rr.ViewCoordinates.RIGHT_HAND_X_UP, rr.ViewCoordinates.RIGHT_HAND_X_DOWN),
            "y": (rr.ViewCoordinates.RIGHT_HAND_Y_UP, rr.ViewCoordinates.RIGHT_HAND_Y_DOWN),
            "z": (rr.ViewCoordinates.RIGHT_HAND_Z_UP, rr.ViewCoordinates.RIGHT_HAND_Z_DOWN)}  # fmt: skip
    up = result.rig.up_axis
    if up is not None:
        recording.log("world", axes[up[-1]][up.startswith("-")], static=True)
    names = list(enumerate(result.skeleton.keypoints))
    people = [((p, person, colour_of(p)), names) for p, person in enumerate(result.person_ids)]
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
                f"world/fields/{person_path(camera.name)}", rr.LineStrips3D(strips, colors=[NOBODY]), static=True
            )


def _frustum_m(cameras: Sequence[Camera]) -> float:
    centres = np.array([camera.centre_m for camera in cameras])
    return 0.15 * float(np.median(np.linalg.norm(centres - np.median(centres, axis=0), axis=-1))) or 0.3


def _field_m(camera: Camera, depth_m: float) -> np.ndarray:
    """Shape (point, 3): the image's border as the true lens sees it, on a ball around the camera."""
    width, height = camera.size_px
    along = np.linspace(0.0, 1.0, _BORDER_STEPS, endpoint=False)
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=float)
    ends = np.roll(corners, -1, axis=0)
    border = np.concatenate([a + along[:, None] * (b - a) for a, b in zip(corners, ends, strict=True)])
    rays, _ = camera.rays(np.concatenate([border, border[:1]]))
    rays = rays[np.isfinite(rays).all(axis=-1)]
    return camera.centre_m + depth_m * rays @ camera.rotation


def _log_video(recording: Any, name: str, video: Footage, clock: Clock) -> None:
    """The file as it is, and which of its pictures belongs to each frame."""
    rr = rerun()
    path = f"world/cameras/{person_path(name)}/video"
    recording.log(path, rr.AssetVideo(contents=video.content, media_type="video/mp4"), static=True)
    if video.by_number:
        wanted = np.round(clock.numbers + video.offset_s / clock.period_s).astype(np.int64)
        there = (wanted >= 0) & (wanted < len(video.picture_s))
    else:
        wanted_s = clock.time_s - video.offset_s
        middles = (video.picture_s[1:] + video.picture_s[:-1]) / 2
        wanted = np.searchsorted(middles, wanted_s)
        there = np.abs(video.picture_s[wanted] - wanted_s) <= 0.51 * max(clock.period_s, _step_s(video.picture_s))
    if not there.any():
        return
    shown_s = video.picture_s[wanted[there]] + video.first_s
    columns = rr.VideoFrameReference.columns_nanos(np.round(shown_s * 1e9).astype(np.int64))
    recording.send_columns(path, _when(clock.numbers[there], clock.time_s[there]), columns)


def _step_s(times_s: np.ndarray) -> float:
    return float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0


def _when(numbers: np.ndarray, time_s: np.ndarray) -> list[Any]:
    rr = rerun()
    return [rr.TimeColumn("frame", sequence=numbers), rr.TimeColumn("time", duration=time_s)]


def _log_people(recording: Any, part: Reconstruction, layer: LayerName, when: list[Any]) -> None:
    rr = rerun()
    points = np.asarray(part.layers[layer].points_m)
    radius_m = 0.012 * _extent_m(points)
    for p, person in enumerate(part.person_ids):
        colour = (*colour_of(p), _LAYER_OPACITY[layer])
        path = f"world/people/{layer}/{person_path(person)}"
        look = {"colors": [colour], "radii": [radius_m]}
        _send(recording, path, (rr.Points3D, rr.LineStrips3D), points[:, p], p, part.skeleton, when, look)


def _log_reprojections(recording: Any, part: Reconstruction, layer: LayerName, when: list[Any]) -> None:
    rr = rerun()
    points = np.asarray(part.layers[layer].points_m)
    for camera in part.rig.cameras:
        width, height = camera.size_px
        pixels = camera.project(points)[0]
        # What lies far outside would make the view zoom out to nothing.
        near = np.all((pixels > [-width, -height]) & (pixels < [2 * width, 2 * height]), axis=-1, keepdims=True)
        pixels = np.where(near, pixels, np.nan)
        for p, person in enumerate(part.person_ids):
            path = f"world/cameras/{person_path(camera.name)}/reprojected/{layer}/{person_path(person)}"
            look = {"colors": [colour_of(p)], "radii": [max(width, height) / 600]}
            _send(recording, path, (rr.Points2D, rr.LineStrips2D), pixels[:, p], p, part.skeleton, when, look)


def _extent_m(points: np.ndarray) -> float:
    """How large people are: a typical largest side of their boxes; 1 where nobody is."""
    there = np.isfinite(points).all(axis=-1)
    if not there.any():
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
    when: list[Any],
    look: dict[str, list[Any]],
) -> None:
    """Points (frame, keypoint, n) and the lines between them; a frame without a point clears those before."""
    dots, strips = kinds
    there = np.all(np.isfinite(points), axis=-1)
    if not there.any():
        return
    keypoints = np.broadcast_to(np.arange(len(skeleton)), there.shape)[there]
    recording.log(path, dots.from_fields(**look, class_ids=[person], show_labels=False), static=True)
    columns = dots.columns(positions=points[there], keypoint_ids=keypoints)
    recording.send_columns(path, when, columns.partition(there.sum(axis=1)))
    edges = skeleton.edge_indices
    if not len(edges):
        return
    joined = there[:, edges].all(axis=-1)
    lines = points[:, edges][joined]
    thin = {"colors": look["colors"], "radii": [look["radii"][0] / 2]}
    recording.log(f"{path}/bones", strips.from_fields(**thin), static=True)
    recording.send_columns(f"{path}/bones", when, strips.columns(strips=lines).partition(joined.sum(axis=1)))


def _log_detections(
    recording: Any, part: Reconstruction, detections: Detections, place_of: Mapping[int, int], when: list[Any]
) -> None:
    rr = rerun()
    judge: LayerName = "measured" if "measured" in part.layers else part.best_layer()[0]
    status = np.asarray(part.layers[judge].view_status)
    places = [place_of.get(number) for number in part.frame_numbers.tolist()]
    for v, camera in enumerate(part.rig.cameras):
        seen = [
            None if place is None else sightings(part, f, v, status[f, :, :, v], detections, place)
            for f, place in enumerate(places)
        ]
        for fate in Fate:
            rows = [np.empty(0, dtype=np.int64) if each is None else np.flatnonzero(each.fate == fate) for each in seen]
            counts = [len(row) for row in rows]
            if not sum(counts):
                continue
            those = [(each, row) for each, row in zip(seen, rows, strict=True) if each is not None]
            pixels = np.concatenate([each.pixels[row] for each, row in those])
            whose = np.concatenate([each.person[row] for each, row in those])
            colours = np.array([_FATE_COLOURS.get(fate, colour_of(max(p, 0))) for p in whose.tolist()], dtype=np.uint8)
            path = f"world/cameras/{person_path(camera.name)}/detected/{fate.name.lower()}"
            radius_px = max(camera.size_px) / 450
            recording.log(path, rr.Points2D.from_fields(radii=[radius_px], draw_order=40.0), static=True)
            columns = rr.Points2D.columns(positions=pixels, colors=colours)
            recording.send_columns(path, when, columns.partition(counts))


def _log_series(
    recording: Any, part: Reconstruction, time_s: np.ndarray, when: list[Any], before: Any
) -> tuple[np.ndarray, float]:
    """Numbers of each person over time, of the best layer; returns what the next range's speed starts from."""
    rr = rerun()
    _, layer = part.best_layer()
    points = np.asarray(layer.points_m)
    errors = _mean(np.asarray(layer.reprojection_error_px), np.isfinite(np.asarray(layer.reprojection_error_px)))
    views = _mean(layer.n_views.astype(float), layer.has_point)
    speeds, after = speeds_m_s(points, time_s, before)
    for p, person in enumerate(part.person_ids):
        for what, values in (("error_px", errors), ("views", views), ("speed_m_s", speeds)):
            path = f"series/{what}/{person_path(person)}"
            recording.log(path, rr.SeriesLines(colors=[colour_of(p)], names=[person]), static=True)
            recording.send_columns(path, when, rr.Scalars.columns(scalars=values[:, p]))
    return after


def _mean(values: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Mean over keypoints where there is a value, NaN where there is none."""
    count = there.sum(axis=-1)
    return np.where(count > 0, np.where(there, values, 0.0).sum(axis=-1) / np.maximum(count, 1), np.nan)
