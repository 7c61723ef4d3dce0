"""Copies of a recording's videos with the detections drawn on them."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from posefuse.io.files import replacing
from posefuse.io.results.names import safe_names
from posefuse.io.videos.writer import write_video
from posefuse.io.view_images import ImageSource
from posefuse.model.detections import CHUNK_FRAMES, Detections
from posefuse.progress import Progress
from posefuse.visualize.annotations import Annotations, ProjectedPerson
from posefuse.visualize.drawing import DrawingStyle, draw

_FAINT_CONFIDENCE = 0.3
_PICTURES_HZ = 2.0


def draw_detections(
    sources: Sequence[ImageSource],
    detections: Detections,
    every: int,
    folder: Path,
    *,
    threads: int = 1,
    progress: Progress,
) -> tuple[Path, ...]:
    """Draw the detections of each view on a copy of its video, in the color of their 2D track.

    Keypoints with a confidence below 0.3 are faint. Pictures become a video of two images per second.

    Args:
        sources: images of the views, in the order of the views.
        detections: detections; frame n belongs to image n * ``every`` of each view.
        every: interval of the examined images; others are not drawn.
        folder: folder for ``<view>.mp4`` of each view; created if absent.
        threads: number of threads of the decoder.
        progress: receives the progress in images.

    Raises:
        FileError: if a video cannot be read, or the output cannot be written.
    """
    paths = [folder / f"{stem}.mp4" for stem in safe_names([source.name for source in sources])]
    for source, path in zip(sources, paths, strict=True):
        of_view = detections.views([source.name])
        progress.start(f"drawing {path.name}", int(of_view.recorded.sum()))
        with replacing(path) as temporary:
            _draw_view(source, of_view, every, temporary, threads, progress)
        progress.finish()
    return tuple(paths)


def _draw_view(
    source: ImageSource, of_view: Detections, every: int, path: Path, threads: int, progress: Progress
) -> None:
    rate_hz = _PICTURES_HZ if source.index is None else (source.index.rate_hz or _PICTURES_HZ)
    style = DrawingStyle.of(source.size_px, source.size_px)
    annotated = {int(n) * every for n in of_view.frame_numbers[of_view.recorded[:, 0]]}
    frames = _annotations(of_view, every)
    reader = source.open(threads)
    with write_video(path, source.size_px, rate_hz / every) as writer:
        if annotated:
            first = min(annotated)
            for number, image in reader.images(first, max(annotated) + 1, annotated.__contains__):
                annotations = next(frames)
                while annotations.number < number:
                    annotations = next(frames)
                rgb = image if image.flags.writeable and image.flags.c_contiguous else image.copy()
                time_s = source.time_s[number] if source.index is not None else number / _PICTURES_HZ
                since_s = time_s - (source.time_s[first] if source.index is not None else first / _PICTURES_HZ)
                draw(rgb, annotations, [source.name, f"image {number}", f"{time_s:.3f} s"], style)
                writer.add(rgb, since_s)
                progress.advance(1)
    reader.close()


def _annotations(of_view: Detections, every: int) -> Iterator[Annotations]:
    """Yield what is drawn on each image; the number is that of the image."""
    edges = of_view.skeleton.edge_indices
    for part in of_view.chunks(CHUNK_FRAMES):
        for f in np.flatnonzero(part.recorded[:, 0]).tolist():
            rows = range(int(part.offsets[f]), int(part.offsets[f + 1]))
            people = tuple(_person(part, row) for row in rows)
            yield Annotations(int(part.frame_numbers[f]) * every, float(part.time_s[f, 0]), people, None, edges)


def _person(part: Detections, row: int) -> ProjectedPerson:
    track = int(part.track_ids[row])
    faint = np.asarray(part.confidence[row]) < _FAINT_CONFIDENCE
    return ProjectedPerson(max(track, 0), str(track) if track >= 0 else "?", np.asarray(part.keypoints_px[row]), faint)
