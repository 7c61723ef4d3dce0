"""Find cameras whose calibrated pose is a copy of another camera's."""

from itertools import combinations

import numpy as np

from posefuse.diagnostics.examination import Examination
from posefuse.model.cameras import CameraRig
from posefuse.model.findings import Finding, FindingKind

_SAME_POSITION, _SAME_ROTATION = 1e-3, 1e-3
_MIN_DIFFERENCE = 0.1


def same_poses(rig: CameraRig) -> list[tuple[int, int]]:
    """Return pairs of cameras with the same position and orientation."""
    centers = np.array([camera.center_m for camera in rig.cameras])
    extent = max(float(np.linalg.norm(centers[:, None] - centers[None], axis=-1).max()), 1e-9)
    return [
        (a, b)
        for a, b in combinations(range(len(rig)), 2)
        if np.linalg.norm(centers[a] - centers[b]) < _SAME_POSITION * extent
        and np.abs(rig.cameras[a].rotation - rig.cameras[b].rotation).max() < _SAME_ROTATION
    ]


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return a finding for each pair of equal poses; agreement with the other views shows which one is the copy."""
    rig = examination.observations.rig
    return tuple(_finding(examination, rig, a, b) for a, b in same_poses(rig))


def copies_of(examination: Examination) -> dict[int, int]:
    """Return the views with a copied pose, and the view each pose was copied from."""
    return {copy: original for copy, original, identified in _copies(examination) if identified}


def _copies(examination: Examination) -> list[tuple[int, int, bool]]:
    """Return copy, original, and whether the observations show which is which."""
    out = []
    coarse = examination.coarse
    moved = set() if coarse is None else {c.view for c in coarse.corrections if c.kind == "pose"}
    table = None if coarse is None else coarse.initial_table
    for a, b in same_poses(examination.observations.rig):
        if (a in moved) != (b in moved):
            out.append((a, b, True) if a in moved else (b, a, True))
            continue
        levels = (0.0, 0.0) if table is None else tuple(_level_without(table, v, (a, b)) for v in (a, b))
        identified = abs(levels[0] - levels[1]) > _MIN_DIFFERENCE
        out.append((a, b, identified) if levels[0] > levels[1] else (b, a, identified))
    return out


def _level_without(table: np.ndarray, view: int, pair: tuple[int, int]) -> float:
    """Return a view's median disagreement with the views outside the pair."""
    rest = np.delete(table[view], list(pair))
    return float(np.nanmedian(rest)) if np.isfinite(rest).any() else 0.0


def _finding(examination: Examination, rig: CameraRig, a: int, b: int) -> Finding:
    copy, original, identified = next(item for item in _copies(examination) if {item[0], item[1]} == {a, b})
    wrong, right = rig.names[copy], rig.names[original]
    kind = FindingKind.COPIED_POSE
    if identified:
        sentence = f"The pose of camera {wrong!r} is a copy of the pose of camera {right!r}."
        remedy = (
            f"Calibrate the camera again (`posefuse.refine_calibration`), or exclude it: `exclude_camera={[wrong]!r}`"
        )
        return Finding(kind, (wrong,), None, 0.0, "m", np.nan, 0.99, 1000.0, sentence, remedy)
    sentence = f"Cameras {wrong!r} and {right!r} have the same pose; one is probably a copy of the other."
    remedy = "Calibrate again, or exclude one of them: `exclude_camera`."
    return Finding(kind, (wrong, right), None, 0.0, "m", np.nan, 0.9, 1000.0, sentence, remedy)
