"""``posefuse compare``."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from cyclopts import Parameter

from posefuse.cli.compare_results import compare_two_results
from posefuse.cli.console import Bars, count, note, say, table, wrote
from posefuse.cli.types import InputFlags, Inputs, OptionFlags, Output, Overwrite
from posefuse.errors import OptionsError, choices, suggestion
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import METHODS

if TYPE_CHECKING:
    from posefuse.evaluation.comparison import Comparison

TABLE, PNG, SVG = "comparison.csv", "comparison.png", "comparison.svg"


@dataclass(frozen=True)
class MethodFlags:
    """Flags of a comparison of methods."""

    methods: Annotated[
        tuple[str, ...], Parameter(help="Comma-separated names that `posefuse methods` lists; by default all.")
    ] = ()
    truth: Annotated[Path | None, Parameter(help="Ground truth, as in posefuse evaluate.")] = None
    timing: Annotated[
        bool, Parameter(help="Measure CPU time, the only number that differs from run to run.", negative="--no-timing")
    ] = True


def compare(
    recording: Annotated[Path, Parameter(help="Folder of the recording; of a result, to compare two results.")],
    other: Annotated[Path | None, Parameter(help="Folder of the second result, of the same recording.")] = None,
    *,
    output: Output,
    study: Annotated[MethodFlags, Parameter(name="*")] = MethodFlags(),
    inputs: Inputs = InputFlags(),  # noqa: B008
    overwrite: Overwrite = False,
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Triangulate a recording by several methods with otherwise equal options; write comparison.csv and a figure.

    The figure requires pip install 'posefuse[plot]'.

    --triangulation.method is ignored; every other option applies to all methods.

    Two results of one recording are compared with each other: distances of points, joint angles, and the options that
    differ. Only --layer and --overwrite apply to them.
    """
    if other is not None:
        _refuse_flags(study, inputs)
        compare_two_results(recording, other, output, options.layer, overwrite=overwrite)
        return
    chosen = chosen_methods(study.methods)

    from posefuse.io.files import must_exist, replacing_folder
    from posefuse.io.open_recording import open_recording
    from posefuse.io.outputs import check_new_folder
    from posefuse.io.results.comparable import pair_with_truth
    from posefuse.io.results.comparison import write
    from posefuse.pipeline.compare_methods import compare_methods
    from posefuse.report.matplotlib_extra import WITHOUT_FIGURES, has_matplotlib

    check_new_folder(output, overwrite=overwrite, marker=TABLE)
    if study.truth is not None:
        must_exist(study.truth, "truth")
    truth = study.truth
    truth_of = None if truth is None else lambda result: pair_with_truth(result, [truth])
    progress = Bars()
    opened = open_recording(recording, inputs.paths(), options, progress)
    with replacing_folder(output, marker=TABLE, owned=(TABLE, PNG, SVG)) as staging:
        found = compare_methods(
            opened.rig, opened.detections, chosen, options, truth_of=truth_of, timed=study.timing, progress=progress
        )
        write(found, staging / TABLE)
        files = [TABLE]
        if has_matplotlib():
            from posefuse.report.comparison import comparison_figure

            picture = comparison_figure(found)
            (staging / PNG).write_bytes(picture.png)
            (staging / SVG).write_bytes(picture.svg)
            files += [PNG, SVG]
    show(found)
    if len(files) == 1:
        note(WITHOUT_FIGURES)
    wrote(files, output)


def _refuse_flags(study: MethodFlags, inputs: InputFlags) -> None:
    """Refuse flags that have no effect on a comparison of two results.

    Raises:
        OptionsError: if one is given.
    """
    given = {
        "--methods": bool(study.methods),
        "--truth": study.truth is not None,
        "--no-timing": not study.timing,
        "--calibration": inputs.calibration is not None,
        "--keypoints": inputs.keypoints is not None,
        "--timestamps": inputs.timestamps is not None,
    }
    unused = [flag for flag, is_given in given.items() if is_given]
    if unused:
        raise OptionsError(
            f"{choices(unused)}: no effect on a comparison of two results. Omit it, or name one recording."
        )


def chosen_methods(given: tuple[str, ...]) -> tuple[str, ...]:
    """Return the methods to compare, each once; all methods if none is given.

    Raises:
        OptionsError: if a method does not exist.
    """
    names = [name.strip() for part in given for name in part.split(",")]
    for name in names:
        if name not in METHODS:
            hint = suggestion(name, METHODS)
            listed = f" The methods are: {choices(METHODS)}." if hint.startswith("Did") else ""
            raise OptionsError(f"--methods: unknown method {name!r}. {hint}{listed}")
    return tuple(dict.fromkeys(names)) or tuple(METHODS)


def show(found: "Comparison") -> None:
    """Print the comparison."""
    rate = f" at {found.rate_hz:g} Hz" if found.rate_hz else ""
    scale = float(np.median(found.noise.scale_px))
    say(
        f"{count(found.n_frames, 'frame')}{rate}, {count(found.n_views, 'camera')}, "
        f"{count(found.n_keypoints, 'keypoint')}"
    )
    note(f"All methods use the same views, frames and detection noise, {scale:.1f} px ({found.noise.origin}).")
    for remark in found.notes:
        note(f"note: {remark}")
    say("")
    table(None, *agreement_columns(found))
    say("")
    if found.methods[0].truth_median_mm is not None:
        table("Against the truth", *truth_columns(found))
        say("")
    for line in explanations(found):
        note(line)


def agreement_columns(found: "Comparison") -> tuple[list[str], list[list[str]]]:
    """Return headings and rows of the columns that need no truth."""
    from posefuse.report.numbers import format_three_digits

    heads = ["\n\nmethod", "used\nmedian\npx", "used\n95 %\npx", "all\nmedian\npx", "views\nper\npoint",
             "points\nmissing\n%", "views\nleft\nout, %"]  # fmt: skip
    rows = [
        [row.method, *map(format_three_digits, (
            row.used_error.median_px, row.used_error.p95_px, row.all_error.median_px, row.mean_views_used,
            100.0 * row.missing_share, 100.0 * row.rejected_share,
        ))]
        for row in found.methods
    ]  # fmt: skip
    optional = {
        "jitter\nmedian\nm/s²": [row.acceleration_m_s2 for row in found.methods],
        "CPU\nms per\nframe": [row.cpu_ms_per_frame for row in found.methods],
    }
    for head, values in optional.items():
        if values[0] is not None:
            heads.append(head)
            for row, value in zip(rows, values, strict=True):
                row.append("-" if value is None else format_three_digits(value))
    return heads, rows


def truth_columns(found: "Comparison") -> tuple[list[str], list[list[str]]]:
    """Return headings and rows of the errors in 3D."""
    from posefuse.report.numbers import format_three_digits

    def shown(value: float | None) -> str:
        return "-" if value is None else format_three_digits(value)

    rows = [[row.method, shown(row.truth_median_mm), shown(row.truth_p99_mm)] for row in found.methods]
    return ["method", "median mm", "99 % mm"], rows


def explanations(found: "Comparison") -> list[str]:
    """Return what the columns mean, and their limits."""
    by_need: dict[int, list[str]] = {}
    for row in found.methods:
        by_need.setdefault(row.min_views, []).append(row.method)
    needs = "; ".join(f"{n} views for {', '.join(names)}" for n, names in sorted(by_need.items()))
    lines = [
        "used: reprojection error over the views that a method used; it favors methods that reject views.",
        "all: reprojection error over all detections; detections of a missing point count as infinitely large.",
        f"missing: points without coordinates. A point needs {needs}; --triangulation.min-views sets the number.",
    ]
    if found.rate_hz is not None:
        lines.append(
            "jitter: acceleration from frame to frame; it includes the motion itself, equally for all methods."
        )
    if found.methods[0].truth_median_mm is not None:
        lines.append("Against the truth: over the points that a method has; missing points are not counted.")
    if found.methods[0].cpu_ms_per_frame is not None:
        lines.append("CPU: triangulation only, after compilation; without reading, noise estimation and writing.")
    return lines
