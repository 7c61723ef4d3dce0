"""Overview of a batch of recordings: a CSV table and an HTML page without network access."""

import csv
import io
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from urllib.parse import quote

from posefuse.model.batch import JobResult, ResultStatistics
from posefuse.report.messages import message_html

_COLUMNS = ("recording", "outcome", *ResultStatistics.__dataclass_fields__, "warnings", "why")
_NO_RESULT = ("failed", "not done")
_HEADINGS = (
    "Recording", "Outcome", "Frames", "Duration, s", "Cameras", "People", "Points", "Median error, px",
    "90th percentile, px", "Median SD, mm",
)  # fmt: skip


def batch_csv(outcomes: Sequence[JobResult]) -> str:
    """Return the table as CSV text, one row per recording; unknown values are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for each in outcomes:
        numbers = (
            [None] * len(ResultStatistics.__dataclass_fields__)
            if each.statistics is None
            else vars(each.statistics).values()
        )
        row = [each.name, _outcome(each), *numbers, " | ".join(each.warnings), each.why]
        writer.writerow("" if value is None else value for value in row)
    return text.getvalue()


def names_in_csv(path: Path) -> list[str] | None:
    """Return the recordings with results in a table that :func:`batch_csv` made, or None if it is something else."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.reader(file))
    except (OSError, ValueError, csv.Error):
        return None
    if not rows or tuple(rows[0]) != _COLUMNS:
        return None
    return [row[0] for row in rows[1:] if row and row[1] not in _NO_RESULT]


def batch_page(outcomes: Sequence[JobResult]) -> str:
    """Return the page as HTML: failures with their reasons, then all recordings with links to their reports."""
    failed = [each for each in outcomes if each.state in _NO_RESULT]
    n_done = len(outcomes) - len(failed)
    css = files("posefuse.report").joinpath("assets", "report.css").read_text("utf-8")
    head = "".join(f"<th>{escape(name)}</th>" for name in _HEADINGS)
    rows = "".join(_row(each) for each in outcomes)
    doubtful = [each for each in outcomes if each.state == "failed check"]
    failures = _reasons("Not reconstructed", failed) + _reasons("Failed check", doubtful)
    heading = "1 recording" if len(outcomes) == 1 else f"{len(outcomes)} recordings"
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>posefuse: {heading}</title><style>{css}</style>"
        f"<h1>{heading}</h1><p>{n_done} reconstructed, {len(failed)} not.</p>{failures}"
        f'<h2>Recordings</h2><div class="wide"><table class="batch"><tr>{head}</tr>{rows}</table></div></html>\n'
    )


def _reasons(heading: str, outcomes: Sequence[JobResult]) -> str:
    """Return a list of recordings with reasons; empty if there are none."""
    rows = "".join(f"<dt>{escape(each.name)}</dt><dd>{message_html(each.why)}</dd>" for each in outcomes)
    return f'<h2>{heading}</h2><dl class="reasons">{rows}</dl>' if rows else ""


def _row(each: JobResult) -> str:
    """Return the numbers of a recording, and below them its warnings over the whole width of the table."""
    name = escape(each.name)
    if each.statistics is None:
        cells = [name, _outcome(each), *[""] * (len(_HEADINGS) - 2)]
    else:
        n = each.statistics
        share = None if n.points_share is None else 100.0 * n.points_share
        cells = [
            f'<a href="{quote(each.name)}/{each.report}">{name}</a>', _outcome(each), str(n.frames),
            _format(n.seconds, 1), str(n.cameras), str(n.people), _format(share, 1, " %"), _format(n.median_px, 2),
            _format(n.p90_px, 2), _format(n.sd_mm, 1),
        ]  # fmt: skip
    numbers = "".join(f"<td>{cell}</td>" for cell in cells)
    if not each.warnings:
        return f"<tr>{numbers}</tr>"
    warnings = "".join(f"<p>{message_html(warning)}</p>" for warning in each.warnings)
    return (
        f'<tr class="warned">{numbers}</tr>'
        f'<tr class="warning"><td colspan="{len(_HEADINGS)}"><div class="hint">{warnings}</div></td></tr>'
    )


def _outcome(each: JobResult) -> str:
    """Return the outcome as files state it.

    It does not distinguish new results from earlier ones, so that repeated runs write the same files.
    """
    return "reconstructed" if each.state in ("done", "kept") else each.state


def _format(value: float | None, digits: int, unit: str = "") -> str:
    return "–" if value is None else f"{value:.{digits}f}{unit}"
