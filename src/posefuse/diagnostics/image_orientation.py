"""Find views whose images were rotated, mirrored or resized after their camera was calibrated."""

import numpy as np

from posefuse.diagnostics.examination import Examination
from posefuse.diagnostics.recording_model import ImageTransform
from posefuse.model.findings import Finding, FindingKind

_ROTATIONS = {
    1: "rotated by 90 degrees clockwise",
    2: "rotated by 180 degrees",
    3: "rotated by 90 degrees counterclockwise",
}


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return a finding for each view whose images differ from those of its calibration."""
    coarse = examination.coarse
    if coarse is None or not coarse.views_agree:
        return ()
    scores = {correction.view: correction.score for correction in coarse.corrections if correction.kind == "image"}
    names = examination.observations.rig.names
    if -1 in scores:
        return (_finding((), coarse.model.images[0], scores[-1], 1.0),)
    model = coarse.model if examination.fine is None else examination.fine.final.model
    return tuple(
        _finding((names[v],), coarse.model.images[v], score, float(model.focal_ratio[0, v].mean()))
        for v, score in sorted(scores.items())
        if coarse.model.images[v] != ImageTransform()
    )


def _finding(cameras: tuple[str, ...], image: ImageTransform, score: float, focal_ratio: float) -> Finding:
    changes = []
    if image.mirrored:
        changes.append("mirrored")
    if image.quarter_turns:
        changes.append(_ROTATIONS[image.quarter_turns])
    if image.scale != 1.0:
        changes.append(f"resized by a factor of {image.scale * focal_ratio:.3g}")
    images = f"The images of view {cameras[0]!r}" if cameras else "The images of all views"
    sentence = f"{images} differ from those of the calibration: {', '.join(changes)}."
    remedy = "Detect keypoints in images like those of the calibration, or calibrate for these images."
    size, unit = (image.scale, "times") if image.scale != 1.0 else (90.0 * image.quarter_turns, "deg")
    kind = FindingKind.IMAGE_TRANSFORM
    return Finding(kind, cameras, None, float(size), unit, np.nan, 0.97, 0.5 * score, sentence, remedy)
