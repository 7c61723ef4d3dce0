"""Result of a reconstruction: 3D people in named layers, with the uncertainty of each number."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TypeVar

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import ArrayRange, check_shape, frozen, in_memory, ranges, same
from posefuse.described import Described, Description, count, names
from posefuse.errors import LayerError, ResultError, choices, suggestion
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import CHUNK_FRAMES
from posefuse.model.findings import Finding
from posefuse.model.in_python import InPython
from posefuse.model.joint_angles import JointAngles
from posefuse.model.label_swaps import Swaps
from posefuse.model.layer_scores import LayerScore, layer_of_scores
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import LayerName, Options
from posefuse.model.status import PointStatus, is_used
from posefuse.model.track_events import Event, Poses
from posefuse.model.tracks import Tracks
from posefuse.skeleton.skeletons import Skeleton

LAYERS: tuple[LayerName, ...] = ("measured", "solved", "model")
"""Layers from least to most processed; without scores, exports use the last one present by default."""

COVARIANCE_ENTRIES = ("xx", "xy", "xz", "yy", "yz", "zz")
_DIAGONAL = (0, 3, 5)


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Layer(Described):
    """3D points of all people at one processing stage.

    Attributes:
        points_m: shape (frame, person, keypoint, 3), NaN where missing.
        covariance_m2: shape (frame, person, keypoint, 6): xx, xy, xz, yy, yz, zz.
        status: shape (frame, person, keypoint), int8: :class:`PointStatus`.
        source: shape (frame, person, keypoint), int8: :class:`Source`.
        reprojection_error_px: shape (frame, person, keypoint): mean reprojection error over the used views.
        view_status: shape (frame, person, keypoint, view), int8: :class:`ViewStatus`.
        view_error_px: shape (frame, person, keypoint, view), float32: reprojection error in every view with a
            detection, used or not; NaN without a detection.

    Raises:
        ResultError: if the shapes of the arrays disagree.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    status: np.ndarray
    source: np.ndarray
    reprojection_error_px: np.ndarray
    view_status: np.ndarray
    view_error_px: np.ndarray

    def __post_init__(self) -> None:
        if len(self.points_m.shape) != 4:
            raise ResultError(f"Layer.points_m: expected (frame, person, keypoint, 3), got {self.points_m.shape}.")
        frame, person, keypoint, _ = self.points_m.shape
        view = self.view_status.shape[-1]
        points = {"frame": frame, "person": person, "keypoint": keypoint}
        check_shape(ResultError, "Layer", "points_m", self.points_m, **points, xyz=3)
        check_shape(ResultError, "Layer", "covariance_m2", self.covariance_m2, **points, entry=6)
        for name in ("status", "source", "reprojection_error_px"):
            check_shape(ResultError, "Layer", name, getattr(self, name), **points)
        for name in ("view_status", "view_error_px"):
            check_shape(ResultError, "Layer", name, getattr(self, name), **points, view=view)

    def _description(self) -> Description:
        frame, person, keypoint, _ = self.points_m.shape
        size = f"{count(frame, 'frame')}, {count(person, 'subject')}, {count(keypoint, 'keypoint')}"
        rows: list[tuple[str, str]] = [("views", str(self.view_status.shape[-1]))]
        if in_memory(self.points_m) and self.has_point.size:
            sds = np.sqrt(np.square(self.sd_m[self.has_point]).mean(axis=-1))
            rows += [("with points", f"{100.0 * self.has_point.mean():.1f} %")]
            rows += [("median sd", f"{format_length(float(np.nanmedian(sds)))} per axis")] if len(sds) else []
        return Description(f"Layer: {size}", tuple(rows))

    def frames(self, start: int, stop: int) -> "Layer":
        """Return the frames from ``start`` to ``stop`` (excluded), in memory."""
        return Layer(*(np.asarray(getattr(self, f.name)[start:stop]) for f in fields(self)))

    @property
    def sd_m(self) -> np.ndarray:
        """Standard deviations along x, y and z of the world, shape (frame, person, keypoint, 3)."""
        return np.sqrt(np.asarray(self.covariance_m2[:])[..., _DIAGONAL])

    @property
    def n_views(self) -> np.ndarray:
        """Number of used views, shape (frame, person, keypoint), int."""
        return is_used(np.asarray(self.view_status[:])).sum(axis=-1)

    @property
    def has_point(self) -> np.ndarray:
        """Whether a point has coordinates, shape (frame, person, keypoint), bool."""
        return np.asarray(self.status[:]) < PointStatus.NOT_SEEN

    @classmethod
    def concatenate(cls, parts: Sequence["Layer"]) -> "Layer":
        """Concatenate consecutive ranges of frames."""
        return cls(*(np.concatenate([getattr(part, f.name)[:] for part in parts]) for f in fields(cls)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Layer) and all(
            same(np.asarray(getattr(self, f.name)[:]), np.asarray(getattr(other, f.name)[:])) for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]


_HOW_TO_GET = {
    "measured": "The file that was read holds no points of single frames.",
    "solved": "By default, points are solved over time with frame times, two or more cameras, half a second or more, "
    "and the method 'consensus'. Set `solve='trajectory'`, `postprocess.fill` or `postprocess.smooth` to get this "
    "layer.",
    "model": "By default, bodies are fitted to several people whose skeleton has a kinematic tree. Set `bodies='fit'` "
    "to get this layer.",
}
"""Layer to what its absence means."""


class Layers(dict[str, Layer]):
    """Layers by name; the name of a layer that does not exist raises an error that states the reason."""

    def __missing__(self, name: str) -> Layer:
        if name not in LAYERS:
            raise LayerError(f"There is no layer {name!r}. {suggestion(str(name), LAYERS)}")
        raise LayerError(
            f"This result has no layer {name!r}; it has {choices(self)}. {_HOW_TO_GET[name]} best_layer() returns the "
            "best layer of any result."
        )


@dataclass(frozen=True)
class Provenance:
    """Origin of a result. Holds nothing that differs between two runs on the same input (no time, host or path).

    Attributes:
        versions: program -> version.
        inputs: name of each input file -> hash of its content.
        notes: notes of readers and stages, in order.
    """

    versions: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def with_notes(self, notes: Iterable[str]) -> "Provenance":
        """Return a copy with additional notes."""
        return replace(self, notes=(*self.notes, *notes))


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Reconstruction(Described, InPython):
    """3D people of a recording.

    Attributes:
        rig: cameras, in the order of every view axis.
        skeleton: skeleton of the keypoint axis.
        person_ids: names of people, in the order of every person axis.
        frame_numbers: shape (frame,), int64: numbers of the frames in the recording.
        time_s: shape (frame,): mean time over the views that recorded the frame; NaN if unknown.
        layers: ``measured``, ``solved`` and ``model`` -> layer, as far as they exist. Access to one that does not exist
            raises a LayerError, which is also a KeyError and states how to get the layer.
        tracks: detection of each person in each view, or None for a result that was not made from detections.
        noise: noise model of the detections, or None for a result that was not made from detections.
        swaps: left/right swaps by view, or None if left/right labels were accepted as given.
        poses: body poses, or None if no body was fitted.
        events: events of tracks and cameras, in order.
        rate_hz: nominal frame rate, or None if unknown.
        alignment: transform from the calibration's world, or None if the worlds are the same.
        unit: ``m``; ``px`` for a single flattened camera, whose points are in its image plane.
        options: options as the user requested them.
        resolved: the same options with every default resolved for this recording; ``options`` by default.
        findings: problems found by the recording check, most serious first.
        provenance: origin of the result.
        layer_scores: how well each layer predicts left-out views; empty if the layers were not compared.
        joint_angles: angles in degrees; None with one camera, unrelated frames, or a skeleton without limbs.

    Raises:
        ResultError: if the parts do not match.
    """

    rig: CameraRig
    skeleton: Skeleton
    person_ids: tuple[str, ...]
    frame_numbers: np.ndarray
    time_s: np.ndarray
    layers: Mapping[str, Layer]
    tracks: Tracks | None = None
    noise: NoiseModel | None = None
    swaps: Swaps | None = None
    poses: Poses | None = None
    events: tuple[Event, ...] = ()
    rate_hz: float | None = None
    alignment: Alignment | None = None
    unit: str = "m"
    options: Options = field(default_factory=Options)
    provenance: Provenance = field(default_factory=Provenance)
    resolved: Options = None  # type: ignore[assignment]
    findings: tuple[Finding, ...] = ()
    layer_scores: tuple[LayerScore, ...] = ()
    joint_angles: JointAngles | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "resolved", self.resolved or self.options)
        object.__setattr__(self, "findings", tuple(self.findings))
        object.__setattr__(self, "person_ids", tuple(self.person_ids))
        object.__setattr__(self, "frame_numbers", frozen(self.frame_numbers, np.int64))
        object.__setattr__(self, "time_s", frozen(self.time_s))
        object.__setattr__(self, "layers", Layers(self.layers))
        object.__setattr__(self, "events", tuple(self.events))
        n_frames, n_people = len(self.frame_numbers), len(self.person_ids)
        check_shape(ResultError, "Reconstruction", "time_s", self.time_s, frame=n_frames)
        if not self.layers:
            raise ResultError(f"A reconstruction needs at least one layer: {choices(LAYERS)}.")
        for name, layer in self.layers.items():
            if name not in LAYERS:
                raise ResultError(f"Unknown layer {name!r}; the layers are {choices(LAYERS)}.")
            expected = (n_frames, n_people, len(self.skeleton), 3)
            if tuple(layer.points_m.shape) != expected:
                raise ResultError(f"Layer {name!r}: expected points of shape {expected}, got {layer.points_m.shape}.")
            if layer.view_status.shape[-1] != len(self.rig):
                raise ResultError(
                    f"Layer {name!r} has {layer.view_status.shape[-1]} views, but the rig has {len(self.rig)} cameras."
                )
        if self.tracks is not None and self.tracks.person_ids != self.person_ids:
            raise ResultError(
                f"The tracks have the people {self.tracks.person_ids}, but the result has {self.person_ids}."
            )

    def _description(self) -> Description:
        rate = f" at {self.rate_hz:g} Hz" if self.rate_hz else ""
        default, _ = self.best_layer(self.options.layer)
        title = (
            f"Reconstruction: {count(self.n_frames, 'frame')}{rate}, {count(len(self.person_ids), 'subject')}, "
            f"{count(len(self.skeleton), 'keypoint')}, {count(len(self.rig), 'camera')}"
        )
        listed = (f"{name} (default)" if name == default else name for name in self.layers)
        rows = [
            ("subjects", names(self.person_ids) or "none"),
            ("skeleton", self.skeleton.name),
            ("cameras", names(self.rig.names)),
            ("layers", ", ".join(listed)),
        ]
        if self.joint_angles is not None:
            angles = self.joint_angles
            rows.append(("angles", f"{len(angles.names)} ({', '.join(dict.fromkeys(angles.conventions))})"))
        rows.append(("findings", names([finding.kind for finding in self.findings]) or "none"))
        if self.provenance.notes:
            rows.append(("notes", f"{len(self.provenance.notes)} in provenance.notes"))
        return Description(title, tuple(rows))

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.frame_numbers)

    @property
    def has_identities(self) -> bool:
        """Whether a person of one frame is the same in the others, which does not hold for unrelated still frames."""
        return self.resolved.people != "stills"

    @property
    def retimed(self) -> np.ndarray:
        """Whether a view's points were interpolated in time to the frame's time, shape (frame, view), bool.

        True where the time offsets in the options require it. A view whose frames are too far apart to interpolate has
        no points there.
        """
        if self.options.sync.does_nothing or not self.n_frames:
            return np.zeros((self.n_frames, len(self.rig)), dtype=bool)
        steps = np.diff(self.time_s)
        period = 1.0 / self.rate_hz if self.rate_hz else float(np.nanmedian(steps)) if len(steps) else np.nan
        return self.options.sync.time_shifted(self.rig.names, self.time_s, period)

    def best_layer(self, name: LayerName | None = None) -> tuple[LayerName, Layer]:
        """Return the named layer, or the one that predicts left-out views best, with its name.

        Where the layers were not compared, the default is the most processed one present, but the model only if it
        covers at least half of the keypoints that have an edge.

        Raises:
            LayerError: if the named layer does not exist.
        """
        if name is None:
            scored = layer_of_scores(self.layer_scores)
            name = scored if scored in self.layers else None
        if name is None:
            with_edge = len(set(self.skeleton.edge_indices.ravel().tolist()))
            sparse = 2 * len(self.skeleton.unmodeled) > with_edge
            present: list[LayerName] = [layer for layer in LAYERS if layer in self.layers]
            name = present[-2] if sparse and present[-1] == "model" and len(present) > 1 else present[-1]
        return name, self.layers[name]

    def frames(self, start: int, stop: int) -> "Reconstruction":
        """Return the frames from index ``start`` to ``stop`` (excluded), in memory."""
        start, stop, _ = slice(start, stop).indices(self.n_frames)
        numbers = set(self.frame_numbers[start:stop].tolist())
        return replace(
            self,
            frame_numbers=self.frame_numbers[start:stop],
            time_s=self.time_s[start:stop],
            events=tuple(event for event in self.events if event.number in numbers),
            layers={name: layer.frames(start, stop) for name, layer in self.layers.items()},
            tracks=None if self.tracks is None else self.tracks.frames(start, stop),
            swaps=None if self.swaps is None else self.swaps.frames(start, stop),
            poses=None if self.poses is None else self.poses.frames(start, stop),
            joint_angles=None if self.joint_angles is None else self.joint_angles.frames(start, stop),
        )

    def chunks(self, size: int = CHUNK_FRAMES) -> Iterator["Reconstruction"]:
        """Yield consecutive ranges of frames, each in memory."""
        for start, stop in ranges(self.n_frames, size):
            yield self.frames(start, stop)

    def windows(self, size: int = CHUNK_FRAMES) -> Iterator["Reconstruction"]:
        """Yield consecutive ranges of frames whose arrays are read on first access; without poses."""
        for start, stop in ranges(self.n_frames, size):
            numbers = set(self.frame_numbers[start:stop].tolist())
            yield replace(
                self,
                frame_numbers=self.frame_numbers[start:stop],
                time_s=self.time_s[start:stop],
                events=tuple(event for event in self.events if event.number in numbers),
                layers={name: _lazy_frames(layer, start, stop) for name, layer in self.layers.items()},
                tracks=None if self.tracks is None else _lazy_frames(self.tracks, start, stop),
                swaps=None if self.swaps is None else _lazy_frames(self.swaps, start, stop),
                poses=None,
                joint_angles=None if self.joint_angles is None else self.joint_angles.window(start, stop),
            )

    @classmethod
    def concatenate(cls, parts: Sequence["Reconstruction"]) -> "Reconstruction":
        """Concatenate consecutive ranges of frames."""
        first = parts[0]
        return replace(
            first,
            frame_numbers=np.concatenate([part.frame_numbers for part in parts]),
            time_s=np.concatenate([part.time_s for part in parts]),
            layers={name: Layer.concatenate([part.layers[name] for part in parts]) for name in first.layers},
            tracks=None if first.tracks is None else Tracks.concatenate([part.tracks for part in parts if part.tracks]),
            swaps=None if first.swaps is None else Swaps.concatenate([part.swaps for part in parts if part.swaps]),
            poses=None if first.poses is None else Poses.concatenate([part.poses for part in parts if part.poses]),
            joint_angles=None
            if first.joint_angles is None
            else JointAngles.concatenate([part.joint_angles for part in parts if part.joint_angles]),
            # A producer of ranges may report an event early, and again in its own range.
            events=tuple(dict.fromkeys(event for part in parts for event in part.events)),
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Reconstruction) and all(
            same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]


def unpack_covariance(entries: np.ndarray) -> np.ndarray:
    """Return covariance matrices, shape (..., 3, 3), from packed entries, shape (..., 6)."""
    return np.asarray(entries)[..., [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def pack_covariance(matrices: np.ndarray) -> np.ndarray:
    """Return the entries xx xy xz yy yz zz, shape (..., 6), of covariance matrices, shape (..., 3, 3)."""
    return np.asarray(matrices)[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]


def format_length(length_m: float) -> str:
    """Return a length with three digits, in mm below 1 m."""
    return f"{1000.0 * length_m:.3g} mm" if abs(length_m) < 1.0 else f"{length_m:.3g} m"


_Record = TypeVar("_Record", Layer, Tracks, Swaps)


def _lazy_frames(record: _Record, start: int, stop: int) -> _Record:
    """Return a range of frames of a record, with arrays that are read on first access."""
    arrays = {each.name: getattr(record, each.name) for each in fields(record)}
    cut = {name: ArrayRange(a, start, stop) for name, a in arrays.items() if not isinstance(a, tuple)}
    return replace(record, **cut)
