"""Wrong frame rates of single views that are far too large to be clock drifts, such as 25 instead of 30 Hz."""

from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.recording_model import RecordingModel

STANDARD_RATES_HZ = (24.0, 25.0, 30.0, 50.0, 60.0)
"""Rates of cameras. Those that differ by a factor of 1000/1001 (29.97 and 30) look alike for the coarse search, and the
joint estimate distinguishes them."""
_SAME_RATE = 0.005


def rate_errors() -> tuple[float, ...]:
    """Return all relative errors of a frame rate: how much longer than stated the time between two frames is."""
    ratios = {round(stated / true, 9) for stated in STANDARD_RATES_HZ for true in STANDARD_RATES_HZ if stated != true}
    return tuple(ratio - 1.0 for ratio in sorted(ratios))


RATE_ERRORS = rate_errors()


def possible_errors(period_s: float) -> tuple[float, ...]:
    """Return the errors that lead from the stated frame rate to one of cameras; all errors if none does."""
    return tuple(e for e in RATE_ERRORS if _is_standard(1.0 / (period_s * (1.0 + e)))) or RATE_ERRORS


def _is_standard(rate_hz: float) -> bool:
    return any(abs(rate_hz / standard - 1.0) < _SAME_RATE for standard in STANDARD_RATES_HZ)


def with_rate_error(
    observations: TrackedObservations, model: RecordingModel, view: int, error: float, start_s: float
) -> RecordingModel:
    """Return the model with a time offset of the view that is ``start_s`` at the first frame and then grows."""
    since_start_s = observations.frame_time_s[model.frames] - observations.frame_time_s[0]
    return model.with_offset(view, start_s + growth(error) * since_start_s)


def growth(error: float) -> float:
    """Return the growth of the time offset per second of true time; the error is per second of the stated time."""
    return error / (1.0 + error)
