"""A batch of recordings as one table: CSV, and an HTML page that needs no network."""

import csv
import io
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from urllib.parse import quote

from posefuse.model.batch import JobResult, ResultStatistics

_COLUMNS = ("recording", "outcome", *ResultStatistics.__dataclass_fields__, "warnings", "why")
_NONE = ("failed", "not done")
_HEADS = ("Recording", "Outcome", "Frames", "s", "Cameras", "People", "Points", "Median px", "90 % px", "Typical sd mm")


def batch_csv(outcomes: Sequence[JobResult]) -> str:
    """A row a recording; what is not known is empty."""
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


def batch_page(outcomes: Sequence[JobResult]) -> str:
    """The page: what failed and why, then all recordings with a link to each report."""
    failed = [each for each in outcomes if each.state in _NONE]
    there = len(outcomes) - len(failed)
    css = files("posefuse.report").joinpath("assets", "report.css").read_text("utf-8")
    head = "".join(f"<th>{escape(name)}</th>" for name in _HEADS)
    rows = "".join(_row(each) for each in outcomes)
    whys = "".join(f"<tr><th>{escape(each.name)}</th><td>{escape(each.why)}</td></tr>" for each in failed)
    faults = f"<h2>Not reconstructed</h2><table>{whys}</table>" if failed else ""
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>posefuse: {len(outcomes)} recordings</title><style>{css}</style>"
        f"<h1>{len(outcomes)} recordings</h1><p>{there} reconstructed, {len(failed)} not.</p>{faults}"
        f'<h2>Recordings</h2><div class="wide"><table><tr>{head}</tr>{rows}</table></div></html>\n'
    )


def _row(each: JobResult) -> str:
    name = escape(each.name)
    if each.statistics is None:
        cells = [name, _outcome(each), *[""] * (len(_HEADS) - 2)]
    else:
        n = each.statistics
        share = None if n.points_share is None else 100.0 * n.points_share
        cells = [
            f'<a href="{quote(each.name)}/report.html">{name}</a>', _outcome(each), str(n.frames), _shown(n.seconds, 1),
            str(n.cameras), str(n.people), _shown(share, 1, " %"), _shown(n.median_px, 2), _shown(n.p90_px, 2),
            _shown(n.sd_mm, 1),
        ]  # fmt: skip
    notes = "".join(f'<br><span class="hint">{escape(warning)}</span>' for warning in each.warnings)
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in [cells[0] + notes, *cells[1:]]) + "</tr>"


def _outcome(each: JobResult) -> str:
    """Files do not say whether a result was made now or before: that would make them differ for no reason."""
    return each.state if each.state in _NONE else "reconstructed"


def _shown(value: float | None, digits: int, unit: str = "") -> str:
    return "–" if value is None else f"{value:.{digits}f}{unit}"
