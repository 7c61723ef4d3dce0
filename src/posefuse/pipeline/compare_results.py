"""Compare two results of one recording: points, joint angles and options."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from posefuse.alignment.apply import in_calibration_world
from posefuse.arguments import checked
from posefuse.evaluation.angle_agreement import AngleComparison, AngleSeries, compare_angles
from posefuse.evaluation.result_differences import ResultDifferences, result_differences
from posefuse.io.motion_tables import is_motion_table, read_joint_angles
from posefuse.io.results.open_result import open_result
from posefuse.model.options.catalog import list_options
from posefuse.model.options.options import LayerName, Options


@dataclass(frozen=True)
class ComparedResults:
    """Two results side by side.

    Attributes:
        points: differences of points.
        angles: agreement of joint angles of each common person; empty where a result has no ``.mot`` files.
        options: options that differ: name, value in the first result, value in the second.
    """

    points: ResultDifferences
    angles: tuple[AngleComparison, ...]
    options: tuple[tuple[str, str, str], ...]


@checked
def compare_results(first: str | Path, second: str | Path, layer: LayerName | None = None) -> ComparedResults:
    """Compare two results of one recording in the calibration's coordinate system.

    Args:
        first: folder of a result or of a run, or ``reconstruction.nc``.
        second: the same, of the other result.
        layer: layer to compare; by default the best one of each result.

    Raises:
        FileError: if there is no result, or it cannot be read.
        ResultError: if the results share no frame, or are not in meters.
    """
    opened = [open_result(Path(path)) for path in (first, second)]
    results = [
        replace(each, options=replace(each.options, layer=layer or each.options.layer))
        for each in (in_calibration_world(content) for _, content in opened)
    ]
    points = result_differences(*results)
    tables = [_angle_files(file.parent) for file, _ in opened]
    angles = [
        compare_angles(tables[0][person.first], tables[1][person.second])
        for person in points.people
        if person.first in tables[0] and person.second in tables[1]
    ]
    return ComparedResults(points, tuple(angles), differing_options(*(content.options for _, content in opened)))


def _angle_files(folder: Path) -> dict[str, AngleSeries]:
    """Return the joint angles of the people of a result by their names."""
    return {file.stem: read_joint_angles(file) for file in sorted(folder.iterdir()) if is_motion_table(file)}


def differing_options(first: Options, second: Options) -> tuple[tuple[str, str, str], ...]:
    """Return the options that differ: name, first value, second value."""
    names = (entry.name for entry in list_options(Options))
    pairs = ((name, _value(first, name), _value(second, name)) for name in names)
    return tuple((name, str(ours), str(theirs)) for name, ours, theirs in pairs if ours != theirs)


def _value(options: Options, name: str) -> Any:
    """Return the value of an option by its dotted name; None where the record that holds it is not set."""
    value: Any = options
    for part in name.split("."):
        value = getattr(value, part, None)
    return value
