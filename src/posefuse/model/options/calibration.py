"""Options of a calibration by a board or by people."""

from dataclasses import dataclass
from typing import Literal

from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option
from posefuse.model.options.named_numbers import named_numbers

BoardLens = Literal["brown", "rational", "fisheye"]


@dataclass(frozen=True)
class CalibrateOptions:
    """Options of a calibration by a board.

    Attributes:
        refine_intrinsics: Adjust the known lenses, too.
        lens: Lens model of estimated lenses: brown (5 coefficients), rational (8) or fisheye (4); by default the one
            that predicts held-out images best.
        origin_frame: Frame whose board, flat on the floor, defines the world with z up; by default the first camera.
        time_offsets: Estimate the time offsets of cameras without a common trigger; disable it for triggered cameras.
        every: Interval of the images of a video that are examined; by default all images, or the most informative
            periods of videos with more than 1500 images.
        jobs: Number of threads; by default one per core.
    """

    refine_intrinsics: bool = False
    lens: BoardLens | None = None
    origin_frame: int | None = option(None, at_least=0, unit="")
    time_offsets: bool = True
    every: int | None = option(None, at_least=1, unit="images")
    jobs: int | None = option(None, at_least=1, unit="")

    def __post_init__(self) -> None:
        check_fields(self, "")


@dataclass(frozen=True)
class PeopleOptions:
    """Options of a calibration by people or animals.

    Attributes:
        stature_m: Standing height of the person, or of the tallest one, for the scale; by default human proportions
            give it with an error of about 6 %.
        length_m: Known distance between two keypoints, for the scale.
        length_between: Names of the two keypoints whose distance is length_m.
        skeleton: Keypoint set: a built-in name or a TOML file. By default it is inferred from the files.
        rate_hz: Frame rate, if the files do not state it.
        view_rates_hz: Frame rates of views that started together, each as view=rate, such as cam_2=60; other views use
            rate_hz.
        image_size: Width and height of the images, if neither the lenses nor videos beside the keypoints state it.
        max_offset_s: Largest difference of start times.
        seed: Random seed of the search for views.
        jobs: Number of processes; by default the physical cores where it pays.
    """

    stature_m: float | None = option(None, above=0.0, at_most=100.0, example="1.78")
    length_m: float | None = option(None, above=0.0, at_most=1e5, example="0.43")
    length_between: tuple[str, ...] = option((), lengths=(0, 2), example='["left_knee", "left_ankle"]')
    skeleton: str | None = option(None, example='"coco_17"')
    rate_hz: float | None = option(None, above=0.0, example="60.0")
    view_rates_hz: tuple[str, ...] = option((), example='["cam_2=60"]')
    image_size: tuple[int, ...] = option((), at_least=1, unit="px", lengths=(0, 2), example="[1920, 1080]")
    max_offset_s: float = option(2.0, at_least=0.0, at_most=60.0)
    seed: int = option(0, at_least=0, unit="")
    jobs: int | None = option(None, at_least=1, unit="")

    def __post_init__(self) -> None:
        check_fields(self, "")
        named_numbers(self.view_rates_hz, "view_rates_hz", "view=rate", "cam_2=60")
        if (self.length_m is None) != (not self.length_between):
            raise OptionsError(
                "`length_m` and `length_between` belong together: a distance and the two keypoints it joins."
            )
        if self.stature_m is not None and self.length_m is not None:
            raise OptionsError("`stature_m` and `length_m` both set the scale. Set one of them.")
