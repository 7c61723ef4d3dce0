"""Points and clocks shared by the tests of post-processing."""

import numpy as np

from posefuse.model.status import Source
from posefuse.postprocess.points import Clock, Points

RATE_HZ = 60.0


def points_of(xyz: np.ndarray, sd_m: float = 0.005) -> Points:
    reference = np.isfinite(xyz[..., 0])
    entries = sd_m**2 * np.array([1.0, 0, 0, 1.0, 0, 1.0])
    covariance = np.where(reference[..., None], entries, np.nan)
    return Points(xyz, covariance, np.where(reference, Source.MEASURED, Source.NONE).astype(np.int8))


def clock_of(frames: int, rate_hz: float = RATE_HZ) -> Clock:
    return Clock.of(np.arange(frames) / rate_hz, rate_hz)


def wave(frames: int, hertz: float, amplitude: float = 0.1, rate_hz: float = RATE_HZ) -> np.ndarray:
    phase = 2 * np.pi * hertz * np.arange(frames) / rate_hz
    return amplitude * np.stack([np.sin(phase), np.cos(phase), 0 * phase], axis=-1)[:, None]
