"""Drawing a result on videos and writing them, one picture in memory at a time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from posefuse.errors import OptionsError, ResultError
from posefuse.io.results.names import safe_names
from posefuse.io.videos.writing import write_video
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress, Silent
from posefuse.visualize.clock import Clock, nothing_between
from posefuse.visualize.colors import BACKGROUND
from posefuse.visualize.drawing import Pen, draw
from posefuse.visualize.mosaic import Board, resized
from posefuse.visualize.overlay.options import OverlayOptions, Written
from posefuse.visualize.overlay.sources import Follower, Source, open_sources
from posefuse.visualize.skeleton_drawing import Sketch, Sketcher


@dataclass(frozen=True, eq=False)
class _Job:
    """What is drawn, and when: the same for every video."""

    sketcher: Sketcher
    clock: Clock
    places: range
    progress: Progress

    @property
    def span_s(self) -> tuple[float, float]:
        """From the middle before the first frame to the middle after the last."""
        times_s, half_s = self.clock.time_s, self.clock.period_s / 2
        return float(times_s[self.places[0]]) - half_s, float(times_s[self.places[-1]]) + half_s


def write_overlays(
    result: Reconstruction,
    videos: Mapping[str, Path],
    folder: Path,
    options: OverlayOptions = OverlayOptions(),  # noqa: B008
    detections: Detections | None = None,
    progress: Progress | None = None,
) -> tuple[Written, ...]:
    """Draw a result's skeletons, through each camera's lens, on its video.

    Args:
        result: what is drawn.
        videos: camera to its video.
        folder: gets ``<camera>_overlay.mp4`` each, or ``overlay.mp4``; made if absent.
        options: how.
        detections: of the result's skeleton, views in the order of its cameras; drawn as well.
        progress: told how far the work is.

    Raises:
        MatchError: if a video or an offset names no camera.
        FileError: if a video cannot be read, or the output cannot be written.
        ResultError: if there is nothing to draw, or a video has another size than its camera.
        OptionsError: if a video would be overwritten.
    """
    layer, _ = result.best_layer(options.layer)
    clock = Clock.of(result)
    sources = open_sources(result.rig, videos, options, clock.timed, result.options.sync)
    places = clock.places(options.start_s, options.end_s)
    if not places:
        raise nothing_between(clock)
    job = _Job(Sketcher(result, layer, detections), clock, places, progress or Silent())
    stems = [f"{stem}_overlay" for stem in safe_names([source.camera.name for source in sources])]
    paths = [folder / f"{stem}.mp4" for stem in (["overlay"] if options.grid else stems)]
    _keep_videos(paths, videos)
    if options.grid:
        return (_side_by_side(job, sources, paths[0]),)
    return tuple(
        _on_background(job, source, path) if source.reading is None else _on_video(job, source, path)
        for source, path in zip(sources, paths, strict=True)
    )


def _keep_videos(paths: Sequence[Path], videos: Mapping[str, Path]) -> None:
    taken = {path.resolve() for path in videos.values()}
    for path in paths:
        if path.resolve() in taken:
            raise OptionsError(f"{path} is one of the videos to be drawn on. Choose another folder for --output.")


def _on_video(job: _Job, source: Source, path: Path) -> Written:
    """Every picture of the video within the result's time, at its own time."""
    assert source.reading is not None
    start_s, end_s = job.span_s
    rate_hz = source.reading.facts.rate_hz or 1.0 / job.clock.period_s
    pen = Pen.of(source.size_px, source.camera.size_px)
    job.progress.start(f"drawing {path.name}", round((end_s - start_s) * rate_hz))
    began_s, drawn, missed_s = None, 0, float("nan")
    with write_video(path, source.size_px, rate_hz) as writing:
        for time_s, image in source.images(job.clock, start_s):
            missed_s = time_s
            if time_s < start_s:
                continue
            if time_s >= end_s:
                break
            began_s = time_s if began_s is None else began_s
            sketch = _sketch(job, source, time_s)
            picture = image.rgb if image.rgb.flags.writeable else image.rgb.copy()
            draw(picture, sketch, _heading(job, source, sketch, time_s), pen)
            writing.add(picture, time_s - began_s)
            drawn += sketch is not None
            job.progress.advance(1)
        if not writing.n_written:
            raise _nothing_in_time(source, job.span_s, missed_s)
    job.progress.finish()
    return Written(path, writing.n_written, drawn, tuple(source.remarks(job.clock, end_s)))


def _on_background(job: _Job, source: Source, path: Path) -> Written:
    """Every frame of the result, on a plain background."""
    width, height = source.size_px
    pen = Pen.of(source.size_px, source.camera.size_px)
    job.progress.start(f"drawing {path.name}", len(job.places))
    with write_video(path, source.size_px, 1.0 / job.clock.period_s) as writing:
        for place in job.places:
            picture = np.full((height, width, 3), BACKGROUND, dtype=np.uint8)
            time_s = float(job.clock.time_s[place])
            sketch = job.sketcher.sketch(source.view, place)
            draw(picture, sketch, _heading(job, source, sketch, time_s), pen)
            writing.add(picture, time_s - float(job.clock.time_s[job.places[0]]))
            job.progress.advance(1)
    job.progress.finish()
    return Written(path, writing.n_written, writing.n_written)


def _side_by_side(job: _Job, sources: Sequence[Source], path: Path) -> Written:
    """Every frame of the result, with each camera's nearest picture."""
    board = Board.of([source.size_px for source in sources])
    start_s, end_s = job.span_s
    followers = [Follower(source, job.clock, start_s) for source in sources]
    pens = [Pen.of(size, source.camera.size_px) for size, source in zip(board.sizes_px, sources, strict=True)]
    job.progress.start(f"drawing {path.name}", len(job.places))
    with write_video(path, board.size_px, 1.0 / job.clock.period_s) as writing:
        for place in job.places:
            whole = board.empty()
            time_s = float(job.clock.time_s[place])
            for i, (source, follower, pen) in enumerate(zip(sources, followers, pens, strict=True)):
                image = follower.at(time_s)
                picture = _background(board.sizes_px[i]) if image is None else resized(image.rgb, board.sizes_px[i])
                sketch = job.sketcher.sketch(source.view, place)
                heading = _heading(job, source, sketch, time_s)
                missing = ["no picture"] if image is None and source.reading is not None else []
                draw(picture, sketch, [*heading, *missing], pen)
                board.put(whole, i, picture)
            writing.add(whole, time_s - float(job.clock.time_s[job.places[0]]))
            job.progress.advance(1)
    job.progress.finish()
    remarks = [remark for source in sources for remark in source.remarks(job.clock, end_s)]
    return Written(path, writing.n_written, writing.n_written, tuple(remarks))


def _background(size_px: tuple[int, int]) -> np.ndarray:
    return np.full((size_px[1], size_px[0], 3), BACKGROUND, dtype=np.uint8)


def _sketch(job: _Job, source: Source, time_s: float) -> Sketch | None:
    place = job.clock.nearest(time_s)
    return None if place is None or place not in job.places else job.sketcher.sketch(source.view, place)


def _heading(job: _Job, source: Source, sketch: Sketch | None, time_s: float) -> list[str]:
    frame = "no frame of the result" if sketch is None else f"frame {sketch.number}"
    when = [f"{time_s:.3f} s"] if job.clock.timed else []
    return [source.camera.name, frame, *when, f"layer {job.sketcher.layer}"]


def _nothing_in_time(source: Source, span_s: tuple[float, float], last_s: float) -> ResultError:
    assert source.reading is not None
    said = f"the result's are from {span_s[0]:.3f} to {span_s[1]:.3f} s, its last picture read is at {last_s:.3f} s"
    return ResultError(
        f"{source.reading.facts.path.name} has no picture in the chosen time: {said}. If the video began at another "
        f"time than the result: --offset-s {source.camera.name}=SECONDS."
    )
