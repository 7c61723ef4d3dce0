"""The time offset between two views from their sounds.

Cross-correlation of the onsets over all lags proposes offsets. At each, the sounds are cut into windows, and the delay
of every window is measured by the generalized cross-correlation with phase transform (GCC-PHAT; Knapp and Carter 1976),
which whitens the spectrum and therefore ignores the frequency response of the microphones. Windows of unrelated sounds
have delays all over the search range; the number of windows that agree decides.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import next_fast_len
from scipy.special import bdtrc

from posefuse.calibration.sound.onsets import STEP_S, Onsets
from posefuse.model.sound import Sound

MIN_OVERLAP_S = 1.5
"""Shortest sound that both views must share."""
_CANDIDATES = 6
_CANDIDATE_SHARE = 0.5
"""Proposals whose correlation is below this share of the best one are not examined."""
_APART_S = 0.06
_REACH_S = 0.3
"""Delays of windows are searched this far around a proposal."""
_AGREE_S = (0.001, 0.004, 0.012)
"""Differences of delays that agree: one source, a source that moves, and sources up to 4 m more or less distant."""
_SAME_OFFSET_S = 0.025
_WINDOWS, _WINDOW_RANGE_S = 32, (0.25, 2.0)
_BAND_HZ = (150.0, 7000.0)
_CHANCE, _CHANCE_WITH_ONSETS, _ONSET_Z = 1e-6, 1e-3, 10.0
"""Largest probability of as many agreeing windows of unrelated sounds, without and with onsets that agree: the peak of
their correlation is at most 9.3 standard deviations high for unrelated sounds of 2.5 s (48 simulated pairs)."""
_HINT_CHANCE = 0.01
_RIVAL_CHANCE, _RIVAL_SHARE = 1e-3, 0.6
_DRIFT_PRIOR_PPM = 50.0
_LEAST_SD_S = 2e-4


@dataclass(frozen=True)
class Delay:
    """The time offset of a second view relative to a first one.

    Attributes:
        offset_s: time by which the second view started later, at ``middle_s``.
        sd_s: its standard deviation by the scatter of the windows, without systematic errors.
        drift_ppm: rate at which the offset grows.
        drift_sd_ppm: its standard deviation.
        middle_s: time on the clock of the first view in the middle of the shared sound.
        n_windows: number of windows compared.
        n_agreeing: number of windows that agree.
        chance: probability that as many windows of unrelated sounds agree.
        onset_z: height of the peak of the onsets' correlation in standard deviations.
        rival_s: another offset that explains the sound nearly as well, or None.
    """

    offset_s: float
    sd_s: float
    drift_ppm: float
    drift_sd_ppm: float
    middle_s: float
    n_windows: int
    n_agreeing: int
    chance: float
    onset_z: float
    rival_s: float | None = None

    @property
    def is_decisive(self) -> bool:
        """Whether the sounds determine the offset."""
        limit = _CHANCE_WITH_ONSETS if self.onset_z > _ONSET_Z else _CHANCE
        return self.chance < limit and self.rival_s is None

    @property
    def is_hinted(self) -> bool:
        """Whether the sounds agree better than most unrelated ones."""
        return self.chance < _HINT_CHANCE or self.onset_z > _ONSET_Z


def measure_delay(sounds: tuple[Sound, Sound], onsets: tuple[Onsets, Onsets]) -> Delay | None:
    """Return the time offset between two views, or None if they share too little sound at any offset.

    Args:
        sounds: sounds of the first and the second view, of one rate.
        onsets: their onsets.
    """
    found: list[Delay] = []
    for offset_s, onset_z in propose_offsets(*onsets):
        delay = _examine(*sounds, offset_s, onset_z)
        if delay is not None and all(abs(delay.offset_s - other.offset_s) > _SAME_OFFSET_S for other in found):
            found.append(delay)
    if not found:
        return None
    best, *others = sorted(found, key=lambda delay: (delay.chance, -delay.n_agreeing))
    for other in others:
        if other.chance < _RIVAL_CHANCE and other.n_agreeing >= _RIVAL_SHARE * best.n_agreeing:
            return replace(best, rival_s=other.offset_s)
    return best


def propose_offsets(a: Onsets, b: Onsets) -> list[tuple[float, float]]:
    """Return the most plausible offsets of the second view, best first, each with the height of its peak in sds."""
    n_a, n_b = a.values.shape[1], b.values.shape[1]
    least = round(MIN_OVERLAP_S / STEP_S)
    if min(n_a, n_b) < least:
        return []
    size = int(next_fast_len(n_a + n_b, real=True) or 0)
    spectrum = (np.conj(np.fft.rfft(a.values, size, axis=1)) * np.fft.rfft(b.values, size, axis=1)).sum(axis=0)
    circular = np.fft.irfft(spectrum, size)
    # At lag l, step n of the first view meets step n + l of the second.
    lags = np.arange(-(n_a - least), n_b - least + 1)
    overlap = np.minimum(n_a, n_b - lags) - np.maximum(0, -lags)
    score = circular[lags % size] / np.sqrt(overlap)
    offsets: list[tuple[float, float]] = []
    sd = 1.4826 * float(np.median(np.abs(score))) or np.inf
    apart = round(_APART_S / STEP_S)
    best = float(score.max())
    for _ in range(_CANDIDATES):
        k = int(np.argmax(score))
        if not score[k] > max(_CANDIDATE_SHARE * best, 0.0):
            break
        offsets.append((float(a.start_s - b.start_s - STEP_S * lags[k]), float(score[k]) / sd))
        score[max(k - apart, 0) : k + apart + 1] = -np.inf
    return offsets


def _examine(a: Sound, b: Sound, offset_s: float, onset_z: float) -> Delay | None:
    """Return the offset near a proposal by the delays of windows, or None if the overlap is too short."""
    start_s, end_s = max(a.start_s, b.start_s + offset_s), min(a.end_s, b.end_s + offset_s)
    if end_s - start_s < MIN_OVERLAP_S:
        return None
    length_s = float(np.clip((end_s - start_s) / _WINDOWS, *_WINDOW_RANGE_S))
    times_s = start_s + length_s * np.arange(int((end_s - start_s) / length_s))
    if len(times_s) > _WINDOWS:
        times_s = times_s[np.linspace(0, len(times_s) - 1, _WINDOWS).round().astype(int)]
    delays = np.array([_window_delay(a, b, float(time_s), length_s, offset_s) for time_s in times_s])
    heard = np.isfinite(delays)
    if not heard.any():
        return None
    return _agreement(times_s[heard] + 0.5 * length_s, delays[heard], 0.5 * (start_s + end_s), onset_z)


def _window_delay(a: Sound, b: Sound, time_s: float, length_s: float, offset_s: float) -> float:
    """Return the offset by one window, NaN if either view is silent in it."""
    rate = a.rate_hz
    n, reach = round(length_s * rate), round(_REACH_S * rate)
    first = a.between(time_s, n)
    second = b.between(time_s - offset_s - _REACH_S, n + 2 * reach)
    if not (first.any() and second.any()):
        return float("nan")
    size = int(next_fast_len(2 * n + 2 * reach, real=True) or 0)
    cross = np.conj(np.fft.rfft(first * np.hanning(n), size)) * np.fft.rfft(second, size)
    frequency = np.arange(len(cross)) * rate / size
    magnitude = np.abs(cross)
    inside = (frequency >= _BAND_HZ[0]) & (frequency <= _BAND_HZ[1]) & (magnitude > 0.0)
    phase = np.where(inside, cross / np.where(inside, magnitude, 1.0), 0.0)
    correlation = np.fft.irfft(phase, size)[: 2 * reach + 1]
    # The sampled start of both pieces is rounded to a sample.
    began = (round((time_s - a.start_s) * rate) / rate + a.start_s,
             round((time_s - offset_s - _REACH_S - b.start_s) * rate) / rate + b.start_s)  # fmt: skip
    return began[0] - (began[1] + int(np.argmax(correlation)) / rate)


def _agreement(times_s: np.ndarray, offsets_s: np.ndarray, middle_s: float, onset_z: float) -> Delay:
    """Return the offset on which windows agree in the way that is least probable by chance."""
    found = [_agree_within(times_s, offsets_s, middle_s, onset_z, each) for each in _AGREE_S]
    return min(found, key=lambda delay: delay.chance)


def _agree_within(
    times_s: np.ndarray, offsets_s: np.ndarray, middle_s: float, onset_z: float, tolerance_s: float
) -> Delay:
    """Return the offset on which most windows agree, with its drift and the probability that they agree by chance."""
    near = np.abs(offsets_s[:, None] - offsets_s[None, :]) <= tolerance_s
    center = offsets_s[int(np.argmax(near.sum(axis=1)))]
    used = np.abs(offsets_s - center) <= tolerance_s
    fit, covariance = _fit_line(times_s[used] - middle_s, offsets_s[used])
    # A drift moves windows away from the first guess.
    for _ in range(3):
        wider = np.abs(offsets_s - fit[0] - fit[1] * (times_s - middle_s)) <= tolerance_s
        if wider.sum() <= used.sum():
            break
        used = wider
        fit, covariance = _fit_line(times_s[used] - middle_s, offsets_s[used])
    n, k = len(offsets_s), int(used.sum())
    # The first window chooses the offset, so it does not count; any window and any tolerance may be chosen.
    tail = float(bdtrc(k - 2, n - 1, tolerance_s / _REACH_S)) if k > 1 else 1.0
    chance = min(tail * n * len(_AGREE_S), 1.0)
    sds = np.sqrt(np.diag(covariance))
    return Delay(
        float(fit[0]), float(sds[0]), 1e6 * float(fit[1]), 1e6 * float(sds[1]), middle_s, n, k, chance, onset_z
    )  # fmt: skip


def _fit_line(times_s: np.ndarray, offsets_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return offset and drift, and their covariance, by a robust fit with a prior on the drift."""
    design = np.stack([np.ones_like(times_s), times_s], axis=1)
    prior = np.diag([0.0, (1e-6 * _DRIFT_PRIOR_PPM) ** -2])
    fit = np.array([np.median(offsets_s), 0.0])
    covariance = np.eye(2)
    for _ in range(10):
        residual = offsets_s - design @ fit
        scale = max(1.4826 * float(np.median(np.abs(residual))), _LEAST_SD_S)
        weight = scale**-2.0 / (1.0 + np.square(residual / scale) / 3.0)
        information = design.T @ (weight[:, None] * design) + prior
        covariance = np.linalg.inv(information)
        fit = covariance @ (design.T @ (weight * offsets_s))
    return fit, covariance
