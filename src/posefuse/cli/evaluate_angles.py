"""``posefuse evaluate`` with reference files of joint angles."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from posefuse.cli.console import count, note, table, wrote
from posefuse.errors import OptionsError, choices

if TYPE_CHECKING:
    from posefuse.evaluation.angle_agreement import AngleAgreement, AngleComparison

_FIGURE = "angles_{}.{}"


def evaluate_angles(
    result: Path, references: Sequence[Path], max_time_shift_s: float, json_file: Path | None, *, overwrite: bool
) -> None:
    """Compare joint angles with references; write the numbers as JSON and one Bland-Altman figure per reference."""
    from posefuse.io.files import must_exist
    from posefuse.io.motion_tables import is_motion_table
    from posefuse.io.outputs import check_new_files, replacing_together
    from posefuse.io.results.open_result import result_file
    from posefuse.pipeline.compare_angles import compare_angle_files
    from posefuse.report.matplotlib_extra import WITHOUT_FIGURES, has_matplotlib

    points = [str(file) for file in references if not is_motion_table(file)]
    if points:
        raise OptionsError(
            f"{choices(points)}: joint angles (.mot, .sto) and points cannot be compared in one call. Call "
            "posefuse evaluate once for each."
        )
    for file in references:
        must_exist(file, "reference")
    target = json_file or result_file(result).parent / "evaluation_angles.json"
    stems = [file.stem for file in references]
    if len(set(stems)) < len(stems):
        raise OptionsError(f"The references have equal names: {choices(sorted(stems))}. Rename one of the files.")
    figures = [
        target.parent / _FIGURE.format(stem, suffix)
        for stem in stems
        for suffix in (("png", "svg") if has_matplotlib() else ())
    ]
    check_new_files([target, *figures], overwrite=overwrite, target="--json")
    compared = compare_angle_files(result, references, max_time_shift_s)
    contents: list[bytes] = []
    if figures:
        from posefuse.report.angle_agreement import agreement_figure

        pictures = [agreement_figure(each) for each in compared]
        contents = [content for picture in pictures for content in (picture.png, picture.svg)]
    values = json.dumps([_numbers(each) for each in compared], indent=2, allow_nan=False) + "\n"
    with replacing_together([target, *figures]) as temporary:
        for path, content in zip(temporary, [values.encode(), *contents], strict=True):
            path.write_bytes(content)
    for each in compared:
        show_comparison(each)
    if not figures:
        note(WITHOUT_FIGURES)
    wrote([file.name for file in (target, *figures)], target.parent)


def show_comparison(comparison: "AngleComparison") -> None:
    """Print the agreement of all angles, in degrees."""
    shift = f", result shifted by {comparison.time_shift_s:+.3f} s" if comparison.time_shift_s else ""
    n = max(angle.n for angle in comparison.angles)
    rows = [
        [angle.angle, *map(_degrees, (angle.rmse_deg, angle.mae_deg, angle.bias_deg)),
         f"{_degrees(angle.limits_deg[0])} to {_degrees(angle.limits_deg[1])}",
         "-" if math.isnan(angle.correlation) else f"{angle.correlation:.3f}"]
        for angle in comparison.angles
    ]  # fmt: skip
    names = (comparison.result, comparison.reference)
    # Both files often have the name of the person.
    title = " minus ".join(names) if names[0] != names[1] else f"result minus reference, both {names[0]}"
    table(
        f"{title}, {count(n, 'frame')}{shift}; degrees",
        ["angle", "RMSE", "MAE", "bias", "95 % limits of agreement", "r"],
        rows,
    )
    if comparison.only_in_reference:
        note(f"Only in the reference: {choices(comparison.only_in_reference, 12)}.")


def _numbers(comparison: "AngleComparison") -> dict[str, object]:
    return {
        "result": comparison.result,
        "reference": comparison.reference,
        "time_shift_s": comparison.time_shift_s,
        "angles": {angle.angle: _angle_numbers(angle) for angle in comparison.angles},
        "only_in_result": comparison.only_in_result,
        "only_in_reference": comparison.only_in_reference,
    }


def _angle_numbers(angle: "AngleAgreement") -> dict[str, object]:
    values = {
        "rmse_deg": angle.rmse_deg,
        "mae_deg": angle.mae_deg,
        "bias_deg": angle.bias_deg,
        "lower_limit_deg": angle.limits_deg[0],
        "upper_limit_deg": angle.limits_deg[1],
        "r": angle.correlation,
    }
    return {"n": angle.n, **{name: value if math.isfinite(value) else None for name, value in values.items()}}


def _degrees(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1f}"
