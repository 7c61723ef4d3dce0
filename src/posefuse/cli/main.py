"""The command ``posefuse``; each command is imported when it is called, so that ``--help`` starts fast."""

import sys
import time
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, CycloptsError, Parameter
from cyclopts.config import Dict as DictConfig
from rich.text import Text

from posefuse.cli.console import detail, err, print_problem, print_time, print_warnings, say
from posefuse.cli.help import HelpFormatter
from posefuse.cli.numbers import refuse_fractions
from posefuse.errors import OptionsError, PosefuseError


def _default_text(value: object) -> str | None:
    """Return a default as help shows it, or None for an empty list."""
    if isinstance(value, tuple):
        return " ".join(str(item) for item in value) or None
    return None if value is None else str(value)


_HELP = HelpFormatter()
refuse_fractions()

app = App(
    name="posefuse",
    help="Reconstruct 3D people and animals from the 2D keypoints of several calibrated cameras.\n\n"
    "Exit codes: 0 success, 1 failure, 2 wrong call, 3 the result is certainly wrong, 130 interrupted. "
    "posefuse --completion bash (zsh, fish) prints the script by which the shell completes commands and options.",
    version_flags=["--version"],
    version=lambda: __import__("posefuse").__version__,
    help_format="plaintext",
    help_formatter=_HELP,
    default_parameter=Parameter(negative_iterable=(), consume_multiple=True, show_default=_default_text),
    suppress_keyboard_interrupt=False,
)
app.meta.suppress_keyboard_interrupt = False

COMMANDS = {
    "run": "Reconstruct people from videos: detect, calibrate, synchronize.",
    "detect": "Detect people in videos and write their 2D keypoints.",
    "reconstruct": "Reconstruct people in 3D from a calibration and 2D keypoints.",
    "inspect": "Show what a recording's folder contains, and whether it fits.",
    "simulate": "Simulate a recording of one subject with known truth.",
    "simulate-people": "Simulate a recording of several people with known truth.",
    "convert": "Convert keypoints, a calibration or a result to another format.",
    "evaluate": "Compare a result with ground truth.",
    "compare": "Compare triangulation methods on one recording.",
    "sync": "Measure the time offsets of views.",
    "calibrate-noise": "Estimate the noise of a detector.",
    "calibrate": "Calibrate cameras by a board or by people.",
    "board": "Draw a calibration board to print.",
    "detector": "Install, list or remove detectors of keypoints in videos.",
    "refine-calibration": "Refine the poses of cameras from detections.",
    "explain": "Explain the identities and points of one frame.",
    "people": "Write a page with a picture and the name of each person.",
    "edit": "Merge, split, rename, drop or swap people of a result.",
    "report": "Write a result's report as one HTML page.",
    "view": "Open a result in the rerun viewer.",
    "overlay": "Draw a result's skeletons on the cameras' videos.",
    "stream": "Track people live from a stream of 2D keypoints.",
    "replay": "Write a recording as the lines that stream reads.",
    "batch": "Reconstruct many recordings.",
    "opensim": "Scale an OpenSim model to each person and run inverse kinematics.",
    "plot": "Draw a result's figures as PNG and SVG.",
    "warm-up": "Compile the kernels before the first recording.",
    "doctor": "Check the installation, and what each command lacks.",
    "demo": "Simulate, reconstruct, evaluate and report.",
    "init": "Write a commented project file.",
    "methods": "List the triangulation methods.",
    "formats": "List the file formats.",
}
_TAKES_URLS = ("batch", "stream")
"""Commands with URLs among their arguments."""
_RESUMING = ("run", "detect")
"""Commands that keep what they have finished."""

for name, help_text in COMMANDS.items():
    module = name.replace("-", "_")
    app.command(f"posefuse.cli.{module}:{module}", name=name, help=help_text)


@app.meta.default
def launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    options: Annotated[Path | None, Parameter(help="TOML file of options (posefuse init); flags override it.")] = None,
    help_all: Annotated[bool, Parameter(negative="", help="Show every option.")] = False,
    verbose: Annotated[bool, Parameter(negative="", help="Print every note, row and file name.")] = False,
    completion: Annotated[Literal["bash", "zsh", "fish"] | None, Parameter(show=False)] = None,
) -> object:
    """Run a command, with options from a file if one is given."""
    if completion is not None:
        from posefuse.cli.completion import completion_script

        return say(completion_script(app, COMMANDS, completion))
    _HELP.show_all = help_all
    detail.verbose = verbose
    if help_all:
        tokens = (*tokens, "--help")
    app.config = ()
    command = next((token for token in tokens if token in COMMANDS), None)
    if command not in _TAKES_URLS and any("://" in token for token in tokens):
        from posefuse.io.object_stores import require_local

        require_local(*tokens, *(token.partition("=")[2] for token in tokens))
    if options is not None:
        from posefuse.cli.options_file import command_values

        # Below the name of the command, because the parser ignores keys that are names of commands, such as people.
        from_videos = command == "run" or (command == "batch" and "--from-videos" in tokens)
        values = {} if command is None else {command: command_values(options, command, from_videos=from_videos)}
        app.config = (DictConfig(values, source=str(options), allow_unknown=True),)
    return app(_joined(tokens), exit_on_error=False, print_error=False, result_action="return_value")


def _joined(tokens: tuple[str, ...]) -> tuple[str, ...]:
    """Join ``--up -y`` to ``--up=-y``, because the parser takes a value that begins with a hyphen for a flag."""
    joined: list[str] = []
    for token in tokens:
        if joined and joined[-1] == "--up" and token in ("-x", "-y", "-z"):
            joined[-1] = f"--up={token}"
        else:
            joined.append(token)
    return tuple(joined)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line.

    The exit code is 0 on success, 1 if the command fails with a message, 2 for a wrong call, 3 if a result is certainly
    wrong, and 130 after Ctrl-C.
    """
    _HELP.show_all = detail.verbose = False
    start_s = time.monotonic()
    with print_warnings():
        try:
            app.meta(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        except CycloptsError as error:
            from posefuse.cli.usage_errors import describe

            _fail(describe(error), 2)
        except OptionsError as error:
            from posefuse.model.options.flags import options_as_flags

            _fail(options_as_flags(str(error)), 2)
        except PosefuseError as error:
            _fail(str(error), 1)
        except OSError as error:
            named = f"{error.filename}: " if error.filename else ""
            _fail(f"{named}{error.strerror or error}.", 1)
        except KeyboardInterrupt:
            _fail_interrupted(sys.argv[1:] if arguments is None else arguments)
    print_time(time.monotonic() - start_s)


def _fail_interrupted(tokens: list[str]) -> None:
    resumes = any(token in _RESUMING for token in tokens[:1])
    text = "Interrupted; no result was written." + (" The same command resumes." if resumes else "")
    err.print(Text(text, "red"))
    sys.exit(130)


def _fail(message: str, code: int) -> None:
    print_problem("error: ", "bold red", message)
    sys.exit(code)
