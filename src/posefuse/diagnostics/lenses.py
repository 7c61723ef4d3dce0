"""Is a camera's focal length wrong, its aspect, or its lens of another model?"""

from typing import TYPE_CHECKING

import numpy as np

from posefuse.diagnostics.camera_poses import is_pose
from posefuse.diagnostics.findings import Finding, Kind, certainty_of
from posefuse.diagnostics.search import Found
from posefuse.diagnostics.state import Column
from posefuse.model.cameras import CameraRig

if TYPE_CHECKING:
    from posefuse.diagnostics.examine import Examination

_SHORTEST, _LEAST_UNEQUAL = 0.1, 0.1


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Cameras whose inner parameters are wrong."""
    return (*_by_themselves(examination.evidence.rig), *_by_agreement(examination))


def _by_themselves(rig: CameraRig) -> tuple[Finding, ...]:
    """Focal lengths that no camera has, whatever it shows."""
    out = []
    for camera in rig.cameras:
        width = max(camera.size_px)
        if camera.matrix[0, 0] < _SHORTEST * width:
            focal = float(camera.matrix[0, 0])
            sentence = (
                f"Camera {camera.name!r} has a focal length of {focal:.4g} px, which no lens gives on an image of "
                f"{width} px."
            )
            remedy = "It is probably in mm or in widths of the image: a matrix K is in px."
            out.append(Finding(Kind.FOCAL, (camera.name,), None, focal, "px", np.nan, 0.95, 500.0, sentence, remedy))
    return tuple(out)


def _by_agreement(examination: "Examination") -> tuple[Finding, ...]:
    if examination.coarse is None or not examination.coarse.agreed:
        return ()
    names = examination.evidence.rig.names
    coarse = {g.view: 400.0 * (g.before - g.after) for g in examination.coarse.guesses if g.kind == "focal"}
    found = () if examination.fine is None else examination.fine.found
    items = [i for i in found if i.hypothesis.kind in ("focal", "lens", "aspect") and not is_pose(i)]
    if -1 in coarse:
        factor = float(examination.coarse.state.focal[0, 0, 0])
        return (_focal(names, 1.0 / factor, np.nan, coarse[-1], 0.9),)
    out = []
    for v in sorted({item.hypothesis.view for item in items} | set(coarse)):
        mine = [item for item in items if item.hypothesis.view == v]
        out.append(_finding(examination, v, mine, coarse.get(v, 0.0)))
    return tuple(out)


def _finding(examination: "Examination", view: int, items: list[Found], coarse_gain: float) -> Finding:
    name = examination.evidence.rig.names[view]
    state = examination.coarse.state if examination.fine is None else examination.fine.last.state  # type: ignore[union-attr]
    given_over_true = float(1.0 / state.focal[0, view].mean())
    score = coarse_gain + sum(item.verdict.score for item in items)
    rivals = [r.score for item in items for r in item.rivals if r.hypothesis.view != view]
    certainty = certainty_of(score if not coarse_gain else 100.0, rivals)
    bends = [item for item in items if any(u.column == Column.BEND for u in item.hypothesis.unknowns)]
    if bends and not coarse_gain:
        place = [u.column for u in bends[0].hypothesis.unknowns].index(Column.BEND)
        return _lens(name, float(state.bend[0, view]), float(bends[0].sds[place]), score, certainty)
    if items and all(item.hypothesis.kind == "aspect" for item in items) and not coarse_gain:
        return _aspect(name, float(state.focal[0, view, 0] / state.focal[0, view, 1]), score, certainty)
    sd = float(items[0].sds[0]) if items else np.nan
    return _focal((name,), given_over_true, sd, score, certainty)


def _focal(names: tuple[str, ...], factor: float, sd: float, gain: float, certainty: float) -> Finding:
    who = f"Camera {names[0]!r} has" if len(names) == 1 else "All cameras have"
    sentence = f"{who} focal lengths {factor:.3f} times those that fit what the other cameras see."
    if len(names) > 1:
        sentence = f"{who} focal lengths {factor:.2f} times those at which they agree."
    remedy = "Check which lens, zoom or image size it was calibrated with; posefuse refine-calibration can free it."
    cameras = names if len(names) == 1 else ()
    return Finding(Kind.FOCAL, cameras, None, factor, "times", sd, certainty, 0.5 * gain, sentence, remedy)


def _lens(name: str, bend: float, sd: float, gain: float, certainty: float) -> Finding:
    sentence = (
        f"The lens of camera {name!r} bends as its calibration does not say: its first distortion term k1 is off by "
        f"{bend:+.2f} +- {sd:.2f}."
    )
    remedy = (
        "Is its distortion missing from the calibration, of another lens, or are its keypoints of images that were "
        "straightened already? posefuse refine-calibration can free it."
    )
    return Finding(Kind.LENS, (name,), None, bend, "k1", sd, certainty, 0.5 * gain, sentence, remedy)


def _aspect(name: str, ratio: float, gain: float, certainty: float) -> Finding:
    sentence = f"Camera {name!r} sees {ratio:.3f} times as wide for its height as its calibration says."
    remedy = "Its focal lengths fx and fy are exchanged, or its images were stretched after it was calibrated."
    return Finding(Kind.FOCAL, (name,), None, ratio, "width / height", np.nan, certainty, 0.5 * gain, sentence, remedy)
