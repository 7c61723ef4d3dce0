"""What came out: people in 3D, in named layers, each number with a statement of how well it is known."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TypeVar

import numpy as np

from posefuse.arrays import ArrayRange, ArraySource, check_shape, frozen, ranges, same
from posefuse.errors import ResultError, choices
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import CHUNK_FRAMES
from posefuse.model.findings import Finding
from posefuse.model.label_swaps import Swaps
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import LayerName, Options
from posefuse.model.status import PointStatus, is_used
from posefuse.model.track_events import Event, Poses
from posefuse.model.tracks import Tracks
from posefuse.skeleton.skeletons import Skeleton

LAYERS: tuple[LayerName, ...] = ("measured", "solved", "model")
"""From the rawest to the most processed; exports take the last one present unless told otherwise."""

COVARIANCE_ENTRIES = ("xx", "xy", "xz", "yy", "yz", "zz")
_DIAGONAL = (0, 3, 5)


@dataclass(frozen=True, eq=False)
class Layer:
    """One kind of 3D points of all people.

    Attributes:
        points_m: shape (frame, person, keypoint, 3), NaN where missing.
        covariance_m2: shape (frame, person, keypoint, 6): xx, xy, xz, yy, yz, zz.
        status: shape (frame, person, keypoint), int8: :class:`PointStatus`.
        source: shape (frame, person, keypoint), int8: :class:`Source`.
        reprojection_error_px: shape (frame, person, keypoint): mean distance over the used views.
        view_status: shape (frame, person, keypoint, view), int8: :class:`ViewStatus`.
        view_error_px: shape (frame, person, keypoint, view), float32: distance in every view that has a detection,
            used or not; NaN where it has none.

    Raises:
        ResultError: where the arrays do not fit each other.
    """

    points_m: ArraySource
    covariance_m2: ArraySource
    status: ArraySource
    source: ArraySource
    reprojection_error_px: ArraySource
    view_status: ArraySource
    view_error_px: ArraySource

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

    def frames(self, start: int, stop: int) -> "Layer":
        """The frames ``start`` to ``stop``, in memory."""
        return Layer(*(np.asarray(getattr(self, f.name)[start:stop]) for f in fields(self)))

    @property
    def sd_m(self) -> np.ndarray:
        """Shape (frame, person, keypoint, 3): standard deviations along the axes."""
        return np.sqrt(np.asarray(self.covariance_m2[:])[..., _DIAGONAL])

    @property
    def n_views(self) -> np.ndarray:
        """Shape (frame, person, keypoint), int: views used."""
        return is_used(np.asarray(self.view_status[:])).sum(axis=-1)

    @property
    def has_point(self) -> np.ndarray:
        """Shape (frame, person, keypoint), bool: whether there are coordinates."""
        return np.asarray(self.status[:]) < PointStatus.NOT_SEEN

    @classmethod
    def concatenate(cls, parts: Sequence["Layer"]) -> "Layer":
        """Consecutive ranges of frames as one."""
        return cls(*(np.concatenate([getattr(part, f.name)[:] for part in parts]) for f in fields(cls)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Layer) and all(
            same(np.asarray(getattr(self, f.name)[:]), np.asarray(getattr(other, f.name)[:])) for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True)
class Provenance:
    """How a result was made; nothing that differs between two runs on the same input (no clock, host or path).

    Attributes:
        versions: program to version.
        inputs: what was read (by file name) to a hash of its content, where it came from files.
        notes: what readers and stages found worth saying, in order.
    """

    versions: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def with_notes(self, notes: Iterable[str]) -> "Provenance":
        """The same with more worth saying."""
        return replace(self, notes=(*self.notes, *notes))


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """People in 3D.

    Attributes:
        rig: the cameras, in the order of every view axis.
        skeleton: what the keypoint axis means.
        person_ids: names, in the order of every person axis.
        frame_numbers: shape (frame,), int64: numbers of the frames in the recording.
        time_s: shape (frame,): mean over the views that took the frame; NaN where unknown.
        layers: name to layer; see :data:`LAYERS`.
        tracks: which detection in which view was whose, or None for a result that was not made from detections.
        noise: how noisy the detections were taken to be, or None likewise.
        swaps: which views took left for right, or None where labels were believed.
        poses: how bodies stand, or None where no body was fitted.
        events: what happened to people, in order.
        rate_hz: nominal frame rate, or None where unknown.
        alignment: how the world follows from the calibration's, or None where it is the same.
        unit: ``m``; ``px`` for one flattened camera, whose image plane is no place in the world.
        options: options as the user requested them.
        resolved: the same options with every default resolved for this recording; ``options`` where it is not given.
        findings: problems that the recording check found, the most serious first.
        provenance: how it was made.

    Raises:
        ResultError: where the parts do not fit each other.
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "resolved", self.resolved or self.options)
        object.__setattr__(self, "findings", tuple(self.findings))
        object.__setattr__(self, "person_ids", tuple(self.person_ids))
        object.__setattr__(self, "frame_numbers", frozen(self.frame_numbers, np.int64))
        object.__setattr__(self, "time_s", frozen(self.time_s))
        object.__setattr__(self, "layers", dict(self.layers))
        object.__setattr__(self, "events", tuple(self.events))
        n_frames, n_people = len(self.frame_numbers), len(self.person_ids)
        check_shape(ResultError, "Reconstruction", "time_s", self.time_s, frame=n_frames)
        if not self.layers:
            raise ResultError(f"A reconstruction needs a layer: {choices(LAYERS)}.")
        for name, layer in self.layers.items():
            if name not in LAYERS:
                raise ResultError(f"No layer {name!r}; there are {choices(LAYERS)}.")
            expected = (n_frames, n_people, len(self.skeleton), 3)
            if tuple(layer.points_m.shape) != expected:
                raise ResultError(f"Layer {name!r}: expected points of shape {expected}, got {layer.points_m.shape}.")
            if layer.view_status.shape[-1] != len(self.rig):
                raise ResultError(
                    f"Layer {name!r} has {layer.view_status.shape[-1]} views, the rig {len(self.rig)} cameras."
                )
        if self.tracks is not None and self.tracks.person_ids != self.person_ids:
            raise ResultError(f"Tracks are of {self.tracks.person_ids}, the reconstruction of {self.person_ids}.")

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.frame_numbers)

    @property
    def retimed(self) -> np.ndarray:
        """Shape (frame, view), bool: which views' points were put between two of their frames, at the frame's time.

        By the offsets in the options; nowhere without any. Where a view's frames were too far apart for that it shows
        nothing.
        """
        if self.options.sync.does_nothing or not self.n_frames:
            return np.zeros((self.n_frames, len(self.rig)), dtype=bool)
        steps = np.diff(self.time_s)
        period = 1.0 / self.rate_hz if self.rate_hz else float(np.nanmedian(steps)) if len(steps) else np.nan
        return self.options.sync.time_shifted(self.rig.names, self.time_s, period)

    def best_layer(self, name: LayerName | None = None) -> tuple[LayerName, Layer]:
        """The named layer, or the most processed one present.

        Raises:
            ResultError: if the named layer is not there.
        """
        if name is None:
            name = next(layer for layer in reversed(LAYERS) if layer in self.layers)
        if name not in self.layers:
            raise ResultError(f"This result has no layer {name!r}; it has {choices(self.layers)}.")
        return name, self.layers[name]

    def frames(self, start: int, stop: int) -> "Reconstruction":
        """The frames ``start`` to ``stop`` (counted from 0), in memory."""
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
        )

    def chunks(self, size: int = CHUNK_FRAMES) -> Iterator["Reconstruction"]:
        """The result in consecutive ranges of frames, each in memory."""
        for start, stop in ranges(self.n_frames, size):
            yield self.frames(start, stop)

    def windows(self, size: int = CHUNK_FRAMES) -> Iterator["Reconstruction"]:
        """The same, each array read when it is first asked for; without poses."""
        for start, stop in ranges(self.n_frames, size):
            numbers = set(self.frame_numbers[start:stop].tolist())
            yield replace(
                self,
                frame_numbers=self.frame_numbers[start:stop],
                time_s=self.time_s[start:stop],
                events=tuple(event for event in self.events if event.number in numbers),
                layers={name: _stretch(layer, start, stop) for name, layer in self.layers.items()},
                tracks=None if self.tracks is None else _stretch(self.tracks, start, stop),
                swaps=None if self.swaps is None else _stretch(self.swaps, start, stop),
                poses=None,
            )

    @classmethod
    def concatenate(cls, parts: Sequence["Reconstruction"]) -> "Reconstruction":
        """Consecutive ranges of frames as one."""
        first = parts[0]
        return replace(
            first,
            frame_numbers=np.concatenate([part.frame_numbers for part in parts]),
            time_s=np.concatenate([part.time_s for part in parts]),
            layers={name: Layer.concatenate([part.layers[name] for part in parts]) for name in first.layers},
            tracks=None if first.tracks is None else Tracks.concatenate([part.tracks for part in parts if part.tracks]),
            swaps=None if first.swaps is None else Swaps.concatenate([part.swaps for part in parts if part.swaps]),
            poses=None if first.poses is None else Poses.concatenate([part.poses for part in parts if part.poses]),
            # A maker of ranges may know of events before it comes to them, and say them twice.
            events=tuple(dict.fromkeys(event for part in parts for event in part.events)),
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Reconstruction) and all(
            same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]


def unpack_covariance(entries: np.ndarray) -> np.ndarray:
    """Matrices of packed covariances: (..., 6) to (..., 3, 3)."""
    return np.asarray(entries)[..., [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


_Noun = TypeVar("_Noun", Layer, Tracks, Swaps)


def _stretch(noun: _Noun, start: int, stop: int) -> _Noun:
    """Some frames of a noun, each array read when it is first asked for."""
    arrays = {each.name: getattr(noun, each.name) for each in fields(noun)}
    cut = {name: ArrayRange(a, start, stop) for name, a in arrays.items() if not isinstance(a, tuple)}
    return replace(noun, **cut)
