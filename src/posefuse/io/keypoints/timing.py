"""From what files and users say of when views took their frames to views on one line of frames."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from posefuse.errors import DetectionsError, MatchError, choices, suggestion
from posefuse.io.keypoints.request import Request
from posefuse.io.timestamps import Timestamps, ViewTimes
from posefuse.model.detections import Detections
from posefuse.model.view_names import plain_name
from posefuse.preprocess.timeline import align_views, nominal_rate_hz, uneven_lengths


def on_one_line(detections: Detections, request: Request) -> Detections:
    """The views put together by their times, where times are known; else by the numbers of their frames.

    Raises:
        MatchError: if the timestamps are of other views.
        DetectionsError: if they do not fit the frames, or the views have nothing in common.
    """
    if request.timestamps is not None:
        detections = with_timestamps(detections, request.timestamps)
    elif request.nearby is not None and request.rate_hz is None and not request.view_rates_hz and _timeless(detections):
        detections = with_timestamps(detections, request.nearby)
    elif request.view_rates_hz:
        detections = with_rates(detections, request.view_rates_hz, request.rate_hz or detections.rate_hz)
    aligned = align_views(detections, request.reference_view)
    timed = request.timestamps is not None or request.nearby is not None or bool(request.view_rates_hz)
    if timed and aligned.rate_hz is None:
        first_s = np.fmin.reduce(aligned.time_s, axis=1)
        return replace(aligned, rate_hz=nominal_rate_hz(aligned.frame_numbers, first_s))
    said = uneven_lengths(aligned) if aligned is detections else None
    return aligned if said is None or said in aligned.notes else replace(aligned, notes=(*aligned.notes, said))


def _timeless(detections: Detections) -> bool:
    return detections.rate_hz is None and not np.isfinite(detections.time_s).any()


def with_rates(detections: Detections, rates_hz: Mapping[str, float], rate_hz: float | None) -> Detections:
    """The times of views that began together, each at its own rate.

    Args:
        detections: their frames numbered from the same moment on.
        rates_hz: by view.
        rate_hz: of views that are not named.

    Raises:
        MatchError: if there is no view of a name.
        DetectionsError: if a view has no rate.
    """
    rates = np.full(detections.n_views, np.nan if rate_hz is None else rate_hz)
    for name, rate in rates_hz.items():
        view = _view_of(name, detections.view_names)
        if view is None:
            raise MatchError(f"view_rates_hz: no view {name!r}. {suggestion(name, detections.view_names)}")
        rates[view] = rate
    unknown = [name for name, rate in zip(detections.view_names, rates, strict=True) if np.isnan(rate)]
    if unknown:
        raise DetectionsError(f"view_rates_hz says nothing of {choices(unknown)}; --rate-hz is for all that it leaves.")
    numbers = detections.frame_numbers - detections.frame_numbers[0]
    times = numbers[:, None] / rates
    return replace(detections, time_s=np.where(detections.recorded, times, np.nan), rate_hz=None)


def with_timestamps(detections: Detections, stamps: Timestamps) -> Detections:
    """The times that a file gives.

    Raises:
        MatchError: if it has no times of a view.
        DetectionsError: if it has not one time a frame.
    """
    of_view, others = {}, []
    for name, each in stamps.by_view.items():
        view = _view_of(name, detections.view_names)
        if view is None:
            others.append(name)
        else:
            of_view[view] = each
    lacking = [name for v, name in enumerate(detections.view_names) if v not in of_view]
    if lacking:
        raise MatchError(
            f"{stamps.source} has no times of {choices(lacking)}; it has those of {choices(stamps.by_view)}. Give the "
            "times of every view, or do without: --rate-hz."
        )
    begin_s = math.floor(min(float(each.time_s.min()) for each in of_view.values()))
    times = np.full((detections.n_frames, detections.n_views), np.nan)
    for v, each in of_view.items():
        recorded = detections.recorded[:, v]
        times[recorded, v] = _times_of(
            detections.frame_numbers[recorded], each, f"{stamps.source}, view {detections.view_names[v]!r}"
        )
    said = f"Times are those of {stamps.source}" + (f"; it has more views: {choices(others)}." if others else ".")
    notes = (*detections.notes, *stamps.notes, said)
    if begin_s:
        notes = (*notes, f"Times count from its second {begin_s}.")
    return replace(detections, time_s=times - begin_s, notes=notes, rate_hz=None)


def _times_of(numbers: np.ndarray, given: ViewTimes, where: str) -> np.ndarray:
    """Shape (frame,): the times of a view's frames."""
    if given.frames is None:
        if len(given.time_s) != len(numbers):
            raise DetectionsError(
                f"{where}: expected a time for each of {len(numbers)} frames, got {len(given.time_s)}. A column of "
                "frame numbers tells which is whose; --rate-hz does without times."
            )
        return given.time_s
    place = np.minimum(np.searchsorted(given.frames, numbers), len(given.frames) - 1)
    missing = numbers[given.frames[place] != numbers]
    if len(missing):
        raise DetectionsError(
            f"{where}: no time for {len(missing)} of {len(numbers)} frames, the first of them {missing[0]}; it has "
            f"frames {given.frames[0]} to {given.frames[-1]}. Numbers are those of the keypoint files."
        )
    return given.time_s[place]


def _view_of(name: str, views: tuple[str, ...]) -> int | None:
    """The view that a name means: the same, or the same but for case and punctuation; of ports the number."""
    plain = plain_name(name)
    for found in (
        [v for v, view in enumerate(views) if view == name],
        [v for v, view in enumerate(views) if plain_name(view) == plain],
        [v for v, view in enumerate(views) if plain.isdigit() and plain_name(view) == f"cam{plain}"],
    ):
        if len(found) == 1:
            return found[0]
    return None
