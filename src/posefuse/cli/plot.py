"""``posefuse plot``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import note, wrote
from posefuse.cli.types import Overwrite, Result
from posefuse.errors import OptionsError, choices
from posefuse.model.options.options import LayerName
from posefuse.report.matplotlib_extra import require_matplotlib
from posefuse.report.plots.registry import PLOT_NAMES, find_plot

_SUFFIXES = ("png", "svg")


def plot(
    result: Result,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for the figures.")],
    figure: Annotated[
        tuple[str, ...],
        Parameter(help=f"Figures to draw: {', '.join(PLOT_NAMES)}; by default all that the result has data for."),
    ] = (),
    keypoint: Annotated[
        tuple[str, ...], Parameter(help="Keypoints of the trajectory figure; by default one of the trunk.")
    ] = (),
    angle: Annotated[
        tuple[str, ...],
        Parameter(help="Joint angles of the angle figure; by default the eight with the largest range."),
    ] = (),
    layer: Annotated[LayerName | None, Parameter(help="Layer to draw; by default the best one available.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Draw a result's figures as PNG and SVG, for papers and slides.

    Requires pip install 'posefuse[plot]'.
    """
    names = chosen_figures(figure)
    require_matplotlib()

    from posefuse.io.outputs import check_new_files, replacing_together
    from posefuse.io.results.open_result import open_result
    from posefuse.pipeline.gait import analyze_gait
    from posefuse.report.plots.data import gather_plot_data
    from posefuse.report.plots.registry import draw_plot

    _, reconstruction = open_result(result)
    if output.exists() and not output.is_dir():
        raise OptionsError(f"--output {output} is a file. Specify a folder.")
    check_new_files([output / f"{name}.{suffix}" for name in names for suffix in _SUFFIXES], overwrite=overwrite)
    gait = analyze_gait(reconstruction) if "gait" in names else None
    data = gather_plot_data(reconstruction, layer, keypoint, angle, None if gait is None else gait.people)
    figures = {name: draw_plot(name, data) for name in names}
    empty = [name for name, drawn in figures.items() if drawn is None]
    if figure and empty:
        raise OptionsError(f"This result has no data for {_with_requirements(empty)}.")
    pictures = {
        f"{name}.{suffix}": getattr(drawn, suffix)
        for name, drawn in figures.items()
        if drawn is not None
        for suffix in _SUFFIXES
    }
    with replacing_together([output / file for file in pictures]) as temporary:
        for path, picture in zip(temporary, pictures.values(), strict=True):
            path.write_bytes(picture)
    if empty:
        note(f"No data for {_with_requirements(empty)}.")
    wrote(list(pictures), output)


def chosen_figures(given: tuple[str, ...]) -> tuple[str, ...]:
    """Return the figures to draw, each once; all figures if none is named.

    Raises:
        OptionsError: if there is no such figure.
    """
    names = [name.strip() for part in given for name in part.split(",")]
    for name in names:
        find_plot(name)
    return tuple(dict.fromkeys(names)) or PLOT_NAMES


def _with_requirements(names: list[str]) -> str:
    """Return the names of figures, each with what it requires of a result."""
    return choices([f"{name} (needs {find_plot(name).requires})" for name in names])
