"""Assembly of the people of each view to one :class:`Detections`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from posefuse.errors import DetectionsError, FileError
from posefuse.model.detections import Detections, frame_times
from posefuse.skeleton.skeletons import Skeleton


@dataclass(frozen=True)
class ViewColumns:
    """The people of one view, one row per person.

    Attributes:
        name: Name of the view.
        recorded: Shape (n,), int64: numbers of the recorded frames, with or without people.
        frame_of_row: Shape (row,), int64: frame number of each row (one person in one frame), ascending.
        keypoints: Shape (row, keypoint, 3): x, y in px and confidence, NaN where missing.
        track_ids: Shape (row,), int64, -1 without one.
        sigma_px: Shape (row, keypoint): standard deviations stated by the detector, or None.
        depth: Shape (row, keypoint): depths stated by the detector, or None.
        time_s: Shape (n,): times of the recorded frames, or None if the files have none.
    """

    name: str
    recorded: np.ndarray
    frame_of_row: np.ndarray
    keypoints: np.ndarray
    track_ids: np.ndarray
    sigma_px: np.ndarray | None = None
    depth: np.ndarray | None = None
    time_s: np.ndarray | None = None


def with_times_from_start(views: Sequence[ViewColumns]) -> tuple[list[ViewColumns], int]:
    """Return the views with times relative to the full second before the first frame, and that second.

    Computer clocks count from their start or from 1970.
    """
    times = [view.time_s for view in views if view.time_s is not None and len(view.time_s)]
    begin_s = math.floor(min(float(each.min()) for each in times)) if times else 0
    shifted = [view if view.time_s is None else replace(view, time_s=view.time_s - begin_s) for view in views]
    return shifted, begin_s


def assemble(
    path: Path,
    views: Sequence[ViewColumns],
    skeleton: Skeleton,
    rate_hz: float | None,
    notes: tuple[str, ...] = (),
    *,
    sparse: bool = False,
) -> Detections:
    """Combine views to detections over all frame numbers from the first to the last.

    Args:
        path: The recording, for messages.
        views: Views in order.
        skeleton: Skeleton of the keypoints.
        rate_hz: Frame rate, or None.
        notes: Notes for the user.
        sparse: Whether to keep only the frames that a view has, as in manually labeled data.

    Raises:
        FileError: If there is no frame, or the frame numbers are not plausible.
        DetectionsError: If the keypoints are invalid.
    """
    numbers = np.unique(np.concatenate([view.recorded for view in views]))
    if not len(numbers):
        raise FileError(f"{path} is an empty recording: its views have no frames.")
    frame_numbers = numbers if sparse else common_frames(path, numbers, own=False)
    recorded = np.stack([np.isin(frame_numbers, view.recorded) for view in views], axis=1)
    frame = np.searchsorted(frame_numbers, np.concatenate([view.frame_of_row for view in views]))
    view_of_row = np.repeat(np.arange(len(views)), [len(view.frame_of_row) for view in views])
    order = np.lexsort((view_of_row, frame))
    cells = frame * len(views) + view_of_row
    counts = np.bincount(cells, minlength=len(frame_numbers) * len(views))
    keypoints = np.concatenate([view.keypoints for view in views])[order]
    times = frame_times(frame_numbers, len(views), rate_hz)
    for v, view in enumerate(views):
        if view.time_s is not None:
            times[np.searchsorted(frame_numbers, view.recorded), v] = view.time_s
    rate_hz = rate_hz or rate_of_frames(times)
    try:
        return Detections(
            skeleton=skeleton,
            view_names=tuple(view.name for view in views),
            frame_numbers=frame_numbers,
            time_s=np.where(recorded, times, np.nan),
            offsets=np.concatenate([[0], np.cumsum(counts)]),
            keypoints_px=np.ascontiguousarray(keypoints[..., :2]),
            confidence=np.ascontiguousarray(keypoints[..., 2]),
            recorded=recorded,
            track_ids=np.concatenate([view.track_ids for view in views])[order],
            depth=_joined([view.depth for view in views], views, order),
            sigma_px=_joined([view.sigma_px for view in views], views, order),
            rate_hz=rate_hz,
            notes=notes,
        )
    except DetectionsError as error:
        raise DetectionsError(f"{path}: {error}") from None


def _joined(parts: Sequence[np.ndarray | None], views: Sequence[ViewColumns], order: np.ndarray) -> np.ndarray | None:
    """Return an optional column of all views, with NaN for views that lack it, or None if all lack it."""
    if all(part is None for part in parts):
        return None
    filled = [
        np.full(view.keypoints.shape[:2], np.nan) if part is None else part
        for part, view in zip(parts, views, strict=True)
    ]
    return np.concatenate(filled)[order]


def is_sparse(numbers: np.ndarray) -> bool:
    """Return whether frame numbers have such large gaps that they are selected frames, or wrong.

    Args:
        numbers: Shape (frame,), ascending.
    """
    return bool(numbers[-1] - numbers[0] + 1 > 4 * len(numbers) + 1000)


def common_frames(path: Path, frame: np.ndarray, *, own: bool) -> np.ndarray:
    """Return the frame numbers of a recording, shape (frame,): all from the first to the last.

    Args:
        path: The recording, for messages.
        frame: Shape (cell,): numbers of the frames of all views, in any order.
        own: Whether posefuse wrote the file. Then large gaps are allowed, as in manually labeled data, and only the
            given numbers are returned.

    Raises:
        FileError: If a file of another program has large gaps.
    """
    numbers = np.unique(frame)
    if not is_sparse(numbers):
        return np.arange(numbers[0], numbers[-1] + 1)
    if own:
        return numbers
    raise FileError(
        f"{path}: frame numbers range from {numbers[0]} to {numbers[-1]}, but there are only {len(numbers)} frames. "
        "Does a file belong to another recording?"
    )


def rate_of_frames(time_s: np.ndarray) -> float | None:
    """Return the frame rate in Hz from the median interval between frames, to six decimals, or None without times.

    Args:
        time_s: Shape (frame, view), NaN where unknown.
    """
    steps = np.diff(time_s, axis=0)
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    return (round(float(1.0 / np.median(steps)), 6) or None) if len(steps) else None
