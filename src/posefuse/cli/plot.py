"""``posefuse plot``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import note, wrote
from posefuse.errors import OptionsError, choices, suggestion
from posefuse.model.options.options import LayerName

FIGURE_NAMES = ("errors", "shares", "time", "gaps", "bones", "lives", "trajectories", "angles")


def plot(
    result: Annotated[Path, Parameter(help="A result's folder, or its reconstruction.nc.")],
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for the figures; made if absent.")],
    figure: Annotated[
        tuple[str, ...],
        Parameter(help=f"Which: {', '.join(FIGURE_NAMES)}; by default all there is something to draw of."),
    ] = (),
    keypoint: Annotated[tuple[str, ...], Parameter(help="Whose trajectories; by default one of the trunk's.")] = (),
    angle: Annotated[
        tuple[str, ...], Parameter(help="Which joint angles; by default the eight that range farthest.")
    ] = (),
    layer: Annotated[LayerName | None, Parameter(help="Of which layer; by default the most processed one.")] = None,
) -> None:
    """Draw a result's figures, each as PNG and as SVG: the report's numbers for papers and slides."""
    names = chosen_figures(figure)

    from posefuse.io.files import replacing
    from posefuse.io.results.open_result import open_result
    from posefuse.report.plots import draw, shown_of

    _, reconstruction = open_result(result)
    if output.exists() and not output.is_dir():
        raise OptionsError(f"--output {output} is a file; give a folder.")
    shown = shown_of(reconstruction, layer, keypoint, angle)
    # All are drawn before the first is written: what fails leaves nothing behind.
    pictures = {name: draw(name, shown) for name in names}
    empty = [name for name, picture in pictures.items() if picture is None]
    if figure and empty:
        raise OptionsError(f"This result has nothing to draw in {choices(empty)}.")
    files = []
    output.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures.items():
        if picture is None:
            continue
        for suffix, content in (("png", picture.png), ("svg", picture.svg)):
            with replacing(output / f"{name}.{suffix}") as temporary:
                temporary.write_bytes(content)
            files.append(f"{name}.{suffix}")
    if empty:
        note(f"Nothing to draw in {choices(empty)}.")
    wrote(files, output)


def chosen_figures(given: tuple[str, ...]) -> tuple[str, ...]:
    """The figures to draw, each once; without any, all there are.

    Raises:
        OptionsError: if there is no such figure.
    """
    names = [name.strip() for part in given for name in part.split(",")]
    for name in names:
        if name not in FIGURE_NAMES:
            raise OptionsError(f"--figure: no figure {name!r}. {suggestion(name, FIGURE_NAMES)}")
    return tuple(dict.fromkeys(names)) or FIGURE_NAMES
