"""Highlights of a report: findings of the recording check, and numbers that stand out, each linked to its frame."""

from html import escape

import numpy as np

from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus
from posefuse.report.heat_map import REJECTED, USED, HeatMap
from posefuse.report.messages import message_html
from posefuse.report.series import Gap, TimeSeries
from posefuse.report.summary import Summary
from posefuse.report.verdict import findings_of
from posefuse.skeleton.subject_words import subject_words

_HIGH_ERROR_RATIO = 1.5
"""List a camera or keypoint whose error exceeds the median of all by this factor."""
_HIGH_REJECTED_SHARE = 0.15
_HIGH_SWAPPED_SHARE = 0.1
_LOW_USED_RATIO = 0.7
"""List a camera that is used less than this fraction of the median camera."""
_NOTABLE_EVENTS = ("camera_rejected", "camera_silent", "possible_identity_switch", "identities_swapped")
_MAX_EVENTS = 6
_HIGH_TWO_VIEW_SHARE = 0.2
_LONG_GAP_S = 0.5
_DEFAULT_RATE_HZ = 30.0


def highlights_section(
    result: Reconstruction, summary: Summary, heat_map: HeatMap, series: TimeSeries, gaps: list[Gap]
) -> str:
    """Return the section as HTML: a list of sentences, findings first."""
    findings = findings_of(result)
    finding_list = (
        "<h3>Findings of the recording check</h3><ol>"
        + "".join(f"<li>{message_html(text)}</li>" for text in findings)
        + "</ol>"
        if findings
        else ""
    )
    items = [
        *_explain_empty_result(result, summary),
        *_list_events(result),
        *_list_cameras(result, summary, heat_map),
        *_list_little_used_cameras(result, summary),
        *_list_keypoints(result, summary, heat_map),
        *_list_swaps(result, summary),
        *_list_two_view_points(summary),
        *_list_longest_gap(result, gaps),
        *_list_worst_frame(result, series),
    ]
    listed = "<ul>" + "".join(f"<li>{item}</li>" for item in items) + "</ul>" if items else "<p>Nothing stands out.</p>"
    return f'<section id="highlights"><h2>Highlights</h2>{finding_list}{listed}</section>'


def frame_button(result: Reconstruction, frame_index: int, label: str, **marked: int) -> str:
    """Return a button, as HTML, that shows a frame in the scene.

    Args:
        result: the result.
        frame_index: index of the frame.
        label: text of the button.
        marked: indices of what to mark in the frame: ``person``, ``keypoint``, ``view``.
    """
    data = "".join(f' data-{name}="{value}"' for name, value in marked.items())
    return f'<button class="go" data-frame-index="{frame_index}"{data}>{escape(label)}</button>'


def format_interval(result: Reconstruction, start: int, stop: int) -> str:
    """Return an interval of frames in seconds, or as frame numbers if times are unknown."""
    first, last = result.time_s[start], result.time_s[stop - 1]
    if np.isfinite([first, last]).all():
        return f"{first:.2f} to {last:.2f} s"
    return f"frames {result.frame_numbers[start]} to {result.frame_numbers[stop - 1]}"


def _explain_empty_result(result: Reconstruction, summary: Summary) -> list[str]:
    """Return why there is nothing to see, if there is nothing."""
    if not result.person_ids:
        one, several = subject_words(result.skeleton)
        return [
            f"No {one} was found. Either there are too few detections or their confidence is too low (posefuse inspect "
            f"counts them), or the cameras disagree on where {several} are: the calibration, the order of the cameras "
            "or a clock may be wrong. See the notes below."
        ]
    if any(code.has_point for code in summary.status_counts):
        return []
    most = max(summary.status_counts, key=lambda code: summary.status_counts[code], default=PointStatus.NOT_SEEN)
    return [f"No point has coordinates. The most frequent reason: {most.sentence}."]


def _list_cameras(result: Reconstruction, summary: Summary, heat_map: HeatMap) -> list[str]:
    """List cameras with a high error or a high share of rejected detections."""
    errors = np.array([error.median for error in summary.error_px_by_view])
    items = []
    for v in _high_errors(errors):
        link = _worst_frame_button(result, heat_map, "error", view=int(v))
        items.append(
            f"Camera {escape(result.rig.names[v])} has a high reprojection error: median {errors[v]:.1f} px, compared "
            f"with {float(np.nanmedian(errors)):.1f} px for the median camera. {link}"
        )
    detected = heat_map.shares[..., USED] + heat_map.shares[..., REJECTED]
    with np.errstate(invalid="ignore", divide="ignore"):
        rejected = np.nansum(heat_map.shares[..., REJECTED], axis=0) / np.nansum(detected, axis=0)
    for v in np.flatnonzero(rejected > _HIGH_REJECTED_SHARE):
        link = _worst_frame_button(result, heat_map, "rejected", view=int(v))
        items.append(
            f"{100 * rejected[v]:.0f} % of the detections of camera {escape(result.rig.names[v])} were not used. Its "
            f"pose, lens model or clock may be wrong, or its detections poor. {link}"
        )
    return items


def _list_events(result: Reconstruction) -> list[str]:
    """List the first notable events."""
    indices = {int(number): index for index, number in enumerate(result.frame_numbers)}
    notable = [event for event in result.events if event.what in _NOTABLE_EVENTS and event.number in indices]
    items = [
        f"{escape(event.person)}: {event.what}, {escape(event.why)}. "
        + frame_button(result, indices[event.number], f"frame {event.number}")
        for event in notable[:_MAX_EVENTS]
    ]
    more = len(notable) - len(items)
    return [*items, *([f"{more} more events of these kinds; see People over time."] if more else [])]


def _list_little_used_cameras(result: Reconstruction, summary: Summary) -> list[str]:
    """List cameras that contribute to far fewer points than the median camera."""
    median = float(np.median(summary.used))
    return [
        f"Camera {escape(result.rig.names[v])} contributes to {100 * summary.used[v]:.0f} % of the points, compared "
        f"with {100 * median:.0f} % for the median camera. The gaps, heat map and events below show when and why."
        for v in np.flatnonzero(summary.used < _LOW_USED_RATIO * median)
    ]


def _list_keypoints(result: Reconstruction, summary: Summary, heat_map: HeatMap) -> list[str]:
    errors = np.array([error.median for error in summary.error_px_by_keypoint])
    worst = _high_errors(errors)
    if not len(worst):
        return []
    k = int(worst[np.argmax(errors[worst])])
    name, more = escape(result.skeleton.keypoints[k]), len(worst) - 1
    others = (
        f" {more} more keypoint{'s exceed' if more > 1 else ' exceeds'} {_HIGH_ERROR_RATIO:g} times the median error."
        if more
        else ""
    )
    link = _worst_frame_button(result, heat_map, "error", keypoint=k)
    return [
        f"The keypoint {name} has the highest reprojection error: median {errors[k]:.1f} px, compared with "
        f"{float(np.nanmedian(errors)):.1f} px for the median keypoint.{others} {link}"
    ]


def _high_errors(errors: np.ndarray) -> np.ndarray:
    finite = errors[np.isfinite(errors)]
    if len(finite) < 2:
        return np.zeros(0, dtype=int)
    return np.flatnonzero(np.nan_to_num(errors) > _HIGH_ERROR_RATIO * np.median(finite))


def _worst_frame_button(result: Reconstruction, heat_map: HeatMap, quantity: str, **of: int) -> str:
    """Return a button for the worst frame of a camera (``view``) or a keypoint (``keypoint``)."""
    worst = heat_map.worst[quantity]
    if not worst.frame_index.shape[-1]:
        return ""
    error = np.where(worst.frame_index[..., 0] >= 0, np.nan_to_num(worst.error_px[..., 0]), -1.0)
    candidates = np.full(error.shape, -np.inf)
    selection = (of.get("keypoint", slice(None)), of.get("view", slice(None)))
    candidates[selection] = error[selection]
    k, v = (int(i) for i in np.unravel_index(int(candidates.argmax()), candidates.shape))
    frame = int(worst.frame_index[k, v, 0])
    if frame < 0:
        return ""
    label = f"worst: {result.skeleton.keypoints[k]} in {result.rig.names[v]}, frame {result.frame_numbers[frame]}"
    return frame_button(result, frame, label, person=int(worst.person[k, v, 0]), keypoint=k, view=v)


def _list_swaps(result: Reconstruction, summary: Summary) -> list[str]:
    shares = [summary.swapped_share(v) for v in range(len(result.rig))]
    named = [
        f"{escape(name)} ({100 * s:.0f} %)"
        for name, s in zip(result.rig.names, shares, strict=True)
        if s > _HIGH_SWAPPED_SHARE
    ]
    return [f"Left/right swaps were corrected in {', '.join(named)}."] if named else []


def _list_two_view_points(summary: Summary) -> list[str]:
    share = summary.status_counts.get(PointStatus.TWO_VIEWS, 0) / max(summary.n_points, 1)
    return (
        [f"{100 * share:.0f} % of the points were triangulated from two views only, so outliers cannot be detected."]
        if share > _HIGH_TWO_VIEW_SHARE
        else []
    )


def _list_longest_gap(result: Reconstruction, gaps: list[Gap]) -> list[str]:
    if not gaps or gaps[0].stop - gaps[0].start < _LONG_GAP_S * (result.rate_hz or _DEFAULT_RATE_HZ):
        return []
    gap = gaps[0]
    person = f" of {result.person_ids[gap.person]}" if len(result.person_ids) > 1 else ""
    name = result.skeleton.keypoints[gap.keypoint]
    label = format_interval(result, gap.start, gap.stop)
    link = frame_button(result, gap.start, label, person=gap.person, keypoint=gap.keypoint)
    handling = "filled" if gap.filled else "left missing"
    return [
        f"The longest interval without a measurement: {escape(name + person)}, {gap.stop - gap.start} frames, "
        f"{handling}. {link}"
    ]


def _list_worst_frame(result: Reconstruction, series: TimeSeries) -> list[str]:
    if not np.isfinite(series.error_px).any():
        return []
    frame, person = (int(i) for i in np.unravel_index(int(np.nanargmax(series.error_px)), series.error_px.shape))
    name = f" of {escape(result.person_ids[person])}" if len(result.person_ids) > 1 else ""
    link = frame_button(result, frame, f"frame {result.frame_numbers[frame]}", person=person)
    return [f"The frame with the highest mean error{name}: {series.error_px[frame, person]:.1f} px. {link}"]
