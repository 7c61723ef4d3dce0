"""Which views took left for right, as the report shows it: shares by camera and limb, and when."""

from collections.abc import Iterable
from html import escape
from typing import Any

import numpy as np

from posefuse.model.label_swaps import SwapState
from posefuse.model.reconstruction import Reconstruction
from posefuse.report.summary import Summary

_COLUMNS = 600
"""A longer recording is shown in about this many stretches of time."""
_MOST_ROWS = 60
"""With more cameras and limbs than this, a row is a camera."""


def time_line(parts: Iterable[Reconstruction], n_frames: int) -> dict[str, Any] | None:
    """For each camera and limb, when it was swapped.

    Args:
        parts: consecutive ranges of frames.
        n_frames: of all.

    Returns:
        Names of the rows, times of the columns in s or, where one is unknown, frame numbers, which of the two, and the
        share of each stretch of time in which the limb was swapped, None where nothing tells; or None where labels were
        believed or there are no limbs.
    """
    stride = max(1, -(-n_frames // _COLUMNS))
    starts = np.arange(0, n_frames, stride)
    counts, of, times, numbers, names = np.zeros(0), np.zeros(0), [], [], []
    at = 0
    for part in parts:
        if part.swaps is None or not part.swaps.chains:
            return None
        state = np.asarray(part.swaps.state[:])
        if not names:
            counts, of = np.zeros((2, len(starts), *state.shape[2:]), dtype=np.int64)
            names = [(camera, chain) for camera in part.rig.names for chain in part.swaps.chains]
        columns = (at + np.arange(part.n_frames)) // stride
        np.add.at(counts, columns, (state == SwapState.SWAPPED).sum(axis=1))
        np.add.at(of, columns, (state != SwapState.UNKNOWN).sum(axis=1))
        times.append(part.time_s)
        numbers.append(part.frame_numbers)
        at += part.n_frames
    if len(names) > _MOST_ROWS:
        counts, of = counts.sum(axis=2, keepdims=True), of.sum(axis=2, keepdims=True)
        names = [(camera, "") for camera in dict.fromkeys(camera for camera, _ in names)]
    shares = np.where(of > 0, counts / np.maximum(of, 1), np.nan).reshape(len(starts), -1).T
    when = np.concatenate(times)
    timed = bool(np.isfinite(when).all())
    when = when if timed else np.concatenate(numbers)
    return {
        "rows": [f"{camera} {chain}".strip() for camera, chain in names],
        "time": when[starts].round(3).tolist(),
        "unit": "s" if timed else "frame",
        "share": [[None if np.isnan(share) else round(float(share), 3) for share in row] for row in shares],
    }


def swap_table(result: Reconstruction, summary: Summary) -> str:
    """The report's section on left and right; empty where labels were believed."""
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
        "<section><h2>Left and right</h2><p>Share of the time in which a camera's keypoints have a limb's left and "
        "right the wrong way round; where so, the points rest on them put right. A dash, or white: the camera does not "
        "tell.</p>"
        f'<div class="wide"><table><tr>{head}</tr>{"".join(rows)}</table></div>'
        '<div id="swaps" role="img" aria-label="When each camera took left for right"></div></section>'
    )


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if np.isfinite(share) else "–"
