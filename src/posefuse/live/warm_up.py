"""Compile and load everything before the first frame, which takes seconds."""

import time
from dataclasses import replace

from posefuse.errors import PosefuseError
from posefuse.io.stream import lines_of
from posefuse.live.session import Session
from posefuse.model.options.options import Options
from posefuse.model.options.stream import StreamOptions
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd

_SCENE = CrowdOptions("crowd", people=2, cameras=4, duration_s=1.0, seed=0)


def warm_up(session: Session, options: Options) -> None:
    """Track two simulated people for a second with the kernels that the session will use.

    Args:
        session: the session to prepare; it is not changed.
        options: options of the session.
    """
    try:
        scene = simulate_crowd(replace(_SCENE, skeleton=options.skeleton or _SCENE.skeleton))
    except PosefuseError:
        # The skeleton is not human; the kernels are the same.
        scene = simulate_crowd(_SCENE)
    # Keep only the options that select kernels, so that no warning is repeated.
    tracker = replace(options.tracker, known_m=(), stature_m=None)
    options = Options(triangulation=options.triangulation, association=options.association, tracker=tracker)
    trial = Session(scene.rig, scene.detections.skeleton, options, StreamOptions(clock="messages"))
    for _, line in lines_of(scene.detections):
        trial.take(line, 0.0)
        while trial.waiting:
            trial.process_frame(time.monotonic)
