"""Simulated sounds of a room, as microphones record them, and videos that contain them."""

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from scipy.signal import butter, fftconvolve, sosfilt

RATE_HZ = 16_000


@dataclass(frozen=True)
class Microphone:
    """How a microphone records: signal-to-noise ratio, error of its clock, and whether the room echoes."""

    snr_db: float = 10.0
    clock_ppm: float = 0.0
    echo: bool = True


def room_sound(duration_s: float, rng: np.random.Generator) -> np.ndarray:
    """Return 2.5 sounds per second of different pitch, length and loudness, as of speech and steps."""
    n = int(duration_s * RATE_HZ)
    out = np.zeros(n)
    for _ in range(int(2.5 * duration_s)):
        at, length, low = rng.integers(0, n - 4000), rng.integers(400, 4000), rng.uniform(150, 2500)
        band = butter(2, [low, min(low * rng.uniform(1.3, 3), 7500)], btype="band", fs=RATE_HZ, output="sos")
        burst = sosfilt(band, rng.standard_normal(length)) * np.exp(-np.arange(length) / rng.uniform(200, 2000))
        out[at : at + length] += burst / np.abs(burst).max() * rng.uniform(0.1, 1.0)
    return out


def record(
    sound: np.ndarray,
    start_s: float,
    duration_s: float,
    rng: np.random.Generator,
    microphone: Microphone = Microphone(),
) -> np.ndarray:
    """Return what a microphone records of a sound from a time on, shape (sample,), float32."""
    n = int(duration_s * RATE_HZ)
    times_s = start_s + np.arange(n) / RATE_HZ * (1.0 + 1e-6 * microphone.clock_ppm)
    heard = np.interp(times_s * RATE_HZ, np.arange(len(sound)), sound)
    if microphone.echo:
        room = np.zeros(4000)
        room[0] = 1.0
        delays = rng.integers(80, 4000, 40)
        room[delays] += 0.35 * rng.standard_normal(40) * np.exp(-delays / 1500)
        heard = fftconvolve(heard, room)[:n]
    band = butter(1, [rng.uniform(100, 400), rng.uniform(3000, 7000)], btype="band", fs=RATE_HZ, output="sos")
    heard = sosfilt(band, heard)
    noise = np.sqrt(np.mean(heard**2)) * 10 ** (-microphone.snr_db / 20)
    heard = heard + noise * rng.standard_normal(n)
    return (0.5 * heard / np.abs(heard).max()).astype(np.float32)


def write_sounding_video(
    path: Path, samples: np.ndarray | None, *, image_hz: float = 30.0, sound_start_s: float = 0.0, codec: str = "aac"
) -> Path:
    """Write a small video with a sound track that starts ``sound_start_s`` after the first image (before, if negative).

    Without samples, the video has no sound track and lasts 1 s.
    """
    n_images = round(image_hz * (1.0 if samples is None else len(samples) / RATE_HZ))
    with av.open(str(path), "w") as container:
        images = container.add_stream("libx264", rate=Fraction(image_hz).limit_denominator(1001))
        images.width, images.height, images.pix_fmt = 32, 32, "yuv420p"
        images.codec_context.time_base = images.time_base = Fraction(1, 90_000)
        sound = None if samples is None else container.add_stream(codec, rate=RATE_HZ, layout="mono")
        earliest_s = min(sound_start_s, 0.0)
        pieces = _pieces(samples, sound, sound_start_s - earliest_s)
        for i in range(n_images):
            time_s = i / image_hz - earliest_s
            while pieces and pieces[0].pts / RATE_HZ <= time_s:
                container.mux(sound.encode(pieces.pop(0)))
            image = av.VideoFrame.from_ndarray(np.full((32, 32, 3), i % 256, dtype=np.uint8), format="rgb24")
            image.pts, image.time_base = round(time_s * 90_000), Fraction(1, 90_000)
            container.mux(images.encode(image))
        for stream, rest in ((images, []), *([(sound, pieces)] if sound is not None else [])):
            for frame in (*rest, None):
                container.mux(stream.encode(frame))
    return path


def _pieces(samples: np.ndarray | None, stream: Any, start_s: float) -> list[av.AudioFrame]:
    """Return the samples as frames of 1024 in the format of a stream."""
    pieces = []
    for first in range(0, 0 if samples is None else len(samples), 1024):
        frame = av.AudioFrame.from_ndarray(samples[None, first : first + 1024].astype(np.float32), "fltp", "mono")
        frame.sample_rate = RATE_HZ
        resampler = av.AudioResampler(format=stream.codec_context.format, layout="mono", rate=RATE_HZ)
        for part in resampler.resample(frame):
            part.pts, part.time_base = round(start_s * RATE_HZ) + first, Fraction(1, RATE_HZ)
            pieces.append(part)
    return pieces
