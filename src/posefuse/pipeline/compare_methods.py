"""Compare triangulation methods on one recording."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from time import process_time

from posefuse.arguments import checked
from posefuse.errors import DetectionsError
from posefuse.evaluation.accuracy import Truth
from posefuse.evaluation.comparison import Comparison, MethodNumbers, method_numbers
from posefuse.evaluation.paired_results import PeoplePoints
from posefuse.model.cameras import CameraRig
from posefuse.model.concatenate import concatenate_ranges
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.measured_layer import measure_layer, reconstruct_chunks
from posefuse.pipeline.plan import Plan
from posefuse.pipeline.reconstruct import examine, with_findings, with_method
from posefuse.progress import Progress, Silent

_MIN_REPETITIONS, _MAX_REPETITIONS, _MIN_TIMED_S = 3, 20, 0.2
"""A method is repeated until this much CPU time has passed."""

TruthOf = Callable[[Reconstruction], Truth | PeoplePoints]
"""Returns the known positions of a result's frames, or its people with theirs."""


@checked
def compare_methods(
    rig: CameraRig,
    detections: Detections,
    methods: Sequence[str],
    options: Options | None = None,
    *,
    truth_of: TruthOf | None = None,
    timed: bool = True,
    progress: Progress | None = None,
) -> Comparison:
    """Triangulate a recording by several methods with otherwise equal settings.

    The recording is examined once: all methods use the same views, frames and noise. One method's result is in memory
    at a time.

    Args:
        rig: calibrated cameras, as of :func:`reconstruct`.
        detections: 2D keypoints.
        methods: names from :data:`posefuse.model.options.triangulation.METHODS`.
        options: options of all methods; the method they name is ignored. Left and right labels are used as they are
            unless the options set ``pairs``.
        truth_of: returns the known positions of a result's frames, where they are known.
        timed: whether to measure CPU time, the only number that differs from run to run.
        progress: receives the progress.

    Raises:
        MatchError: if views and cameras do not match.
        DetectionsError: if the detections do not allow what the options ask for, or are of one camera.
        OptionsError: if a method does not exist.
        ResultError: if a result cannot be compared with the truth.
    """
    progress = progress or Silent()
    options = options or Options()
    options = replace(options, layer="measured", pairs=options.pairs or "labels")
    examined = with_findings(examine(rig, detections, options, progress))
    if len(examined.rig) == 1:
        raise DetectionsError("Only one camera is used. A comparison of triangulation methods needs two or more.")
    plans = [with_method(examined, method) for method in methods]
    notes = [note for plan in plans for note in plan.provenance.notes]
    if options.pairs == "labels":
        notes.append(
            "All methods use the left and right labels as they are; `pairs='enumerate'` corrects swapped labels first."
        )
    return Comparison(
        methods=tuple(_measure_method(plan, truth_of, timed, progress) for plan in plans),
        n_frames=examined.detections.n_frames,
        n_views=len(examined.rig),
        n_keypoints=len(examined.detections.skeleton),
        rate_hz=examined.detections.rate_hz,
        noise=examined.noise,
        notes=tuple(dict.fromkeys(notes)),
    )


def _measure_method(plan: Plan, truth_of: TruthOf | None, timed: bool, progress: Progress) -> MethodNumbers:
    result = concatenate_ranges(reconstruct_chunks(plan, progress), plan.detections.n_frames)
    truth = None if truth_of is None else truth_of(result)
    return method_numbers(result, truth, triangulation_cpu_s(plan) if timed else None)


def triangulation_cpu_s(plan: Plan) -> float:
    """Return the CPU time of triangulation per frame in seconds, without reading, compiling and resolving options.

    The fastest of several repetitions over the first frames, after one that is not counted: other load on the machine
    makes a repetition slower, never faster.
    """
    chunk = next(plan.detections.chunks())
    tracks = plan.subjects.tracks(0, chunk.n_frames)
    times: list[float] = []
    for _ in range(1 + _MAX_REPETITIONS):
        start_s = process_time()
        measure_layer(plan, chunk, tracks)
        times.append(process_time() - start_s)
        if len(times) > _MIN_REPETITIONS and sum(times[1:]) > _MIN_TIMED_S:
            break
    return min(times[1:]) / chunk.n_frames
