"""Several triangulation methods on one recording, side by side."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from time import process_time

from posefuse.errors import DetectionsError
from posefuse.evaluation.accuracy import Truth
from posefuse.evaluation.comparison import Comparison, MethodNumbers, method_numbers
from posefuse.evaluation.paired_results import PeoplePoints
from posefuse.model.cameras import CameraRig
from posefuse.model.concatenate import gathered
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.measured_layer import Plan, measure_layer, reconstruct_chunks
from posefuse.pipeline.reconstruct import examine, settle
from posefuse.progress import Progress, Silent

_FEWEST_TURNS, _MOST_TURNS, _ENOUGH_S = 3, 20, 0.2
"""How often a method is timed: until this much CPU time went by."""


def compare_methods(
    rig: CameraRig,
    detections: Detections,
    methods: Sequence[str],
    options: Options | None = None,
    *,
    truth_of: Callable[[Reconstruction], Truth | PeoplePoints] | None = None,
    timed: bool = True,
    progress: Progress | None = None,
) -> Comparison:
    """Measure a recording by several methods, all else alike, and put what came out side by side.

    The recording is examined once: all methods get the same views, frames and noise. One method's result is in memory
    at a time.

    Args:
        rig: calibrated cameras, as :func:`reconstruct` takes them.
        detections: 2D keypoints.
        methods: which, each one of :data:`posefuse.model.options.triangulation.METHODS`.
        options: of every method; the method they name is not looked at. Labels of left and right are believed unless
            they say otherwise.
        truth_of: known positions of the frames of a result, where they are known; of many, a result's people beside
            them.
        timed: whether to take the time; it is the only number that differs from run to run.
        progress: told how far the work is.

    Raises:
        MatchError: if views and cameras do not belong together.
        DetectionsError: if the detections do not allow what the options ask for, or are of one camera.
        OptionsError: if there is no such method.
        ResultError: if a result cannot be compared with the truth.
    """
    progress = progress or Silent()
    options = options or Options()
    options = replace(options, layer="measured", pairs=options.pairs or "labels")
    examined = examine(rig, detections, options, progress)
    if len(examined.rig) == 1:
        raise DetectionsError("There is one camera, so no method triangulates; a comparison needs two or more.")
    plans = [settle(examined, method) for method in methods]
    notes = [note for plan in plans for note in plan.provenance.notes]
    if options.pairs == "labels":
        notes.append("Labels of left and right are believed by all methods; --pairs enumerate puts them right first.")
    return Comparison(
        methods=tuple(_numbers(plan, truth_of, timed, progress) for plan in plans),
        n_frames=examined.detections.n_frames,
        n_views=len(examined.rig),
        n_keypoints=len(examined.detections.skeleton),
        rate_hz=examined.detections.rate_hz,
        noise=examined.noise,
        notes=tuple(dict.fromkeys(notes)),
    )


def _numbers(
    plan: Plan, truth_of: Callable[[Reconstruction], Truth | PeoplePoints] | None, timed: bool, progress: Progress
) -> MethodNumbers:
    result = gathered(reconstruct_chunks(plan, progress), plan.detections.n_frames)
    truth = None if truth_of is None else truth_of(result)
    return method_numbers(result, truth, triangulation_cpu_s(plan) if timed else None)


def triangulation_cpu_s(plan: Plan) -> float:
    """CPU time a frame of triangulation alone, in s: everything read, compiled and settled.

    The fastest of several turns over the first frames, after one that is not counted: what else the machine does
    makes a turn slower, never faster.
    """
    chunk = next(plan.detections.chunks())
    tracks = plan.subjects.tracks(0, chunk.n_frames)
    turns: list[float] = []
    for _ in range(1 + _MOST_TURNS):
        start_s = process_time()
        measure_layer(plan, chunk, tracks)
        turns.append(process_time() - start_s)
        if len(turns) > _FEWEST_TURNS and sum(turns[1:]) > _ENOUGH_S:
            break
    return min(turns[1:]) / chunk.n_frames
