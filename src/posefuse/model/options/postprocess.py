"""Options of postprocessing: dropping, gap filling, filters and rigid bones."""

from dataclasses import dataclass, field
from typing import Literal

from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, check_no_repetition, option

Fill = Literal["none", "linear", "pchip", "smoother"]
Filter = Literal["hampel", "median", "butterworth", "savgol", "one_euro", "kalman"]


@dataclass(frozen=True)
class HampelOptions:
    """Options of the Hampel filter, a running median that replaces outliers only.

    Attributes:
        window_s: Length of the Hampel filter's window around a point.
        sigma: Distance from the window's median, in robust standard deviations, beyond which a coordinate is replaced.
    """

    window_s: float = option(0.25, above=0.0, at_most=10.0)
    sigma: float = option(3.0, above=0.0, unit="standard deviations")

    def __post_init__(self) -> None:
        check_fields(self, "postprocess.hampel")


@dataclass(frozen=True)
class MedianOptions:
    """Options of the running median.

    Attributes:
        window_s: Length of the running median's window around a point.
    """

    window_s: float = option(0.1, above=0.0, at_most=10.0)

    def __post_init__(self) -> None:
        check_fields(self, "postprocess.median")


@dataclass(frozen=True)
class ButterworthOptions:
    """Options of the zero-phase Butterworth low-pass filter, which runs forward and backward.

    Attributes:
        order: Order of the Butterworth filter over both passes; 4 is second order forward and second order backward.
        cutoff_hz: Butterworth cutoff frequency. The gain at this frequency is -3 dB for both passes combined.
    """

    order: int = option(4, at_least=2, at_most=16)
    cutoff_hz: float = option(6.0, at_least=0.01, common=True)

    def __post_init__(self) -> None:
        check_fields(self, "postprocess.butterworth")
        if self.order % 2:
            raise OptionsError(
                "postprocess.butterworth.order counts both passes together, so it must be an even number from 2 to 16, "
                f"got {self.order}."
            )


@dataclass(frozen=True)
class SavgolOptions:
    """Options of the Savitzky-Golay filter, which fits a polynomial to the points around each point.

    Attributes:
        window_s: Length of the Savitzky-Golay filter's window around a point.
        degree: Degree of the Savitzky-Golay filter's polynomial.
    """

    window_s: float = option(0.2, above=0.0, at_most=10.0)
    degree: int = option(3, at_least=0, at_most=8)

    def __post_init__(self) -> None:
        check_fields(self, "postprocess.savgol")


@dataclass(frozen=True)
class OneEuroOptions:
    """Options of the one-euro filter, a causal low-pass filter whose cutoff frequency increases with speed.

    Attributes:
        min_cutoff_hz: Cutoff frequency of the one-euro filter at rest.
        beta: Increase of the one-euro filter's cutoff frequency with speed.
        speed_cutoff_hz: Cutoff frequency of the filter that the one-euro filter applies to the speed.
    """

    min_cutoff_hz: float = option(1.5, above=0.0)
    beta: float = option(3.0, at_least=0.0, unit="Hz per m/s")
    speed_cutoff_hz: float = option(2.0, above=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "postprocess.one_euro")


@dataclass(frozen=True)
class KalmanOptions:
    """Options of the Rauch-Tung-Striebel smoother, which weights each point by its covariance and uses true times.

    Attributes:
        acceleration: Spectral density of the white-noise acceleration that the Kalman smoother and the covariances of
            filled points assume.
        error_memory_s: Correlation time of the errors of measured points; 0 assumes white noise.
    """

    acceleration: float = option(20.0, above=0.0, unit="m^2/s^3")
    error_memory_s: float = option(0.06, at_least=0.0, at_most=60.0)

    def __post_init__(self) -> None:
        check_fields(self, "postprocess.kalman")


@dataclass(frozen=True)
class PostprocessOptions:
    """Options of the processing of solved points, in this order: drop, fill, smooth, make bones rigid.

    Attributes:
        drop_beyond_px: Mean reprojection error beyond which a point is dropped; no limit by default.
        drop_beyond_sd_m: Standard deviation (RMS over the axes) beyond which a point is dropped; no limit by default.
        fill: Gap filling: none, linear, pchip or smoother. "pchip" is monotone cubic interpolation, "smoother" the
            Kalman smoother's estimate; points are never extrapolated beyond a keypoint's first and last point.
        max_gap_s: Longest gap that is filled, in seconds.
        smooth: Filters to apply, in this order.
        rigid_bones: Set every bone to its median length. Bones keep their directions, from the root outward.
        hampel: Options of the Hampel filter.
        median: Options of the running median.
        butterworth: Options of the Butterworth filter.
        savgol: Options of the Savitzky-Golay filter.
        one_euro: Options of the one-euro filter.
        kalman: Options of the Kalman smoother, whose motion model postprocess.fill also uses.
    """

    drop_beyond_px: float | None = option(None, above=0.0, example="20.0")
    drop_beyond_sd_m: float | None = option(None, above=0.0, example="0.05")
    fill: Fill = option("none", common=True)
    max_gap_s: float = option(0.2, above=0.0, common=True)
    smooth: tuple[Filter, ...] = option((), common=True, example='["hampel", "butterworth"]')
    rigid_bones: bool = option(False, common=True)
    hampel: HampelOptions = field(default_factory=HampelOptions)
    median: MedianOptions = field(default_factory=MedianOptions)
    butterworth: ButterworthOptions = field(default_factory=ButterworthOptions)
    savgol: SavgolOptions = field(default_factory=SavgolOptions)
    one_euro: OneEuroOptions = field(default_factory=OneEuroOptions)
    kalman: KalmanOptions = field(default_factory=KalmanOptions)

    def __post_init__(self) -> None:
        check_fields(self, "postprocess")
        check_no_repetition(self.smooth, "postprocess.smooth")

    @property
    def does_nothing(self) -> bool:
        """Whether the options leave all points unchanged."""
        drops = self.drop_beyond_px is not None or self.drop_beyond_sd_m is not None
        return not (drops or self.fill != "none" or self.smooth or self.rigid_bones)
