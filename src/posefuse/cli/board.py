"""``posefuse board``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import note, say
from posefuse.cli.types import Overwrite


def board(
    description: Annotated[
        str,
        Parameter(
            help="Board, such as charuco:7x5,square=30mm,marker=0.75,dict=4X4_50 or checkerboard:4x7,square=60mm "
            "(inner corners), or its file."
        ),
    ] = "charuco:7x5,square=30mm,marker=0.75,dict=4X4_50",
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="File to write: name.pdf or name.svg.")],
    overwrite: Overwrite = False,
) -> None:
    """Draw a calibration board to print in its true size."""
    from posefuse.io.board_specs import read_board_spec
    from posefuse.io.outputs import check_new_files
    from posefuse.visualize.board_sheet import write_board

    drawn = read_board_spec(description)
    check_new_files([output], overwrite=overwrite)
    write_board(drawn, output)
    width, height = drawn.size_m
    note(f"Wrote {output}: {drawn}, {1000 * width:.0f} x {1000 * height:.0f} mm.")
    say("Print it at 100 %, measure the ruler, and glue it to something flat.")
    say(f"Use it: posefuse calibrate VIDEOS --board {drawn} --output calibration.toml")
