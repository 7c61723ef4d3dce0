"""A comparison of methods as CSV: one row per method, units in the column names, empty cells for missing numbers."""

import csv
import math
from collections.abc import Callable
from pathlib import Path

from posefuse.evaluation.comparison import Comparison, MethodNumbers

COLUMNS: dict[str, Callable[[MethodNumbers], float | str | None]] = {
    "method": lambda row: row.method,
    "min_views": lambda row: row.min_views,
    "used_views_median_reprojection_error_px": lambda row: row.used_error.median_px,
    "used_views_p95_reprojection_error_px": lambda row: row.used_error.p95_px,
    "all_detections_median_reprojection_error_px": lambda row: row.all_error.median_px,
    "mean_views_used": lambda row: row.mean_views_used,
    "missing_points_percent": lambda row: 100.0 * row.missing_share,
    "rejected_observations_percent": lambda row: 100.0 * row.rejected_share,
    "median_acceleration_m_per_s2": lambda row: row.acceleration_m_s2,
    "cpu_time_ms_per_frame": lambda row: row.cpu_ms_per_frame,
    "median_error_against_truth_mm": lambda row: row.truth_median_mm,
    "p99_error_against_truth_mm": lambda row: row.truth_p99_mm,
}


def write(comparison: Comparison, path: Path) -> None:
    """Write the columns for which at least one method has a value."""
    cells = {name: [_cell(value(row)) for row in comparison.methods] for name, value in COLUMNS.items()}
    nonempty = {name: column for name, column in cells.items() if any(column)}
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(nonempty)
        writer.writerows(zip(*nonempty.values(), strict=True))


def _cell(value: float | str | None) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
