"""The command ``posefuse``. Commands are loaded when called: ``--help`` starts no compiler."""

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.config import Dict as DictConfig
from rich.text import Text

from posefuse.cli.console import complain, err, spoken_warnings
from posefuse.errors import FileError, OptionsError, PosefuseError


def _shown_default(value: object) -> str | None:
    """A default as help shows it; an empty list says nothing."""
    if isinstance(value, tuple):
        return " ".join(str(item) for item in value) or None
    return None if value is None else str(value)


app = App(
    name="posefuse",
    help="3D people and animals from several calibrated cameras' 2D keypoints.",
    version_flags=["--version"],
    version=lambda: __import__("posefuse").__version__,
    help_format="markdown",
    default_parameter=Parameter(negative_iterable=(), consume_multiple=True, show_default=_shown_default),
)

COMMANDS = {
    "reconstruct": "Reconstruct people in 3D from a recording's calibration and 2D keypoints.",
    "inspect": "Say what is in a recording's folder.",
    "simulate": "Simulate a recording of one subject with known truth.",
    "simulate-people": "Simulate a recording of several people with known truth.",
    "convert": "Write keypoints, a calibration or a result in another format.",
    "evaluate": "Compare a result with the truth.",
    "compare": "Compare triangulation methods on one recording.",
    "sync": "Measure how late views are, for reconstruct --sync FILE.",
    "calibrate-noise": "Find how a detector errs, for reconstruct --options FILE.",
    "refine-calibration": "Refine where cameras stand by what they saw.",
    "explain": "Say of a frame which detection is whose, and why.",
    "edit": "Merge, split, rename, drop or swap people of a result.",
    "report": "Write a result's report, one HTML page.",
    "view": "Look at a result in rerun's viewer.",
    "overlay": "Draw a result's skeletons on the cameras' videos.",
    "stream": "Follow people live, from lines of 2D keypoints.",
    "replay": "Write a recording as the lines that stream reads.",
    "batch": "Reconstruct many recordings side by side.",
    "plot": "Draw a result's figures, each as PNG and SVG.",
    "demo": "Simulate, reconstruct, evaluate and report.",
    "init": "Write a commented file of every option.",
    "methods": "List the triangulation methods.",
    "formats": "List the file formats.",
}
for name, help_text in COMMANDS.items():
    module = name.replace("-", "_")
    app.command(f"posefuse.cli.{module}:{module}", name=name, help=help_text)


@app.meta.default
def launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    options: Annotated[Path | None, Parameter(help="TOML file of options (posefuse init); flags beat it.")] = None,
) -> object:
    """Run a command, with options from a file if one is given."""
    app.config = ()
    if options is not None:
        from posefuse.cli.options_file import command_values

        values = command_values(options)
        app.config = (DictConfig(values, source=str(options), use_commands_as_keys=False, allow_unknown=True),)
    tokens = _joined(tokens)
    return app(tokens, exit_on_error=True, print_error=True, result_action="return_value")


def _joined(tokens: tuple[str, ...]) -> tuple[str, ...]:
    """Write ``--up -y`` as ``--up=-y``: the parser takes a value that begins with a hyphen for a flag."""
    joined: list[str] = []
    for token in tokens:
        if joined and joined[-1] == "--up" and token in ("-x", "-y", "-z"):
            joined[-1] = f"--up={token}"
        else:
            joined.append(token)
    return tuple(joined)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; exit code 0 only if the job was done, 1 for a reason it gives, 2 for a wrong call."""
    with spoken_warnings():
        try:
            app.meta(arguments, exit_on_error=True, result_action="return_value")
        except OptionsError as error:
            _fail(error, 2)
        except PosefuseError as error:
            _fail(error, 1)
        except OSError as error:
            named = f"{error.filename}: " if error.filename else ""
            _fail(FileError(f"{named}{error.strerror or error}."), 1)
        except KeyboardInterrupt:
            err.print(Text("interrupted; nothing half-written was left behind", "red"))
            sys.exit(130)


def _fail(error: Exception, code: int) -> None:
    complain("error: ", "bold red", str(error))
    sys.exit(code)
