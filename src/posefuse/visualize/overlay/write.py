"""Draw a result on videos and write them, with one image in memory at a time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from posefuse.errors import OptionsError, ResultError
from posefuse.io.outputs import check_new_files, replacing_together
from posefuse.io.results.names import safe_names
from posefuse.io.videos.writer import write_video
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress, Silent
from posefuse.visualize.annotations import Annotations, Annotator
from posefuse.visualize.colors import BACKGROUND
from posefuse.visualize.drawing import DrawingStyle, draw
from posefuse.visualize.frame_times import FrameTimes, no_frames_error
from posefuse.visualize.mosaic import Mosaic, resize_image
from posefuse.visualize.overlay.options import OverlayOptions, OverlayVideo
from posefuse.visualize.overlay.video_sources import VideoCursor, VideoSource, open_sources
from posefuse.visualize.pillow_extra import require_pillow


@dataclass(frozen=True, eq=False)
class _Job:
    """What is drawn on every video."""

    annotator: Annotator
    frame_times: FrameTimes
    frame_indices: range
    progress: Progress

    @property
    def span_s(self) -> tuple[float, float]:
        """Half a frame before the first frame to half a frame after the last one."""
        times_s, half_s = self.frame_times.time_s, self.frame_times.period_s / 2
        return float(times_s[self.frame_indices[0]]) - half_s, float(times_s[self.frame_indices[-1]]) + half_s


def write_overlays(
    result: Reconstruction,
    videos: Mapping[str, Path],
    folder: Path,
    options: OverlayOptions = OverlayOptions(),  # noqa: B008
    detections: Detections | None = None,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> tuple[OverlayVideo, ...]:
    """Draw a result's skeletons, projected with lens distortion, on the cameras' videos.

    Args:
        result: the result to draw.
        videos: videos by camera name.
        folder: output folder for ``<camera>_overlay.mp4`` of each camera, or ``overlay.mp4``; created if absent.
        options: options of the overlay.
        detections: detections of the result's skeleton, with views in the order of its cameras, to draw as well.
        overwrite: whether to replace existing overlay videos.
        progress: receives the progress.

    Raises:
        MatchError: if a video or an offset names an unknown camera.
        FileError: if a video cannot be read, or the output cannot be written.
        ResultError: if there is nothing to draw, the size of a video differs from its camera's, or Pillow or matplotlib
            is not installed.
        OptionsError: if a video to be drawn on would be replaced.
        OutputExistsError: if an overlay video exists and ``overwrite`` is False.
    """
    require_pillow()
    layer, _ = result.best_layer(options.layer)
    frame_times = FrameTimes.of(result)
    sources = open_sources(result.rig, videos, options, frame_times.timed, result.options.sync)
    frame_indices = frame_times.indices_between(options.start_s, options.end_s)
    if not frame_indices:
        raise no_frames_error(frame_times)
    job = _Job(Annotator(result, layer, detections), frame_times, frame_indices, progress or Silent())
    stems = [f"{stem}_overlay" for stem in safe_names([source.camera.name for source in sources])]
    paths = [folder / f"{stem}.mp4" for stem in (["overlay"] if options.grid else stems)]
    _check_targets(paths, videos)
    check_new_files(paths, overwrite=overwrite)
    with replacing_together(paths) as temporary:
        if options.grid:
            drawn = [_draw_mosaic(job, sources, temporary[0])]
        else:
            drawn = [
                _draw_on_background(job, source, path) if source.reader is None else _draw_on_video(job, source, path)
                for source, path in zip(sources, temporary, strict=True)
            ]
    return tuple(replace(video, path=path) for video, path in zip(drawn, paths, strict=True))


def _check_targets(paths: Sequence[Path], videos: Mapping[str, Path]) -> None:
    taken = {path.resolve() for path in videos.values()}
    for path in paths:
        if path.resolve() in taken:
            raise OptionsError(f"{path} is one of the videos to be drawn on. Choose another folder for `output`.")


def _draw_on_video(job: _Job, source: VideoSource, path: Path) -> OverlayVideo:
    """Draw on every image of the video within the result's time range; times of the images are kept."""
    assert source.reader is not None
    start_s, end_s = job.span_s
    rate_hz = source.reader.info.rate_hz or 1.0 / job.frame_times.period_s
    style = DrawingStyle.of(source.size_px, source.camera.size_px)
    job.progress.start(f"drawing {path.name}", round((end_s - start_s) * rate_hz))
    first_s, n_drawn, last_s = None, 0, float("nan")
    with write_video(path, source.size_px, rate_hz) as writer:
        for time_s, image in source.images(job.frame_times, start_s):
            last_s = time_s
            if time_s < start_s:
                continue
            if time_s >= end_s:
                break
            first_s = time_s if first_s is None else first_s
            annotations = _annotate_time(job, source, time_s)
            rgb = image.rgb if image.rgb.flags.writeable else image.rgb.copy()
            draw(rgb, annotations, _caption(job, source, annotations, time_s), style)
            writer.add(rgb, time_s - first_s)
            n_drawn += annotations is not None
            job.progress.advance(1)
        if not writer.n_written:
            raise _no_images_error(source, job.span_s, last_s)
    job.progress.finish()
    return OverlayVideo(path, writer.n_written, n_drawn, tuple(source.notes(job.frame_times, end_s)))


def _draw_on_background(job: _Job, source: VideoSource, path: Path) -> OverlayVideo:
    """Draw every frame of the result on a plain background."""
    style = DrawingStyle.of(source.size_px, source.camera.size_px)
    job.progress.start(f"drawing {path.name}", len(job.frame_indices))
    first_s = float(job.frame_times.time_s[job.frame_indices[0]])
    with write_video(path, source.size_px, 1.0 / job.frame_times.period_s) as writer:
        for frame_index in job.frame_indices:
            rgb = _background(source.size_px)
            time_s = float(job.frame_times.time_s[frame_index])
            annotations = job.annotator.annotate(source.view, frame_index)
            draw(rgb, annotations, _caption(job, source, annotations, time_s), style)
            writer.add(rgb, time_s - first_s)
            job.progress.advance(1)
    job.progress.finish()
    return OverlayVideo(path, writer.n_written, writer.n_written)


def _draw_mosaic(job: _Job, sources: Sequence[VideoSource], path: Path) -> OverlayVideo:
    """Draw every frame of the result on the nearest image of each camera, side by side."""
    mosaic = Mosaic.of([source.size_px for source in sources])
    start_s, end_s = job.span_s
    cursors = [VideoCursor(source, job.frame_times, start_s) for source in sources]
    sizes = mosaic.sizes_px
    styles = [DrawingStyle.of(size, source.camera.size_px) for size, source in zip(sizes, sources, strict=True)]
    job.progress.start(f"drawing {path.name}", len(job.frame_indices))
    first_s = float(job.frame_times.time_s[job.frame_indices[0]])
    with write_video(path, mosaic.size_px, 1.0 / job.frame_times.period_s) as writer:
        for frame_index in job.frame_indices:
            canvas = mosaic.empty()
            time_s = float(job.frame_times.time_s[frame_index])
            for i, (source, cursor, style) in enumerate(zip(sources, cursors, styles, strict=True)):
                image = cursor.at(time_s)
                rgb = _background(sizes[i]) if image is None else resize_image(image.rgb, sizes[i])
                annotations = job.annotator.annotate(source.view, frame_index)
                caption = _caption(job, source, annotations, time_s)
                missing = ["no image"] if image is None and source.reader is not None else []
                draw(rgb, annotations, [*caption, *missing], style)
                mosaic.paste(canvas, i, rgb)
            writer.add(canvas, time_s - first_s)
            job.progress.advance(1)
    job.progress.finish()
    notes = [note for source in sources for note in source.notes(job.frame_times, end_s)]
    return OverlayVideo(path, writer.n_written, writer.n_written, tuple(notes))


def _background(size_px: tuple[int, int]) -> np.ndarray:
    return np.full((size_px[1], size_px[0], 3), BACKGROUND, dtype=np.uint8)


def _annotate_time(job: _Job, source: VideoSource, time_s: float) -> Annotations | None:
    frame_index = job.frame_times.nearest(time_s)
    if frame_index is None or frame_index not in job.frame_indices:
        return None
    return job.annotator.annotate(source.view, frame_index)


def _caption(job: _Job, source: VideoSource, annotations: Annotations | None, time_s: float) -> list[str]:
    frame = "no frame of the result" if annotations is None else f"frame {annotations.number}"
    time = [f"{time_s:.3f} s"] if job.frame_times.timed else []
    return [source.camera.name, frame, *time, f"layer {job.annotator.layer}"]


def _no_images_error(source: VideoSource, span_s: tuple[float, float], last_s: float) -> ResultError:
    assert source.reader is not None
    return ResultError(
        f"{source.reader.info.path.name} has no image in the selected time range: the result's frames are from "
        f"{span_s[0]:.3f} to {span_s[1]:.3f} s, and the last image read is at {last_s:.3f} s. If the video starts at a "
        f"different time than the result, set `offset_s` of {source.camera.name!r}."
    )
