"""How noisy the detections are."""

import math
from dataclasses import dataclass, fields

import numpy as np

from posefuse.arrays import PickledByFields, frozen, same
from posefuse.errors import OptionsError


@dataclass(frozen=True, eq=False)
class NoiseModel(PickledByFields):
    """The standard deviation of a detection, per axis: ``scale_px / confidence^exponent``.

    Attributes:
        scale_px: shape (view,).
        exponent: 0 where confidence says nothing about noise.
        origin: ``fixed`` by the user, ``calibrated`` before, ``estimated`` from this recording's residuals, or
            ``assumed``, where there were too few of them to tell.
        spread: how far accepted observations err in these units, 1 if as the law says. Covariances count with it, the
            choice between right and wrong views does not.
        nu: degrees of freedom of the errors' Student t, NaN where it is not known.

    Raises:
        OptionsError: on a scale that is not positive or an exponent that is negative.
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

    def __eq__(self, other: object) -> bool:
        return isinstance(other, NoiseModel) and all(
            same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]
