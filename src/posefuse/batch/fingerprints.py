"""Fingerprints of results, stored beside them, so that only changed recordings are reconstructed again."""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path

from posefuse.io.files import replacing
from posefuse.model.batch import JobResult, ResultStatistics
from posefuse.model.options.options import Options

RESULT, REPORT = "reconstruction.nc", "report.html"
MARK = "batch.json"
"""File beside a result that holds its fingerprint."""


def fingerprint(inputs: Mapping[str, str], options: Options, skeleton: str = "", window_s: float | None = None) -> str:
    """Return a digest of everything a result depends on: contents, options and version, but no path, host or time.

    Args:
        inputs: names and digests of the inputs.
        options: options of the reconstruction.
        skeleton: digest of the file that ``options.skeleton`` names, if it names one.
        window_s: length of the windows into which the recording was divided, None if it was not.
    """
    values = dataclasses.asdict(options)
    if skeleton:
        values["skeleton"] = skeleton
    whole: dict[str, object] = {"inputs": dict(inputs), "options": values, "posefuse": version("posefuse")}
    if window_s is not None:
        whole["window_s"] = window_s
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


def write_mark(folder: Path, key: str, result: JobResult, digest: Callable[[Path], str]) -> None:
    """Write the fingerprint of a finished result.

    Args:
        folder: folder of the result.
        key: fingerprint of its inputs, from :func:`fingerprint`.
        result: result of the job.
        digest: returns the digest of a file.
    """
    assert result.statistics is not None
    statistics, warnings = dataclasses.asdict(result.statistics), list(result.warnings)
    mark = {"key": key, "result": digest(folder / RESULT), "statistics": statistics, "warnings": warnings}
    with replacing(folder / MARK) as temporary:
        temporary.write_text(json.dumps(mark, indent=1, sort_keys=True) + "\n", "utf-8")


def remove_mark(folder: Path) -> None:
    """Remove the fingerprint of a folder whose result is about to change."""
    (folder / MARK).unlink(missing_ok=True)


def unchanged_result(name: str, folder: Path, key: str, digest: Callable[[Path], str]) -> JobResult | None:
    """Return the result of an earlier run if it is complete and has the same fingerprint, or None.

    Args:
        name: name of the job.
        folder: folder of the result.
        key: fingerprint of the present inputs.
        digest: returns the digest of a file.
    """
    try:
        mark = json.loads((folder / MARK).read_text("utf-8"))
        if not (folder / REPORT).is_file() or mark["key"] != key or mark["result"] != digest(folder / RESULT):
            return None
        return JobResult(name, "kept", "", ResultStatistics(**mark["statistics"]), tuple(mark["warnings"]))
    except (OSError, ValueError, TypeError, KeyError):
        return None
