"""People in unrelated still frames: each frame is associated on its own, without tracking."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posefuse.errors import OptionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.model.subjects import FixedSubjects
from posefuse.model.tracks import Tracks, TrackState
from posefuse.pipeline.people.initial_noise import initial_noise, propose_from_all, sample_frames
from posefuse.progress import Progress

STILLS = "stills"
_CHOSEN = (
    "Frames are {} s apart, too far for tracking: each frame is associated on its own (`people='stills'`). Numbers of "
    "people are not identities. `people='many'` tracks them nevertheless."
)
_REQUESTED = "Each frame is associated on its own (`people='stills'`): numbers of people are not identities."


def stills_note(requested: Options, interval_s: float) -> str:
    """Return a note on unrelated frames.

    Args:
        requested: options as the user gave them.
        interval_s: median time between frames, NaN if unknown.
    """
    return _REQUESTED if requested.people == STILLS else _CHOSEN.format(f"{interval_s:.3g}")


def resolve_still_options(options: Options, n_cameras: int) -> Options:
    """Return the options of unrelated frames: nothing is fitted, solved or assigned over time.

    Raises:
        OptionsError: if the options ask for what needs consecutive frames, or there is one camera.
    """
    align = options.align
    over_time = {
        "`bodies='fit'`": options.bodies == "fit",
        "`solve='trajectory'`": options.solve == "trajectory",
        "`postprocess`": options.postprocess != PostprocessOptions(),
        "`sync`": not options.sync.does_nothing,
        "`person`": bool(options.person),
        "`pick`": options.pick is not None,
        "`align.floor='feet'`": align.floor == "feet",
        "`align.forward='walk'`": align.forward == "walk",
        "`align.origin='subject'`": align.origin == "subject",
    }
    unusable = [name for name, is_set in over_time.items() if is_set]
    if unusable:
        raise OptionsError(
            f"{' and '.join(unusable)} {'needs' if len(unusable) == 1 else 'need'} consecutive frames, but the frames "
            "are unrelated (`people='stills'`). Leave this out, or track people with `people='many'`."
        )
    if n_cameras == 1:
        raise OptionsError("`people='stills'` needs two cameras or more; this rig has one.")
    pairs = options.pairs or "labels"
    over_time_sides = pairs != "labels" and options.sides == "chains"
    sides = "votes" if over_time_sides else options.sides
    return replace(options, bodies="none", solve="frame", pairs=pairs, sides=sides)


def associate_stills(rig: CameraRig, detections: Detections, options: Options, progress: Progress) -> FixedSubjects:
    """Assign the detections of each frame to people, the most likely person first.

    Args:
        rig: calibrated cameras.
        detections: detections of all frames.
        options: options of the association and the noise.
        progress: receives the progress.

    Returns:
        The assignment. The n-th people of two frames are unrelated.
    """
    skeleton = detections.skeleton
    noise = initial_noise(rig, sample_frames(detections), skeleton, options)
    progress.start("associating people", detections.n_frames)
    found: list[np.ndarray] = []
    for i in range(detections.n_frames):
        frame = Frame.of(detections, i)
        rows = propose_from_all(rig, frame, noise, skeleton, options).rows
        first = np.concatenate([[0], np.cumsum(frame.shown)[:-1]])
        found.append(np.where(rows >= 0, rows - first, -1).astype(np.int32))
        progress.advance(1)
    progress.finish()
    return FixedSubjects(_tracks_of(found, detections.n_views))


def _tracks_of(found: Sequence[np.ndarray], n_views: int) -> Tracks:
    """Return the people of all frames; ``found``: by frame, shape (person, view)."""
    most = max((len(each) for each in found), default=0)
    detection = np.full((len(found), most, n_views), -1, dtype=np.int32)
    state = np.full((len(found), most), TrackState.ABSENT, dtype=np.int8)
    for f, each in enumerate(found):
        detection[f, : len(each)] = each
        state[f, : len(each)] = TrackState.ACTIVE
    return Tracks(tuple(f"person_{p + 1}" for p in range(most)), detection, state)
