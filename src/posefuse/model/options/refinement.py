"""Options of calibration refinement."""

from dataclasses import dataclass
from typing import Literal, get_args

from posefuse.errors import OptionsError, choices
from posefuse.model.options.bounds import check_fields, option

Refine = Literal["extrinsics", "focal", "lens"]
REFINES: tuple[Refine, ...] = get_args(Refine)


@dataclass(frozen=True)
class RefineOptions:
    """Options of the refinement of cameras from the detections of a recording.

    Attributes:
        refine: Parameters to refine: extrinsics, focal (also the focal length) or lens (also the first two distortion
            coefficients).
        fix: Cameras whose parameters stay fixed; they define the coordinate system.
        relocate: Cameras whose pose is estimated without using the given pose.
        max_points: Maximum number of points in the bundle adjustment.
        seed: Random seed of the samples from which cameras are located.
        rigid: Treat the points as those of a rigid board seen in many poses, not of a moving subject.
        jobs: Number of processes; by default the physical cores where it pays.
    """

    refine: Refine = "extrinsics"
    fix: tuple[str, ...] = ()
    relocate: tuple[str, ...] = ()
    max_points: int = option(6000, at_least=200)
    seed: int = option(0, at_least=0)
    rigid: bool = False
    jobs: int | None = option(None, at_least=1, unit="")

    def __post_init__(self) -> None:
        check_fields(self, "")
        both = sorted(set(self.fix) & set(self.relocate))
        if both:
            raise OptionsError(f"fix and relocate must not name the same camera, got {choices(both)} in both.")
