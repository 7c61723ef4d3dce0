"""The two recipes of a batch: reconstruct from 2D keypoints, or run from videos."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from posefuse.errors import OutputExistsError
from posefuse.io.object_stores import name_of, parents_of
from posefuse.io.open_recording import RecordingInputs, input_digests, open_recording
from posefuse.model.batch import Job, JobResult, JobState, ResultStatistics
from posefuse.model.findings import certain_faults
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.distributed import Workers, is_long
from posefuse.pipeline.fingerprints import find_earlier, is_occupied, read_mark, recording_keys
from posefuse.pipeline.reconstruct_recording import Execution, Outcome, Request, carry_out, kept_outcome
from posefuse.pipeline.run.recipe import Watcher, run_in_batch
from posefuse.progress import Silent
from posefuse.report.summary import summarize


@dataclass(frozen=True)
class Processing:
    """How a job is processed.

    Attributes:
        warned: warnings given so far.
        workers: run the pieces of a long recording, or None.
        leaves_long: whether a recording that is to be divided is left to the caller.
        stage_finished: called when the files of a stage are complete.
    """

    warned: Sequence[str]
    workers: Workers | None = None
    leaves_long: bool = False
    stage_finished: Callable[[], None] = lambda: None


def process(job: Job, how: Processing) -> JobResult | None:
    """Process a recording in a local folder, unless its result is unchanged.

    Returns:
        The result; None for a recording that is to be divided, if the caller divides it.

    Raises:
        PosefuseError: if the recording cannot be read, reconstructed or written.
    """
    if job.run is not None:
        return _run(job, how)
    unchanged = None if how.workers is not None else _unchanged(job)
    if unchanged is not None:
        return unchanged
    return None if how.leaves_long and _is_long(job) else _reconstruct(job, how)


def _unchanged(job: Job) -> JobResult | None:
    """Return the result of an earlier run on the same inputs, undivided or divided; None if there is work to do.

    Raises:
        OutputExistsError: if the folder contains a result that the job may not replace.
    """
    output = Path(job.output)
    if job.treatment.again or not is_occupied(output):
        return None
    digests = input_digests(Path(job.folder), _inputs(job), job.options)
    windows = dict.fromkeys((None, job.window_s))
    try:
        mark = find_earlier(output, [recording_keys(digests, job.options, window_s=each) for each in windows])
    except OutputExistsError:
        if not job.treatment.overwrite:
            raise
        return None
    if mark is None:
        return None
    outcome = kept_outcome(output, mark)
    return _result(job, "kept", _Remembered.of_mark(mark.remembered, outcome), outcome)


def _is_long(job: Job) -> bool:
    if job.window_s is None:
        return False
    opened = open_recording(Path(job.folder), _inputs(job), job.options)
    return is_long(opened.detections, job.options, job.window_s)


def with_short_paths(job: Job, text: str) -> str:
    """Return a text whose paths start at the recording's folder or the one above, without folders of this machine."""
    folder = job.folder
    above = parents_of(folder)[0] if isinstance(folder, str) else folder.parent
    name = name_of(folder) if isinstance(folder, str) else folder.name
    for path, shown in ((folder, name), (job.output, job.name), (above, "..")):
        text = text.replace(str(path), shown)
    return text


def _reconstruct(job: Job, how: Processing) -> JobResult:
    memory = _Memory(job, how.warned)
    request = Request(Path(job.folder), Path(job.output), job.options, _inputs(job), overwrite=True)
    outcome = carry_out(request, Silent(), Execution(workers=how.workers, remember=memory))
    assert memory.remembered is not None
    return _result(job, "done", memory.remembered, outcome)


def _inputs(job: Job) -> RecordingInputs:
    calibration = None if job.calibration is None else Path(job.calibration)
    return RecordingInputs(calibration, board=job.board)


def _run(job: Job, how: Processing) -> JobResult | None:
    """Run from videos; stages whose inputs and options did not change are kept."""
    assert job.run is not None
    memory, watcher = _Memory(job, how.warned), Watcher(finished=lambda *_: how.stage_finished())
    # Recordings run side by side, each on a core.
    leave_s = job.window_s if how.leaves_long else None
    execution = Execution(1, how.workers, memory, leave_s)
    made = run_in_batch(Path(job.folder), Path(job.output), job.run, job.options, watcher, execution)
    outcome = made.reconstruction
    if outcome is None:
        return None
    if outcome.kept:
        mark = read_mark(outcome.output)
        assert mark is not None
        remembered = _Remembered.of_mark(mark.remembered, outcome)
    else:
        assert memory.remembered is not None
        remembered = memory.remembered
    report = "report.html" if (made.output / "report.html").is_file() else f"{outcome.output.name}/report.html"
    return replace(_result(job, "kept" if outcome.kept else "done", remembered, outcome), report=report)


@dataclass(frozen=True)
class _Remembered:
    """What a batch stores beside a result.

    Attributes:
        statistics: of the result.
        warnings: given while the recording was reconstructed, and findings.
    """

    statistics: ResultStatistics
    warnings: tuple[str, ...]

    @classmethod
    def of(cls, result: Reconstruction, warned: Sequence[str]) -> "_Remembered":
        return cls(_statistics(result), (*warned, *(str(finding) for finding in result.findings)))

    @classmethod
    def of_mark(cls, values: Mapping[str, Any], outcome: Outcome) -> "_Remembered":
        try:
            return cls(ResultStatistics(**values["statistics"]), tuple(values["warnings"]))
        except (TypeError, KeyError):
            # The commands reconstruct and run store no statistics.
            return cls.of(outcome.open(), ())


class _Memory:
    """Remembers the statistics of a result when it is finished."""

    def __init__(self, job: Job, warned: Sequence[str]) -> None:
        self._job, self._warned = job, warned
        self.remembered: _Remembered | None = None

    def __call__(self, result: Reconstruction) -> Mapping[str, Any]:
        warned = [with_short_paths(self._job, text) for text in self._warned]
        self.remembered = _Remembered.of(result, warned)
        return asdict(self.remembered)


def _result(job: Job, state: JobState, remembered: _Remembered, outcome: Outcome) -> JobResult:
    faults = () if job.treatment.accept_findings else certain_faults(outcome.findings)
    if faults:
        why = f"{faults[0].sentence} `accept_findings=True` accepts the result."
        return JobResult(job.name, "failed check", why, remembered.statistics, remembered.warnings)
    return JobResult(job.name, state, "", remembered.statistics, remembered.warnings)


def _statistics(result: Reconstruction) -> ResultStatistics:
    layer, _ = result.best_layer(result.options.layer)
    summary = summarize(result.windows(), layer)
    with_points = sum(n for code, n in summary.status_counts.items() if code.has_point)
    return ResultStatistics(
        frames=result.n_frames,
        seconds=result.n_frames / result.rate_hz if result.rate_hz else None,
        cameras=len(result.rig),
        people=len(result.person_ids),
        points_share=with_points / summary.n_points if summary.n_points else None,
        median_px=_rounded(summary.error_px.median),
        p90_px=_rounded(summary.error_px.p90),
        sd_mm=_rounded(summary.sd_mm.median),
    )


def _rounded(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None
