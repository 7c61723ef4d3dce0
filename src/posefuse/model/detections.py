"""2D keypoints of a recording: any number of detections per view and frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from posefuse.arguments import Shape, checked
from posefuse.arrays import ArraySource, check_shape, frozen, in_memory, ranges, same
from posefuse.described import Described, Description
from posefuse.errors import DetectionsError, MatchError, choices, suggestion
from posefuse.model.descriptions import describe_detections
from posefuse.model.lazy_rows import chosen_rows
from posefuse.skeleton.skeletons import Skeleton

CHUNK_FRAMES = 2048
"""Default number of frames that a stage processes at a time."""


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Detections(Described):
    """The detections of all views of a recording: one row per detection.

    Rows are ordered by frame, then view: those of frame f (index from 0) and view v are
    ``offsets[f * views + v]`` to ``offsets[f * views + v + 1]``. Long arrays may stay in files; then
    :meth:`frames` loads a range into memory.

    Attributes:
        skeleton: skeleton of the keypoint axis.
        view_names: names of the views, in order.
        frame_numbers: shape (frame,), int64, increasing: frame numbers of the recording.
        time_s: shape (frame, view): capture times; NaN where a view has no frame, and everywhere if the files
            give neither times nor a rate.
        offsets: shape (frame * view + 1,), int64: first row of each frame and view.
        keypoints_px: shape (row, keypoint, 2), NaN where not detected.
        confidence: shape (row, keypoint): the detector's score as read; NaN without one.
        recorded: shape (frame, view), bool: whether the view has the frame.
        track_ids: shape (row,), int64: the detector's identity in this view, -1 without one.
        depth: shape (row, keypoint): the detector's depth estimate in its own unit, or None.
        sigma_px: shape (row, keypoint): the detector's standard deviation of each keypoint, px per axis, NaN
            without one; or None. It weights the detections.
        rate_hz: nominal frame rate, or None if unknown.
        notes: notes of the reader.

    Raises:
        DetectionsError: if the arrays do not match or contain infinities.
    """

    skeleton: Skeleton
    view_names: tuple[str, ...]
    frame_numbers: np.ndarray
    time_s: np.ndarray
    offsets: np.ndarray
    keypoints_px: np.ndarray
    confidence: np.ndarray
    recorded: np.ndarray
    track_ids: np.ndarray
    depth: np.ndarray | None = None
    sigma_px: np.ndarray | None = None
    rate_hz: float | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "view_names", tuple(self.view_names))
        object.__setattr__(self, "frame_numbers", frozen(self.frame_numbers, np.int64))
        object.__setattr__(self, "time_s", frozen(self.time_s))
        object.__setattr__(self, "offsets", frozen(self.offsets, np.int64))
        object.__setattr__(self, "recorded", frozen(self.recorded, np.bool_))
        self._check_axes()
        self._check_index()
        if in_memory(self.keypoints_px):
            self._check_numbers()

    def _description(self) -> Description:
        return describe_detections(self)

    def _check_axes(self) -> None:
        n_frames, n_views, n_keypoints = len(self.frame_numbers), len(self.view_names), len(self.skeleton)
        repeated = sorted({name for name in self.view_names if self.view_names.count(name) > 1})
        if repeated or not self.view_names:
            raise DetectionsError(f"At least one view is needed, with unique names; got {choices(self.view_names)}.")

        def check(name: str, source: ArraySource, **axes: int) -> None:
            check_shape(DetectionsError, "Detections", name, source, **axes)

        check("time_s", self.time_s, frame=n_frames, view=n_views)
        check("recorded", self.recorded, frame=n_frames, view=n_views)
        check("offsets", self.offsets, frame_view_plus_1=n_frames * n_views + 1)
        rows = int(self.offsets[-1])
        check("keypoints_px", self.keypoints_px, row=rows, keypoint=n_keypoints, pixel=2)
        check("confidence", self.confidence, row=rows, keypoint=n_keypoints)
        check("track_ids", self.track_ids, row=rows)
        for name in ("depth", "sigma_px"):
            if getattr(self, name) is not None:
                check(name, getattr(self, name), row=rows, keypoint=n_keypoints)

    def _check_index(self) -> None:
        if np.any(np.diff(self.frame_numbers) <= 0):
            at = int(np.argmax(np.diff(self.frame_numbers) <= 0))
            raise DetectionsError(
                f"Frame numbers must increase; {self.frame_numbers[at]} is followed by {self.frame_numbers[at + 1]}."
            )
        if self.offsets[0] != 0 or np.any(np.diff(self.offsets) < 0):
            raise DetectionsError(
                "Offsets must start at 0 and never decrease: they count the detections before each view."
            )
        if self.rate_hz is not None and not (np.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise DetectionsError(f"rate_hz must be positive, got {self.rate_hz}.")
        people = self.people_counts
        unrecorded = np.argwhere((people > 0) & ~self.recorded)
        if len(unrecorded):
            f, v = unrecorded[0]
            raise DetectionsError(
                f"View {self.view_names[v]!r} has people in frame {self.frame_numbers[f]}, which is marked as not "
                "recorded."
            )

    def _check_numbers(self) -> None:
        for name in ("keypoints_px", "confidence", "depth", "sigma_px"):
            values = getattr(self, name)
            if values is None:
                continue
            numbers = frozen(values)
            object.__setattr__(self, name, numbers)
            infinite = np.isinf(numbers)
            if infinite.any():
                row = int(np.argwhere(infinite)[0, 0])
                frame, view = self.place_of_row(row)
                raise DetectionsError(
                    f"{name} of view {view!r}, frame {frame}, contains an infinite number. Use NaN for missing values."
                )
        object.__setattr__(self, "track_ids", frozen(self.track_ids, np.int64))
        if self.sigma_px is not None and np.any(np.asarray(self.sigma_px) <= 0.0):
            row = int(np.argwhere(np.asarray(self.sigma_px) <= 0.0)[0, 0])
            frame, view = self.place_of_row(row)
            raise DetectionsError(
                f"sigma_px of view {view!r}, frame {frame}, contains a number that is not positive. Use NaN for "
                "unknown values."
            )

    @classmethod
    def from_dense(
        cls,
        skeleton: Skeleton,
        view_names: Sequence[str],
        keypoints_px: np.ndarray,
        confidence: np.ndarray | None = None,
        *,
        rate_hz: float | None = None,
        time_s: np.ndarray | None = None,
        depth: np.ndarray | None = None,
        frame_numbers: np.ndarray | None = None,
    ) -> "Detections":
        """Build detections with one person per view and frame.

        Args:
            skeleton: skeleton of the keypoint axis.
            view_names: names of the views.
            keypoints_px: shape (frame, view, keypoint, 2).
            confidence: shape (frame, view, keypoint), or None without one.
            rate_hz: nominal frame rate.
            time_s: shape (frame, view); default: frame / rate_hz, or NaN without a rate.
            depth: shape (frame, view, keypoint), or None.
            frame_numbers: shape (frame,); default: from 0.

        Raises:
            DetectionsError: if the arrays do not match.
        """
        pixels = np.ascontiguousarray(keypoints_px, dtype=np.float64)
        if pixels.ndim != 4:
            raise DetectionsError(f"keypoints_px: expected (frame, view, keypoint, 2), got shape {pixels.shape}.")
        n_frames, n_views, n_keypoints, _ = pixels.shape
        numbers = np.arange(n_frames) if frame_numbers is None else np.asarray(frame_numbers)
        if time_s is None:
            time_s = frame_times(numbers, n_views, rate_hz)
        rows = n_frames * n_views

        def flat(name: str, values: np.ndarray | None) -> np.ndarray | None:
            if values is None:
                return None
            numbers = np.asarray(values, dtype=np.float64)
            check_shape(
                DetectionsError, "Detections", name, numbers, frame=n_frames, view=n_views, keypoint=n_keypoints
            )
            return numbers.reshape(rows, n_keypoints)

        flat_confidence = flat("confidence", confidence)
        return cls(
            skeleton=skeleton,
            view_names=tuple(view_names),
            frame_numbers=numbers,
            time_s=time_s,
            offsets=np.arange(rows + 1),
            keypoints_px=pixels.reshape(rows, n_keypoints, pixels.shape[-1]),
            confidence=np.full((rows, n_keypoints), np.nan) if flat_confidence is None else flat_confidence,
            recorded=np.ones((n_frames, n_views), dtype=bool),
            track_ids=np.full(rows, -1),
            depth=flat("depth", depth),
            rate_hz=rate_hz,
        )

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.frame_numbers)

    @property
    def n_views(self) -> int:
        """Number of views."""
        return len(self.view_names)

    @cached_property
    def people_counts(self) -> np.ndarray:
        """Shape (frame, view), int64: number of detections."""
        return np.diff(self.offsets).reshape(self.n_frames, self.n_views)

    def place_of_row(self, row: int) -> tuple[int, str]:
        """Return the frame number and view name of a row."""
        cell = int(np.searchsorted(self.offsets, row, side="right")) - 1
        return int(self.frame_numbers[cell // self.n_views]), self.view_names[cell % self.n_views]

    def frames(self, start: int, stop: int) -> "Detections":
        """Return the frames ``start`` to ``stop`` (index from 0), in memory."""
        start, stop, _ = slice(start, stop).indices(self.n_frames)
        stop = max(start, stop)
        cells = self.offsets[start * self.n_views : stop * self.n_views + 1]
        rows = slice(int(cells[0]), int(cells[-1]))
        parts: dict[str, Any] = {
            "frame_numbers": self.frame_numbers[start:stop],
            "time_s": self.time_s[start:stop],
            "offsets": frozen(cells - cells[0], np.int64),
            "keypoints_px": np.asarray(self.keypoints_px[rows]),
            "confidence": np.asarray(self.confidence[rows]),
            "recorded": self.recorded[start:stop],
            "track_ids": np.asarray(self.track_ids[rows]),
            "depth": None if self.depth is None else np.asarray(self.depth[rows]),
            "sigma_px": None if self.sigma_px is None else np.asarray(self.sigma_px[rows]),
        }
        if not in_memory(self.keypoints_px):
            return replace(self, **parts)
        # A range of checked data needs no check, which would cost as much as triangulating it.
        part = object.__new__(Detections)
        for each in fields(self):
            object.__setattr__(part, each.name, parts.get(each.name, getattr(self, each.name)))
        return part

    def between(self, start: int, stop: int) -> "Detections":
        """Return the frames ``start`` to ``stop`` (index from 0); arrays in files stay in files."""
        if in_memory(self.keypoints_px):
            return self.frames(start, stop)
        start, stop, _ = slice(start, stop).indices(self.n_frames)
        stop = max(start, stop)
        cells = self.offsets[start * self.n_views : stop * self.n_views + 1]
        return replace(
            self,
            frame_numbers=self.frame_numbers[start:stop],
            time_s=self.time_s[start:stop],
            offsets=cells - cells[0],
            recorded=self.recorded[start:stop],
            **self.rows(np.arange(int(cells[0]), int(cells[-1]))),
        )

    def rows(self, rows: Annotated[np.ndarray, Shape(None)]) -> dict[str, np.ndarray | None]:
        """Return selected rows of all per-detection arrays, by name; arrays in files stay in files.

        Args:
            rows: shape (row,), int64.
        """
        names = ("keypoints_px", "confidence", "track_ids", "depth", "sigma_px")
        sources = {name: getattr(self, name) for name in names}
        return {name: None if each is None else chosen_rows(each, rows) for name, each in sources.items()}

    def pieces(self, spans: Sequence[tuple[int, int]]) -> "Detections":
        """Return the frames of several ascending ranges (index from 0), concatenated, in memory."""

        def joined(source: ArraySource, *bounds: tuple[int, int]) -> np.ndarray:
            return np.concatenate([np.asarray(source[start:stop]) for start, stop in bounds])

        cells = [(start * self.n_views, stop * self.n_views) for start, stop in spans]
        rows = [(int(self.offsets[start]), int(self.offsets[stop])) for start, stop in cells]
        return replace(
            self,
            frame_numbers=joined(self.frame_numbers, *spans),
            time_s=joined(self.time_s, *spans),
            offsets=_starts(joined(np.diff(self.offsets), *cells)),
            keypoints_px=joined(self.keypoints_px, *rows),
            confidence=joined(self.confidence, *rows),
            recorded=joined(self.recorded, *spans),
            track_ids=joined(self.track_ids, *rows),
            depth=None if self.depth is None else joined(self.depth, *rows),
            sigma_px=None if self.sigma_px is None else joined(self.sigma_px, *rows),
        )

    def chunks(self, size: int = CHUNK_FRAMES) -> Iterator["Detections"]:
        """Yield consecutive ranges of frames, each in memory."""
        for start, stop in ranges(self.n_frames, size):
            yield self.frames(start, stop)

    def views(self, names: Sequence[str]) -> "Detections":
        """Return the named views, in the given order; arrays in files stay in files.

        Raises:
            MatchError: if a view does not exist.
        """
        for name in names:
            if name not in self.view_names:
                raise MatchError(f"No view {name!r} in the keypoints. {suggestion(name, self.view_names)}")
        columns = [self.view_names.index(name) for name in names]
        counts = self.people_counts[:, columns]
        starts = self.offsets[:-1].reshape(self.n_frames, self.n_views)[:, columns]
        rows = np.repeat(starts.ravel() - _starts(counts)[:-1], counts.ravel()) + np.arange(int(counts.sum()))
        return replace(
            self,
            view_names=tuple(names),
            time_s=self.time_s[:, columns],
            offsets=_starts(counts),
            recorded=self.recorded[:, columns],
            **self.rows(rows),
        )

    def with_rate(self, rate_hz: float) -> "Detections":
        """Return the same frames with times from a frame rate, for files without times."""
        times = frame_times(self.frame_numbers, self.n_views, rate_hz)
        return replace(self, rate_hz=rate_hz, time_s=np.where(self.recorded, times, np.nan))

    def to_skeleton(self, skeleton: Skeleton) -> "Detections":
        """Return the same detections with the keypoints of another skeleton, in memory.

        Common keypoints are kept. A derived keypoint is the mean of its parts where all were detected, with the
        lowest confidence and the largest standard deviation. Other keypoints are missing.
        """
        sources = self.skeleton.sources_of(skeleton)
        everything = self.frames(0, self.n_frames)
        pixels = np.asarray(everything.keypoints_px)
        trust = np.asarray(everything.confidence)
        shape = len(pixels), len(skeleton)
        new_pixels, new_trust = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
        new_depth = None if everything.depth is None else np.full(shape, np.nan)
        new_sigma = None if everything.sigma_px is None else np.full(shape, np.nan)
        for name, parts in sources.items():
            columns = [self.skeleton.index(part) for part in parts]
            k = skeleton.index(name)
            new_pixels[:, k] = pixels[:, columns].mean(axis=1)
            new_trust[:, k] = trust[:, columns].min(axis=1)
            if new_depth is not None:
                new_depth[:, k] = np.asarray(everything.depth)[:, columns].mean(axis=1)
            if new_sigma is not None:
                # Errors of parts are correlated: their mean is assumed to be as uncertain as the worst part.
                new_sigma[:, k] = np.asarray(everything.sigma_px)[:, columns].max(axis=1)
        return replace(
            everything,
            skeleton=skeleton,
            keypoints_px=new_pixels,
            confidence=new_trust,
            depth=new_depth,
            sigma_px=new_sigma,
        )

    def dense(self) -> tuple[np.ndarray, np.ndarray]:
        """Return dense arrays of one subject: pixels (frame, view, keypoint, 2) and confidence (frame, view, keypoint).

        Raises:
            DetectionsError: if a view has several detections in one frame.
        """
        crowded = np.argwhere(self.people_counts > 1)
        if len(crowded):
            f, v = crowded[0]
            raise DetectionsError(
                f"View {self.view_names[v]!r} has {self.people_counts[f, v]} people in frame {self.frame_numbers[f]}: "
                "a dense array holds one detection per view."
            )
        shape = (self.n_frames, self.n_views, len(self.skeleton))
        pixels = np.full((*shape, 2), np.nan)
        trust = np.full(shape, np.nan)
        seen = self.people_counts == 1
        pixels[seen] = self.keypoints_px[:]
        trust[seen] = self.confidence[:]
        return pixels, trust

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Detections):
            return False
        mine, theirs = self.frames(0, self.n_frames), other.frames(0, other.n_frames)
        return all(same(getattr(mine, field.name), getattr(theirs, field.name)) for field in fields(self))

    __hash__ = None  # type: ignore[assignment]


def frame_times(frame_numbers: np.ndarray, n_views: int, rate_hz: float | None) -> np.ndarray:
    """Return times, shape (frame, view): frame / rate in every view, NaN without a rate."""
    times = np.full(len(frame_numbers), np.nan) if rate_hz is None else np.asarray(frame_numbers) / rate_hz
    return np.repeat(times[:, None], n_views, axis=1)


def _starts(counts: np.ndarray) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(counts.ravel())]).astype(np.int64)
