"""Find cameras whose pose differs from their calibration, always or from some frame on."""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.joint.evidence import POSE_KINDS as JUDGED_KINDS
from posefuse.diagnostics.copied_poses import copies_of
from posefuse.diagnostics.examination import Examination
from posefuse.diagnostics.findings import certainty_of
from posefuse.diagnostics.fine_result import AcceptedFault
from posefuse.diagnostics.hypotheses import Hypothesis
from posefuse.diagnostics.recording_model import Parameter
from posefuse.diagnostics.verdict import Verdict, rival_text
from posefuse.model.cameras import vector_from_rotation
from posefuse.model.findings import Finding, FindingKind

POSE_KINDS = ("pose", "axial", "lateral", "rotation")
SMALL_FOCAL = 0.04
"""Smaller errors of the focal length cannot be distinguished from a shift along the optical axis."""
SMALL_K1, _SIMILAR_SCORE = 0.15, 12.0
"""Smaller errors of the distortion cannot be distinguished either if people keep to the middle of the image."""


def is_pose(fault: AcceptedFault) -> bool:
    """Return whether a fault is reported as an error of the camera pose."""
    kind, values = fault.hypothesis.kind, fault.values
    if kind == "distortion":
        unknowns = fault.hypothesis.unknowns
        k1 = next(x for x, u in zip(values, unknowns, strict=True) if u.parameter == Parameter.K1)
        scores = [c.score for c in fault.competitors if c.hypothesis.view == fault.hypothesis.view]
        return abs(float(k1)) < SMALL_K1 and bool(scores) and max(scores) > fault.evaluation.score - _SIMILAR_SCORE
    return kind in POSE_KINDS or (kind == "focal" and abs(float(values[0])) < SMALL_FOCAL)


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return a finding for each camera with a wrong pose."""
    if examination.coarse is None or examination.fine is None:
        return ()
    moved = {c.view: c.score for c in examination.coarse.corrections if c.kind == "pose"}
    zoomed = {c.view for c in examination.coarse.corrections if c.kind == "focal"}
    faults = [f for f in examination.fine.accepted if is_pose(f) and not _belongs_to_focal(f, zoomed)]
    faults = [f for f in faults if f.hypothesis.since_block is not None or _is_confirmed(examination, f)]
    views = {fault.hypothesis.view for fault in faults} | set(moved) | _judged_views(examination, zoomed)
    return tuple(
        _finding(examination, v, [fault for fault in faults if fault.hypothesis.view == v], moved.get(v, 0.0))
        for v in sorted(views - set(copies_of(examination)))
    )


def _judged_views(examination: Examination, zoomed: set[int]) -> set[int]:
    """Return the views whose pose the joint estimate finds wrong."""
    choices = () if examination.verdict is None else examination.verdict.choices
    return {choice.explanation.view for choice in choices if choice.explanation.kind in JUDGED_KINDS} - zoomed


def _is_confirmed(examination: Examination, fault: AcceptedFault) -> bool:
    """Return whether the joint estimate confirms a pose error; it does not judge the lens."""
    if examination.verdict is None or fault.hypothesis.kind in ("focal", "distortion"):
        return True
    return bool(examination.verdict.of(fault.hypothesis.view, JUDGED_KINDS))


def _belongs_to_focal(fault: AcceptedFault, zoomed: set[int]) -> bool:
    """Return whether a fault is the remainder of a grossly wrong focal length."""
    return fault.hypothesis.view in zoomed and fault.hypothesis.kind in ("axial", "focal")


def pose_difference(examination: Examination, view: int, sample: int) -> tuple[float, np.ndarray]:
    """Return how far a camera is from its calibrated pose: rotation in degrees and shift along its own axes in m."""
    assert examination.fine is not None
    model = examination.fine.final.model
    camera = examination.observations.rig.cameras[model.cameras[view]]
    rotation, translation = model.rotation[sample, view], model.translation_m[sample, view]
    rotation_deg = np.degrees(np.linalg.norm(vector_from_rotation(rotation @ camera.rotation.T)))
    return float(rotation_deg), rotation @ (-rotation.T @ translation - camera.center_m)


def _finding(examination: Examination, view: int, faults: list[AcceptedFault], coarse_score: float) -> Finding:
    observations, fine = examination.observations, examination.fine
    assert fine is not None
    names = observations.rig.names
    rotation_deg, shift_m = pose_difference(examination, view, len(fine.final.model.frames) - 1)
    first = None if coarse_score else _first_frame(examination, faults)
    choices = () if examination.verdict is None else examination.verdict.of(view, JUDGED_KINDS)
    score = coarse_score + sum(fault.evaluation.score for fault in faults)
    if not score:
        score = 2.0 * sum(choice.gain for choice in choices)
    competitors = [c.score for f in faults for c in f.competitors if not _is_equivalent(view, c.hypothesis, faults)]
    sds = _pose_sds(faults)
    if choices and first is None and not coarse_score:
        assert examination.verdict is not None
        rotation_deg, shift_m, sds = _judged_difference(examination.verdict, view)
    difference = _describe(faults, rotation_deg, shift_m, sds, bool(coarse_score))
    start = "" if first is None else f" from frame {first} on"
    camera = f"Camera {names[view]!r}"
    if len(names) == 2:
        camera = f"One of the cameras {' and '.join(map(repr, names))}"
    remedy = (
        f"Estimate its pose with `posefuse.refine_calibration` (`fix` names correct cameras), or exclude the camera: "
        f"`exclude_camera={[names[view]]!r}`"
    )
    if first is not None:
        remedy = (
            "The camera was bumped. Split the recording there (`start_s`, `end_s`) and calibrate each part, or exclude "
            f"the camera: `exclude_camera={[names[view]]!r}`"
        )
    return Finding(
        kind=FindingKind.CAMERA_POSE,
        cameras=names if len(names) == 2 else (names[view],),
        frames=None if first is None else (first, int(observations.frame_numbers[-1])),
        size=difference.size,
        unit=difference.unit,
        sd=difference.sd,
        certainty=certainty_of(score if not coarse_score else 100.0, competitors),
        gain=0.5 * score,
        sentence=f"{camera} differs from its calibrated pose{start}: {difference.text}."
        + "".join(dict.fromkeys(rival_text(examination.verdict, choice) for choice in choices if examination.verdict)),
        remedy=remedy,
    )


def _judged_difference(verdict: Verdict, view: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Return rotation in degrees, shift along the camera's axes in m, and the standard deviations of both."""
    change, turn = verdict.change[view], verdict.estimate.parameters.rotation[view]
    return float(np.degrees(np.linalg.norm(change[:3]))), turn @ change[3:6], verdict.sd[view, :6]


def _is_equivalent(view: int, hypothesis: Hypothesis, faults: list[AcceptedFault]) -> bool:
    """Return whether a competitor describes the same error by other parameters."""
    return hypothesis.view == view and (hypothesis.kind in POSE_KINDS or hypothesis.kind == "focal" or not faults)


def _first_frame(examination: Examination, faults: list[AcceptedFault]) -> int | None:
    """Return the number of the first frame with the error, or None if it is always present."""
    blocks = [fault.hypothesis.since_block for fault in faults]
    if not blocks or any(block is None for block in blocks):
        return None
    assert examination.fine is not None
    final = examination.fine.final
    sample = int(np.argmax(final.system.block_index >= min(block for block in blocks if block is not None)))
    return int(examination.observations.frame_numbers[final.model.frames[sample]])


def _pose_sds(faults: list[AcceptedFault]) -> np.ndarray:
    """Return standard deviations of the six pose parameters, NaN where they were not estimated."""
    sds = np.full(6, np.nan)
    for fault in faults:
        for unknown, sd in zip(fault.hypothesis.unknowns, fault.sds, strict=True):
            if unknown.parameter <= Parameter.TRANSLATION_Z:
                sds[unknown.parameter] = sd
    return sds


@dataclass(frozen=True)
class _Difference:
    """Describe how a camera differs from its calibration.

    Attributes:
        text: description.
        size: magnitude, NaN where it has none.
        unit: unit of the size.
        sd: standard deviation of the size, NaN where unknown.
    """

    text: str
    size: float
    unit: str
    sd: float


def _describe(
    faults: list[AcceptedFault], rotation_deg: float, shift_m: np.ndarray, sds: np.ndarray, is_gross: bool
) -> _Difference:
    """Describe a pose error in words, with its size and standard deviation."""
    kinds = {fault.hypothesis.kind for fault in faults}
    lateral, axial = float(np.linalg.norm(shift_m[:2])), float(shift_m[2])
    rotation_sd = float(np.degrees(np.sqrt(np.nanmean(sds[:3] ** 2)))) if np.isfinite(sds[:3]).any() else np.nan
    if kinds == {"distortion"} and not is_gross:
        text = (
            "it is shifted along its optical axis, or its focal length or distortion is slightly wrong (the data do "
            "not distinguish these)"
        )
        return _Difference(text, np.nan, "", np.nan)
    if kinds == {"focal"} and not is_gross:
        # A larger distance and a shorter focal length reduce the image size alike.
        focal = sum(float(f.values[0]) for f in faults if f.hypothesis.kind == "focal")
        text = (
            f"its focal length is {100 * focal:+.1f} % wrong, or it is shifted along its optical axis by the same "
            "share of the distance to the people (the data do not distinguish these)"
        )
        return _Difference(text, 100.0 * focal, "%", np.nan)
    if kinds == {"axial"} and not is_gross:
        sd = float(100.0 * sds[5])
        text = (
            f"it is shifted by {100 * axial:+.1f} +- {sd:.1f} cm along its optical axis, or its focal length is wrong "
            "by the same share (the data do not distinguish these)"
        )
        return _Difference(text, 100.0 * axial, "cm", sd)
    if kinds == {"lateral"} and not is_gross:
        sd = float(100.0 * np.sqrt(np.nanmean(sds[3:5] ** 2)))
        text = (
            f"it is shifted by {100 * lateral:.1f} +- {sd:.1f} cm across its optical axis, or slightly rotated (from "
            "afar the data do not distinguish these)"
        )
        return _Difference(text, 100.0 * lateral, "cm", sd)
    spread = f" +- {rotation_sd:.2f}" if np.isfinite(rotation_sd) else ""
    text = f"it is rotated by {rotation_deg:.2f}{spread} degrees"
    if lateral + abs(axial) > 1e-4:
        text += f" and shifted by {100 * lateral:.1f} cm across and {100 * axial:+.1f} cm along its optical axis"
    return _Difference(text, rotation_deg, "deg", rotation_sd)
