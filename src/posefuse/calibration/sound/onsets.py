"""Onsets of sounds in frequency bands, which different microphones and rooms change least."""

from dataclasses import dataclass

import numpy as np

from posefuse.model.sound import Sound

STEP_S = 0.005
_WINDOW_S = 0.032
_EDGES_HZ = np.geomspace(150.0, 7000.0, 13)
_FLOOR_QUANTILE = 0.1
_LARGEST = 4.0
_BLOCK = 4096


@dataclass(frozen=True, eq=False)
class Onsets:
    """The onsets of one view's sound.

    Attributes:
        values: shape (band, step), float32: increase of the loudness of each band, of mean 0 and variance 1, limited.
        start_s: time of the first step on the view's clock.
    """

    values: np.ndarray
    start_s: float


def find_onsets(sound: Sound) -> Onsets:
    """Return the onsets of a sound of at least one window.

    The loudness is logarithmic, so the level and the frequency response of the microphone cancel in its increase.
    """
    size, hop = round(_WINDOW_S * sound.rate_hz), round(STEP_S * sound.rate_hz)
    n_steps = max((len(sound.samples) - size) // hop + 1, 0)
    energy = np.empty((len(_EDGES_HZ) - 1, n_steps))
    edges = np.searchsorted(np.fft.rfftfreq(size, 1.0 / sound.rate_hz), _EDGES_HZ)
    window = np.hanning(size)
    for first in range(0, n_steps, _BLOCK):
        starts = hop * np.arange(first, min(first + _BLOCK, n_steps))
        pieces = sound.samples[starts[:, None] + np.arange(size)] * window
        power = np.square(np.abs(np.fft.rfft(pieces, axis=1)))
        energy[:, first : first + len(starts)] = np.add.reduceat(power, edges[:-1], axis=1)[:, : len(edges) - 1].T
    values = _increase(energy)
    return Onsets(values.astype(np.float32), sound.start_s + 0.5 * _WINDOW_S)


def _increase(energy: np.ndarray) -> np.ndarray:
    """Return the normalized increase of the logarithmic energy, shape (band, step)."""
    if energy.shape[1] < 3:
        return np.zeros_like(energy)
    # Energy near the background noise does not count as a change.
    floor = np.quantile(energy, _FLOOR_QUANTILE, axis=1, keepdims=True) + 1e-9 * energy.max(axis=1, keepdims=True)
    level = np.log(energy + floor + 1e-20)
    rise = np.maximum(np.diff(level, axis=1, prepend=level[:, :1]), 0.0)
    rise -= rise.mean(axis=1, keepdims=True)
    sd = rise.std(axis=1, keepdims=True)
    limited = np.clip(rise / np.where(sd > 0.0, sd, np.inf), -_LARGEST, _LARGEST)
    return limited - limited.mean(axis=1, keepdims=True)
