"""Track people in one window of a long recording, independently of the other windows.

Tracking starts from the tracker that has processed all earlier frames: what it estimated in a person's first seconds
(the lengths of the body, its heading, its lean) persists as long as the track. A window is tracked from some seconds
before its first frame until some seconds after its last, long enough that every track remembered there had a detection
within the window. Neighboring windows therefore share these people, and :mod:`posefuse.pipeline.people.stitching`
matches them. The noise and the kinematic tree, which all windows must share, are determined beforehand.
"""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.noise import NoiseOptions
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Layer
from posefuse.model.track_events import Event, Poses
from posefuse.model.tracks import Tracks
from posefuse.noise.fixed import fixed_noise
from posefuse.pipeline.people.initial_noise import initial_noise, sample_frames
from posefuse.pipeline.people.track_recording import track_people
from posefuse.pipeline.people.trackers import with_tree
from posefuse.progress import Silent
from posefuse.skeleton.skeletons import Skeleton
from posefuse.tracking.tracker import ArticulatedTracker

_BEFORE_S = 30.0
"""Earlier frames change smoothed bodies by less than 0.1 mm; with ten seconds the change is up to 0.5 mm."""
_AFTER_S = 10.0
"""Time until tracks are confirmed and their bodies estimated."""


@dataclass(frozen=True)
class TrackingWindow:
    """A range of frames of a recording, and the wider range that is tracked.

    Attributes:
        first: index of the first frame of the wider range.
        start: index of the first frame of the window itself.
        stop: index after its last frame.
        last: index after the last frame of the wider range.
    """

    first: int
    start: int
    stop: int
    last: int


@dataclass(frozen=True, eq=False)
class TrackedWindow:
    """People tracked in a window.

    Attributes:
        window: the window.
        tracks: tracks in the wider range; their names are valid in this window only.
        events: track events in the wider range.
        skeleton: skeleton with the kinematic tree that bodies were fitted to.
        shape_m: shape (person, shape): lengths of the bodies.
        shape_sd_m: shape (person, shape): their standard deviations.
    """

    window: TrackingWindow
    tracks: Tracks
    events: tuple[Event, ...]
    skeleton: Skeleton
    shape_m: np.ndarray
    shape_sd_m: np.ndarray


WindowBodies = tuple[Layer, Poses]
"""The model layer and the poses of a window, without the frames around it."""


def tracking_windows(n_frames: int, rate_hz: float, window_s: float, terminate_after_s: float) -> list[TrackingWindow]:
    """Divide a recording into windows of nearly equal length.

    Args:
        n_frames: number of frames of the recording.
        rate_hz: frame rate.
        window_s: approximate length of a window.
        terminate_after_s: time after which a lost track is terminated.
    """
    number = max(round(n_frames / (window_s * rate_hz)), 1)
    before, after = (math.ceil(time_s * rate_hz) for time_s in (_BEFORE_S, terminate_after_s + _AFTER_S))
    bounds = np.linspace(0, n_frames, number + 1).round().astype(int).tolist()
    return [
        TrackingWindow(max(start - before, 0), start, stop, min(stop + after, n_frames))
        for start, stop in itertools.pairwise(bounds)
    ]


def shared_settings(rig: CameraRig, detections: Detections, options: Options) -> tuple[Skeleton, Options]:
    """Return the settings that all windows share, as :func:`track_people` determines them for a whole recording.

    Returns:
        The skeleton, with a kinematic tree, and the options, which fix the noise.

    Raises:
        SkeletonError: if the skeleton has no kinematic tree, and none can be measured.
    """
    frames, skeleton = sample_frames(detections), detections.skeleton
    noise = initial_noise(rig, frames, skeleton, options)
    skeleton = with_tree(rig, frames, skeleton, noise, options)
    if fixed_noise(rig, options) is None:
        fixed = NoiseOptions(rig.names, tuple(noise.scale_px.tolist()))
        triangulation = replace(options.triangulation, confidence_exponent=noise.exponent)
        options = replace(options, noise=fixed, triangulation=triangulation)
    return skeleton, options


def track_window(
    rig: CameraRig, detections: Detections, options: Options, window: TrackingWindow, tracker: ArticulatedTracker
) -> tuple[TrackedWindow, WindowBodies]:
    """Track people through a window and smooth their bodies.

    Args:
        rig: calibrated cameras.
        detections: detections of the wider range.
        options: options from :func:`shared_settings`.
        window: the window.
        tracker: tracker that has processed all frames before the wider range.

    Raises:
        DetectionsError: if frames have no times.
    """
    people = track_people(rig, detections, options, Silent(), tracker=tracker)
    tracked = TrackedWindow(
        window, people.recording_tracks, people.events, people.skeleton, people.shape_m, people.shape_sd_m
    )
    start, stop = window.start - window.first, window.stop - window.first
    smoother = people.smoother()
    if start:
        smoother.take(start)
    return tracked, people.bodies(rig, detections.frames(start, stop), start, smoother.take(stop))
