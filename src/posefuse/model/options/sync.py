"""Time offsets and clock drifts of views, as ``posefuse sync`` measures them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option

NEAR_FRAMES = 0.1
"""Views whose offset from the frame times is within this fraction of a frame period are not interpolated."""
_FAR_APART_S = 1.0
"""Views whose offsets differ by more are aligned on a new timeline."""


@checked
@dataclass(frozen=True)
class SyncOptions:
    """Time offsets of views, as `posefuse sync` writes them; one row each, the rows of a view in order of time.

    Attributes:
        cameras: Camera of each row, by name; a camera has several rows if frames were dropped.
        start_s: Time, on the view's clock, from which each row applies; the first row of a view also applies before it.
        offset_s: Time by which the view took its frames later than its timestamps state, at start_s.
        drift_ppm: Rate at which the offset grows.
    """

    cameras: tuple[str, ...] = option((), example='["cam_2", "cam_3"]')
    start_s: tuple[float, ...] = option((), example="[0.0, 0.0]")
    offset_s: tuple[float, ...] = option((), example="[0.012, -0.008]")
    drift_ppm: tuple[float, ...] = option((), above=-1e6, below=1e6, example="[0.0, 15.0]")

    def __post_init__(self) -> None:
        check_fields(self, "sync")
        for name in ("start_s", "offset_s", "drift_ppm"):
            if len(getattr(self, name)) != len(self.cameras):
                raise OptionsError(
                    f"sync.{name} must contain one value per entry of sync.cameras ({len(self.cameras)}), got "
                    f"{len(getattr(self, name))}."
                )

    @property
    def does_nothing(self) -> bool:
        """Whether no view has a time offset."""
        return not self.cameras

    def offset_at(self, camera: str, time_s: np.ndarray) -> np.ndarray:
        """Return a view's time offset at times of the view, in s; 0 for a view without a row.

        Args:
            camera: Name of the view's camera.
            time_s: Times by the view's clock, any shape.
        """
        rows = sorted((start, i) for i, start in enumerate(self.start_s) if self.cameras[i] == camera)
        offset = np.zeros_like(time_s, dtype=float)
        for number, (start, i) in enumerate(rows):
            of_row = self.offset_s[i] + 1e-6 * self.drift_ppm[i] * (time_s - start)
            offset = of_row if number == 0 else np.where(time_s >= start, of_row, offset)
        return offset

    def are_far_apart(self, cameras: Sequence[str]) -> bool:
        """Return whether the views of these cameras start so far apart that they get a new timeline."""
        offsets = [float(self.offset_at(name, np.zeros(()))) for name in cameras]
        return max(offsets) - min(offsets) > _FAR_APART_S

    def time_shifted(self, cameras: Sequence[str], time_s: np.ndarray, period_s: float) -> np.ndarray:
        """Return which points are interpolated between two frames of their view, shape (frame, view), bool.

        With views that start far apart, any point may be interpolated.

        Args:
            cameras: Names of the views' cameras.
            time_s: Frame times by the views' clocks, shape (frame,), NaN where unknown.
            period_s: Frame period.
        """
        offset = np.stack([self.offset_at(name, time_s) for name in cameras], axis=1) / period_s
        if self.are_far_apart(cameras):
            return np.ones(offset.shape, dtype=bool)
        with np.errstate(invalid="ignore"):
            return np.abs(offset - np.round(offset)) > NEAR_FRAMES
