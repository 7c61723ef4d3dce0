"""From what each view's files hold to one :class:`Detections`."""

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
    """The people of one view.

    Attributes:
        name: of the view.
        recorded: shape (n,), int64: numbers of the frames it has, with people or without.
        frame_of_row: shape (row,), int64: the frame number of each person, in order.
        keypoints: shape (row, keypoint, 3): x, y, confidence; NaN where missing.
        track_ids: shape (row,), int64, -1 where there is none.
        sigma_px: shape (row, keypoint): the detector's own standard deviations, or None.
        depth: shape (row, keypoint): the detector's own depths, or None.
        time_s: shape (n,): when it took the recorded frames, or None where the files do not say.
    """

    name: str
    recorded: np.ndarray
    frame_of_row: np.ndarray
    keypoints: np.ndarray
    track_ids: np.ndarray
    sigma_px: np.ndarray | None = None
    depth: np.ndarray | None = None
    time_s: np.ndarray | None = None


def counted_from_start(views: Sequence[ViewColumns]) -> tuple[list[ViewColumns], int]:
    """The views with times from the whole second before the first frame on, and that second: 0 where it is the first.

    Clocks of computers count from when they started, or from 1970.
    """
    times = [view.time_s for view in views if view.time_s is not None and len(view.time_s)]
    begin_s = math.floor(min(float(each.min()) for each in times)) if times else 0
    moved = [view if view.time_s is None else replace(view, time_s=view.time_s - begin_s) for view in views]
    return moved, begin_s


def assemble(
    path: Path,
    views: Sequence[ViewColumns],
    skeleton: Skeleton,
    rate_hz: float | None,
    notes: tuple[str, ...] = (),
    *,
    sparse: bool = False,
) -> Detections:
    """Put views together, frame by frame, over every frame number from the first to the last.

    Args:
        path: for messages.
        views: in order.
        skeleton: of the keypoints.
        rate_hz: frames per second, or None.
        notes: what is worth saying.
        sparse: whether frames lie far apart, as labels by hand do: then only those that some view has are kept.

    Raises:
        FileError: if there is no frame, or the numbers make no recording.
        DetectionsError: if the keypoints cannot be.
    """
    numbers = np.unique(np.concatenate([view.recorded for view in views]))
    if not len(numbers):
        raise FileError(f"{path} is an empty recording: its views have no frames.")
    frame_numbers = numbers if sparse else line_of_frames(path, numbers, own=False)
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
    """What some views have, NaN for the others; None where none has it."""
    if all(part is None for part in parts):
        return None
    filled = [
        np.full(view.keypoints.shape[:2], np.nan) if part is None else part
        for part, view in zip(parts, views, strict=True)
    ]
    return np.concatenate(filled)[order]


def far_apart(numbers: np.ndarray) -> bool:
    """Whether frame numbers are so far apart that they are no recording's, but somebody's choice of frames, or wrong.

    Args:
        numbers: shape (frame,), ascending.
    """
    return bool(numbers[-1] - numbers[0] + 1 > 4 * len(numbers) + 1000)


def line_of_frames(path: Path, frame: np.ndarray, *, own: bool) -> np.ndarray:
    """Shape (frame,): every frame number from the first to the last; of frames far apart those that there are.

    Args:
        path: for messages.
        frame: shape (cell,): numbers of the frames that views have, in any order.
        own: whether posefuse wrote the file: then frames may lie far apart, as those labelled by hand do.

    Raises:
        FileError: if they are far apart in a file of another program's.
    """
    numbers = np.unique(frame)
    if not far_apart(numbers):
        return np.arange(numbers[0], numbers[-1] + 1)
    if own:
        return numbers
    raise FileError(
        f"{path}: frame numbers run from {numbers[0]} to {numbers[-1]}, but there are only {len(numbers)} frames. Are "
        "files of another recording among them?"
    )


def rate_of_frames(time_s: np.ndarray) -> float | None:
    """Frames per second from the times of consecutive frames, to six decimals; None where there are none.

    Args:
        time_s: shape (frame, view), NaN where unknown.
    """
    steps = np.diff(time_s, axis=0)
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    return (round(float(1.0 / np.median(steps)), 6) or None) if len(steps) else None
