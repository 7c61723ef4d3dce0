"""Find cameras with a wrong focal length, aspect ratio or lens distortion."""

import numpy as np

from posefuse.diagnostics.camera_poses import is_pose
from posefuse.diagnostics.examination import Examination
from posefuse.diagnostics.findings import certainty_of
from posefuse.diagnostics.fine_result import AcceptedFault
from posefuse.diagnostics.recording_model import Parameter
from posefuse.model.cameras import CameraRig
from posefuse.model.findings import Finding, FindingKind

_MIN_FOCAL_PER_WIDTH = 0.1


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return findings for cameras with wrong intrinsics."""
    return (*_implausible_focal_lengths(examination.observations.rig), *_by_agreement(examination))


def _implausible_focal_lengths(rig: CameraRig) -> tuple[Finding, ...]:
    """Return findings for focal lengths that no lens has, regardless of the detections."""
    out = []
    for camera in rig.cameras:
        width = max(camera.size_px)
        if camera.matrix[0, 0] < _MIN_FOCAL_PER_WIDTH * width:
            focal_px = float(camera.matrix[0, 0])
            sentence = (
                f"Camera {camera.name!r} has an implausible focal length of {focal_px:.4g} px for an image width of "
                f"{width} px."
            )
            remedy = "The value is probably in mm or in image widths; the camera matrix K must be in px."
            kind, cameras = FindingKind.FOCAL_LENGTH, (camera.name,)
            out.append(Finding(kind, cameras, None, focal_px, "px", np.nan, 0.95, 500.0, sentence, remedy))
    return tuple(out)


def _by_agreement(examination: Examination) -> tuple[Finding, ...]:
    """Return findings for intrinsics that contradict the other views."""
    coarse, fine = examination.coarse, examination.fine
    if coarse is None or not coarse.views_agree:
        return ()
    names = examination.observations.rig.names
    coarse_scores = {c.view: c.score for c in coarse.corrections if c.kind == "focal"}
    accepted = () if fine is None else fine.accepted
    faults = [f for f in accepted if f.hypothesis.kind in ("focal", "distortion", "aspect") and not is_pose(f)]
    if -1 in coarse_scores:
        factor = float(coarse.model.focal_ratio[0, 0, 0])
        return (_focal(names, 1.0 / factor, np.nan, coarse_scores[-1], 0.9),)
    out = []
    for v in sorted({fault.hypothesis.view for fault in faults} | set(coarse_scores)):
        of_view = [fault for fault in faults if fault.hypothesis.view == v]
        out.append(_finding(examination, v, of_view, coarse_scores.get(v, 0.0)))
    return tuple(out)


def _finding(examination: Examination, view: int, faults: list[AcceptedFault], coarse_score: float) -> Finding:
    name = examination.observations.rig.names[view]
    assert examination.coarse is not None
    model = examination.coarse.model if examination.fine is None else examination.fine.final.model
    calibrated_over_true = float(1.0 / model.focal_ratio[0, view].mean())
    score = coarse_score + sum(fault.evaluation.score for fault in faults)
    competitors = [c.score for fault in faults for c in fault.competitors if c.hypothesis.view != view]
    certainty = certainty_of(score if not coarse_score else 100.0, competitors)
    distorted = [f for f in faults if any(u.parameter == Parameter.K1 for u in f.hypothesis.unknowns)]
    if distorted and not coarse_score:
        place = [u.parameter for u in distorted[0].hypothesis.unknowns].index(Parameter.K1)
        return _distortion(name, float(model.k1_correction[0, view]), float(distorted[0].sds[place]), score, certainty)
    if faults and all(fault.hypothesis.kind == "aspect" for fault in faults) and not coarse_score:
        return _aspect(name, float(model.focal_ratio[0, view, 0] / model.focal_ratio[0, view, 1]), score, certainty)
    sd = float(faults[0].sds[0]) if faults else np.nan
    return _focal((name,), calibrated_over_true, sd, score, certainty)


def _focal(names: tuple[str, ...], factor: float, sd: float, score: float, certainty: float) -> Finding:
    spread = f" +- {sd:.3f}" if np.isfinite(sd) else ""
    sentence = (
        f"The calibrated focal lengths of camera {names[0]!r} are {factor:.3f}{spread} times those that agree with the "
        "other cameras."
    )
    if len(names) > 1:
        sentence = f"The calibrated focal lengths of all cameras are {factor:.2f} times those at which they agree."
    remedy = (
        "Check the lens, zoom and image size of the calibration, or estimate the focal length with "
        "`posefuse.refine_calibration` and `refine='focal'`."
    )
    cameras = names if len(names) == 1 else ()
    kind = FindingKind.FOCAL_LENGTH
    return Finding(kind, cameras, None, factor, "times", sd, certainty, 0.5 * score, sentence, remedy)


def _distortion(name: str, k1: float, sd: float, score: float, certainty: float) -> Finding:
    sentence = (
        f"The lens distortion of camera {name!r} differs from its calibration: the radial coefficient k1 is wrong by "
        f"{k1:+.2f} +- {sd:.2f}."
    )
    remedy = (
        "Check whether the calibration lacks the distortion or belongs to another lens, or whether the keypoints were "
        "detected in undistorted images; `posefuse.refine_calibration` with `refine='lens'` estimates it."
    )
    kind = FindingKind.LENS_DISTORTION
    return Finding(kind, (name,), None, k1, "k1", sd, certainty, 0.5 * score, sentence, remedy)


def _aspect(name: str, ratio: float, score: float, certainty: float) -> Finding:
    sentence = f"The aspect ratio of the images of camera {name!r} is {ratio:.3f} times that of its calibration."
    remedy = "Check whether fx and fy are swapped, or whether the images were stretched after the calibration."
    kind = FindingKind.FOCAL_LENGTH
    return Finding(kind, (name,), None, ratio, "width / height", np.nan, certainty, 0.5 * score, sentence, remedy)
