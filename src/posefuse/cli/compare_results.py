"""``posefuse compare`` with two results."""

import csv
import io
import math
from pathlib import Path
from typing import TYPE_CHECKING

from posefuse.cli.console import count, note, say, table, wrote
from posefuse.cli.evaluate_angles import show_comparison
from posefuse.errors import choices
from posefuse.model.options.options import LayerName

if TYPE_CHECKING:
    from posefuse.evaluation.result_differences import KeypointDifference, ResultDifferences
    from posefuse.pipeline.compare_results import ComparedResults

TABLE = "comparison.csv"
_COLUMNS = (
    "person", "quantity", "name", "unit", "n", "median_distance", "p95_distance", "rms", "bias", "r", "only_in_first",
    "only_in_second",
)  # fmt: skip
_MOST_OPTIONS = 12


def compare_two_results(first: Path, second: Path, output: Path, layer: LayerName | None, *, overwrite: bool) -> None:
    """Compare two results of one recording; write comparison.csv."""
    from posefuse.io.files import replacing_folder
    from posefuse.io.outputs import check_new_folder
    from posefuse.pipeline.compare_results import compare_results

    check_new_folder(output, overwrite=overwrite, marker=TABLE)
    compared = compare_results(first, second, layer)
    with replacing_folder(output, marker=TABLE, owned=(TABLE,)) as staging:
        (staging / TABLE).write_text(_table_text(compared), "utf-8", newline="")
    show_differences(compared.points)
    for angles in compared.angles:
        show_comparison(angles)
    _show_options(compared.options)
    wrote([TABLE], output)


def show_differences(points: "ResultDifferences") -> None:
    """Print the distances of the points of each person."""
    layers = points.layers[0] if len(set(points.layers)) == 1 else " and ".join(points.layers)
    say(f"layer {layers}, by {points.matched_by}: {count(points.n_frames, 'frame')}")
    heads = ["person", "frames", "median\nmm", "95 %\nmm", "RMS\nmm", "points only\nin first", "points only\nin second"]
    rows = [
        [person.first if person.first == person.second else f"{person.first}, {person.second}", str(person.n_frames),
         *_distances(person.whole), str(person.whole.only_in_first), str(person.whole.only_in_second)]
        for person in points.people
    ]  # fmt: skip
    if rows:
        table("Distances between the points of the two results", heads, rows)
    for names, which in ((points.only_in_first, "first"), (points.only_in_second, "second")):
        if names:
            note(f"Only in the {which} result: {choices(names, 12)}.")


def _show_options(options: tuple[tuple[str, str, str], ...]) -> None:
    if not options:
        note("All options are equal.")
        return
    table(
        "Options that differ", ["option", "first", "second"], [list(row) for row in options[:_MOST_OPTIONS]], words=True
    )
    if len(options) > _MOST_OPTIONS:
        note(f"{len(options) - _MOST_OPTIONS} more options differ.")


def _distances(row: "KeypointDifference") -> list[str]:
    return ["-" if math.isnan(value) else f"{value:.2f}" for value in (row.median_mm, row.p95_mm, row.rms_mm)]


def _table_text(compared: "ComparedResults") -> str:
    """Return the table: one row per person and keypoint, and one per person and angle."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for person in compared.points.people:
        for row in (person.whole, *person.keypoints):
            cells = [row.median_mm, row.p95_mm, row.rms_mm]
            writer.writerow(
                [person.first, "point", row.keypoint, "mm", row.n, *map(_cell, cells), "", "", row.only_in_first,
                 row.only_in_second]
            )  # fmt: skip
    for comparison in compared.angles:
        name = Path(comparison.result).stem
        for angle in comparison.angles:
            cells = [angle.rmse_deg, angle.bias_deg, angle.correlation]
            writer.writerow([name, "angle", angle.angle, "deg", angle.n, "", "", *map(_cell, cells), "", ""])
    return text.getvalue()


def _cell(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6g}"
