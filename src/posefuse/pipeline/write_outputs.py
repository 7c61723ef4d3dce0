"""Write the outputs of a reconstruction beside its ``reconstruction.nc``."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from posefuse.biomechanics.tables import angle_table, body_tables
from posefuse.errors import OptionsError, suggestion
from posefuse.evaluation.error_profile import error_profile
from posefuse.io.results.figures import write_figures
from posefuse.io.results.open_result import open_result
from posefuse.io.results.write import additional_names, people_with_frames, write_also, write_folder
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.measured_layer import reconstruct_chunks
from posefuse.pipeline.plan import Plan
from posefuse.pipeline.reconstruct import with_method
from posefuse.progress import Progress
from posefuse.report.html import render_report
from posefuse.report.percentile_filter import percentile_filter_figure
from posefuse.triangulation.method import DebugFigure
from posefuse.triangulation.registry import find_method

REPORT = "report.html"


@dataclass(frozen=True)
class WrittenOutputs:
    """The outputs written beside ``reconstruction.nc``.

    Attributes:
        files: names of the files.
        layer: the layer that TRC and C3D hold.
        remarks: what the formats cannot hold.
    """

    files: tuple[str, ...]
    layer: LayerName
    remarks: tuple[str, ...]


def write_outputs(result: Reconstruction, folder: Path, progress: Progress) -> WrittenOutputs:
    """Write the tables, TRC, C3D, BVH and glTF files and the report of a result."""
    files, layer = write_folder(result, folder, progress, angle_table, body_tables(result))
    figures, remarks = write_figures(result, people_with_frames(result), folder, progress)
    (folder / REPORT).write_text(render_report(result, progress=progress), "utf-8")
    return WrittenOutputs((*files, *figures, REPORT), layer, tuple(remarks))


def require_formats(also: Sequence[str]) -> None:
    """Refuse unknown format names before any work is done.

    Raises:
        OptionsError: if a format cannot be written beside a result.
    """
    offered = additional_names() if also else {}
    for name in also:
        if name not in offered:
            raise OptionsError(
                f"--also {name}: there is no additional format with this name. {suggestion(name, offered)}"
            )


def write_other_formats(folder: Path, also: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Write the result of a folder in other formats beside it.

    Returns:
        The names of the files, and what the formats cannot hold.
    """
    return write_also(open_result(folder)[1], folder, also) if also else ([], ())


def find_debug_figure(plan: Plan) -> DebugFigure | None:
    """Return the figure that shows what the method did, or None if it has none for this recording."""
    triangulation = plan.options.triangulation
    figure = find_method(triangulation.method).debug_figure
    return figure if figure is not None and figure.applies(plan.rig, triangulation) else None


def write_debug_figures(plan: Plan, result: Reconstruction, folder: Path, progress: Progress) -> tuple[str, ...]:
    """Write the figures that show what the method did, if it has any, and return their names."""
    figure = find_debug_figure(plan)
    if figure is None:
        return ()
    before = error_profile(reconstruct_chunks(with_method(plan, "simple"), progress))
    picture = percentile_filter_figure(before, error_profile(result.chunks()), result)
    (folder / figure.path).parent.mkdir()
    (folder / figure.path).write_bytes(picture.png)
    return (figure.path,)
