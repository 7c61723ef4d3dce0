"""Does a camera stand or look elsewhere than its calibration says, all the time or from some moment on?"""

from typing import TYPE_CHECKING

import numpy as np

from posefuse.diagnostics.copied_poses import copies_of
from posefuse.diagnostics.findings import Finding, Kind, certainty_of
from posefuse.diagnostics.linear_system import System
from posefuse.diagnostics.search import Found
from posefuse.diagnostics.state import Column
from posefuse.model.cameras import vector_from_rotation

if TYPE_CHECKING:
    from posefuse.diagnostics.examine import Examination

POSES = ("pose", "along", "across", "turn")
SMALL_FOCAL = 0.04
"""Focal lengths off by less are not told from a camera that stands nearer or farther."""
SMALL_BEND, _ALIKE = 0.15, 12.0
"""Nor are lenses that bend a little more or less, where people keep to the middle of the image."""


def is_pose(found: Found) -> bool:
    """Whether this says that a camera stands or looks elsewhere."""
    kind, values = found.hypothesis.kind, found.values
    if kind == "lens":
        bend = next(x for x, u in zip(values, found.hypothesis.unknowns, strict=True) if u.column == Column.BEND)
        like = [r.score for r in found.rivals if r.hypothesis.view == found.hypothesis.view]
        return abs(float(bend)) < SMALL_BEND and bool(like) and max(like) > found.verdict.score - _ALIKE
    return kind in POSES or (kind == "focal" and abs(float(values[0])) < SMALL_FOCAL)


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Cameras whose pose is off, with how much."""
    if examination.coarse is None or examination.fine is None:
        return ()
    moved = {g.view: 400.0 * (g.before - g.after) for g in examination.coarse.guesses if g.kind == "pose"}
    zoomed = {guess.view for guess in examination.coarse.guesses if guess.kind == "focal"}
    items = [i for i in examination.fine.found if is_pose(i) and not _of_the_focal(i, zoomed)]
    views = sorted(({item.hypothesis.view for item in items} | set(moved)) - set(copies_of(examination)))
    return tuple(
        _finding(examination, v, [item for item in items if item.hypothesis.view == v], moved.get(v, 0.0))
        for v in views
    )


def _of_the_focal(item: Found, zoomed: set[int]) -> bool:
    """Whether this is what is left of a focal length that was found to be far off."""
    return item.hypothesis.view in zoomed and item.hypothesis.kind in ("along", "focal")


def difference(examination: "Examination", view: int, sample: int) -> tuple[float, np.ndarray]:
    """How far a view's camera is from its calibration: degrees turned, and metres moved along its own axes."""
    assert examination.fine is not None
    state = examination.fine.last.state
    camera = examination.evidence.rig.cameras[state.cameras[view]]
    rotation, translation = state.rotation[sample, view], state.translation_m[sample, view]
    turn = np.degrees(np.linalg.norm(vector_from_rotation(rotation @ camera.rotation.T)))
    return float(turn), rotation @ (-rotation.T @ translation - camera.centre_m)


def _finding(examination: "Examination", view: int, items: list[Found], coarse_gain: float) -> Finding:
    evidence, fine = examination.evidence, examination.fine
    assert fine is not None
    name = evidence.rig.names[view]
    turn, moved = difference(examination, view, len(fine.last.state.frames) - 1)
    since = None if coarse_gain else _since(examination, items)
    score = coarse_gain + sum(item.verdict.score for item in items)
    rivals = [r.score for item in items for r in item.rivals if not _explained(view, r.hypothesis, items)]
    focal = sum(float(i.values[0]) for i in items if i.hypothesis.kind == "focal")
    sds = _sds(items)
    what, size, unit, sd = _words(items, turn, moved, focal, sds, coarse_gain)
    when = "" if since is None else f", from frame {since} on"
    two = len(evidence.rig) == 2
    who = f"Camera {name!r}" if not two else f"One of the cameras {' and '.join(map(repr, evidence.rig.names))}"
    last = int(evidence.frame_numbers[-1])
    return Finding(
        Kind.POSE,
        evidence.rig.names if two else (name,),
        None if since is None else (since, last),
        size,
        unit,
        sd,
        certainty_of(score if not coarse_gain else 100.0, rivals),
        0.5 * score,
        f"{who} is not where its calibration says: {what}{when}.",
        "posefuse refine-calibration finds its pose anew (--fix names cameras that are right); "
        f"--exclude-camera {name} leaves it out."
        if since is None
        else f"It was bumped: cut the recording there (--start-s, --end-s) and calibrate each part, or leave the "
        f"camera out (--exclude-camera {name}).",
    )


def _explained(view: int, hypothesis: object, items: list[Found]) -> bool:
    """Whether a rival says the same in other words."""
    kind = getattr(hypothesis, "kind", "")
    same = getattr(hypothesis, "view", -1) == view
    return same and (kind in POSES or kind == "focal" or not items)


def _since(examination: "Examination", items: list[Found]) -> int | None:
    """The frame number from which on the camera is off, where it was not before."""
    blocks = [item.hypothesis.since for item in items]
    if not blocks or any(block is None for block in blocks):
        return None
    system: System = examination.fine.last.system  # type: ignore[union-attr]
    sample = int(np.argmax(system.block_of >= min(block for block in blocks if block is not None)))
    return int(examination.evidence.frame_numbers[examination.fine.last.state.frames[sample]])  # type: ignore[union-attr]


def _sds(items: list[Found]) -> np.ndarray:
    """Standard deviations of the six numbers of a pose, NaN where they were not free."""
    sds = np.full(6, np.nan)
    for item in items:
        for unknown, sd in zip(item.hypothesis.unknowns, item.sds, strict=True):
            if unknown.column <= Column.SHIFT_Z:
                sds[unknown.column] = sd
    return sds


def _words(
    items: list[Found], turn_deg: float, moved_m: np.ndarray, focal: float, sds: np.ndarray, coarse_gain: float
) -> tuple[str, float, str, float]:
    """What is off in words, and its size, unit and standard deviation."""
    kinds = {item.hypothesis.kind for item in items}
    across, along = float(np.linalg.norm(moved_m[:2])), float(moved_m[2])
    turn_sd = float(np.degrees(np.sqrt(np.nanmean(sds[:3] ** 2)))) if np.isfinite(sds[:3]).any() else np.nan
    if kinds == {"lens"} and not coarse_gain:
        text = (
            "it stands nearer or farther along its axis, or its focal length or lens is a little off (they look alike)"
        )
        return text, np.nan, "", np.nan
    if kinds == {"focal"} and not coarse_gain:
        # A camera that stands farther away makes people as much smaller as a shorter lens.
        text = f"its focal length is {100 * focal:+.1f} % off, or it stands nearer or farther along its axis by as much"
        return text + " of the distance to the people (the two look alike)", 100.0 * focal, "%", np.nan
    if kinds <= {"along"} and not coarse_gain:
        sd = float(100.0 * sds[5])
        text = (
            f"moved {100 * along:+.1f} +- {sd:.1f} cm along its axis (or its focal length is off by as many per cent "
        )
        return text + "as that is of the distance: the two look alike)", 100.0 * along, "cm", sd
    if kinds <= {"across"} and not coarse_gain:
        sd = float(100.0 * np.sqrt(np.nanmean(sds[3:5] ** 2)))
        text = f"moved {100 * across:.1f} +- {sd:.1f} cm across its axis, or turned a little (from afar the two look "
        return text + "alike)", 100.0 * across, "cm", sd
    spread = f" +- {turn_sd:.2f}" if np.isfinite(turn_sd) else ""
    text = f"turned by {turn_deg:.2f}{spread} degrees"
    if across + abs(along) > 1e-4:
        text += f", moved {100 * across:.1f} cm across and {100 * along:+.1f} cm along its axis"
    return text, turn_deg, "deg", turn_sd
