"""Many people followed through one window of a long recording, by whoever has time, knowing nothing of the others.

A window is followed from before its first frame to after its last, so long that whoever a tracker still remembers at
either end was seen within: who lives there is known to both neighbours, which :mod:`posefuse.following.stitching` makes
one. What all windows have to agree on, the noise and how bodies move, is found before. So are the lengths of bodies,
which a tracker finds in the first seconds that show somebody: windows are looked through once before they are followed,
and who comes from an earlier window brings along the body that was found there.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from posefuse.following.followed import Followed
from posefuse.following.noise import rough_noise
from posefuse.following.recording import follow
from posefuse.following.trackers import with_tree
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.life import Event, Poses
from posefuse.model.options import NoiseOptions, Options
from posefuse.model.reconstruction import Layer
from posefuse.model.skeletons import Skeleton
from posefuse.model.tracks import Tracks
from posefuse.progress import Silent
from posefuse.survey import known_noise
from posefuse.tracking.known_bodies import KnownBodies, KnownBody

_SETTLE_S = 10.0
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
        kept: by name, bodies whose lengths were kept.
    """

    window: Window
    tracks: Tracks
    events: tuple[Event, ...]
    skeleton: Skeleton
    shape_m: np.ndarray
    shape_sd_m: np.ndarray
    kept: Mapping[str, KnownBody] = field(default_factory=dict)


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
    around = math.ceil((remembered_s + _SETTLE_S) * rate_hz)
    bounds = np.linspace(0, n_frames, number + 1).round().astype(int).tolist()
    return [
        Window(max(start - around, 0), start, stop, min(stop + around, n_frames))
        for start, stop in itertools.pairwise(bounds)
    ]


def agreed(rig: CameraRig, detections: Detections, options: Options) -> tuple[Skeleton, Options]:
    """What the windows of a recording are followed with, as :func:`follow` finds it for the whole.

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


def look_through(rig: CameraRig, detections: Detections, options: Options, window: Window) -> Seen:
    """Follow everybody through a window, to know who is there and what their bodies are.

    Arguments and errors are those of :func:`follow_window`.
    """
    return _seen(follow(rig, detections, options, Silent()), window)


def follow_window(
    rig: CameraRig, detections: Detections, options: Options, window: Window, known: KnownBodies
) -> tuple[Seen, Bodies]:
    """Follow everybody through a window, with the bodies that people brought along.

    Args:
        rig: the cameras.
        detections: of the wider range of the window.
        options: from :func:`agreed`.
        window: which.
        known: bodies of those who were there before.

    Raises:
        DetectionsError: if frames have no times.
    """
    found = follow(rig, detections, options, Silent(), known=known)
    start, stop = window.start - window.first, window.stop - window.first
    smoother = found.smoother()
    if start:
        smoother.take(start)
    return _seen(found, window), found.bodies(rig, detections.frames(start, stop), start, smoother.take(stop))


def _seen(found: Followed, window: Window) -> Seen:
    return Seen(
        window, found.tracks, found.events, found.skeleton, found.shape_m, found.shape_sd_m, dict(found.kept)
    )  # fmt: skip
