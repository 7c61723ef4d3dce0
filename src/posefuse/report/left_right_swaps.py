"""Report section on left/right swaps: share of frames by camera and limb, and when."""

from collections.abc import Iterable
from html import escape
from typing import Any

import numpy as np

from posefuse.model.label_swaps import SwapState
from posefuse.model.reconstruction import Reconstruction
from posefuse.report.summary import Summary

_MAX_INTERVALS = 600
"""Longer recordings are summarized in about this many time intervals."""
_MAX_ROWS = 60
"""With more combinations of camera and limb than this, the chart has one row per camera."""


def swap_timeline(parts: Iterable[Reconstruction], n_frames: int) -> dict[str, Any] | None:
    """Return when each limb was swapped in each camera, as JSON data of the report page.

    Args:
        parts: consecutive ranges of frames.
        n_frames: total number of frames.

    Returns:
        Names of the rows; times of the columns in s, or frame numbers if a time is unknown, with the unit; and the
        share of each time interval in which the limb was swapped, None where it could not be decided. None if swaps
        were not examined or the skeleton has no limbs.
    """
    stride = max(1, -(-n_frames // _MAX_INTERVALS))
    starts = np.arange(0, n_frames, stride)
    swapped, decided, times, numbers, names = np.zeros(0), np.zeros(0), [], [], []
    n_frames_read = 0
    for part in parts:
        if part.swaps is None or not part.swaps.chains:
            return None
        state = np.asarray(part.swaps.state[:])
        if not names:
            swapped, decided = np.zeros((2, len(starts), *state.shape[2:]), dtype=np.int64)
            names = [(camera, chain) for camera in part.rig.names for chain in part.swaps.chains]
        columns = (n_frames_read + np.arange(part.n_frames)) // stride
        np.add.at(swapped, columns, (state == SwapState.SWAPPED).sum(axis=1))
        np.add.at(decided, columns, (state != SwapState.UNKNOWN).sum(axis=1))
        times.append(part.time_s)
        numbers.append(part.frame_numbers)
        n_frames_read += part.n_frames
    if len(names) > _MAX_ROWS:
        swapped, decided = swapped.sum(axis=2, keepdims=True), decided.sum(axis=2, keepdims=True)
        names = [(camera, "") for camera in dict.fromkeys(camera for camera, _ in names)]
    shares = np.where(decided > 0, swapped / np.maximum(decided, 1), np.nan).reshape(len(starts), -1).T
    all_times = np.concatenate(times)
    timed = bool(np.isfinite(all_times).all())
    all_times = all_times if timed else np.concatenate(numbers)
    return {
        "rows": [f"{camera} {chain}".strip() for camera, chain in names],
        "time": all_times[starts].round(3).tolist(),
        "unit": "s" if timed else "frame",
        "share": [[None if np.isnan(share) else round(float(share), 3) for share in row] for row in shares],
    }


def swap_section(result: Reconstruction, summary: Summary) -> str:
    """Return the section as HTML; empty if swaps were not examined."""
    if summary.swapped is None or result.swaps is None or not result.swaps.chains:
        return ""
    head = "".join(f"<th>{escape(name)}</th>" for name in ("Camera", *result.swaps.chains))
    rows = [
        "<tr>"
        + "".join(f"<td>{escape(cell)}</td>" for cell in (camera, *(_percent(share) for share in shares)))
        + "</tr>"
        for camera, shares in zip(result.rig.names, summary.swapped, strict=True)
    ]
    return (
        "<section><h2>Left/right swaps</h2><p>Share of frames in which a camera's detections swap the left and right "
        "side of a limb. Swapped detections are corrected before triangulation. A dash or a blank cell means that no "
        "decision was possible.</p>"
        f'<div class="wide"><table><tr>{head}</tr>{"".join(rows)}</table></div>'
        '<div id="swaps" role="img" aria-label="When each camera swapped left and right"></div></section>'
    )


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if np.isfinite(share) else "–"
