"""Formatting of numbers in tables and figures."""

import math


def format_three_digits(value: float) -> str:
    """Return a number with about three significant digits; a dash for NaN."""
    if not math.isfinite(value):
        return "-" if math.isnan(value) else "inf"
    size = abs(value)
    if size == 0:
        return "0"
    decimals = 3 if size < 0.0995 else 2 if size < 9.995 else 1 if size < 99.95 else 0
    return f"{value:.{decimals}f}"
