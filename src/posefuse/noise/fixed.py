"""The noise that options fix, which live tracking uses without the estimation of noise."""

import math

import numpy as np

from posefuse.errors import OptionsError, choices
from posefuse.model.cameras import CameraRig
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options


def fixed_noise(rig: CameraRig, options: Options) -> NoiseModel | None:
    """Return the noise that the options fix, or None.

    Raises:
        OptionsError: if they fix it for other cameras.
    """
    exponent, noise = options.triangulation.confidence_exponent, options.noise
    if options.noise_scale_px is not None:
        return NoiseModel(np.full(len(rig), options.noise_scale_px), exponent)
    if not noise.cameras:
        return None
    scale_of = dict(zip(noise.cameras, noise.scale_px, strict=True))
    missing = [name for name in rig.names if name not in scale_of]
    if missing:
        raise OptionsError(
            f"noise.cameras has no scale for {choices(missing)}; it names {choices(noise.cameras)}. Calibrate the "
            "noise with this rig, or remove the table [noise]."
        )
    scale_px = np.array([scale_of[name] for name in rig.names])
    return NoiseModel(scale_px, exponent, "calibrated", noise.spread, math.nan if noise.nu is None else noise.nu)
