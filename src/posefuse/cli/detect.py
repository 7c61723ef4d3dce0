"""``posefuse detect``."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from posefuse.cli.console import Bars, count, note, say, table, warn
from posefuse.cli.types import Overwrite
from posefuse.errors import OptionsError
from posefuse.model.options.detection import Device

if TYPE_CHECKING:
    from posefuse.model.options.detection import DetectOptions
    from posefuse.pipeline.detect import DetectionOutcome


@dataclass(frozen=True)
class DetectFlags:
    """Flags of the detector and of what it examines."""

    detector: Annotated[
        str | None, Parameter(help="Detector (posefuse detector list) or worker file; by default the best one.")
    ] = None
    detector_python: Annotated[Path | None, Parameter(help="Python interpreter that has the detector's packages.")] = (
        None
    )
    weights: Annotated[tuple[Path, ...], Parameter(help="Files of the detector's weights.")] = ()
    device: Annotated[Device, Parameter(help="Where the detector computes.")] = "auto"
    every: Annotated[int, Parameter(help="Examine every n-th image.")] = 1
    start_s: Annotated[float, Parameter(help="Start time in each video.")] = 0.0
    end_s: Annotated[float | None, Parameter(help="End time in each video, exclusive.")] = None
    crop: Annotated[
        tuple[str, ...],
        Parameter(help="Examine a part of the images: LEFT,TOP,WIDTH,HEIGHT in px, or CAMERA=... for one camera."),
    ] = ()
    max_people: Annotated[int | None, Parameter(help="Most people per image, the most confident ones.")] = None
    jobs: Annotated[
        int | Literal["auto"], Parameter(help="Detectors that run side by side; auto starts one per core.")
    ] = "auto"
    overlay: Annotated[bool, Parameter(help="Also write videos with the detections drawn on them.", negative="")] = (
        False
    )

    def options(self) -> "DetectOptions":
        """Return the options."""
        from posefuse.model.options.detection import DetectOptions

        python = None if self.detector_python is None else str(self.detector_python)
        weights = tuple(str(file) for file in self.weights)
        jobs = None if self.jobs == "auto" else self.jobs
        return DetectOptions(**{**vars(self), "detector_python": python, "weights": weights, "jobs": jobs})


def detect(
    videos: Annotated[
        tuple[str, ...], Parameter(help="Folder of videos, one per camera, or the videos; CAMERA=FILE names a camera.")
    ],
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for the keypoints.")],
    flags: Annotated[DetectFlags, Parameter(name="*")] = DetectFlags(),
    overwrite: Overwrite = False,
) -> None:
    """Detect people in videos and write their 2D keypoints with the true times of the images.

    Writes keypoints.parquet, which all commands read, and detection.json, which states how it was made. The same
    command resumes an interrupted run.
    """
    from posefuse.pipeline.detect import detect_videos

    outcome = detect_videos(videos_given(videos), output, flags.options(), overwrite=overwrite, progress=Bars("images"))
    describe(outcome)


def videos_given(given: tuple[str, ...]) -> list[str | Path] | dict[str, str | Path]:
    """Return the videos, by camera if their cameras are named.

    Raises:
        OptionsError: if some videos have a name of a camera and others have none, or a camera has two.
    """
    if not given:
        raise OptionsError("No videos were given. Give a folder of videos, or the videos, one per camera.")
    named = {text: text.partition("=")[::2] for text in given if "=" in text and not Path(text).exists()}
    if not named:
        return [Path(text) for text in given]
    if len(named) < len(given):
        other = next(text for text in given if text not in named)
        raise OptionsError(f"{other}: expected CAMERA=FILE, because other videos are given so.")
    by_camera = {camera: Path(file) for camera, file in named.values()}
    if len(by_camera) < len(named):
        cameras = [camera for camera, _ in named.values()]
        repeated = next(camera for camera in cameras if cameras.count(camera) > 1)
        raise OptionsError(f"Two videos are given for camera {repeated!r}.")
    return dict(by_camera)


def describe(outcome: "DetectionOutcome") -> None:
    """Print what was found in each view, and where it was written."""
    columns = ["view", "images", "with people", "most people", "tracks", "video Hz"]
    rows = [
        [
            view.name,
            str(view.n_images),
            str(view.n_with_people),
            str(view.most_people),
            str(view.n_tracks),
            "-" if view.rate_hz is None else f"{view.rate_hz:.4g}",
        ]
        for view in outcome.views
    ]
    table(None, columns, rows)
    for text in outcome.notes:
        warn(text)
    for view in outcome.views:
        if view.n_images and not view.n_with_people:
            warn(f"No person was found in view {view.name!r}. Look at its images, or try another detector.")
    written = list(outcome.overlays)
    if outcome.n_images:
        written.insert(0, outcome.keypoints)
        speed = f" ({outcome.n_images / outcome.seconds:.1f} images/s)" if outcome.seconds > 0 else ""
        say(f"{count(outcome.n_images, 'image')} by {outcome.detector} in {outcome.seconds:.1f} s{speed}")
    else:
        note(f"Nothing to detect: {outcome.keypoints} is complete.")
    for path in written:
        say(f"Wrote {path}")
