"""How views are out of step, as ``posefuse sync`` measures it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.errors import OptionsError

NEAR_FRAMES = 0.1
"""Views within this share of a frame's time are left as they are."""


@dataclass(frozen=True)
class SyncOptions:
    """How late views are, as `posefuse sync` writes it; a row each, all rows of a view in the order of their times.

    Attributes:
        cameras: Which camera each row is of, by name; several rows where frames were dropped.
        since_s: From which time of the view on each row holds, in s; the first of a view holds before it too.
        late_s: How much later than it says the view took its frames at that time, in s.
        drift_ppm: How fast that grows, in millionths.
    """

    cameras: tuple[str, ...] = ()
    since_s: tuple[float, ...] = ()
    late_s: tuple[float, ...] = ()
    drift_ppm: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("cameras", "since_s", "late_s", "drift_ppm"):
            values = tuple(getattr(self, name))
            object.__setattr__(self, name, values)
            if len(values) != len(self.cameras):
                raise OptionsError(
                    f"sync.{name} holds one value for each of sync.cameras: expected {len(self.cameras)}, got "
                    f"{len(values)}."
                )
            if name != "cameras" and not np.all(np.isfinite(np.array(values, dtype=float))):
                raise OptionsError(f"sync.{name} must be numbers, got {values}.")

    @property
    def does_nothing(self) -> bool:
        """Whether no view is out of step."""
        return not self.cameras

    def late(self, camera: str, time_s: np.ndarray) -> np.ndarray:
        """How late a view is at times that it says, in s; 0 for a view that has no row.

        Args:
            camera: its name.
            time_s: of any shape.
        """
        rows = sorted((since, i) for i, since in enumerate(self.since_s) if self.cameras[i] == camera)
        late = np.zeros_like(time_s, dtype=float)
        for number, (since, i) in enumerate(rows):
            told = self.late_s[i] + 1e-6 * self.drift_ppm[i] * (time_s - since)
            late = told if number == 0 else np.where(time_s >= since, told, late)
        return late

    def retimed(self, cameras: Sequence[str], time_s: np.ndarray, period_s: float) -> np.ndarray:
        """Shape (frame, view), bool: where a view's points are put between two of its frames, at the frame's time.

        Args:
            cameras: names of the views.
            time_s: shape (frame,): when frames were, as the views say, NaN where unknown.
            period_s: between frames.
        """
        late = np.stack([self.late(name, time_s) for name in cameras], axis=1) / period_s
        with np.errstate(invalid="ignore"):
            return np.abs(late - np.round(late)) > NEAR_FRAMES
