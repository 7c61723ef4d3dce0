"""Sound tracks of videos, placed by their timestamps."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import must_exist
from posefuse.io.videos.library import import_pyav
from posefuse.model.sound import Sound

RATE_HZ = 16_000
"""Rate to which all sounds are converted; higher frequencies add nothing to the measurement of delays."""
LONGEST_S = 1200.0
"""Length of the sound that is read; offsets of longer recordings follow from their first 20 minutes."""
_GAP_S = 0.005
"""Timestamps this far from the count of samples show a gap or an overlap; smaller differences are rounding."""
_SILENCE = 1e-3


def read_sound(path: Path, view: str) -> Sound:
    """Read the sound of a video, or of a sound file, as one channel.

    Times count from the first image. The sound stream of a video usually starts some milliseconds before or after the
    images; gaps in the sound are silence.

    Args:
        path: the video.
        view: name of the view.

    Raises:
        FileError: if the file cannot be read.
    """
    av = import_pyav()
    must_exist(path, "video")
    nothing = np.empty(0, dtype=np.float32)
    try:
        with av.open(str(path)) as container:
            if not container.streams.audio:
                return Sound(view, nothing, RATE_HZ, problem="has no sound track")
            runs = _read_runs(container, av)
        with av.open(str(path)) as container:
            first_s = _first_image_s(container)
    except (av.error.FFmpegError, EOFError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(f"{path} cannot be read as a video ({reason}). Is it truncated or not a video?") from None
    if not runs:
        return Sound(view, nothing, RATE_HZ, problem="has a sound track that cannot be decoded")
    start_s, samples = _join(runs)
    if np.abs(samples).max() < _SILENCE:
        return Sound(view, nothing, RATE_HZ, problem="is silent")
    return Sound(view, samples, RATE_HZ, start_s - first_s)


def _first_image_s(container: Any) -> float:
    """Return the timestamp of the first image; 0 for a sound file."""
    if not container.streams.video:
        return 0.0
    first = next(container.decode(container.streams.video[0]), None)
    return 0.0 if first is None or first.time is None else float(first.time)


def _read_runs(container: Any, av: Any) -> list[tuple[float, np.ndarray]]:
    """Return the start time and the samples of every uninterrupted run of sound."""
    runs: list[tuple[float, list[np.ndarray]]] = []
    resampler, expected_s, begin_s = None, None, None
    for frame in _frames(container, av):
        time_s = float(frame.time) if frame.time is not None else expected_s or 0.0
        begin_s = time_s if begin_s is None else begin_s
        if time_s - begin_s > LONGEST_S:
            break
        if resampler is None or expected_s is None or abs(time_s - expected_s) > _GAP_S:
            if resampler is not None:
                runs[-1][1].extend(_convert(resampler, None))
            resampler = av.AudioResampler(format="flt", layout="mono", rate=RATE_HZ)
            runs.append((time_s, []))
            expected_s = time_s
        expected_s += frame.samples / frame.sample_rate
        frame.pts = None  # the resampler counts samples; times are those of the runs
        runs[-1][1].extend(_convert(resampler, frame))
    if resampler is not None:
        runs[-1][1].extend(_convert(resampler, None))
    return [(start_s, np.concatenate(parts)) for start_s, parts in runs if parts]


def _frames(container: Any, av: Any) -> Iterator[Any]:
    """Yield the decoded frames up to the end or the first unreadable one: the sound before it is good."""
    try:
        yield from container.decode(container.streams.audio[0])
    except (av.error.FFmpegError, EOFError):
        return


def _convert(resampler: Any, frame: Any) -> list[np.ndarray]:
    return [out.to_ndarray().reshape(-1).astype(np.float32) for out in resampler.resample(frame)]


def _join(runs: list[tuple[float, np.ndarray]]) -> tuple[float, np.ndarray]:
    """Return the start time and the samples of all runs, with silence in the gaps."""
    start_s = min(start for start, _ in runs)
    first = [round((start - start_s) * RATE_HZ) for start, _ in runs]
    n = max(at + len(samples) for at, (_, samples) in zip(first, runs, strict=True))
    out = np.zeros(min(n, round((LONGEST_S + 1.0) * RATE_HZ)), dtype=np.float32)
    for at, (_, samples) in zip(first, runs, strict=True):
        part = samples[: max(len(out) - at, 0)]
        out[at : at + len(part)] = part
    return start_s, out
