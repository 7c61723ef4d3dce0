"""Times of frames: timestamps and rates are applied to views, which are then aligned to common frames."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from posefuse.errors import DetectionsError, MatchError, choices, suggestion
from posefuse.io.keypoints.frame_rates import FrameRate
from posefuse.io.keypoints.request import Request
from posefuse.io.timestamps import Timestamps, ViewTimes
from posefuse.model.detections import Detections
from posefuse.model.view_names import plain_name
from posefuse.preprocess.timeline import align_views, nominal_rate_hz, uneven_lengths

_SAME_RATE = 0.05
"""Relative difference of frame rates that are the same: webcams deviate from their nominal rate."""


def with_common_frames(detections: Detections, request: Request) -> Detections:
    """Align the views by time if times are available, otherwise by frame number.

    Raises:
        MatchError: If the timestamps belong to other views.
        DetectionsError: If the timestamps do not match the frames, or the views do not overlap in time.
    """
    if request.timestamps is not None:
        detections = with_timestamps(detections, request.timestamps)
    elif (
        request.nearby is not None
        and request.rate_hz is None
        and not request.view_rates_hz
        and _has_no_times(detections)
    ):
        detections = with_timestamps(detections, request.nearby)
    elif request.view_rates_hz:
        detections = with_rates(detections, request.view_rates_hz, request.rate_hz or detections.rate_hz)
    aligned = align_views(detections, request.reference_view)
    timed = request.timestamps is not None or request.nearby is not None or bool(request.view_rates_hz)
    if timed and aligned.rate_hz is None:
        first_s = np.fmin.reduce(aligned.time_s, axis=1)
        return replace(aligned, rate_hz=nominal_rate_hz(aligned.frame_numbers, first_s))
    note = uneven_lengths(aligned) if aligned is detections else None
    return aligned if note is None or note in aligned.notes else replace(aligned, notes=(*aligned.notes, note))


def replace_mismatched_timestamps(
    detections: Detections, request: Request, stated: FrameRate | None
) -> tuple[Detections, Request]:
    """Replace timestamps found beside the files by a constant rate if they do not match the frames.

    Args:
        detections: Detections without times.
        request: How to read them. Without timestamps found beside the files, nothing changes.
        stated: Frame rate that files beside the keypoints state, or None.

    Returns:
        The detections, with a note if the timestamps or their rate do not match, and the request. A mismatch requires
        equal numbers of frames and one rate, that of the timestamps or of the files.

    Raises:
        MatchError: If the timestamps belong to other views, and no common rate is known.
        DetectionsError: If the numbers of frames do not match, and no common rate is known.
    """
    stamps = request.nearby
    if stamps is None or not _has_no_times(detections):
        return detections, request
    rates_hz = [rate for each in stamps.by_view.values() if (rate := _rate_of(each)) is not None]
    try:
        with_timestamps(detections, stamps)
    except (MatchError, DetectionsError) as error:
        known_hz = [*rates_hz, *([stated.rate_hz] if stated is not None else [])]
        lengths = detections.recorded.sum(axis=0)
        if not known_hz or max(known_hz) > (1.0 + _SAME_RATE) * min(known_hz) or np.ptp(lengths):
            raise
        source, rate_hz = (stamps.source, rates_hz[0]) if stated is None else (stated.source, stated.rate_hz)
        note = (
            f"The timestamps in {stamps.source} do not match and are not used: {_reason(error)} All views have "
            f"{lengths[0]} frames, so the frame rate of {source}, {rate_hz:.5g} Hz, is used."
        )
        timed = detections.with_rate(rate_hz)
        return replace(timed, notes=(*timed.notes, note)), replace(request, nearby=None)
    differing = [rate for rate in rates_hz if stated is not None and not _same_rate(rate, stated.rate_hz)]
    if stated is not None and differing:
        note = (
            f"The timestamps in {stamps.source} are at {differing[0]:.4g} Hz, but {stated.source} states "
            f"{stated.rate_hz:.4g} Hz. The timestamps are used; `rate_hz` replaces them."
        )
        detections = replace(detections, notes=(*detections.notes, note))
    return detections, request


def _rate_of(stamps: ViewTimes) -> float | None:
    numbers = np.arange(len(stamps.time_s)) if stamps.frames is None else stamps.frames
    return nominal_rate_hz(numbers, stamps.time_s)


def _same_rate(rate_hz: float, other_hz: float) -> bool:
    return abs(rate_hz - other_hz) <= _SAME_RATE * other_hz


def _reason(error: Exception) -> str:
    """Return the first sentence of an error, which states what does not match."""
    return str(error).split(". ")[0].removesuffix(".") + "."


def _has_no_times(detections: Detections) -> bool:
    return detections.rate_hz is None and not np.isfinite(detections.time_s).any()


def with_rates(detections: Detections, rates_hz: Mapping[str, float], rate_hz: float | None) -> Detections:
    """Compute the times of views that started together, each at its own rate.

    Args:
        detections: Frames must be numbered from the same moment in all views.
        rates_hz: Frame rate by view.
        rate_hz: Frame rate of views that are not named, or None.

    Raises:
        MatchError: If there is no view with a given name.
        DetectionsError: If a view has no rate.
    """
    rates = np.full(detections.n_views, np.nan if rate_hz is None else rate_hz)
    for name, rate in rates_hz.items():
        view = _view_of(name, detections.view_names)
        if view is None:
            raise MatchError(f"view_rates_hz: unknown view {name!r}. {suggestion(name, detections.view_names)}")
        rates[view] = rate
    unknown = [name for name, rate in zip(detections.view_names, rates, strict=True) if np.isnan(rate)]
    if unknown:
        raise DetectionsError(
            f"view_rates_hz sets no rate for {choices(unknown)}. Add it, or set `rate_hz` for all other views."
        )
    numbers = detections.frame_numbers - detections.frame_numbers[0]
    times = numbers[:, None] / rates
    return replace(detections, time_s=np.where(detections.recorded, times, np.nan), rate_hz=None)


def with_timestamps(detections: Detections, stamps: Timestamps) -> Detections:
    """Replace the times by timestamps, counted from the full second before the first frame.

    Raises:
        MatchError: If the timestamps lack a view.
        DetectionsError: If a view does not have exactly one time per frame.
    """
    by_view, others = {}, []
    for name, each in stamps.by_view.items():
        view = _view_of(name, detections.view_names)
        if view is None:
            others.append(name)
        else:
            by_view[view] = each
    missing = [name for v, name in enumerate(detections.view_names) if v not in by_view]
    if missing:
        raise MatchError(
            f"{stamps.source} has no times for {choices(missing)}, only for {choices(stamps.by_view)}. Specify the "
            "times of every view, or use a constant rate: `rate_hz`."
        )
    begin_s = math.floor(min(float(each.time_s.min()) for each in by_view.values()))
    times = np.full((detections.n_frames, detections.n_views), np.nan)
    for v, each in by_view.items():
        recorded = detections.recorded[:, v]
        times[recorded, v] = _times_of(
            detections.frame_numbers[recorded], each, f"{stamps.source}, view {detections.view_names[v]!r}"
        )
    note = f"Times are read from {stamps.source}" + (f", which has more views: {choices(others)}." if others else ".")
    notes = (*detections.notes, *stamps.notes, note)
    if begin_s:
        notes = (*notes, f"Time 0 corresponds to {begin_s} s in {stamps.source}.")
    return replace(detections, time_s=times - begin_s, notes=notes, rate_hz=None)


def _times_of(numbers: np.ndarray, stamps: ViewTimes, where: str) -> np.ndarray:
    """Return the times of a view's frames in s, shape (frame,)."""
    if stamps.frames is None:
        if len(stamps.time_s) != len(numbers):
            raise DetectionsError(
                f"{where}: expected a time for each of {len(numbers)} frames, got {len(stamps.time_s)}. Add a column "
                "of frame numbers, or use a constant rate: `rate_hz`."
            )
        return stamps.time_s
    place = np.minimum(np.searchsorted(stamps.frames, numbers), len(stamps.frames) - 1)
    missing = numbers[stamps.frames[place] != numbers]
    if len(missing):
        raise DetectionsError(
            f"{where}: times are missing for {len(missing)} of {len(numbers)} frames, the first of which is "
            f"{missing[0]}; the available frames are {stamps.frames[0]} to {stamps.frames[-1]}. Frame numbers must "
            "match those of the keypoint files."
        )
    return stamps.time_s[place]


def _view_of(name: str, views: tuple[str, ...]) -> int | None:
    """Return the index of the view with this name, ignoring case and punctuation, or with this port number."""
    plain = plain_name(name)
    for candidates in (
        [v for v, view in enumerate(views) if view == name],
        [v for v, view in enumerate(views) if plain_name(view) == plain],
        [v for v, view in enumerate(views) if plain.isdigit() and plain_name(view) == f"cam{plain}"],
    ):
        if len(candidates) == 1:
            return candidates[0]
    return None
