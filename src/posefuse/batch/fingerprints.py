"""What a result was made from, kept beside it, so that it is done again only where something has changed."""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path

from posefuse.io.files import replacing
from posefuse.model.batch import Numbers, Outcome
from posefuse.model.options.options import Options

RESULT, REPORT = "reconstruction.nc", "report.html"
MARK = "batch.json"
"""Beside a result: what it was made from."""


def key_of(inputs: Mapping[str, str], options: Options, skeleton: str = "", window_s: float | None = None) -> str:
    """A digest of all that a result depends on: contents, options and version; no path, host or time is in it.

    Args:
        inputs: names and digests of what is read.
        options: of the reconstruction.
        skeleton: digest of the file that ``options.skeleton`` names, if it is one.
        window_s: of the windows that the recording was divided into, None if it was not.
    """
    told = dataclasses.asdict(options)
    if skeleton:
        told["skeleton"] = skeleton
    whole: dict[str, object] = {"inputs": dict(inputs), "options": told, "posefuse": version("posefuse")}
    if window_s is not None:
        whole["window_s"] = window_s
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


def write_mark(folder: Path, key: str, outcome: Outcome, digest: Callable[[Path], str]) -> None:
    """Say of a finished result what it was made from."""
    assert outcome.numbers is not None
    numbers, warnings = dataclasses.asdict(outcome.numbers), list(outcome.warnings)
    mark = {"key": key, "result": digest(folder / RESULT), "numbers": numbers, "warnings": warnings}
    with replacing(folder / MARK) as temporary:
        temporary.write_text(json.dumps(mark, indent=1, sort_keys=True) + "\n", "utf-8")


def remove_mark(folder: Path) -> None:
    """What is in the folder is about to be another result."""
    (folder / MARK).unlink(missing_ok=True)


def kept(name: str, folder: Path, key: str, digest: Callable[[Path], str]) -> Outcome | None:
    """A result that is whole and was made from just this; None if it is to be made anew."""
    try:
        mark = json.loads((folder / MARK).read_text("utf-8"))
        if not (folder / REPORT).is_file() or mark["key"] != key or mark["result"] != digest(folder / RESULT):
            return None
        return Outcome(name, "kept", "", Numbers(**mark["numbers"]), tuple(mark["warnings"]))
    except (OSError, ValueError, TypeError, KeyError):
        return None
