"""The sound track of a video."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Sound:
    """The sound of one view on the clock of its video.

    Attributes:
        view: name of the view.
        samples: shape (sample,), float32, one channel, -1 to 1; empty without a sound track.
        rate_hz: samples per second.
        start_s: time of the first sample since the first image; negative if the sound starts before it.
        problem: why there is no sound, as the predicate of a sentence such as "has no sound track"; empty if there is.
    """

    view: str
    samples: np.ndarray
    rate_hz: float
    start_s: float = 0.0
    problem: str = ""

    @property
    def duration_s(self) -> float:
        """Length of the sound."""
        return len(self.samples) / self.rate_hz

    @property
    def end_s(self) -> float:
        """Time after the last sample since the first image."""
        return self.start_s + self.duration_s

    def between(self, start_s: float, n_samples: int) -> np.ndarray:
        """Return samples from a time on, shape (n_samples,), with silence where there is no sound."""
        first = round((start_s - self.start_s) * self.rate_hz)
        out = np.zeros(n_samples, dtype=np.float32)
        begin, end = max(first, 0), min(first + n_samples, len(self.samples))
        if end > begin:
            out[begin - first : end - first] = self.samples[begin:end]
        return out
