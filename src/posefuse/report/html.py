"""The report: one HTML file with everything in it, the same bytes for the same result."""

import json
from collections.abc import Iterator
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

from plotly.offline import get_plotlyjs

from posefuse.evaluation.accuracy import Accuracy
from posefuse.evaluation.people import PeopleScores
from posefuse.evaluation.sightings import count_misses
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress, Silent, report_ranges
from posefuse.report import tables
from posefuse.report.cells import cell_data, cells_of
from posefuse.report.charts import chart_data
from posefuse.report.highlights import look_section
from posefuse.report.people import life_lines, lives, people_section
from posefuse.report.scene import scene_data, stride_of
from posefuse.report.series import gaps_of, series_data, series_of
from posefuse.report.summary import summarise
from posefuse.report.summary_text import in_words, scene_in_words
from posefuse.report.swaps import swap_table, time_line

_SCRIPTS = ("scene.js", "lens.js", "player.js", "heat.js", "time.js", "charts.js")
"""Parts of one script, in this order."""
_SIDES_HINT = '<span class="left">Left</span>, <span class="right">right</span>'
_PEOPLE_HINT = "One colour a person, names above their heads"


def render_report(
    result: Reconstruction,
    truth: Reconstruction | None = None,
    accuracy: Accuracy | PeopleScores | None = None,
    progress: Progress | None = None,
) -> str:
    """The report of a result, as the text of its HTML file.

    Args:
        result: what to show; the layer ``options.layer`` names, or the best.
        truth: known positions of the same frames and keypoints, shown beside it.
        accuracy: of the result against the truth.
        progress: told how far the work is.
    """
    layer, _ = result.best_layer(result.options.layer)
    parts = _Ranges(result, progress or Silent())
    summary = summarise(parts, layer)
    cells = cells_of(parts, layer, result.n_frames)
    series = series_of(parts, layer, result.skeleton)
    gaps = gaps_of(series)
    stride = stride_of(result)
    scene, strays = scene_data(result, parts, layer, truth, stride)
    data = {
        "scene": scene,
        "charts": chart_data(result, summary),
        "cells": cell_data(cells, result.frame_numbers),
        "series": series_data(result, series),
        "swaps": time_line(parts, result.n_frames),
        "lives": life_lines(result),
    }
    several = len(result.person_ids) != 1
    misses = count_misses(parts, layer) if several else None
    return Template(_asset("report.html")).substitute(
        title=escape(f"posefuse: {len(result.person_ids)} x {result.skeleton.name}"),
        css=_asset("report.css"),
        plotly=get_plotlyjs(),
        script=_script(),
        data=_safe_json(data),
        sides=_PEOPLE_HINT if several else _SIDES_HINT,
        words=in_words(result, summary, accuracy, scene_in_words(stride, strays)),
        look=look_section(result, summary, cells, series, gaps),
        accuracy=tables.accuracy_table(accuracy),
        people=people_section(result, lives(parts, layer), misses),
        cameras=tables.camera_table(result, summary),
        keypoints=tables.keypoint_table(result, summary, cells),
        swaps=swap_table(result, summary),
        gaps=tables.gap_section(result, gaps),
        bones=tables.bone_section(result, series),
        notes=tables.notes_list(result),
        options=tables.options_table(result.options),
        versions=escape(", ".join(f"{name} {number}" for name, number in result.provenance.versions.items())),
    )


class _Ranges:
    """A result in ranges of frames, to be gone through anew for each part of the page, which reads what it needs."""

    def __init__(self, result: Reconstruction, progress: Progress) -> None:
        self._result, self._progress = result, progress

    def __iter__(self) -> Iterator[Reconstruction]:
        return report_ranges(self._result.windows(), self._result.n_frames, "reporting", self._progress)


def _script() -> str:
    """The parts as one function, so that their names are nobody else's."""
    return "\n".join(['"use strict";', "(() => {", *(_asset(name) for name in _SCRIPTS), "})();"])


def _asset(name: str) -> str:
    return files("posefuse.report").joinpath("assets", name).read_text("utf-8")


def _safe_json(data: Any) -> str:
    """JSON that cannot end the script element it stands in."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c").replace("&", "\\u0026")
