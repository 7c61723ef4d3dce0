"""``posefuse init``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import say


def init(
    path: Annotated[Path, Parameter(help="Where to write it.")] = Path("posefuse.toml"),
) -> None:
    """Write a commented TOML file of every option, to give with --options."""
    from posefuse.errors import FileError
    from posefuse.io.files import replacing
    from posefuse.io.options import options_template

    if path.exists():
        raise FileError(f"{path} exists already; choose another name or remove it.")
    with replacing(path) as temporary:
        temporary.write_text(options_template(), "utf-8")
    say(f"Wrote {path}")
    say(f"Use it: posefuse --options {path} reconstruct ...")
