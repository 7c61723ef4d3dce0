"""Options of the detection noise."""

from dataclasses import dataclass

from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option


@dataclass(frozen=True)
class NoiseOptions:
    """Noise of the detections, as `posefuse calibrate-noise` writes it; values that are not set are estimated.

    Attributes:
        cameras: Names of the cameras that noise.scale_px describes.
        scale_px: Standard deviation per axis of each camera's detections at a confidence of 1.
        spread: Standard deviation of inlier residuals in units of the modeled noise; covariances scale with its square.
        nu: Degrees of freedom of the Student-t error distribution, stored with the result.
    """

    cameras: tuple[str, ...] = option((), example='["cam_1", "cam_2"]')
    scale_px: tuple[float, ...] = option((), above=0.0, example="[4.5, 5.0]")
    spread: float = option(1.0, above=0.0)
    nu: float | None = option(None, above=0.0, example="2.5")

    def __post_init__(self) -> None:
        check_fields(self, "noise")
        if len(self.cameras) != len(self.scale_px):
            raise OptionsError(
                f"noise.scale_px must contain one number per camera in noise.cameras ({len(self.cameras)}), got "
                f"{len(self.scale_px)}."
            )
