"""Views of unequal length, start or rate on one line of frames: put together by when they took them, not by index."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from posefuse.errors import DetectionsError, choices, suggestion
from posefuse.model.detections import Detections

_SAME_RATE = 0.01
_SAME_STEP = 0.2
# Half an interval, but for what rounding makes of frames that lie exactly between two others.
_HALF = 0.5 * (1.0 - 1e-6)


@dataclass(frozen=True, eq=False)
class _Line:
    """The frames that there are to be.

    Attributes:
        view: number of the view that it follows.
        period_s: between frames.
        time_s: shape (frame,), ascending.
        source: shape (frame, view), int64: which of the given frames each view has there, -1 for none.
    """

    view: int
    period_s: float
    time_s: np.ndarray
    source: np.ndarray


def align_views(detections: Detections, reference: str | None = None) -> Detections:
    """Put the views together by their times.

    Each frame of the line holds what every view took nearest to it, within half a frame interval of the view that the
    line follows; nothing is interpolated. Where a view took nothing near enough it has not recorded the frame. Each
    view keeps the times at which it truly took what is used. Frames that the followed view lacks, between its others
    and beyond its ends, are those of other views.

    Args:
        detections: with ``time_s`` of every recorded frame; without any times nothing is done.
        reference: the view that the line follows; by default the slowest, and of the slowest the longest.

    Returns:
        The detections, with a note on the line and one on every view that lost or lacks frames; the same object where
        its frames are together already. Frame numbers continue from the first frame of most views.

    Raises:
        DetectionsError: if there is no such view, a view's times are missing or go backwards, or no two views have
            taken anything at the same time.
    """
    if reference is not None and reference not in detections.view_names:
        raise DetectionsError(f"No view {reference!r} to follow. {suggestion(reference, detections.view_names)}")
    known = detections.recorded & np.isfinite(detections.time_s)
    if detections.n_views == 1 or not known.any():
        return detections
    _check_times(detections, known)
    if _together(detections, known, reference):
        return detections
    view = _slowest(detections, known) if reference is None else detections.view_names.index(reference)
    line = _line(detections, known, view)
    if (np.sum(line.source >= 0, axis=1) > 1).sum() == 0:
        raise DetectionsError(
            "No two views have taken anything at the same time, by their times: "
            + ", ".join(_span(detections, known, v) for v in range(detections.n_views))
            + ". Times must be of one clock."
        )
    return _gathered(detections, line, known)


def _check_times(detections: Detections, known: np.ndarray) -> None:
    for v, name in enumerate(detections.view_names):
        lacking = int((detections.recorded[:, v] & ~known[:, v]).sum())
        if lacking:
            raise DetectionsError(
                f"View {name!r} has no time for {lacking} of its {int(detections.recorded[:, v].sum())} frames, while "
                "others have times. Give the times of all, or of none."
            )
        times = detections.time_s[known[:, v], v]
        backwards = np.flatnonzero(np.diff(times) < 0)
        if len(backwards):
            at = detections.frame_numbers[known[:, v]][backwards[0]]
            raise DetectionsError(
                f"The times of view {name!r} go backwards after frame {at}: {times[backwards[0]]:.6f} s is followed by "
                f"{times[backwards[0] + 1]:.6f} s. Mend the times."
            )


def _period(times: np.ndarray) -> float:
    """Seconds between a view's frames; NaN where fewer than two differ."""
    steps = np.diff(times)
    return float(np.median(steps[steps > 0])) if (steps > 0).any() else float("nan")


def nominal_rate_hz(frame_numbers: np.ndarray, time_s: np.ndarray) -> float | None:
    """The rate of frames by their numbers and times, in five digits: more are not in clocks' times.

    Args:
        frame_numbers: shape (frame,), increasing.
        time_s: shape (frame,), NaN where unknown.

    Returns:
        Over the whole time, where that is as over the median step: single times may be rounded, and clocks may stop
        for a while. None where fewer than two times are known.
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


def _together(detections: Detections, known: np.ndarray, reference: str | None) -> bool:
    """Whether there is a view that all others keep within half an interval of."""
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


def _line(detections: Detections, known: np.ndarray, view: int) -> _Line:
    times = [detections.time_s[known[:, v], v] for v in range(detections.n_views)]
    period = _period(times[view])
    if not np.isfinite(period):
        raise DetectionsError(
            f"View {detections.view_names[view]!r} has no two frames of different times, so that it has no rate to "
            "follow."
        )
    others = np.sort(np.concatenate([each for v, each in enumerate(times) if v != view]))
    ticks = _ticks(np.unique(times[view]), others, period)
    source = np.full((len(ticks), detections.n_views), -1, dtype=np.int64)
    for v, each in enumerate(times):
        frames = np.flatnonzero(known[:, v])
        tick, used = _nearest(each, ticks, period)
        source[tick, v] = frames[used]
    # A tick without a nearest frame in any view has no frame.
    there = (source >= 0).any(axis=1)
    return _Line(view, period, ticks[there], source[there])


def _ticks(own: np.ndarray, others: np.ndarray, period: float) -> np.ndarray:
    """The times of the followed view, and of others where it has none: every interval about one."""
    before = _walk(own[0], np.inf, -others[::-1], period, backwards=True)
    after = _walk(own[-1], np.inf, others, period)
    holes = np.flatnonzero(np.diff(own) > 1.5 * period)
    filled = [_walk(own[i], own[i + 1] - _HALF * period, others, period) for i in holes]
    return np.sort(np.concatenate([before, own, *filled, after]))


def _walk(start: float, stop: float, others: np.ndarray, period: float, *, backwards: bool = False) -> np.ndarray:
    """Times of others from ``start`` to ``stop``, one an interval; backwards they are given and walked negative."""
    last = -start if backwards else start
    found = []
    while True:
        wanted = last + period
        first = int(np.searchsorted(others, wanted - _HALF * period, side="right"))
        if first == len(others):
            break
        near = others[first : int(np.searchsorted(others, wanted + _HALF * period))]
        # After a gap without frames nearby, alignment restarts.
        last = float(near[np.abs(near - wanted).argmin()]) if len(near) else float(others[first])
        if last >= stop:
            break
        found.append(last)
    return -np.array(found) if backwards else np.array(found)


def _nearest(times: np.ndarray, ticks: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Which tick each used frame goes to, and which frames those are: the nearest to each tick, each once."""
    tick = np.searchsorted(0.5 * (ticks[1:] + ticks[:-1]), times)
    off = np.abs(times - ticks[tick])
    frames = np.flatnonzero(off <= 0.5 * period * (1.0 + 1e-6))
    order = frames[np.lexsort((frames, off[frames], tick[frames]))]
    chosen, first = np.unique(tick[order], return_index=True)
    return chosen, order[first]


def _numbers(detections: Detections, line: _Line, periods: np.ndarray) -> np.ndarray:
    """Numbers of the line's frames: a step an interval, from where most of the views of its rate begin."""
    steps = np.maximum(1, np.round(np.diff(line.time_s) / line.period_s)).astype(np.int64)
    count = np.concatenate([[0], np.cumsum(steps)])
    begins = Counter[int]()
    # Of numbers that as many views begin with, those of the view that is followed.
    for v in (line.view, *(v for v in range(detections.n_views) if v != line.view)):
        there = np.flatnonzero(line.source[:, v] >= 0)
        if len(there) and abs(periods[v] / line.period_s - 1.0) < _SAME_STEP:
            begins[int(detections.frame_numbers[line.source[there[0], v]] - count[there[0]])] += 1
    return count + max(begins.most_common(1)[0][0], 0)


def _gathered(detections: Detections, line: _Line, known: np.ndarray) -> Detections:
    """The frames of the line."""
    periods = _periods(detections, known)
    has = line.source >= 0
    cells = np.where(has, line.source, 0) * detections.n_views + np.arange(detections.n_views)
    counts = np.where(has, np.diff(detections.offsets)[cells], 0)
    offsets = np.concatenate([[0], np.cumsum(counts.ravel())])
    rows = np.repeat(detections.offsets[:-1][cells].ravel() - offsets[:-1], counts.ravel()) + np.arange(offsets[-1])
    numbers = _numbers(detections, line, periods)
    rate = nominal_rate_hz(numbers, line.time_s) or 1.0 / line.period_s
    told = detections.rate_hz
    return replace(
        detections,
        frame_numbers=numbers,
        time_s=np.where(has, detections.time_s.ravel()[cells], np.nan),
        offsets=offsets,
        recorded=has,
        rate_hz=told if told is not None and abs(told / rate - 1.0) < _SAME_RATE else rate,
        notes=(*detections.notes, *_notes(detections, line, known, periods)),
        **detections.rows(rows),
    )


def _notes(detections: Detections, line: _Line, known: np.ndarray, periods: np.ndarray) -> tuple[str, ...]:
    """A sentence on the line, and one on every view that lost or lacks frames."""
    rate = f"{1.0 / line.period_s:.4g}"
    n_frames = len(line.time_s)
    said = [
        f"Views are put together by time: {n_frames} frames, {rate} Hz as {detections.view_names[line.view]}; of each "
        f"view what it took within {500.0 * line.period_s:.1f} ms."
    ]
    for v, name in enumerate(detections.view_names):
        has = line.source[:, v] >= 0
        total, used = int(known[:, v].sum()), int(has.sum())
        if total == used == n_frames:
            continue
        words = [f"{total - used} of its {total} frames are not used"] if used < total else []
        words += [f"{n_frames - used} of the {n_frames} frames it did not record"] if used < n_frames else []
        off_ms = 0.0
        if used:
            off_ms = 1000.0 * float(np.abs(detections.time_s[line.source[has, v], v] - line.time_s[has]).max())
        said.append(f"View {name} ({1.0 / periods[v]:.4g} Hz): {', '.join(words)}; at most {off_ms:.1f} ms off.")
    return tuple(said)


def _span(detections: Detections, known: np.ndarray, view: int) -> str:
    times = detections.time_s[known[:, view], view]
    name = detections.view_names[view]
    return f"{name} none" if not len(times) else f"{name} {times[0]:.3f} to {times[-1]:.3f} s"


def uneven_lengths(detections: Detections) -> str | None:
    """What there is to say of views of unequal length that no times tell how to put together, or None."""
    if not _by_number(detections):
        return None
    counts = detections.recorded.sum(axis=0)
    if len(set(counts.tolist())) == 1:
        return None
    listed = choices([f"{name} {n}" for name, n in zip(detections.view_names, counts.tolist(), strict=True)])
    return (
        f"Views have unequal numbers of frames ({listed}), and no times: they are put together by frame number. "
        "--timestamps, or --view-rates-hz, says when frames were taken."
    )


def _by_number(detections: Detections) -> bool:
    """Whether all that is known of times is the frames' numbers and a rate."""
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
