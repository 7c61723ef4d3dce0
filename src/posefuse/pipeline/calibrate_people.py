"""Calibrate cameras by the people that they film: read, track, match the views, estimate, find the floor."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from posefuse.arguments import checked
from posefuse.calibration.people.estimate import PeopleEstimate, estimate_people
from posefuse.calibration.people.identities import useful_jobs
from posefuse.calibration.people.match import match_views
from posefuse.calibration.people.result import PeopleCalibration
from posefuse.calibration.people.tracks import tracks_in_views
from posefuse.calibration.people.views import MatchedViews
from posefuse.io.calibration.read import read_cameras
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.calibration import PeopleOptions
from posefuse.parallel import Jobs, number_of_jobs
from posefuse.pipeline.people_inputs import cameras_of, read_people
from posefuse.pipeline.people_result import people_result
from posefuse.pipeline.people_world import PeopleWorld, people_world
from posefuse.progress import Progress, Silent


@checked
def calibrate_by_people(
    recording: Detections | str | Path,
    *,
    intrinsics: CameraRig | str | Path | None = None,
    keypoints: str | Path | None = None,
    timestamps: str | Path | None = None,
    image_sizes: Mapping[str, tuple[int, int]] | None = None,
    options: PeopleOptions | None = None,
    progress: Progress | None = None,
) -> PeopleCalibration:
    """Calibrate cameras by the 2D keypoints of people, or of animals with a known skeleton, without a board.

    Views may start up to ``options.max_offset_s`` apart and have different frame rates; people need no common identity
    across views, and left and right sides may be exchanged.

    Args:
        recording: folder of a recording with 2D keypoints, or keypoints in memory.
        intrinsics: cameras with known lenses, or a calibration file, whose poses are not used; focal lengths of cameras
            that it does not name are estimated.
        keypoints: file or folder of keypoints; by default those in the recording.
        timestamps: file or folder of frame times; by default those in the recording.
        image_sizes: width and height of the images of views in px, which cameras without known lenses need; by default
            those of the videos in the recording.
        options: scale and reading options.
        progress: receives the progress.

    Returns:
        The cameras with their uncertainty, in a world whose floor people stand on if they show it.

    Raises:
        CalibrationError: if people do not determine the cameras; the message states what to film.
        FileError: if a file cannot be read.
        RecordingError: if the recording has no keypoints, or several sets of them.
    """
    options = options or PeopleOptions()
    known = intrinsics if isinstance(intrinsics, CameraRig) or intrinsics is None else read_cameras(Path(intrinsics))
    source = PeopleSource(recording, keypoints, timestamps, image_sizes or {})
    matched = match_people(source, known, options, progress or Silent())
    estimate = estimate_people(matched)
    return people_result(matched, estimate, world_of_people(matched, estimate, options))


@dataclass(frozen=True, eq=False)
class PeopleSource:
    """Where 2D keypoints of people are.

    Attributes:
        recording: folder of a recording, or keypoints in memory.
        keypoints: file or folder of keypoints; None for those in the recording.
        timestamps: file or folder of frame times; None for those in the recording.
        image_sizes: width and height of the images of views in px, beside those of the videos in the recording.
    """

    recording: Detections | str | Path
    keypoints: str | Path | None = None
    timestamps: str | Path | None = None
    image_sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)


def match_people(
    source: PeopleSource, known: CameraRig | None, options: PeopleOptions, progress: Progress
) -> MatchedViews:
    """Read the keypoints of people, and relate the views to each other.

    Args:
        source: the keypoints.
        known: cameras with known lenses.
        options: reading options.
        progress: receives the progress.

    Raises:
        PosefuseError: if the keypoints cannot be read, or do not relate the views.
    """
    recording = source.recording
    folder = None if isinstance(recording, Detections) else Path(recording)
    if isinstance(recording, Detections):
        detections = recording
    else:
        paths = [None if path is None else Path(path) for path in (source.keypoints, source.timestamps)]
        detections = read_people(Path(recording), paths[0], paths[1], options, progress)
    for name in options.length_between:
        detections.skeleton.index(name)  # refuses unknown names before the work
    cameras, focal_known = cameras_of(detections.view_names, known, folder, options, source.image_sizes)
    views = replace(tracks_in_views(detections, cameras, focal_known), max_offset_s=options.max_offset_s)
    progress.start("match views", len(cameras))
    with Jobs(number_of_jobs(options.jobs or "auto", useful_jobs(views))) as jobs:
        matched = match_views(views, options.seed, jobs)
    progress.finish()
    return matched


def world_of_people(
    matched: MatchedViews, estimate: PeopleEstimate, options: PeopleOptions, known_scale: str = ""
) -> PeopleWorld:
    """Return the world in which people stand on the floor, and have their size unless the scale is known."""
    rig = CameraRig(estimate.cameras)
    return people_world(estimate.points_m, matched.skeleton, rig, _rate_hz(estimate), options, known_scale)


def _rate_hz(estimate: PeopleEstimate) -> float | None:
    """Return the rate of the sampled points, None for fewer than two."""
    steps = np.diff(estimate.time_s)
    return float(1.0 / np.median(steps)) if len(steps) and np.median(steps) > 0.0 else None
