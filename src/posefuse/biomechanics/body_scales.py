"""Sizes of people: independent logarithms of scales with a prior, and the scale factors of bodies that follow."""

import numpy as np

from posefuse.biomechanics.anatomy.anatomy import Anatomy

_STATURE_SD = 0.09
_SCALES: tuple[tuple[tuple[str, ...], tuple[int, ...], float], ...] = (
    (("pelvis",), (0, 1), 0.07),
    (("pelvis",), (2,), 0.07),
    (("torso",), (0,), 0.05),
    (("torso",), (1,), 0.05),
    (("torso",), (2,), 0.06),
    (("head",), (0, 1, 2), 0.04),
    (("femur",), (0, 1, 2), 0.035),
    (("tibia", "patella"), (0, 1, 2), 0.04),
    (("talus", "calcn", "toes"), (0, 1, 2), 0.04),
    (("humerus",), (0, 1, 2), 0.04),
    (("ulna", "radius"), (0, 1, 2), 0.045),
    (("hand",), (0, 1, 2), 0.05),
)
"""Bodies, their axes, and the standard deviation of the logarithm of their scale relative to stature."""


def scale_basis(anatomy: Anatomy) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivatives of the logarithms of scale factors, and the standard deviations of the parameters.

    The first parameter is stature, which scales all bodies; left and right bodies have the same scale factors.

    Returns:
        Shape (body, 3, parameter), and shape (parameter,).
    """
    basis = np.zeros((len(anatomy.bodies), 3, 1 + len(_SCALES)))
    basis[..., 0] = 1.0
    for s, (names, axes, _) in enumerate(_SCALES, start=1):
        for b, body in enumerate(anatomy.bodies):
            if body.removesuffix("_r").removesuffix("_l") in names:
                basis[b, list(axes), s] = 1.0
    return basis, np.array([_STATURE_SD, *(sd for *_, sd in _SCALES)])


def scale_factors(basis: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Return the scale factors of bodies, shape (body, 3)."""
    return np.exp(basis @ parameters)
