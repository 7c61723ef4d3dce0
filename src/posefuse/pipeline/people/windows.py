"""Many people followed through one window of a long recording, by whoever has time, knowing nothing of the others.

Each goes on from the tracker that went through all that comes before: what it found in somebody's first seconds (the
lengths of the body, which way it faces, how far it leans) shows for as long as it is followed. A window is followed
from some seconds before its first frame to so long after its last that whoever a tracker still remembers there was seen
within: who lives there is known to both neighbours, which :mod:`posefuse.pipeline.people.stitching` makes one. What all
windows have to agree on besides, the noise and how bodies move, is found before.
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
from posefuse.noise.survey import known_noise
from posefuse.pipeline.people.initial_noise import rough_noise
from posefuse.pipeline.people.track_recording import track_people
from posefuse.pipeline.people.trackers import with_tree
from posefuse.progress import Silent
from posefuse.skeleton.skeletons import Skeleton
from posefuse.tracking.tracker import ArticulatedTracker

_BEFORE_S = 30.0
"""What lies farther before moves smoothed bodies by less than 0.1 mm; ten seconds before, by up to 0.5 mm."""
_AFTER_S = 10.0
"""Until people are believed and their bodies known."""


@dataclass(frozen=True)
class Window:
    """A range of frames of a recording, counted from 0, and the wider one that it is followed with.

    Attributes:
        first: of the wider one.
        start: of the window itself.
        stop: the frame after its last.
        last: the frame after the last of the wider one.
    """

    first: int
    start: int
    stop: int
    last: int


@dataclass(frozen=True, eq=False)
class Seen:
    """Who was followed in a window.

    Attributes:
        window: which.
        tracks: of the wider range, by names that mean nothing in other windows.
        events: of the wider range.
        skeleton: with the tree that bodies were fitted to.
        shape_m: shape (person, shape).
        shape_sd_m: shape (person, shape).
    """

    window: Window
    tracks: Tracks
    events: tuple[Event, ...]
    skeleton: Skeleton
    shape_m: np.ndarray
    shape_sd_m: np.ndarray


Bodies = tuple[Layer, Poses]
"""The model layer of a window itself, without what lies around it, and how bodies stood."""


def windows_of(n_frames: int, rate_hz: float, window_s: float, remembered_s: float) -> list[Window]:
    """A recording in windows of nearly the same length.

    Args:
        n_frames: of the recording.
        rate_hz: of the frames.
        window_s: about how long.
        remembered_s: for how long somebody who is lost is looked for.
    """
    number = max(round(n_frames / (window_s * rate_hz)), 1)
    before, after = (math.ceil(time_s * rate_hz) for time_s in (_BEFORE_S, remembered_s + _AFTER_S))
    bounds = np.linspace(0, n_frames, number + 1).round().astype(int).tolist()
    return [
        Window(max(start - before, 0), start, stop, min(stop + after, n_frames))
        for start, stop in itertools.pairwise(bounds)
    ]


def agreed(rig: CameraRig, detections: Detections, options: Options) -> tuple[Skeleton, Options]:
    """What the windows of a recording are followed with, as :func:`track_people` finds it for the whole.

    Returns:
        The skeleton, with a tree, and the options, which fix the noise.

    Raises:
        SkeletonError: if the skeleton has no tree, and none can be measured.
    """
    noise = rough_noise(rig, detections, options)
    skeleton = with_tree(rig, detections, noise, options)
    if known_noise(rig, options) is None:
        fixed = NoiseOptions(rig.names, tuple(noise.scale_px.tolist()))
        triangulation = replace(options.triangulation, confidence_exponent=noise.exponent)
        options = replace(options, noise=fixed, triangulation=triangulation)
    return skeleton, options


def follow_window(
    rig: CameraRig, detections: Detections, options: Options, window: Window, tracker: ArticulatedTracker
) -> tuple[Seen, Bodies]:
    """Follow everybody through a window.

    Args:
        rig: the cameras.
        detections: of the wider range of the window.
        options: from :func:`agreed`.
        window: which.
        tracker: that has followed everybody up to the wider range.

    Raises:
        DetectionsError: if frames have no times.
    """
    found = track_people(rig, detections, options, Silent(), tracker=tracker)
    seen = Seen(window, found.recording_tracks, found.events, found.skeleton, found.shape_m, found.shape_sd_m)
    start, stop = window.start - window.first, window.stop - window.first
    smoother = found.smoother()
    if start:
        smoother.take(start)
    return seen, found.bodies(rig, detections.frames(start, stop), start, smoother.take(stop))
