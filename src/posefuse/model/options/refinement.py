"""What a user can choose of a refinement."""

from dataclasses import dataclass
from typing import Literal, get_args

from posefuse.errors import OptionsError, suggestion

Refine = Literal["extrinsics", "focal", "lens"]
REFINES: tuple[Refine, ...] = get_args(Refine)


@dataclass(frozen=True)
class RefineOptions:
    """How cameras are refined.

    Attributes:
        refine: What may change: ``extrinsics``, these and the ``focal`` length, or also the first two distortion terms
            of the ``lens``.
        fix: Cameras that keep their place and lens, and hold the world.
        relocate: Cameras located from scratch, their given pose ignored.
        most_points: Points that cameras are adjusted to, at most.
        seed: Of the samples by which cameras are located.
        rigid: Points keep their places on a board, seen in many poses, rather than being a subject's.
    """

    refine: Refine = "extrinsics"
    fix: tuple[str, ...] = ()
    relocate: tuple[str, ...] = ()
    most_points: int = 6000
    seed: int = 0
    rigid: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "fix", tuple(self.fix))
        object.__setattr__(self, "relocate", tuple(self.relocate))
        if self.refine not in REFINES:
            raise OptionsError(f"refine: no {self.refine!r}. {suggestion(str(self.refine), REFINES)}")
        both = sorted(set(self.fix) & set(self.relocate))
        if both:
            raise OptionsError(f"Camera {both[0]!r} cannot both stay fixed and be located from scratch.")
        if self.most_points < 200:
            raise OptionsError(f"most_points must be at least 200, got {self.most_points}.")
