"""The noise model of detections."""

import math
from dataclasses import dataclass, fields

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import PickledByFields, frozen, same
from posefuse.errors import OptionsError

NOT_USED = 1000.0
"""Multiple of the noise of the other cameras with which a camera determines nothing."""


@checked
@dataclass(frozen=True, eq=False)
class NoiseModel(PickledByFields):
    """The standard deviation of a detection, per axis: ``scale_px / confidence^exponent``.

    Attributes:
        scale_px: shape (view,): standard deviation at a confidence of 1, per axis.
        exponent: exponent of the confidence; 0 where the noise does not depend on it.
        origin: ``fixed`` by the user, ``calibrated`` before, ``estimated`` from this recording's residuals, or
            ``assumed`` where there were too few residuals.
        spread: standard deviation of inlier residuals in units of the noise, 1 for Gaussian errors. Covariances are
            scaled by its square; outlier rejection does not use it.
        nu: degrees of freedom of the Student t distribution of errors, NaN where unknown.

    Raises:
        OptionsError: if a scale is not positive or the exponent is negative.
    """

    scale_px: np.ndarray
    exponent: float = 0.0
    origin: str = "fixed"
    spread: float = 1.0
    nu: float = math.nan

    def __post_init__(self) -> None:
        object.__setattr__(self, "scale_px", frozen(np.atleast_1d(self.scale_px)))
        if not (np.all(np.isfinite(self.scale_px)) and np.all(self.scale_px > 0)):
            raise OptionsError(f"noise_scale_px must be positive px, got {self.scale_px.tolist()}.")
        if not self.spread > 0:
            raise OptionsError(f"The noise spread must be positive, got {self.spread}.")
        if not self.exponent >= 0:
            raise OptionsError(f"The noise exponent must be 0 or more, got {self.exponent}.")

    @property
    def is_used(self) -> np.ndarray:
        """Return which cameras determine points, shape (view,), bool: those with at most 100 times the median noise."""
        return self.scale_px <= 0.1 * NOT_USED * np.median(self.scale_px)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, NoiseModel) and all(
            same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]
