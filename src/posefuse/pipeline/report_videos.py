"""The report of a result with the videos of its cameras."""

import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import ResultError
from posefuse.evaluation.accuracy import Accuracy
from posefuse.evaluation.people import PeopleScores
from posefuse.io.outputs import check_new_files, replacing_together
from posefuse.io.results.names import safe_names
from posefuse.io.videos.reader import open_video
from posefuse.io.videos.small_copy import RATE_HZ, SmallCopy, write_small_copy
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.gait import analyze_gait
from posefuse.progress import Progress, Silent
from posefuse.report.html import render_report
from posefuse.report.videos import PageVideo, PageVideos
from posefuse.visualize.frame_times import FrameTimes
from posefuse.visualize.overlay.video_sources import VideoSource, check_names, shown_area_px

EMBEDDED_BYTES = 8_000_000
"""Largest total size of the videos that a report contains; larger ones are files beside it."""


@dataclass(frozen=True, eq=False)
class ReportTruth:
    """Ground truth that a report shows.

    Attributes:
        points_m: shape (frame, person, keypoint, 3), as of ``render_report``.
        accuracy: accuracy of the result compared with it.
    """

    points_m: np.ndarray
    accuracy: Accuracy | PeopleScores


@checked
def write_report(
    result: Reconstruction,
    path: Path,
    *,
    videos: Mapping[str, Path] | None = None,
    offset_s: Mapping[str, float] | None = None,
    truth: ReportTruth | None = None,
    recording: str = "",
    overwrite: bool = False,
    progress: Progress | None = None,
) -> tuple[Path, ...]:
    """Write the report of a result, with small copies of the cameras' videos beside its 3D scene.

    Copies of up to 8 MB together are contained in the page. Larger ones are files in the folder ``<page>_videos``
    beside it. Folders of pictures and videos whose shape differs from their camera's are left out, as the page states,
    and so is that of a single camera without a calibration.

    Args:
        result: the result to show.
        path: the HTML file.
        videos: video of each camera, by name; cameras without one are left out.
        offset_s: start of each camera's video in the result's time; 0 by default.
        truth: ground truth to show.
        recording: name of the recording in the title.
        overwrite: whether to replace an existing report.
        progress: receives the progress.

    Returns:
        The files that were written, the page first.

    Raises:
        MatchError: if a video or an offset names an unknown camera.
        FileError: if a video cannot be read.
        OutputExistsError: if the report exists and ``overwrite`` is False.
    """
    progress = progress or Silent()
    check_new_files([path], overwrite=overwrite)
    with tempfile.TemporaryDirectory() as folder:
        page, copies = PageVideos(), []
        if videos and result.unit == "m":
            page, copies = _copy_videos(result, videos, offset_s or {}, Path(folder), progress)
        linked = []
        if sum(video.n_bytes for video in page.videos) <= EMBEDDED_BYTES:
            embedded = [
                replace(video, content=copy.read_bytes()) for video, copy in zip(page.videos, copies, strict=True)
            ]
            page = replace(page, videos=tuple(embedded))
        else:
            beside = path.parent / f"{path.stem}_videos"
            stems = safe_names([result.rig.names[video.camera] for video in page.videos])
            linked = [beside / f"{stem}.mp4" for stem in stems]
            named = [replace(v, link=f"{beside.name}/{p.name}") for v, p in zip(page.videos, linked, strict=True)]
            page = replace(page, videos=tuple(named))
        gait = analyze_gait(result)
        people = None if gait is None else gait.people
        compared = (None, None) if truth is None else (truth.points_m, truth.accuracy)
        text = render_report(result, *compared, progress, page, people, recording)
        for parent in {file.parent for file in linked}:
            parent.mkdir(parents=True, exist_ok=True)
        with replacing_together([path, *linked]) as temporary:
            temporary[0].write_text(text, "utf-8")
            for copy, target in zip(copies, temporary[1:], strict=False):
                shutil.copyfile(copy, target)
    return (path, *linked)


def _copy_videos(
    result: Reconstruction, videos: Mapping[str, Path], offset_s: Mapping[str, float], folder: Path, progress: Progress
) -> tuple[PageVideos, list[Path]]:
    """Write small copies of the videos, and return what the page shows of them and their paths."""
    check_names(result.rig, videos, "videos")
    check_names(result.rig, offset_s, "offset_s")
    frame_times = FrameTimes.of(result)
    sources, notes = [], []
    for view, camera in enumerate(result.rig.cameras):
        if camera.name not in videos:
            continue
        if videos[camera.name].is_dir():
            notes.append(f"The images of {camera.name} are a folder of pictures, which is not shown.")
            continue
        reader = open_video(videos[camera.name])
        shift_s = offset_s.get(camera.name, 0.0)
        source = VideoSource(camera, view, reader, shift_s, not frame_times.timed, result.options.sync)
        try:
            area_px = shown_area_px(camera, reader.info)
        except ResultError as error:
            notes.append(f"The video of {camera.name} is not shown: {error}")
            continue
        sources.append((source, area_px))
    progress.start("copying videos", len(sources))
    shown, paths = [], []
    for source, area_px in sources:
        copy = _copy(source, frame_times, folder / f"{source.view}.mp4")
        notes += _notes(source, copy, frame_times)
        progress.advance(1)
        if not copy.n_images:
            continue
        assert source.reader is not None
        rate_hz = min(source.reader.info.rate_hz or RATE_HZ, RATE_HZ)
        n_bytes = copy.path.stat().st_size
        shown.append(
            PageVideo(source.view, copy.size_px, area_px, frame_times.first_s + copy.first_s, rate_hz, n_bytes=n_bytes)
        )
        paths.append(copy.path)
    progress.finish()
    start_s = float(frame_times.time_s[0]) if len(frame_times.time_s) else 0.0
    return PageVideos(tuple(shown), frame_times.period_s, start_s, tuple(notes)), paths


def _copy(source: VideoSource, frame_times: FrameTimes, path: Path) -> SmallCopy:
    """Write a small copy of one video from the first to the last frame of the result."""
    assert source.reader is not None
    start_s = frame_times.first_s

    def time_of(number: int, video_s: float) -> float:
        if source.by_number:
            return source.synchronized_s(frame_times.time_of_number(number)) - start_s
        return source.synchronized_s(video_s) - start_s

    shift_s = source.synchronized_s(start_s) - start_s
    from_s = 0.0 if source.by_number else max(start_s - max(shift_s, source.offset_s) - 1.0, 0.0)
    return write_small_copy(source.reader.info, path, time_of, frame_times.end_s - start_s, from_s)


def _notes(source: VideoSource, copy: SmallCopy, frame_times: FrameTimes) -> list[str]:
    """Return what is missing in the copy of a video."""
    assert source.reader is not None
    name, duration_s = source.reader.info.path.name, frame_times.end_s - frame_times.first_s
    if not copy.n_images:
        return [f"{name} has no image within the time of the result."]
    if copy.error:
        return [f"{name} cannot be read beyond {frame_times.first_s + copy.last_s:.2f} s ({copy.error})."]
    if copy.last_s < duration_s - 2.0 * max(frame_times.period_s, 1.0 / RATE_HZ):
        return [f"{name} ends at {frame_times.first_s + copy.last_s:.2f} s."]
    return []
