"""Compare the joint angles of a result with reference files of OpenSim."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import FileError, OptionsError, ResultError
from posefuse.evaluation.angle_agreement import AngleComparison, AngleSeries, compare_angles
from posefuse.io.files import must_exist
from posefuse.io.motion_tables import is_motion_table, read_joint_angles
from posefuse.io.results.open_result import result_file


@checked
def compare_angle_files(
    result: str | Path, references: Sequence[str | Path], max_time_shift_s: float = 0.0
) -> tuple[AngleComparison, ...]:
    """Compare joint angles of a result with reference files, each with the person it agrees with best.

    Args:
        result: folder of a result or of a run with its ``.mot`` files, or one ``.mot`` file.
        references: ``.mot`` or ``.sto`` files, one per person.
        max_time_shift_s: largest time shift to search; 0 compares times as they are.

    Returns:
        One comparison per reference.

    Raises:
        FileError: if a file does not exist or is no table of OpenSim.
        OptionsError: if the time shift is negative or not finite.
        ResultError: if a reference shares no angle or no time with any person.
    """
    if not (np.isfinite(max_time_shift_s) and max_time_shift_s >= 0):
        raise OptionsError(f"`max_time_shift_s`: expected a time of at least 0 s, got {max_time_shift_s:g}.")
    people = joint_angles_in(Path(result))
    return tuple(
        _best_person(people, read_joint_angles(must_exist(Path(file), "reference")), max_time_shift_s)
        for file in references
    )


def joint_angles_in(path: Path) -> tuple[AngleSeries, ...]:
    """Return the joint angles of all people of a result, or of one ``.mot`` file.

    Raises:
        FileError: if there are none.
    """
    if path.is_file() and is_motion_table(path):
        return (read_joint_angles(path),)
    folder = must_exist(result_file(path), "result").parent
    files = sorted(file for file in folder.iterdir() if is_motion_table(file))
    if not files:
        raise FileError(
            f"{folder} has no .mot file, so there are no joint angles to compare. They are written for people in "
            "worlds with a known up axis."
        )
    return tuple(read_joint_angles(file) for file in files)


def _best_person(people: Sequence[AngleSeries], reference: AngleSeries, max_time_shift_s: float) -> AngleComparison:
    """Return the comparison with the lowest median error over the angles; raise the first error if none fits."""
    found: list[AngleComparison] = []
    problems: list[ResultError] = []
    for person in people:
        try:
            found.append(compare_angles(person, reference, max_time_shift_s))
        except ResultError as problem:
            problems.append(problem)
    if not found:
        raise problems[0]
    return min(found, key=lambda each: float(np.nanmedian([angle.rmse_deg for angle in each.angles])))
