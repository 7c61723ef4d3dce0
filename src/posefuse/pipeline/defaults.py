"""Resolve the options that depend on the recording: its length, its cameras and its people."""

import math
import warnings
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from posefuse.errors import DetectionsError, OptionsError, PosefuseWarning
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.pipeline.people.stills import STILLS, resolve_still_options
from posefuse.skeleton.skeletons import Skeleton
from posefuse.triangulation.registry import find_method

_MIN_TRAJECTORY_S = 0.5
_MAX_TRACKED_INTERVAL_S = 2.0
"""Longest time between frames that motion models bridge: in 2 s, a person walks 2.5 m and turns around."""

_CHUNK_BYTES, _BYTES_PER_KEYPOINT, _MIN_CHUNK_FRAMES = 300_000_000, 130, 256
"""Approximate memory of a chunk; memory per detected keypoint, measured with eight cameras; and the chunk length below
which most of the work would be the context around a chunk."""
BLOCK_FRAMES = 1024
"""Number of frames that are solved at a time, besides the margin around them."""


@dataclass(frozen=True)
class RecordingFacts:
    """Facts about a recording that decide the defaults of options.

    Attributes:
        n_frames: number of frames.
        n_views: number of views.
        n_detections: number of detections of all frames and views.
        several_people: whether a view ever shows several people.
        timed: whether frame times or a frame rate are known.
        duration_s: length of the recording; 0 where no times are known.
        skeleton: skeleton of the detections.
        interval_s: median time between frames; NaN where no times are known.
    """

    n_frames: int
    n_views: int
    n_detections: int
    several_people: bool
    timed: bool
    duration_s: float
    skeleton: Skeleton
    interval_s: float = math.nan

    @classmethod
    def of(cls, detections: Detections) -> "RecordingFacts":
        """Collect the facts of a recording."""
        return cls(
            n_frames=detections.n_frames,
            n_views=detections.n_views,
            n_detections=int(detections.offsets[-1]),
            several_people=bool((detections.people_counts > 1).any()),
            timed=detections.rate_hz is not None or bool(np.isfinite(np.asarray(detections.time_s)).any()),
            duration_s=_duration_s(detections),
            interval_s=_interval_s(detections),
            skeleton=detections.skeleton,
        )

    @property
    def unrelated(self) -> bool:
        """Whether frames are too far apart for tracking."""
        return self.interval_s > _MAX_TRACKED_INTERVAL_S


def _interval_s(detections: Detections) -> float:
    if detections.rate_hz is not None:
        return 1.0 / detections.rate_hz
    times = np.asarray(detections.time_s)
    known = np.isfinite(times)
    frame_s = np.where(known, times, 0.0).sum(axis=1)[known.any(axis=1)] / known.sum(axis=1)[known.any(axis=1)]
    return float(np.median(np.diff(frame_s))) if len(frame_s) > 1 else math.nan


def _duration_s(detections: Detections) -> float:
    if detections.rate_hz is not None:
        return detections.n_frames / detections.rate_hz
    times = np.asarray(detections.time_s)
    return float(np.nanmax(times) - np.nanmin(times)) if np.isfinite(times).any() else 0.0


def cut_time(detections: Detections, options: Options) -> Detections:
    """Return the frames from ``start_s`` up to, but not including, ``end_s``; arrays in files stay there.

    Raises:
        DetectionsError: if frame times are unknown or no frame is left.
    """
    if options.start_s is None and options.end_s is None:
        return detections
    known = detections.recorded & np.isfinite(detections.time_s)
    times = np.where(known, detections.time_s, np.inf).min(axis=1)
    if not np.isfinite(times).all():
        raise DetectionsError("start_s and end_s need times, but the files contain no frame rate. Add `rate_hz`.")
    start = 0 if options.start_s is None else int(np.searchsorted(times, options.start_s - 1e-9))
    stop = len(times) if options.end_s is None else int(np.searchsorted(times, options.end_s - 1e-9))
    if start >= stop:
        raise DetectionsError(
            f"No frame lies {_span_words(options)}; the recording runs from {times[0]:.3f} s to {times[-1]:.3f} s."
        )
    return detections.between(start, stop)


def _span_words(options: Options) -> str:
    """Return the times between which frames are wanted."""
    if options.end_s is None:
        return f"from `start_s={options.start_s}` on"
    if options.start_s is None:
        return f"before `end_s={options.end_s}`"
    return f"between `start_s={options.start_s}` and `end_s={options.end_s}`"


def resolve_options(options: Options, facts: RecordingFacts, n_cameras: int) -> Options:
    """Resolve the options that do not depend on the triangulation method: people and chunk length.

    Raises:
        OptionsError: if frames are unrelated and the options ask for what needs consecutive frames.
    """
    options = resolve_people(options, facts, n_cameras)
    if options.people == STILLS:
        options = resolve_still_options(options, n_cameras)
    return resolve_chunk_frames(options, facts)


def resolve_chunk_frames(options: Options, facts: RecordingFacts) -> Options:
    """Lower ``chunk_frames`` where a chunk of many people with many keypoints would exhaust the memory."""
    rows_per_frame = facts.n_detections / max(facts.n_frames, 1)
    frame_bytes = max(rows_per_frame, 1.0) * len(facts.skeleton) * _BYTES_PER_KEYPOINT
    most = max(int(_CHUNK_BYTES / frame_bytes), _MIN_CHUNK_FRAMES)
    if most > BLOCK_FRAMES:
        # A chunk that is a block needs no copy.
        most -= most % BLOCK_FRAMES
    return replace(options, chunk_frames=min(options.chunk_frames, most))


def resolve_people(options: Options, facts: RecordingFacts, n_cameras: int) -> Options:
    """Resolve ``people = "auto"``: many, or stills if frames are far apart, if a view ever shows several people.

    One camera cannot locate people.
    """
    if options.people != "auto":
        return options
    several = facts.several_people and n_cameras > 1 and options.pick is None
    return replace(options, people=("stills" if facts.unrelated else "many") if several else "one")


def resolve_method(options: Options, facts: RecordingFacts, n_cameras: int) -> tuple[Options, tuple[str, ...]]:
    """Resolve the options that depend on the triangulation method: pairs, solve and minimum number of views.

    Returns:
        The options, and notes for the result.

    Raises:
        DetectionsError: if a solve over time is requested and frame times are unknown.
        OptionsError: if a solve over time is requested and there is one camera.
    """
    options = resolve_pairs(options, n_cameras, facts.skeleton)
    unused = unused_side_options(options)
    for note in unused:
        warnings.warn(note, PosefuseWarning, stacklevel=5)
    options, notes = resolve_min_views(resolve_solve(options, facts, n_cameras), n_cameras)
    return options, (*unused, *notes)


def resolve_min_views(options: Options, n_cameras: int) -> tuple[Options, tuple[str, ...]]:
    """Fill in the method's own ``min_views``, and lower it, with a warning, to the number of cameras."""
    triangulation = options.triangulation
    requested = triangulation.min_views or find_method(triangulation.method).default_min_views
    resolved = max(2, min(requested, n_cameras))
    notes: tuple[str, ...] = ()
    if resolved < requested and n_cameras > 1:
        notes = (f"min_views lowered from {requested} to {resolved}: the rig has {n_cameras} cameras.",)
        warnings.warn(notes[0], PosefuseWarning, stacklevel=5)
    return replace(options, triangulation=replace(triangulation, min_views=resolved)), notes


def resolve_pairs(options: Options, n_cameras: int, skeleton: Skeleton) -> Options:
    """Fill in how left/right pairs of keypoints are solved; some methods use the labels as they are."""
    supported = find_method(options.triangulation.method).supports_left_right
    pairs = options.pairs or ("enumerate" if supported else "labels")
    return replace(options, pairs=pairs if n_cameras > 1 and skeleton.pairs else "labels")


def unused_side_options(options: Options) -> tuple[str, ...]:
    """Return a note if options of the left/right correction are given and left/right labels are used as they are."""
    if options.pairs != "labels":
        return ()
    default = _default_options()
    names = ("sides", "side_search", "pair_search")
    given = [name for name in names if getattr(options, name) != getattr(default, name)]
    if not given:
        return ()
    return (
        f"{' and '.join(given)} {'has' if len(given) == 1 else 'have'} no effect: the left/right labels are used as "
        "they are (pairs = 'labels'). `pairs='enumerate'` corrects them, with a method that supports it and at least "
        "two cameras.",
    )


@cache
def _default_options() -> Options:
    return Options()


def resolve_solve(options: Options, facts: RecordingFacts, n_cameras: int) -> Options:
    """Resolve ``solve = "auto"``: frame by frame, or all frames together.

    All frames are solved together for one subject or tracked people and at least half a second, if the triangulation
    method supports it.

    Raises:
        DetectionsError: if a solve over time is requested and frame times are unknown.
        OptionsError: if a solve over time is requested and there is one camera.
    """
    if options.solve == "trajectory" and n_cameras == 1:
        raise OptionsError("solve = 'trajectory' needs two cameras or more; this rig has one. Remove this option.")
    if options.solve == "trajectory" and not facts.timed:
        raise DetectionsError("solve = 'trajectory' needs times, but the files contain no frame rate. Add `rate_hz`.")
    if options.solve != "auto":
        return options
    over_time = find_method(options.triangulation.method).supports_trajectory
    long_enough = facts.duration_s >= _MIN_TRAJECTORY_S and not facts.unrelated
    together = options.people in ("one", "many") and n_cameras > 1 and over_time and long_enough
    return replace(options, solve="trajectory" if together else "frame")
