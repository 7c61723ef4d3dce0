"""``posefuse init``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import say
from posefuse.cli.types import Overwrite


def init(
    path: Annotated[Path, Parameter(help="File to write.")] = Path("posefuse.toml"),
    *,
    every: Annotated[
        bool, Parameter(name="--all", negative="", help="Write every option instead of a short project file.")
    ] = False,
    overwrite: Overwrite = False,
) -> None:
    """Write a commented project file: inputs, output and the common options.

    Run it with posefuse reconstruct --options FILE.
    """
    from posefuse.io.files import replacing
    from posefuse.io.options_template import options_template, project_template
    from posefuse.io.outputs import check_new_files

    check_new_files([path], overwrite=overwrite, target="name")
    with replacing(path) as temporary:
        temporary.write_text(options_template() if every else project_template(), "utf-8")
    say(f"Wrote {path}")
    arguments = " RECORDING --output OUTPUT" if every else ""
    say(f"Run it: posefuse reconstruct --options {path}{arguments}")
