"""Data of the report's bar charts: errors and detection shares by camera, errors by keypoint."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import ViewStatus
from posefuse.report.summary import Summary
from posefuse.skeleton.skeletons import Skeleton

_VIEW_CODES = (
    ViewStatus.USED,
    ViewStatus.USED_SWAPPED,
    ViewStatus.OUTLIER,
    ViewStatus.LOW_CONFIDENCE,
    ViewStatus.UNSEEN,
)


def chart_data(result: Reconstruction, summary: Summary) -> dict[str, Any]:
    """Return the numbers of the bar charts as JSON data of the report page."""
    observations = summary.view_status_counts.sum(axis=1, keepdims=True)
    shares = summary.view_status_counts / np.maximum(observations, 1)
    order = list(ViewStatus)
    named = {code.label.replace("_", " "): shares[:, order.index(code)].round(5).tolist() for code in _VIEW_CODES}
    others = 1.0 - sum(shares[:, order.index(code)] for code in _VIEW_CODES)
    return {
        "views": list(result.rig.names),
        "view_median": _numbers([distribution.median for distribution in summary.error_px_by_view]),
        "view_p90": _numbers([distribution.p90 for distribution in summary.error_px_by_view]),
        "view_shares": named | {"other": np.maximum(others, 0.0).round(5).tolist()},
        "keypoints": list(result.skeleton.keypoints),
        "keypoint_median": _numbers([distribution.median for distribution in summary.error_px_by_keypoint]),
        "keypoint_p90": _numbers([distribution.p90 for distribution in summary.error_px_by_keypoint]),
        "keypoint_groups": keypoint_groups(result.skeleton),
        "keypoint_missing": summary.missing_by_keypoint.round(5).tolist(),
    }


def keypoint_groups(skeleton: Skeleton) -> list[list[Any]]:
    """Return the body and its parts (hands, face), each with its name and keypoint indices; groups do not overlap."""
    taken: set[int] = set()
    groups: list[list[Any]] = []
    for part in skeleton.parts:
        keypoints = [int(k) for k in part.keypoints if int(k) not in taken]
        groups.append([part.name.replace("_", " "), keypoints])
        taken.update(keypoints)
    rest = [k for k in range(len(skeleton)) if k not in taken]
    return [["body", rest], *groups] if rest else groups


def _numbers(values: Sequence[float]) -> list[float | None]:
    return [round(value, 4) if np.isfinite(value) else None for value in values]
