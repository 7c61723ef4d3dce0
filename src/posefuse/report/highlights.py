"""What to look at first: findings of the health check, and what stands out of the numbers, each with its frame."""

from html import escape

import numpy as np

from posefuse.diagnostics.findings import HEALTH
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus
from posefuse.report.cells import REJECTED, USED, Cells
from posefuse.report.series import Gap, Series
from posefuse.report.summary import Summary

_STANDS_OUT = 1.5
"""A camera or keypoint whose error is this many times the usual is named."""
_MUCH_REJECTED = 0.15
_MUCH_SWAPPED = 0.1
_LITTLE_USED = 0.7
"""A camera that is used less than this share of the usual is named."""
_TELLING = ("camera refused", "camera silent", "identity uncertain", "identities exchanged")
_MOST_EVENTS = 6
_FEW_VIEWS = 0.2
_LONG_GAP_S = 0.5
_USUAL_RATE_HZ = 30.0


def look_section(result: Reconstruction, summary: Summary, cells: Cells, series: Series, gaps: list[Gap]) -> str:
    """A list of sentences, the findings first."""
    health = [str(finding) for finding in result.findings]
    # Results of earlier versions hold findings as notes.
    health += [note.removeprefix(HEALTH) for note in result.provenance.notes if note.startswith(HEALTH)]
    findings = (
        "<h3>Findings of the health check</h3><ol>" + "".join(f"<li>{escape(text)}</li>" for text in health) + "</ol>"
        if health
        else ""
    )
    items = [
        *_empty(result, summary),
        *_events(result),
        *_cameras(result, summary, cells),
        *_little_used(result, summary),
        *_keypoints(result, summary, cells),
        *_swapped(result, summary),
        *_few_views(summary),
        *_long_gap(result, gaps),
        *_worst_moment(result, series),
    ]
    listed = "<ul>" + "".join(f"<li>{item}</li>" for item in items) + "</ul>" if items else "<p>Nothing stands out.</p>"
    return f'<section id="look"><h2>What to look at</h2>{findings}{listed}</section>'


def jump(result: Reconstruction, place: int, words: str, **marked: int) -> str:
    """A button that shows a frame.

    Args:
        result: whose frame.
        place: of the frame.
        words: on the button.
        marked: places of what is marked there: person, keypoint, view.
    """
    data = "".join(f' data-{name}="{value}"' for name, value in marked.items())
    return f'<button class="go" data-place="{place}"{data}>{escape(words)}</button>'


def span(result: Reconstruction, start: int, stop: int) -> str:
    """A stretch of frames in seconds, or by number where times are unknown."""
    first, last = result.time_s[start], result.time_s[stop - 1]
    if np.isfinite([first, last]).all():
        return f"{first:.2f} to {last:.2f} s"
    return f"frames {result.frame_numbers[start]} to {result.frame_numbers[stop - 1]}"


def _empty(result: Reconstruction, summary: Summary) -> list[str]:
    """Why there is nothing to see, where there is nothing."""
    if not result.person_ids:
        return [
            "Nobody was found. Either the detections are too few or too unsure (posefuse inspect counts them), or the "
            "cameras do not agree where anybody is: a wrong calibration, order of cameras, or clock. Notes below say "
            "what was noticed."
        ]
    if any(code.has_point for code in summary.status_counts):
        return []
    most = max(summary.status_counts, key=lambda code: summary.status_counts[code], default=PointStatus.NOT_SEEN)
    return [f"No point has coordinates, most for one reason: {most.sentence}."]


def _cameras(result: Reconstruction, summary: Summary, cells: Cells) -> list[str]:
    """Cameras whose error or rejected share stands out."""
    errors = np.array([error.median for error in summary.error_px_by_view])
    items = []
    for v in _outstanding(errors):
        where = _worst_link(result, cells, "error", view=int(v))
        items.append(
            f"Camera {escape(result.rig.names[v])} errs more than the others: median {errors[v]:.1f} px, "
            f"usual {float(np.nanmedian(errors)):.1f} px. {where}"
        )
    seen = cells.shares[..., USED] + cells.shares[..., REJECTED]
    with np.errstate(invalid="ignore", divide="ignore"):
        rejected = np.nansum(cells.shares[..., REJECTED], axis=0) / np.nansum(seen, axis=0)
    for v in np.flatnonzero(rejected > _MUCH_REJECTED):
        where = _worst_link(result, cells, "rejected", view=int(v))
        items.append(
            f"{100 * rejected[v]:.0f} % of what camera {escape(result.rig.names[v])} shows was not used: its pose, "
            f"lens or clock may be off, or its detections bad. {where}"
        )
    return items


def _events(result: Reconstruction) -> list[str]:
    """What happened that a reader should see, the first few."""
    places = {int(number): place for place, number in enumerate(result.frame_numbers)}
    telling = [event for event in result.events if event.what in _TELLING and event.number in places]
    items = [
        f"{escape(event.person)}: {event.what}, {escape(event.why)}. "
        + jump(result, places[event.number], f"frame {event.number}")
        for event in telling[:_MOST_EVENTS]
    ]
    more = len(telling) - len(items)
    return [*items, *([f"{more} more events of these kinds: see people over time."] if more else [])]


def _little_used(result: Reconstruction, summary: Summary) -> list[str]:
    """Cameras that count in far fewer points than the usual one."""
    usual = float(np.median(summary.used))
    return [
        f"Camera {escape(result.rig.names[v])} counts in {100 * summary.used[v]:.0f} % of the points, the usual one in "
        f"{100 * usual:.0f} %: gaps, cells and events below say when and why."
        for v in np.flatnonzero(summary.used < _LITTLE_USED * usual)
    ]


def _keypoints(result: Reconstruction, summary: Summary, cells: Cells) -> list[str]:
    errors = np.array([error.median for error in summary.error_px_by_keypoint])
    worst = _outstanding(errors)
    if not len(worst):
        return []
    k = int(worst[np.argmax(errors[worst])])
    name, more = escape(result.skeleton.keypoints[k]), len(worst) - 1
    others = (
        f" (and {more} more keypoint{'s' if more > 1 else ''} over {_STANDS_OUT:g} times the usual)" if more else ""
    )
    where = _worst_link(result, cells, "error", keypoint=k)
    return [f"{name} errs most: median {errors[k]:.1f} px, usual {float(np.nanmedian(errors)):.1f} px{others}. {where}"]


def _outstanding(errors: np.ndarray) -> np.ndarray:
    known = errors[np.isfinite(errors)]
    if len(known) < 2:
        return np.zeros(0, dtype=int)
    return np.flatnonzero(np.nan_to_num(errors) > _STANDS_OUT * np.median(known))


def _worst_link(result: Reconstruction, cells: Cells, quantity: str, **of: int) -> str:
    """The worst frame of a camera or a keypoint."""
    worst = cells.worst[quantity]
    if not worst.place.shape[-1]:
        return ""
    error = np.where(worst.place[..., 0] >= 0, np.nan_to_num(worst.error_px[..., 0]), -1.0)
    chosen = np.full(error.shape, -np.inf)
    place = (of.get("keypoint", slice(None)), of.get("view", slice(None)))
    chosen[place] = error[place]
    k, v = (int(i) for i in np.unravel_index(int(chosen.argmax()), chosen.shape))
    frame = int(worst.place[k, v, 0])
    if frame < 0:
        return ""
    words = f"worst in {result.rig.names[v]} at {result.skeleton.keypoints[k]}, frame {result.frame_numbers[frame]}"
    return jump(result, frame, words, person=int(worst.person[k, v, 0]), keypoint=k, view=v)


def _swapped(result: Reconstruction, summary: Summary) -> list[str]:
    shares = [summary.swapped_in(v) for v in range(len(result.rig))]
    named = [
        f"{escape(name)} ({100 * s:.0f} %)"
        for name, s in zip(result.rig.names, shares, strict=True)
        if s > _MUCH_SWAPPED
    ]
    return [f"Left and right were the wrong way round, and put right, in {', '.join(named)}."] if named else []


def _few_views(summary: Summary) -> list[str]:
    few = summary.status_counts.get(PointStatus.TWO_VIEWS, 0) / max(summary.n_points, 1)
    return (
        [f"{100 * few:.0f} % of the points rest on two views, with nothing to check them against."]
        if few > _FEW_VIEWS
        else []
    )


def _long_gap(result: Reconstruction, gaps: list[Gap]) -> list[str]:
    if not gaps or gaps[0].stop - gaps[0].start < _LONG_GAP_S * (result.rate_hz or _USUAL_RATE_HZ):
        return []
    gap = gaps[0]
    who = f" of {result.person_ids[gap.person]}" if len(result.person_ids) > 1 else ""
    name = result.skeleton.keypoints[gap.keypoint]
    link = jump(result, gap.start, span(result, gap.start, gap.stop), person=gap.person, keypoint=gap.keypoint)
    what = "filled" if gap.filled else "left out"
    return [
        f"The longest stretch without a measurement: {escape(name + who)}, {gap.stop - gap.start} frames, {what}. "
        f"{link}"
    ]


def _worst_moment(result: Reconstruction, series: Series) -> list[str]:
    if not np.isfinite(series.error_px).any():
        return []
    frame, person = (int(i) for i in np.unravel_index(int(np.nanargmax(series.error_px)), series.error_px.shape))
    who = f" of {escape(result.person_ids[person])}" if len(result.person_ids) > 1 else ""
    link = jump(result, frame, f"frame {result.frame_numbers[frame]}", person=person)
    return [f"The worst moment{who}: {series.error_px[frame, person]:.1f} px on average. {link}"]
