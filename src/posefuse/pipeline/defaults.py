"""Options settled from what a recording is: its length, its cameras, its people."""

import warnings
from dataclasses import replace

import numpy as np

from posefuse.arrays import ranges
from posefuse.errors import DetectionsError, OptionsError, PosefuseWarning
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import CHUNK_FRAMES, Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.subjects import Subjects
from posefuse.skeleton.skeletons import Skeleton
from posefuse.triangulation.registry import find_method

_TELLING_S = 10.0
_CHUNK_BYTES, _DETECTED_BYTES, _LEAST_FRAMES = 600_000_000, 130, 256
"""Of a chunk, about; of a detected keypoint in it, measured on eight cameras; and frames below which what is looked at
around a chunk is most of the work."""


def cut_time(detections: Detections, options: Options) -> Detections:
    """The frames between ``start_s`` and ``end_s`` (exclusive); what is in a file stays there.

    Raises:
        DetectionsError: if the times are unknown or nothing is left.
    """
    if options.start_s is None and options.end_s is None:
        return detections
    known = detections.recorded & np.isfinite(detections.time_s)
    times = np.where(known, detections.time_s, np.inf).min(axis=1)
    if not np.isfinite(times).all():
        raise DetectionsError("start_s and end_s need times, and the files give no frame rate. Add --rate-hz.")
    start = 0 if options.start_s is None else int(np.searchsorted(times, options.start_s - 1e-9))
    stop = len(times) if options.end_s is None else int(np.searchsorted(times, options.end_s - 1e-9))
    if start >= stop:
        raise DetectionsError(
            f"No frame lies between start_s = {options.start_s} and end_s = {options.end_s}; the recording runs from "
            f"{times[0]:.3f} s to {times[-1]:.3f} s."
        )
    return detections.between(start, stop)


def settle_chunks(options: Options, detections: Detections) -> Options:
    """Lower ``chunk_frames`` where so many people have so many keypoints that a chunk would fill the memory."""
    rows_of_frame = int(detections.offsets[-1]) / max(detections.n_frames, 1)
    frame_bytes = max(rows_of_frame, 1.0) * len(detections.skeleton) * _DETECTED_BYTES
    most = max(int(_CHUNK_BYTES / frame_bytes), _LEAST_FRAMES)
    return replace(options, chunk_frames=min(options.chunk_frames, most))


def settle_min_views(options: Options, n_cameras: int) -> tuple[Options, tuple[str, ...]]:
    """Fill in the method's own ``min_views``, and lower it to the cameras there are, saying so once."""
    triangulation = options.triangulation
    method = find_method(triangulation.method)
    wanted = triangulation.min_views or method.default_min_views
    settled = max(2, min(wanted, n_cameras))
    notes: tuple[str, ...] = ()
    if settled < wanted and n_cameras > 1:
        notes = (f"min_views lowered from {wanted} to {settled}: the rig has {n_cameras} cameras.",)
        warnings.warn(notes[0], PosefuseWarning, stacklevel=5)
    return replace(options, triangulation=replace(triangulation, min_views=settled)), notes


def settle_people(options: Options, detections: Detections, n_cameras: int) -> Options:
    """Decide how many people there are, where that is left open: many, if a view ever shows several.

    One camera cannot tell where people are, and a skeleton without a tree not how they move.
    """
    if options.people != "auto":
        return options
    several = bool((detections.people_counts > 1).any())
    can = n_cameras > 1 and detections.skeleton.tree is not None
    return replace(options, people="many" if several and can and options.pick is None else "one")


def settle_pairs(options: Options, n_cameras: int, skeleton: Skeleton) -> Options:
    """Fill in how keypoints that come in pairs are solved.

    Other methods than the default are asked for by name for what they do with the labels as they are. And who asks for
    people as they are followed, without a smoother, asks for what a stream gives: sides are decided over time, by later
    frames too, which a stream has not seen.
    """
    causal = options.people == "many" and options.tracker.smoother == "none"
    believed = causal or not find_method(options.triangulation.method).supports_left_right
    pairs = options.pairs or ("labels" if believed else "enumerate")
    return replace(options, pairs=pairs if n_cameras > 1 and skeleton.pairs else "labels")


def settle_solve(options: Options, detections: Detections, n_cameras: int) -> Options:
    """Decide whether frames are solved each by itself or all together, where that is left open.

    Together for one subject, whose motion and bones ten seconds or more tell well enough; of many people bodies are
    fitted, which are smooth already. Other methods than the default are asked for by name for what they make of each
    frame.

    Raises:
        DetectionsError: if all frames are to be solved together and have no times.
        OptionsError: if they are and there is one camera.
    """
    timed = detections.rate_hz is not None or bool(np.isfinite(np.asarray(detections.time_s)).any())
    if options.solve == "trajectory" and n_cameras == 1:
        raise OptionsError("solve = 'trajectory' needs two cameras or more; this rig has one. Leave it out.")
    if options.solve == "trajectory" and not timed:
        raise DetectionsError(
            "solve = 'trajectory' needs times, and the files give no frame rate. Add --rate-hz, or in Python: "
            "detections.with_rate(60)."
        )
    if options.solve != "auto":
        return options
    usual = find_method(options.triangulation.method).supports_trajectory
    together = options.people == "one" and n_cameras > 1 and usual and _duration_s(detections) >= _TELLING_S
    return replace(options, solve="trajectory" if together else "frame")


def _duration_s(detections: Detections) -> float:
    """How long a recording is; 0 where it has no times."""
    if detections.rate_hz is not None:
        return detections.n_frames / detections.rate_hz
    times = np.asarray(detections.time_s)
    return float(np.nanmax(times) - np.nanmin(times)) if np.isfinite(times).any() else 0.0


def settle_method(
    rig: CameraRig, detections: Detections, options: Options, subjects: Subjects, noise: NoiseModel
) -> tuple[Options, tuple[str, ...]]:
    """Let a method that has to see the whole recording first do so."""
    method = find_method(options.triangulation.method)
    if method.prepare is None or len(rig) == 1:
        return options, ()
    spans = ranges(detections.n_frames, CHUNK_FRAMES)
    pieces = ((detections.frames(*span), subjects.tracks(*span)) for span in spans)
    settled, notes = method.prepare(rig, pieces, noise, options.triangulation)
    return replace(options, triangulation=settled), notes
