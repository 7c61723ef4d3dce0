"""Lens models and their coefficients."""

from collections.abc import Iterable
from enum import StrEnum

from posefuse.errors import CameraError


class LensModel(StrEnum):
    """Lens model; see :mod:`posefuse.kernels.cameras.lens` for the formulas."""

    PINHOLE = "pinhole"
    BROWN = "brown"
    """OpenCV's k1 k2 p1 p2 k3."""
    RATIONAL = "rational"
    """OpenCV's k1 k2 p1 p2 k3 k4 k5 k6."""
    FISHEYE = "fisheye"
    """OpenCV's fisheye (Kannala-Brandt) k1 k2 k3 k4."""


def lens_from_opencv(
    name: str, distortion: Iterable[float], *, fisheye: bool = False
) -> tuple[LensModel, tuple[float, ...]]:
    """Return the lens model and coefficients for a list of OpenCV coefficients.

    Trailing zeros are dropped down to the next simpler model: five zeros are a pinhole. This changes no pixel.

    Raises:
        CameraError: if no supported model has this number of coefficients.
    """
    given = tuple(float(k) for k in distortion)
    if fisheye:
        if len(given) not in (0, 4) and any(given[4:]):
            raise CameraError(f"Camera {name!r}: a fisheye lens has 4 coefficients, got {len(given)}: {list(given)}.")
        return LensModel.FISHEYE, (given + (0.0,) * 4)[:4]
    if len(given) > 8 and any(given[8:]):
        raise CameraError(
            f"Camera {name!r}: {len(given)} distortion coefficients; 0, 4, 5 and 8 are supported. "
            "Thin-prism and tilt terms are not: calibrate without them."
        )
    if len(given) not in (0, 1, 2, 4, 5, 8, 12, 14):
        raise CameraError(
            f"Camera {name!r}: OpenCV has 0, 4, 5 or 8 distortion coefficients, got {len(given)}: {list(given)}."
        )
    padded = (given + (0.0,) * 8)[:8]
    if any(padded[5:]):
        return LensModel.RATIONAL, padded
    if any(padded):
        return LensModel.BROWN, padded[:5]
    return LensModel.PINHOLE, ()


N_COEFFICIENTS = {LensModel.PINHOLE: 0, LensModel.BROWN: 5, LensModel.RATIONAL: 8, LensModel.FISHEYE: 4}
"""Number of distortion coefficients of each lens model."""
