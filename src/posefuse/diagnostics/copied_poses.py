"""Is one camera's pose a copy of another's?"""

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from posefuse.diagnostics.findings import Finding, Kind
from posefuse.model.cameras import CameraRig

if TYPE_CHECKING:
    from posefuse.diagnostics.examine import Examination

_SAME_PLACE, _SAME_WAY = 1e-3, 1e-3


def same_pose(rig: CameraRig) -> list[tuple[int, int]]:
    """Pairs of cameras that stand in one place and look one way."""
    centres = np.array([camera.centre_m for camera in rig.cameras])
    spread = max(float(np.linalg.norm(centres[:, None] - centres[None], axis=-1).max()), 1e-9)
    pairs = combinations(range(len(rig)), 2)
    return [
        (a, b)
        for a, b in pairs
        if np.linalg.norm(centres[a] - centres[b]) < _SAME_PLACE * spread
        and np.abs(rig.cameras[a].rotation - rig.cameras[b].rotation).max() < _SAME_WAY
    ]


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Cameras whose pose is another's; which is the copy by what agrees with the rest."""
    rig = examination.evidence.rig
    return tuple(_finding(examination, rig, a, b) for a, b in same_pose(rig))


def copies_of(examination: "Examination") -> dict[int, int]:
    """The views that stand where others do by mistake, and whose pose it is."""
    return {copy: original for copy, original, known in _told(examination) if known}


def _told(examination: "Examination") -> list[tuple[int, int, bool]]:
    """Copy, original, and whether what they see tells them apart."""
    out = []
    moved = set() if examination.coarse is None else {g.view for g in examination.coarse.guesses if g.kind == "pose"}
    first = None if examination.coarse is None else examination.coarse.first
    for a, b in same_pose(examination.evidence.rig):
        if (a in moved) != (b in moved):
            out.append((a, b, True) if a in moved else (b, a, True))
            continue
        levels = (0.0, 0.0) if first is None else tuple(_others(first, v, (a, b)) for v in (a, b))
        known = abs(levels[0] - levels[1]) > 0.1
        out.append((a, b, known) if levels[0] > levels[1] else (b, a, known))
    return out


def _others(table: np.ndarray, view: int, pair: tuple[int, int]) -> float:
    rest = np.delete(table[view], list(pair))
    return float(np.nanmedian(rest)) if np.isfinite(rest).any() else 0.0


def _finding(examination: "Examination", rig: CameraRig, a: int, b: int) -> Finding:
    copy, original, known = next(item for item in _told(examination) if {item[0], item[1]} == {a, b})
    wrong, right = rig.names[copy], rig.names[original]
    if known:
        sentence = f"The calibration of camera {wrong!r} is a copy of that of camera {right!r}: same place, same view."
        remedy = f"Calibrate it again (posefuse refine-calibration), or leave it out: --exclude-camera {wrong}"
        return Finding(Kind.COPY, (wrong,), None, 0.0, "m", np.nan, 0.99, 1000.0, sentence, remedy)
    sentence = f"Cameras {wrong!r} and {right!r} have the same pose; one of them is a copy of the other."
    remedy = "Calibrate again, or leave one out with --exclude-camera."
    return Finding(Kind.COPY, (wrong, right), None, 0.0, "m", np.nan, 0.9, 1000.0, sentence, remedy)
