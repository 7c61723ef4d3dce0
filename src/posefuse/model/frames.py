"""One frame of a recording: the detections of every view at one time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import check_shape, kernel_array
from posefuse.errors import DetectionsError
from posefuse.model.detections import Detections


@checked
@dataclass(frozen=True, eq=False)
class Frame:
    """The detections of one frame: one row per detection, rows ordered by view.

    Attributes:
        keypoints_px: shape (row, keypoint, 2), NaN where not detected.
        confidence: shape (row, keypoint), NaN where the detector gives none.
        view: shape (row,), int64: index of the view.
        track_ids: shape (row,), int64: the detector's identity in that view, -1 without one.
        time_s: shape (view,): capture time of each view.
        recorded: shape (view,), bool: whether the view has this frame.
        number: frame number in the recording.

    Raises:
        DetectionsError: if the arrays do not match or contain infinities.
    """

    keypoints_px: np.ndarray
    confidence: np.ndarray
    view: np.ndarray
    track_ids: np.ndarray
    time_s: np.ndarray
    recorded: np.ndarray
    number: int = 0

    def __post_init__(self) -> None:
        rows, views = len(self.view), len(self.recorded)
        check_shape(DetectionsError, "Frame", "keypoints_px", self.keypoints_px, row=rows, keypoint=None, pixel=2)
        keypoints = self.keypoints_px.shape[1]
        check_shape(DetectionsError, "Frame", "confidence", self.confidence, row=rows, keypoint=keypoints)
        check_shape(DetectionsError, "Frame", "track_ids", self.track_ids, row=rows)
        check_shape(DetectionsError, "Frame", "time_s", self.time_s, view=views)
        if rows and not (self.view[0] >= 0 and self.view[-1] < views and (self.view[1:] >= self.view[:-1]).all()):
            raise DetectionsError(
                f"Frame {self.number}: rows must be ordered by view, and views must be from 0 to {views - 1}."
            )
        if np.isinf(self.keypoints_px).any():
            raise DetectionsError(f"Frame {self.number} contains an infinite pixel. Use NaN for missing keypoints.")
        object.__setattr__(self, "keypoints_px", kernel_array(self.keypoints_px))
        object.__setattr__(self, "confidence", kernel_array(self.confidence))

    def __reduce__(self) -> tuple[type["Frame"], tuple[Any, ...]]:
        """Return what pickle stores: kernels would be compiled again for the writable arrays that it restores."""
        return Frame, tuple(getattr(self, each.name) for each in fields(self))

    @cached_property
    def taken_s(self) -> list[float]:
        """Capture time of each view in seconds, NaN if not recorded or unknown."""
        views = zip(self.recorded.tolist(), self.time_s.tolist(), strict=True)
        return [time_s if recorded and math.isfinite(time_s) else math.nan for recorded, time_s in views]

    @cached_property
    def shown(self) -> np.ndarray:
        """Shape (view,), int64: number of detections per view."""
        return np.bincount(self.view, minlength=len(self.recorded))

    @cached_property
    def boxes_px(self) -> np.ndarray:
        """Shape (row, 4): smallest and largest u, v of each detection's keypoints, NaN where it has none."""
        # Reductions over the first axis of a contiguous array are vectorized.
        pixels = np.ascontiguousarray(self.keypoints_px.transpose(1, 0, 2))
        low = np.fmin.reduce(pixels, axis=0, initial=np.nan)
        return np.concatenate([low, np.fmax.reduce(pixels, axis=0, initial=np.nan)], axis=1)

    @classmethod
    def of(cls, detections: Detections, index: int) -> "Frame":
        """Return one frame of a recording.

        Args:
            detections: the recording.
            index: index of the frame, from 0.
        """
        views = detections.n_views
        cells = detections.offsets[index * views : (index + 1) * views + 1]
        rows = slice(int(cells[0]), int(cells[-1]))
        return cls(
            keypoints_px=np.ascontiguousarray(detections.keypoints_px[rows]),
            confidence=np.ascontiguousarray(detections.confidence[rows]),
            view=np.repeat(np.arange(views), np.diff(cells)),
            track_ids=np.asarray(detections.track_ids[rows]),
            time_s=detections.time_s[index],
            recorded=detections.recorded[index],
            number=int(detections.frame_numbers[index]),
        )

    @classmethod
    def of_people(
        cls,
        keypoints_px: Sequence[np.ndarray | None],
        confidence: Sequence[np.ndarray | None] | None = None,
        time_s: float | Sequence[float] | None = None,
        track_ids: Sequence[Sequence[int]] | None = None,
        number: int = 0,
    ) -> "Frame":
        """Build a frame from the output of each view's detector.

        Args:
            keypoints_px: per view, shape (person, keypoint, 2); shape (0, keypoint, 2) or an empty list if it shows no
                person; None if the view has no such frame (dropped, too late, or its camera failed).
            confidence: per view, shape (person, keypoint), not used where ``keypoints_px`` is None; omit it if the
                detector gives none.
            time_s: capture time of the frame, or of each view; NaN if unknown.
            track_ids: per view, the detector's identities, one per person.
            number: frame number.

        Raises:
            DetectionsError: if the numbers of views or keypoints differ, or the time is missing.
        """
        recorded = np.array([people is not None for people in keypoints_px], dtype=bool)
        if time_s is None or not len(recorded):
            lacking = "has no view" if not len(recorded) else "has no time, which the motion model needs"
            raise DetectionsError(
                f"Frame {number} {lacking}. Frame.of_people takes one array of keypoints per camera (empty if it shows "
                "no person, None if it has no such frame), optionally as many confidences, and time_s in seconds: one "
                "number, or one per camera."
            )
        times_s = np.asarray(time_s, dtype=np.float64)
        if times_s.shape not in ((), (len(recorded),)):
            raise DetectionsError(
                f"Frame {number}: time_s must be one number, or one per view ({len(recorded)}); got shape "
                f"{times_s.shape}."
            )
        keypoints_px = [np.empty((0, 0, 2)) if people is None else people for people in keypoints_px]
        counts = [len(people) for people in keypoints_px]
        if confidence is None:
            confidence = [np.full(np.shape(people)[:2], np.nan) for people in keypoints_px]
        if len(confidence) != len(counts) or (track_ids is not None and len(track_ids) != len(counts)):
            raise DetectionsError(
                f"Frame {number}: expected the same number of views, got keypoints of {len(counts)}, confidences of "
                f"{len(confidence)}"
                + ("" if track_ids is None else f", track IDs of {len(track_ids)}")
                + ". Pass one array per view, empty if it shows no person."
            )
        confidence = [
            np.empty((0, 0)) if each is None or not seen else each
            for each, seen in zip(confidence, recorded, strict=True)
        ]
        shapes = [np.shape(people) for people in keypoints_px]
        _check_people(number, shapes, [np.shape(each) for each in confidence])
        keypoints = {shape[1] for shape in shapes if len(shape) == 3 and (shape[0] or shape[1])}
        if len(keypoints) > 1:
            raise DetectionsError(f"Frame {number}: views differ in the number of keypoints per person: {keypoints}.")
        k = keypoints.pop() if keypoints else 0
        ids = [[-1] * n for n in counts] if track_ids is None else track_ids
        ids = [of_view if seen else () for of_view, seen in zip(ids, recorded, strict=True)]
        return cls(
            keypoints_px=np.concatenate(
                [np.reshape(people, (len(people), k, 2)) for people in keypoints_px], dtype=np.float64
            ),
            confidence=np.concatenate([np.reshape(each, (len(each), k)) for each in confidence], dtype=np.float64),
            view=np.repeat(np.arange(len(counts)), counts),
            track_ids=np.array([i for of_view in ids for i in of_view], dtype=np.int64),
            time_s=np.broadcast_to(times_s, (len(counts),)),
            recorded=recorded,
            number=number,
        )

    def rows_of(self, view: int) -> np.ndarray:
        """Return the rows of one view, shape (row,), int64."""
        first, last = np.searchsorted(self.view, [view, view + 1])
        return np.arange(first, last)


def _check_people(number: int, keypoints: list[tuple[int, ...]], confidence: list[tuple[int, ...]]) -> None:
    """Check the shapes of the arrays of each view; those without a person may have any."""
    for v, (shape, trust) in enumerate(zip(keypoints, confidence, strict=True)):
        if shape[:1] != (0,) and (len(shape) != 3 or shape[2] != 2):
            raise DetectionsError(f"Frame {number}, view {v}: expected keypoints (person, keypoint, 2), got {shape}.")
        if trust[:1] != (0,) and trust != shape[:2]:
            raise DetectionsError(
                f"Frame {number}, view {v}: expected confidences (person, keypoint) = {shape[:2]}, got {trust}."
            )
