"""Options of a calibration by a board."""

from dataclasses import dataclass
from typing import Literal

from posefuse.model.options.bounds import check_fields, option

BoardLens = Literal["brown", "rational", "fisheye"]


@dataclass(frozen=True)
class CalibrateOptions:
    """Options of a calibration by a board.

    Attributes:
        refine_intrinsics: Adjust the known lenses, too.
        lens: Lens model of estimated lenses: brown (5 coefficients), rational (8) or fisheye (4); by default the one
            that predicts held-out images best.
        origin_frame: Frame whose board, flat on the floor, defines the world with z up; by default the first camera.
        every: Interval of the images of a video that are examined.
        jobs: Number of processes; by default one per core.
    """

    refine_intrinsics: bool = False
    lens: BoardLens | None = None
    origin_frame: int | None = option(None, at_least=0, unit="")
    every: int = option(1, at_least=1, unit="images")
    jobs: int | None = option(None, at_least=1, unit="")

    def __post_init__(self) -> None:
        check_fields(self, "")
