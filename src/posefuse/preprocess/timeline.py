"""Align views of different length, start or rate on a common timeline, by time instead of by frame index."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import DetectionsError, choices, suggestion
from posefuse.model.detections import Detections

_SAME_RATE = 0.01
_SAME_STEP = 0.2
# Half a frame period, minus a margin for rounding of frames exactly between two others.
_HALF = 0.5 * (1.0 - 1e-6)


@dataclass(frozen=True, eq=False)
class _Timeline:
    """The common frames of all views.

    Attributes:
        view: index of the reference view.
        period_s: time between frames.
        time_s: shape (frame,), ascending.
        source: shape (frame, view), int64: index of each view's own frame, -1 for none.
    """

    view: int
    period_s: float
    time_s: np.ndarray
    source: np.ndarray


@checked
def align_views(detections: Detections, reference: str | None = None) -> Detections:
    """Align the views on a common timeline by their times.

    Each frame of the timeline holds the nearest frame of every view, within half a frame period of the reference view;
    nothing is interpolated. A view without a near frame has not recorded the frame. Each view keeps the true times of
    the frames used. Where the reference view has no frames, between or beyond its own, the timeline follows the other
    views.

    Args:
        detections: detections with ``time_s`` of every recorded frame; without any times they are returned unchanged.
        reference: reference view; by default the slowest view, and the longest of several slowest ones.

    Returns:
        The detections, with a note on the timeline and one on every view that lost or lacks frames; the same object if
        the views are aligned already. Frame numbers continue from where most views begin.

    Raises:
        DetectionsError: if the reference view does not exist, a view's times are missing or decrease, or no two views
            recorded a frame at the same time.
    """
    if reference is not None and reference not in detections.view_names:
        raise DetectionsError(
            f"reference_view: {reference!r} is not a view. {suggestion(reference, detections.view_names)}"
        )
    known = detections.recorded & np.isfinite(detections.time_s)
    if detections.n_views == 1 or not known.any():
        return detections
    _check_times(detections, known)
    if _are_aligned(detections, known, reference):
        return detections
    view = _slowest(detections, known) if reference is None else detections.view_names.index(reference)
    timeline = _timeline_of(detections, known, view)
    if (np.sum(timeline.source >= 0, axis=1) > 1).sum() == 0:
        raise DetectionsError(
            "No two views recorded a frame at the same time: "
            + ", ".join(_span(detections, known, v) for v in range(detections.n_views))
            + ". All times must come from the same clock."
        )
    return _aligned(detections, timeline, known)


def _check_times(detections: Detections, known: np.ndarray) -> None:
    for v, name in enumerate(detections.view_names):
        lacking = int((detections.recorded[:, v] & ~known[:, v]).sum())
        if lacking:
            raise DetectionsError(
                f"View {name!r} has no time for {lacking} of its {int(detections.recorded[:, v].sum())} frames, while "
                "others have times. Specify times for all views, or for none."
            )
        times = detections.time_s[known[:, v], v]
        backward = np.flatnonzero(np.diff(times) < 0)
        if len(backward):
            at = detections.frame_numbers[known[:, v]][backward[0]]
            raise DetectionsError(
                f"The times of view {name!r} go backward after frame {at}: {times[backward[0]]:.6f} s is followed by "
                f"{times[backward[0] + 1]:.6f} s. Correct the times."
            )


def _period(times: np.ndarray) -> float:
    """Return the frame period of a view; NaN with fewer than two different times."""
    steps = np.diff(times)
    return float(np.median(steps[steps > 0])) if (steps > 0).any() else float("nan")


def nominal_rate_hz(frame_numbers: np.ndarray, time_s: np.ndarray) -> float | None:
    """Return the frame rate from frame numbers and times, to five digits, the precision of clock times.

    Args:
        frame_numbers: shape (frame,), increasing.
        time_s: shape (frame,), NaN where unknown.

    Returns:
        The rate over the whole time if it agrees with the median step, else that of the median step: single times may
        be rounded, and clocks may stop for a while. None with fewer than two known times.
    """
    known = np.flatnonzero(np.isfinite(time_s))
    numbers, times = np.asarray(frame_numbers)[known], time_s[known]
    if len(known) < 2 or not times[-1] > times[0]:
        return None
    whole = (times[-1] - times[0]) / (numbers[-1] - numbers[0])
    usual = float(np.median(np.diff(times) / np.diff(numbers)))
    period_s = whole if abs(whole - usual) <= _SAME_RATE * whole or usual <= 0 else usual
    return float(f"{1.0 / period_s:.5g}")


def _periods(detections: Detections, known: np.ndarray) -> np.ndarray:
    return np.array([_period(detections.time_s[known[:, v], v]) for v in range(detections.n_views)])


def _are_aligned(detections: Detections, known: np.ndarray, reference: str | None) -> bool:
    """Return whether the frames of all views are within half a frame period of one view's frames."""
    periods = _periods(detections, known)
    times = np.where(known, detections.time_s, np.nan)
    first = np.fmin.reduce(times, axis=1)
    spread = np.fmax.reduce(times, axis=1) - first
    if np.any(np.diff(first[np.isfinite(first)]) < 0):
        return False
    for v, name in enumerate(detections.view_names):
        if reference not in (None, name) or not np.isfinite(periods[v]):
            continue
        mine = known[:, v]
        off = np.abs(times[mine] - times[mine, v, None])
        near = not np.any(off > 0.5 * periods[v] * (1.0 + 1e-6))
        if near and not np.any(spread[~mine] > periods[v] * (1.0 + 1e-6)):
            return True
    return not np.isfinite(periods).any()


def _slowest(detections: Detections, known: np.ndarray) -> int:
    periods = _periods(detections, known)
    slow = periods >= np.nanmax(periods) * (1.0 - _SAME_RATE)
    return int(np.argmax(np.where(slow, known.sum(axis=0), -1)))


def _timeline_of(detections: Detections, known: np.ndarray, view: int) -> _Timeline:
    times = [detections.time_s[known[:, v], v] for v in range(detections.n_views)]
    period = _period(times[view])
    if not np.isfinite(period):
        raise DetectionsError(
            f"View {detections.view_names[view]!r} has no two frames at different times, so it has no frame rate and "
            "cannot be the reference."
        )
    others = np.sort(np.concatenate([each for v, each in enumerate(times) if v != view]))
    ticks = _ticks(np.unique(times[view]), others, period)
    source = np.full((len(ticks), detections.n_views), -1, dtype=np.int64)
    for v, each in enumerate(times):
        frames = np.flatnonzero(known[:, v])
        tick, used = _nearest(each, ticks, period)
        source[tick, v] = frames[used]
    # Drop times to which no frame of any view is nearest.
    there = (source >= 0).any(axis=1)
    return _Timeline(view, period, ticks[there], source[there])


def _ticks(own: np.ndarray, others: np.ndarray, period: float) -> np.ndarray:
    """Return the times of the reference view and, in its gaps, of other views: about one per frame period."""
    before = _walk(own[0], np.inf, -others[::-1], period, backward=True)
    after = _walk(own[-1], np.inf, others, period)
    holes = np.flatnonzero(np.diff(own) > 1.5 * period)
    filled = [_walk(own[i], own[i + 1] - _HALF * period, others, period) for i in holes]
    return np.sort(np.concatenate([before, own, *filled, after]))


def _walk(start: float, stop: float, others: np.ndarray, period: float, *, backward: bool = False) -> np.ndarray:
    """Return times of other views from ``start`` to ``stop``, one per frame period; negated times if backward."""
    last = -start if backward else start
    found = []
    while True:
        expected = last + period
        first = int(np.searchsorted(others, expected - _HALF * period, side="right"))
        if first == len(others):
            break
        near = others[first : int(np.searchsorted(others, expected + _HALF * period))]
        # After a gap without near frames, continue from the next frame.
        last = float(near[np.abs(near - expected).argmin()]) if len(near) else float(others[first])
        if last >= stop:
            break
        found.append(last)
    return -np.array(found) if backward else np.array(found)


def _nearest(times: np.ndarray, ticks: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the tick of each used frame, and the frames: the nearest one to each tick, each used once."""
    tick = np.searchsorted(0.5 * (ticks[1:] + ticks[:-1]), times)
    off = np.abs(times - ticks[tick])
    frames = np.flatnonzero(off <= 0.5 * period * (1.0 + 1e-6))
    order = frames[np.lexsort((frames, off[frames], tick[frames]))]
    chosen, first = np.unique(tick[order], return_index=True)
    return chosen, order[first]


def _numbers(detections: Detections, timeline: _Timeline, periods: np.ndarray) -> np.ndarray:
    """Return frame numbers: one step per frame period, starting where most views of the same rate begin."""
    steps = np.maximum(1, np.round(np.diff(timeline.time_s) / timeline.period_s)).astype(np.int64)
    count = np.concatenate([[0], np.cumsum(steps)])
    begins = Counter[int]()
    # Between equally common starts, prefer that of the reference view.
    for v in (timeline.view, *(v for v in range(detections.n_views) if v != timeline.view)):
        there = np.flatnonzero(timeline.source[:, v] >= 0)
        if len(there) and abs(periods[v] / timeline.period_s - 1.0) < _SAME_STEP:
            begins[int(detections.frame_numbers[timeline.source[there[0], v]] - count[there[0]])] += 1
    return count + max(begins.most_common(1)[0][0], 0)


def _aligned(detections: Detections, timeline: _Timeline, known: np.ndarray) -> Detections:
    """Return the detections on the timeline."""
    periods = _periods(detections, known)
    has = timeline.source >= 0
    cells = np.where(has, timeline.source, 0) * detections.n_views + np.arange(detections.n_views)
    counts = np.where(has, np.diff(detections.offsets)[cells], 0)
    offsets = np.concatenate([[0], np.cumsum(counts.ravel())])
    rows = np.repeat(detections.offsets[:-1][cells].ravel() - offsets[:-1], counts.ravel()) + np.arange(offsets[-1])
    numbers = _numbers(detections, timeline, periods)
    rate = nominal_rate_hz(numbers, timeline.time_s) or 1.0 / timeline.period_s
    stated_hz = detections.rate_hz
    return replace(
        detections,
        frame_numbers=numbers,
        time_s=np.where(has, detections.time_s.ravel()[cells], np.nan),
        offsets=offsets,
        recorded=has,
        rate_hz=stated_hz if stated_hz is not None and abs(stated_hz / rate - 1.0) < _SAME_RATE else rate,
        notes=(*detections.notes, *_notes(detections, timeline, known, periods)),
        **detections.rows(rows),
    )


def _notes(detections: Detections, timeline: _Timeline, known: np.ndarray, periods: np.ndarray) -> tuple[str, ...]:
    """Return a note on the timeline, and one on every view that lost or lacks frames."""
    rate = f"{1.0 / timeline.period_s:.4g}"
    n_frames = len(timeline.time_s)
    notes = [
        f"Views are aligned by time: {n_frames} frames at {rate} Hz, following {detections.view_names[timeline.view]}; "
        f"each view contributes its frame within {500.0 * timeline.period_s:.1f} ms."
    ]
    for v, name in enumerate(detections.view_names):
        has = timeline.source[:, v] >= 0
        total, used = int(known[:, v].sum()), int(has.sum())
        if total == used == n_frames:
            continue
        words = [f"{total - used} of its {total} frames are not used"] if used < total else []
        words += [f"{n_frames - used} of the {n_frames} frames missing"] if used < n_frames else []
        off_ms = 0.0
        if used:
            off_ms = 1000.0 * float(np.abs(detections.time_s[timeline.source[has, v], v] - timeline.time_s[has]).max())
        notes.append(f"View {name} ({1.0 / periods[v]:.4g} Hz): {', '.join(words)}; at most {off_ms:.1f} ms off.")
    return tuple(notes)


def _span(detections: Detections, known: np.ndarray, view: int) -> str:
    times = detections.time_s[known[:, view], view]
    name = detections.view_names[view]
    return f"{name} none" if not len(times) else f"{name} {times[0]:.3f} to {times[-1]:.3f} s"


def uneven_lengths(detections: Detections) -> str | None:
    """Return a note if views of unequal length have no times to align them by, or None."""
    if not _by_number(detections):
        return None
    counts = detections.recorded.sum(axis=0)
    if len(set(counts.tolist())) == 1:
        return None
    listed = choices([f"{name} {n}" for name, n in zip(detections.view_names, counts.tolist(), strict=True)])
    return (
        f"Views have unequal numbers of frames ({listed}) and no times, so they are aligned by frame number. "
        "`timestamps` or `view_rates_hz` gives the times of frames."
    )


def _by_number(detections: Detections) -> bool:
    """Return whether times follow from frame numbers and a frame rate alone."""
    known = np.isfinite(detections.time_s)
    if detections.rate_hz is None or not known.any():
        return not known.any()
    times = np.repeat(detections.frame_numbers[:, None] / detections.rate_hz, detections.n_views, axis=1)
    return bool(np.allclose(detections.time_s[known], times[known], rtol=0.0, atol=1e-9))


def fill_missing_times(time_s: np.ndarray, frame_numbers: np.ndarray) -> np.ndarray:
    """Interpolate missing frame times by frame number; unchanged if fewer than two are known.

    Args:
        time_s: shape (frame,), NaN if unknown.
        frame_numbers: shape (frame,), ascending.
    """
    there = np.isfinite(time_s)
    if there.sum() < 2:
        return time_s
    known_s, numbers = time_s[there], np.asarray(frame_numbers, dtype=float)
    times_s = np.interp(numbers, numbers[there], known_s)
    period_s = np.median(np.diff(known_s) / np.diff(numbers[there]))
    first, final = np.flatnonzero(there)[[0, -1]]
    times_s[:first] = known_s[0] - period_s * (numbers[first] - numbers[:first])
    times_s[final + 1 :] = known_s[-1] + period_s * (numbers[final + 1 :] - numbers[final])
    return times_s
