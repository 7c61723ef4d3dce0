"""The report: one self-contained HTML file, byte-identical for the same result."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import Any

import numpy as np

from posefuse.biomechanics.gait import Gait
from posefuse.evaluation.accuracy import Accuracy
from posefuse.evaluation.people import PeopleScores
from posefuse.evaluation.visibility import count_misses
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress, Silent, report_ranges
from posefuse.report import tables
from posefuse.report.charts import chart_data
from posefuse.report.command import command_box
from posefuse.report.header import facts_line, page_title, verdict_box
from posefuse.report.heat_map import HeatMap, gather_heat_map, heat_map_data
from posefuse.report.highlights import highlights_section
from posefuse.report.left_right_swaps import swap_section, swap_timeline
from posefuse.report.movement import SIDES_KEY, movement_data, movement_section
from posefuse.report.page import asset, document, safe_json, script
from posefuse.report.people import people_section, summarize_people, track_timeline
from posefuse.report.scene import display_stride, scene_data
from posefuse.report.series import Gap, TimeSeries, find_gaps, gather_series, time_series_data
from posefuse.report.summary import Summary, summarize
from posefuse.report.summary_text import scene_note, summary_paragraphs
from posefuse.report.verdict import judge_result
from posefuse.report.videos import PageVideos, video_data, videos_sentence
from posefuse.skeleton.subject_words import subject_words

PLOTLY = "plotly-cartesian.min.js"
"""Charts of plotly.js: its distribution with scatter, bar and heatmap; plotly-cartesian.LICENSE."""
_SCRIPTS = (
    "idle.js", "scene.js", "projection.js", "solids.js", "viewpoint.js", "player.js", "video.js", "parts.js",
    "heat_map.js", "time.js", "gaps.js", "movement.js", "timeline.js", "charts.js", "page.js",
)  # fmt: skip
"""Parts of one script, in this order."""


class PageData:
    """What the sections of a report are made from; each statistic is gathered once, when it is first needed.

    Args:
        result: the result to show.
        truth_m: ground truth, shape (frame, person, keypoint, 3), or None.
        accuracy: accuracy of the result, or None.
        progress: receives the progress.
        videos: videos to show beside the scene.
        gait: contacts, gait and repetitions by person.
    """

    def __init__(
        self,
        result: Reconstruction,
        truth_m: np.ndarray | None,
        accuracy: Accuracy | PeopleScores | None,
        progress: Progress,
        videos: PageVideos = PageVideos(),  # noqa: B008
        gait: Mapping[str, Gait] | None = None,
    ) -> None:
        self.result = result
        self.truth_m = truth_m
        self.accuracy = accuracy
        self.videos = videos
        self.gait = gait or {}
        self.layer: LayerName = result.best_layer(result.options.layer)[0]
        self.parts = _Ranges(result, progress)

    @cached_property
    def summary(self) -> Summary:
        """Summary statistics of the layer."""
        return summarize(self.parts, self.layer)

    @cached_property
    def heat_map(self) -> HeatMap:
        """Errors and shares of detections by keypoint and camera."""
        return gather_heat_map(self.parts, self.layer, self.result.n_frames)

    @cached_property
    def series(self) -> TimeSeries:
        """Numbers of every frame."""
        return gather_series(self.parts, self.layer, self.result.skeleton)

    @cached_property
    def gaps(self) -> list[Gap]:
        """The longest intervals without a measurement; none in unrelated frames."""
        return find_gaps(self.series) if self.result.has_identities else []

    @cached_property
    def scene(self) -> tuple[dict[str, Any], str]:
        """JSON data of the 3D scene, and what the scene leaves out in words."""
        stride = display_stride(self.result)
        scene, n_outside = scene_data(self.result, self.parts, self.layer, self.truth_m, stride)
        return scene, scene_note(stride, n_outside)

    @property
    def color_hint(self) -> str:
        """Which colors several subjects have."""
        return f"One color per {subject_words(self.result.skeleton)[0]}, names above their heads"

    @property
    def has_several_people(self) -> bool:
        """Whether people are distinguished by color; False for exactly one person."""
        return len(self.result.person_ids) != 1


class _Ranges:
    """A result in ranges of frames that can be iterated over repeatedly."""

    def __init__(self, result: Reconstruction, progress: Progress) -> None:
        self._result, self._progress = result, progress

    def __iter__(self) -> Iterator[Reconstruction]:
        return report_ranges(self._result.windows(), self._result.n_frames, "reporting", self._progress)


@dataclass(frozen=True)
class Section:
    """One section of the page.

    Attributes:
        name: placeholder in ``report.html``.
        render: returns the section as HTML.
    """

    name: str
    render: Callable[[PageData], str]


def _people(page: PageData) -> str:
    counted = page.has_several_people and page.result.has_identities
    misses = count_misses(page.parts, page.layer) if counted else None
    return people_section(page.result, page.summary, summarize_people(page.parts, page.layer), misses)


def _versions(page: PageData) -> str:
    return escape(", ".join(f"{name} {number}" for name, number in page.result.provenance.versions.items()))


SECTIONS = (
    Section("facts", lambda page: facts_line(page.result)),
    Section("verdict", lambda page: verdict_box(judge_result(page.result, page.summary))),
    Section("summary", lambda page: summary_paragraphs(page.result, page.summary, page.accuracy, page.scene[1])),
    Section(
        "highlights",
        lambda page: highlights_section(page.result, page.summary, page.heat_map, page.series, page.gaps),
    ),
    Section("sides", lambda page: page.color_hint if page.has_several_people else SIDES_KEY),
    Section("videos", lambda page: escape(videos_sentence(page.videos.videos, page.videos.notes))),
    Section("accuracy", lambda page: tables.accuracy_table(page.accuracy)),
    Section("movement", lambda page: movement_section(page.result, page.gait)),
    Section("layers", lambda page: tables.layer_section(page.result)),
    Section("people", _people),
    Section("cameras", lambda page: tables.camera_table(page.result, page.summary)),
    Section("keypoints", lambda page: tables.keypoint_table(page.result, page.summary, page.heat_map)),
    Section("swaps", lambda page: swap_section(page.result, page.summary)),
    Section("gaps", lambda page: tables.gap_section(page.result, page.gaps)),
    Section("bones", lambda page: tables.bone_section(page.result, page.series) if page.result.has_identities else ""),
    Section("command", lambda page: command_box(page.result)),
    Section("notes", lambda page: tables.notes_list(page.result)),
    Section("options", lambda page: tables.options_table(page.result.resolved)),
    Section("versions", _versions),
)
"""The sections that Python renders; adding one takes a function, one record and a placeholder in ``report.html``."""

CHARTS: dict[str, Callable[[PageData], Any]] = {
    "scene": lambda page: page.scene[0],
    "videos": lambda page: video_data(page.videos),
    "charts": lambda page: chart_data(page.result, page.summary),
    "heatMap": lambda page: heat_map_data(page.heat_map, page.result.frame_numbers),
    "series": lambda page: time_series_data(page.result, page.series),
    "movement": lambda page: movement_data(page.result, page.gait, page.series),
    "swaps": lambda page: swap_timeline(page.parts, page.result.n_frames),
    "tracks": lambda page: track_timeline(page.result),
}
"""The JSON data that the page's scripts draw from. Each name is a constant of the scripts."""


def render_report(
    result: Reconstruction,
    truth_m: np.ndarray | None = None,
    accuracy: Accuracy | PeopleScores | None = None,
    progress: Progress | None = None,
    videos: PageVideos = PageVideos(),  # noqa: B008
    gait: Mapping[str, Gait] | None = None,
    recording: str = "",
) -> str:
    """Return the report of a result as the text of an HTML file.

    Args:
        result: what to show: the layer of ``options.layer``, or the best one.
        truth_m: ground truth, drawn next to the result: shape (frame, person, keypoint, 3) with the frames and
            keypoints of the result, NaN where unknown.
        accuracy: accuracy of the result compared with the ground truth.
        progress: receives the progress.
        videos: videos to show beside the scene.
        gait: contacts, gait and repetitions by person.
        recording: name of the recording in the title.
    """
    page = PageData(result, truth_m, accuracy, progress or Silent(), videos, gait)
    return document(
        "report.html",
        title=escape(page_title(result, recording)),
        css=("report.css",),
        scene=asset("scene.html"),
        theme=asset("theme.js"),
        three=asset("three.min.js"),
        plotly=asset(PLOTLY),
        script=script(_SCRIPTS, CHARTS),
        data=safe_json({name: data(page) for name, data in CHARTS.items()}),
        **{section.name: section.render(page) for section in SECTIONS},
    )
