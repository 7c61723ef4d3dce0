"""Result of a refinement: the cameras before and after, and the change of each."""

from dataclasses import dataclass, replace
from typing import Literal

from posefuse.arguments import checked
from posefuse.model.cameras import CameraRig
from posefuse.model.findings import POSE_FINDINGS, Finding
from posefuse.model.options.refinement import Refine

Role = Literal["refined", "fixed", "located", "left out"]
_MIN_GAIN_Z = 3.0


@dataclass(frozen=True)
class CameraOutcome:
    """Describe the refinement of one camera; NaN where a number does not apply.

    Attributes:
        name: name of the camera.
        role: what was done: refined, kept fixed, located without an initial pose, or left out.
        why: reason why it was left out.
        before_px: median reprojection error in held-out frames with the original calibration; for a camera left out,
            from points of the other, refined cameras.
        after_px: the same with the refined calibration.
        used_before: share of its detections in those frames that agree with other views, with the original calibration.
        used_after: the same with the refined calibration.
        turn_deg: rotation angle.
        turn_sd_deg: its standard deviation in the least certain direction.
        shift_m: displacement of its center.
        shift_sd_m: its standard deviation in the least certain direction.
        focal_share: relative change of the focal length.
        focal_sd: its standard deviation.
    """

    name: str
    role: Role
    why: str
    before_px: float
    after_px: float
    used_before: float
    used_after: float
    turn_deg: float
    turn_sd_deg: float
    shift_m: float
    shift_sd_m: float
    focal_share: float
    focal_sd: float


def with_slow_errors(camera: CameraOutcome, turn_sd_deg: float, shift_sd_m: float) -> CameraOutcome:
    """Return the outcome of a refined camera with at least the standard deviations of the joint estimate.

    Those of the adjustment come from the variation between parts of the recording, which does not show errors that last
    for all of it.
    """
    if camera.role != "refined":
        return camera
    return replace(
        camera, turn_sd_deg=max(camera.turn_sd_deg, turn_sd_deg), shift_sd_m=max(camera.shift_sd_m, shift_sd_m)
    )


@checked
@dataclass(frozen=True)
class Refinement:
    """Hold a refined calibration and its validation.

    Attributes:
        before: original cameras.
        rig: refined cameras, without those left out; its notes describe the refinement.
        cameras: outcome of each camera, in the order of ``before``.
        refine: which parameters were free.
        n_points: number of points used for the adjustment.
        n_frames: number of their frames.
        n_held_out: number of frames held out for validation.
        before_px: median error of all detections of the remaining cameras in the held-out frames, before.
        after_px: the same, after.
        gain_z: mean decrease of the held-out errors over periods of time, in units of its standard deviation.
        findings: what is wrong with the recording by the recording check; None if it was not examined.
    """

    before: CameraRig
    rig: CameraRig
    cameras: tuple[CameraOutcome, ...]
    refine: Refine
    n_points: int
    n_frames: int
    n_held_out: int
    before_px: float
    after_px: float
    gain_z: float = float("nan")
    findings: tuple[Finding, ...] | None = None

    @property
    def is_better(self) -> bool:
        """Return whether to use the refined calibration.

        Errors of held-out frames have the same systematic part as those of the others, so a decrease alone is no proof:
        the recording check must find the calibration wrong, too. Without its result, and for cameras whose poses were
        not used, the decrease decides.
        """
        if self.findings is None or any(camera.role != "refined" for camera in self.cameras if camera.role != "fixed"):
            return self.predicts_better
        return self.after_px < self.before_px and any(finding.kind in POSE_FINDINGS for finding in self.findings)

    @property
    def predicts_better(self) -> bool:
        """Return whether the errors of held-out frames decrease significantly."""
        return self.after_px < self.before_px and not self.gain_z < _MIN_GAIN_Z

    def __getitem__(self, name: str) -> CameraOutcome:
        return self.cameras[self.before.index(name)]

    @property
    def left_out(self) -> tuple[str, ...]:
        """Return the names of the cameras that are not in the refined calibration."""
        return tuple(camera.name for camera in self.cameras if camera.role == "left out")
