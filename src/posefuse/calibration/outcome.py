"""What a refinement found: the cameras before and after, and what can be said of each."""

from dataclasses import dataclass
from typing import Literal

from posefuse.model.cameras import CameraRig
from posefuse.model.options.refinement import Refine

Role = Literal["refined", "fixed", "located", "left out"]


@dataclass(frozen=True)
class CameraOutcome:
    """What became of one camera. NaN where there is no such number.

    Attributes:
        name: of the camera.
        role: what was done with it: refined, kept fixed, located from scratch, or left out.
        why: it was left out.
        before_px: median distance of its detections in frames that were kept back from where their points project,
            with the calibration as it was; of a camera left out, from points of the others, refined.
        after_px: the same with the refined calibration.
        used_before: share of its detections in those frames that agree with other views, with the calibration as it
            was.
        used_after: the same with the refined calibration.
        turn_deg: by how much it turned.
        turn_sd_deg: the standard deviation of that in the direction that is known worst.
        shift_m: how far its centre moved.
        shift_sd_m: the standard deviation of that in the direction that is known worst.
        focal_share: by how much its focal length grew.
        focal_sd: the standard deviation of that.
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


@dataclass(frozen=True)
class Refinement:
    """A refined calibration and how it came about.

    Attributes:
        before: the cameras as they were.
        rig: the refined cameras, those left out not among them; its notes say what was done.
        cameras: what became of each camera, in the order of ``before``.
        refine: what was free to change.
        n_points: how many points the cameras were adjusted to.
        n_frames: of how many frames.
        n_held_out: how many frames were kept back to judge by.
        before_px: median error of all detections of the cameras that are kept, in the frames kept back, before.
        after_px: the same after.
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

    def __getitem__(self, name: str) -> CameraOutcome:
        return self.cameras[self.before.index(name)]

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the cameras that are not in the refined calibration."""
        return tuple(camera.name for camera in self.cameras if camera.role == "left out")
