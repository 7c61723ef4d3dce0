"""What a user can choose about gaps and filters; the text of each attribute is the help."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from posefuse.errors import OptionsError, choices, suggestion

Fill = Literal["none", "linear", "pchip", "smoother"]
Filter = Literal["hampel", "median", "butterworth", "savgol", "one_euro", "kalman"]


def _must_be_positive(table: str, **values: float) -> None:
    for name, value in values.items():
        if not value > 0:
            raise OptionsError(f"postprocess.{table}{name} must be positive, got {value}.")


@dataclass(frozen=True)
class HampelOptions:
    """A median that only replaces outliers.

    Attributes:
        window_s: How long the window around a point is, in seconds.
        sigma: A coordinate farther from the window's median than so many robust standard deviations becomes it.
    """

    window_s: float = 0.25
    sigma: float = 3.0

    def __post_init__(self) -> None:
        _must_be_positive("hampel.", window_s=self.window_s, sigma=self.sigma)


@dataclass(frozen=True)
class MedianOptions:
    """A running median.

    Attributes:
        window_s: How long the window around a point is, in seconds.
    """

    window_s: float = 0.1

    def __post_init__(self) -> None:
        _must_be_positive("median.", window_s=self.window_s)


@dataclass(frozen=True)
class ButterworthOptions:
    """A Butterworth low-pass filter, run forwards and backwards so that nothing is late.

    Attributes:
        order: Of both passes together: 4 is a second order forwards and a second order backwards.
        cutoff_hz: Where both passes together leave 71 % of an amplitude (-3 dB).
    """

    order: int = 4
    cutoff_hz: float = 6.0

    def __post_init__(self) -> None:
        _must_be_positive("butterworth.", cutoff_hz=self.cutoff_hz)
        if self.order < 2 or self.order % 2 or self.order > 16:
            raise OptionsError(
                "postprocess.butterworth.order counts both passes together: an even number from 2 to 16, got "
                f"{self.order}."
            )


@dataclass(frozen=True)
class SavgolOptions:
    """Savitzky and Golay's filter: a polynomial through the points around each point.

    Attributes:
        window_s: How long the window around a point is, in seconds.
        degree: Of the polynomial.
    """

    window_s: float = 0.2
    degree: int = 3

    def __post_init__(self) -> None:
        _must_be_positive("savgol.", window_s=self.window_s)
        if not 0 <= self.degree <= 8:
            raise OptionsError(f"postprocess.savgol.degree must lie between 0 and 8, got {self.degree}.")


@dataclass(frozen=True)
class OneEuroOptions:
    """The one-euro filter: causal, a low-pass whose cut-off rises with speed.

    Attributes:
        min_cutoff_hz: The cut-off of a point at rest.
        beta: By how much the cut-off rises with speed, in Hz for each m/s.
        speed_cutoff_hz: The cut-off with which the speed itself is filtered.
    """

    min_cutoff_hz: float = 1.5
    beta: float = 3.0
    speed_cutoff_hz: float = 2.0

    def __post_init__(self) -> None:
        _must_be_positive("one_euro.", min_cutoff_hz=self.min_cutoff_hz, speed_cutoff_hz=self.speed_cutoff_hz)
        if not self.beta >= 0:
            raise OptionsError(f"postprocess.one_euro.beta cannot be negative, got {self.beta}.")


@dataclass(frozen=True)
class KalmanOptions:
    """The smoother of Rauch, Tung and Striebel: each point weighed by its own covariance, over true times.

    Attributes:
        acceleration: Spectral density of the accelerations of points, taken for white, in m^2 / s^3.
        error_memory_s: For how long errors of measured points last: so much less a frame counts. 0 takes them for
            white.
    """

    acceleration: float = 20.0
    error_memory_s: float = 0.06

    def __post_init__(self) -> None:
        _must_be_positive("kalman.", acceleration=self.acceleration)
        if not self.error_memory_s >= 0:
            raise OptionsError(f"postprocess.kalman.error_memory_s cannot be negative, got {self.error_memory_s}.")


@dataclass(frozen=True)
class PostprocessOptions:
    """What is done with points once they are solved, in this order: drop, fill, smooth, make bones rigid.

    Attributes:
        drop_beyond_px: Points whose mean reprojection error is larger are dropped first; by default none.
        drop_beyond_sd_m: Likewise those known worse than this, root mean square of the standard deviations along the
            axes.
        fill: What gaps are filled with: nothing, lines (linear), monotone cubics (pchip), or what the smoother
            expects there (smoother). Never beyond the first and the last point of a keypoint.
        max_gap_s: Gaps in which points are missing for longer stay as they are.
        smooth: Filters, one after the other; by default none.
        rigid_bones: Whether bones get the median of their lengths, from the root outwards, along their directions.
        hampel: Of the filter that only replaces outliers.
        median: Of the running median.
        butterworth: Of the zero-phase low-pass filter.
        savgol: Of Savitzky and Golay's filter.
        one_euro: Of the causal filter.
        kalman: Of the smoother, for filling too.
    """

    drop_beyond_px: float | None = None
    drop_beyond_sd_m: float | None = None
    fill: Fill = "none"
    max_gap_s: float = 0.2
    smooth: tuple[Filter, ...] = ()
    rigid_bones: bool = False
    hampel: HampelOptions = field(default_factory=HampelOptions)
    median: MedianOptions = field(default_factory=MedianOptions)
    butterworth: ButterworthOptions = field(default_factory=ButterworthOptions)
    savgol: SavgolOptions = field(default_factory=SavgolOptions)
    one_euro: OneEuroOptions = field(default_factory=OneEuroOptions)
    kalman: KalmanOptions = field(default_factory=KalmanOptions)

    def __post_init__(self) -> None:
        _must_be_positive("", max_gap_s=self.max_gap_s)
        for name in ("drop_beyond_px", "drop_beyond_sd_m"):
            value = getattr(self, name)
            if value is not None:
                _must_be_positive("", **{name: value})
        if self.fill not in get_args(Fill):
            raise OptionsError(f"postprocess.fill: no {self.fill!r}. {suggestion(str(self.fill), get_args(Fill))}")
        if isinstance(self.smooth, str):
            raise OptionsError(f"postprocess.smooth is a tuple of filters, got {self.smooth!r}.")
        object.__setattr__(self, "smooth", tuple(self.smooth))
        for name in self.smooth:
            if name not in get_args(Filter):
                raise OptionsError(f"postprocess.smooth: no filter {name!r}. {suggestion(str(name), get_args(Filter))}")
        repeated = sorted({name for name in self.smooth if self.smooth.count(name) > 1})
        if repeated:
            raise OptionsError(f"postprocess.smooth names {choices(repeated)} twice.")

    @property
    def does_nothing(self) -> bool:
        """Whether points come out as they went in."""
        drops = self.drop_beyond_px is not None or self.drop_beyond_sd_m is not None
        return not (drops or self.fill != "none" or self.smooth or self.rigid_bones)
