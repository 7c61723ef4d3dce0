"""Detect people in the videos of a recording: decode, examine chunks side by side, link, and write keypoints."""

import contextlib
import hashlib
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import CodeType
from typing import Any

from posefuse.arguments import checked
from posefuse.checkpoint import Checkpoint
from posefuse.detection.detector import Detector
from posefuse.detection.open import AnyDetector, default_detector, open_detector, opens_several
from posefuse.io.checkpoints import CheckpointFolder, digest_of
from posefuse.io.files import replacing, writable
from posefuse.io.folder_locks import exclusive_folder
from posefuse.io.keypoints.read import read_detections
from posefuse.io.keypoints.request import Request
from posefuse.io.keypoints.tidy_parquet import read as read_parquet
from posefuse.io.keypoints.tidy_parquet import write_parts
from posefuse.io.view_images import find_views, open_source
from posefuse.model.detections import Detections
from posefuse.model.options.detection import DetectOptions
from posefuse.pipeline.detection.assemble import Assembly, ViewRecord, record_of_view
from posefuse.pipeline.detection.chunks import Chunk, ChunkQueue, plan_chunks
from posefuse.pipeline.detection.output import (
    OVERLAY_FOLDER,
    DetectedView,
    OutputFolder,
    describe_inputs,
    describe_videos,
)
from posefuse.pipeline.detection.workers import Task, check_rectangles, detect_chunks
from posefuse.progress import Progress, Silent
from posefuse.skeleton.skeletons import Skeleton
from posefuse.visualize.overlay.detected_people import draw_detections

Videos = str | Path | Iterable[str | Path] | Mapping[str, str | Path]


@dataclass(frozen=True)
class DetectionOutcome:
    """What a detection wrote.

    Attributes:
        keypoints: the file of keypoints.
        detector: name of the detector.
        views: what was found in each view.
        n_images: number of images that this run examined; 0 if an earlier one had finished.
        seconds: time that it took.
        notes: sentences on images that are missing.
        overlays: videos with the detections drawn on them.
    """

    keypoints: Path
    detector: str
    views: tuple[DetectedView, ...]
    n_images: int = 0
    seconds: float = 0.0
    notes: tuple[str, ...] = ()
    overlays: tuple[Path, ...] = ()


@checked
def detect(
    videos: Videos,
    detector: Any = None,
    options: DetectOptions | None = None,
    *,
    skeleton: str | Path | Skeleton | None = None,
    output: str | Path | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Detections:
    """Detect people in the videos of a recording.

    Args:
        videos: a folder of videos or of folders of pictures, one per view; several of them; or these by view name.
        detector: a function of one image, shape (height, width, 3), uint8, RGB, that returns x, y and confidence,
            shape (person, keypoint, 3); or an object with the methods of ``Detector``. By default that of the options.
        options: options of the detection.
        skeleton: skeleton of the keypoints that a function returns.
        output: folder for the keypoints; an interrupted call resumes there. None to return them only.
        overwrite: whether to replace the keypoints of another detection in that folder.
        progress: receives the progress in images.

    Returns:
        The detections, in px of the upright images, with the times of the images since the first one of each video.
        Track IDs are identities within a view; a track ends where the identity is ambiguous.

    Raises:
        FileError: if a video cannot be read, or the output cannot be written.
        RecordingError: if there are no videos, or two views are the same.
        DetectorError: if the detector is not installed, or fails.
        DetectionsError: if no image lies in the selected time.
        OptionsError: if the options do not fit the views.
        OutputExistsError: if the folder has keypoints of another detection, and ``overwrite`` is False.
    """
    given = Given(detector, skeleton)
    if output is not None:
        outcome = detect_videos(videos, Path(output), options, given, overwrite=overwrite, progress=progress)
        return read_detections(outcome.keypoints)
    with tempfile.TemporaryDirectory() as folder:
        outcome = detect_videos(videos, Path(folder), options, given, progress=progress)
        stored = read_detections(outcome.keypoints)
        return stored.frames(0, stored.n_frames)


@dataclass(frozen=True)
class Given:
    """A detector given in Python.

    Attributes:
        detector: as in :func:`detect`.
        skeleton: as in :func:`detect`.
    """

    detector: Any = None
    skeleton: str | Path | Skeleton | None = None

    def opener(self, options: DetectOptions, progress: Progress) -> tuple[AnyDetector, Callable[[], Detector]]:
        """Return what is opened, and a function that opens it; the default detector is noted."""
        python = None if options.detector_python is None else Path(options.detector_python)
        chosen = self.detector if self.detector is not None else options.detector
        if chosen is None:
            best = default_detector(weights_given=bool(options.weights), python_given=python is not None)
            progress.note(f"Detector: {best.name}, {best.reason}.")
            chosen = best.name
        weights = [Path(file) for file in options.weights]
        return chosen, partial(
            open_detector, chosen, skeleton=self.skeleton, python=python, device=options.device, weights=weights
        )


def detect_videos(
    videos: Videos,
    output: Path,
    options: DetectOptions | None = None,
    given: Given = Given(),
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> DetectionOutcome:
    """Detect people in the videos of a recording and write their keypoints.

    Args and errors are those of :func:`detect`.

    Returns:
        What was written. If an earlier call with the same videos, options and versions finished, nothing is done.
    """
    options, progress = options or DetectOptions(), progress or Silent()
    sources = [open_source(view) for view in find_views(_as_paths(videos))]
    rectangles = options.rectangles([source.name for source in sources])
    check_rectangles(sources, rectangles)
    videos_found = describe_videos(sources)
    chunks = plan_chunks(sources, options)
    chosen, opened = given.opener(options, progress)
    jobs = (options.jobs or os.cpu_count() or 1) if opens_several(chosen) else 1
    with _open_detectors(opened, min(jobs, max(len(chunks), 1)), borrowed=chosen) as detectors:
        first = detectors[0].result()
        inputs = describe_inputs(videos_found, first, _identity(chosen), options)
        folder = OutputFolder(output, digest_of(inputs))
        finished = None if overwrite else folder.finished_views()
        if finished is None:
            folder.check_new(overwrite=overwrite)
        with _new_folder(output), exclusive_folder(output, output):
            task = Task(sources, rectangles, options.max_people)
            work = _Detection(folder, inputs, task, options, progress)
            outcome = DetectionOutcome(folder.keypoints, first.name, finished or ())
            if finished is None:
                outcome = work.run(chunks, [future.result for future in detectors], first)
            return replace(outcome, overlays=work.draw()) if options.overlay else outcome


@contextmanager
def _new_folder(output: Path) -> Iterator[None]:
    """Create a folder, and remove it after an error if nothing is in it."""
    existed = output.exists()
    with writable(output):
        output.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        if not existed:
            with contextlib.suppress(OSError):
                output.rmdir()
        raise


@contextmanager
def _open_detectors(opened: Callable[[], Detector], count: int, *, borrowed: Any) -> Iterator[list[Future[Detector]]]:
    """Open detectors at the same time, and close them at the end, except the one that the caller gave."""
    with ThreadPoolExecutor(count, "open detector") as threads:
        futures = [threads.submit(opened) for _ in range(count)]
        try:
            yield futures
        finally:
            for future in futures:
                if future.exception() is None and future.result() is not borrowed:
                    future.result().close()


def _as_paths(videos: Videos) -> Path | list[Path] | dict[str, Path]:
    if isinstance(videos, str | Path):
        return Path(videos)
    if isinstance(videos, Mapping):
        return {str(name): Path(path) for name, path in videos.items()}
    return [Path(path) for path in videos]


def _identity(detector: AnyDetector) -> str:
    """Return what identifies a function: a digest of its code."""
    code = getattr(detector, "__code__", None)
    return hashlib.sha256(_text_of_code(code).encode()).hexdigest() if isinstance(code, CodeType) else ""


def _text_of_code(code: CodeType) -> str:
    """Return instructions, names and constants, which are the same in every process."""
    constants = [
        _text_of_code(each) if isinstance(each, CodeType) else _text_of_constant(each) for each in code.co_consts
    ]
    return "\n".join([code.co_code.hex(), *code.co_names, *constants])


def _text_of_constant(value: Any) -> str:
    return str(sorted(map(repr, value))) if isinstance(value, frozenset) else repr(value)


@dataclass(frozen=True, eq=False)
class _Detection:
    """A detection of one recording.

    Attributes:
        folder: the output.
        inputs: everything that the detections depend on.
        task: what workers do.
        options: options of the detection.
        progress: receives the progress.
    """

    folder: OutputFolder
    inputs: Mapping[str, Any]
    task: Task
    options: DetectOptions
    progress: Progress

    def run(
        self, chunks: Sequence[Chunk], detectors: Sequence[Callable[[], Detector]], first: Detector
    ) -> DetectionOutcome:
        """Examine what is not stored yet, and write everything."""
        begun_s = time.monotonic()
        stored, removed = CheckpointFolder.opened(self.folder.parts, self.folder.key)
        if removed:
            self.progress.note(f"Removed {removed} parts of other videos, options or versions.")
        done = {chunk.name for chunk in chunks if stored.load(chunk.name) is not None}
        rest = [chunk for chunk in chunks if chunk.name not in done]
        n_images, n_rest = sum(chunk.n_images for chunk in chunks), sum(chunk.n_images for chunk in rest)
        if done:
            self.progress.note(f"Resuming: {n_images - n_rest} of {n_images} images are done.")
        self.progress.start("detecting", n_rest)
        for result in detect_chunks(self.task, ChunkQueue(chunks, done), detectors[: max(len(rest), 1)]):
            if isinstance(result, int):
                self.progress.advance(result)
            else:
                stored.save(result[0].name, result[1].as_arrays())
        self.progress.finish()
        seconds = time.monotonic() - begun_s
        records, views = self._write(chunks, stored, first)
        stored.remove()
        notes = tuple(note for record in records for note in record.notes)
        return DetectionOutcome(self.folder.keypoints, first.name, views, n_rest, seconds, notes)

    def draw(self) -> tuple[Path, ...]:
        """Write videos with the detections drawn on them."""
        return draw_detections(
            self.task.sources,
            read_parquet(self.folder.keypoints, Request()),
            self.options.every,
            self.folder.folder / OVERLAY_FOLDER,
            threads=os.cpu_count() or 1,
            progress=self.progress,
        )

    def _write(
        self, chunks: Sequence[Chunk], stored: Checkpoint, detector: Detector
    ) -> tuple[list[ViewRecord], tuple[DetectedView, ...]]:
        """Link the detections of each view and write all of them."""
        records = [
            record_of_view(source, [chunk for chunk in chunks if chunk.view == v], stored, detector.skeleton)
            for v, source in enumerate(self.task.sources)
        ]
        assembly = Assembly.of(records, stored, detector.skeleton, self.options.every)
        with replacing(self.folder.keypoints) as temporary:
            write_parts(assembly.parts(), temporary)
        views = tuple(_view_of(record) for record in records)
        self.folder.finish(self.inputs, views)
        return records, views


def _view_of(record: ViewRecord) -> DetectedView:
    return DetectedView(
        record.source.name,
        n_images=len(record.numbers),
        n_with_people=int((record.people > 0).sum()),
        most_people=int(record.people.max(initial=0)),
        n_tracks=int(record.track_ids.max(initial=-1)) + 1,
        rate_hz=None if record.source.index is None else record.source.index.rate_hz,
    )
