"""Reconstruct a recording: read it, reconstruct it, write every output. The recipe of every caller."""

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from posefuse.arguments import checked
from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.errors import PosefuseWarning, RecordingError, handle_warnings
from posefuse.free_memory import release_free_memory
from posefuse.io.checkpoints import CheckpointFolder, remove_parts
from posefuse.io.files import CHECKPOINT_FOLDER, replacing_folder
from posefuse.io.object_stores import require_local
from posefuse.io.open_recording import OpenedRecording, RecordingInputs, digest_path, input_digests, open_recording
from posefuse.io.results import netcdf
from posefuse.model.findings import Finding
from posefuse.model.options.options import LayerName, Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.parallel import JobCount, Jobs, number_of_jobs
from posefuse.pipeline.calibrate_recording import ensure_calibration
from posefuse.pipeline.diagnose import begin_check
from posefuse.pipeline.distributed import PieceRunner, Workers, prepare_distributed, reconstruct_distributed
from posefuse.pipeline.edit_result import Edits, write_edited
from posefuse.pipeline.fingerprints import (
    MARK,
    RESULT,
    Mark,
    RecordingKeys,
    find_earlier,
    is_occupied,
    recording_keys,
    write_mark,
)
from posefuse.pipeline.left_out_views import with_layer_scores
from posefuse.pipeline.measured_layer import PARTIAL, finished_chunks, reconstruct_chunks
from posefuse.pipeline.plan import Plan, useful_jobs
from posefuse.pipeline.reconstruct import prepare
from posefuse.pipeline.recording_checkpoint import open_checkpoint
from posefuse.pipeline.write_outputs import (
    find_debug_figure,
    require_known_formats,
    require_possible_formats,
    write_debug_figures,
    write_other_formats,
    write_outputs,
)
from posefuse.progress import Progress, Silent

_CHANGED = "The files of the recording changed while it was reconstructed. Run the same command again."


@checked
@dataclass(frozen=True)
class Outcome:
    """The outcome of :func:`reconstruct_recording`.

    Attributes:
        output: folder of the result.
        files: names of the files and folders written, relative to ``output``.
        layer: the layer that formats with a single layer hold (TRC, C3D and others).
        findings: problems that the recording check found, the most serious first.
        notes: notes of the readers and stages.
        remarks: what the formats cannot hold.
        partial: why the result does not cover the whole recording; empty if it does.
        gait: a line for each person with gait, jumps, squats or rises from a seat.
        kept: whether the folder already contained the result, so that nothing was done.
    """

    output: Path
    files: tuple[str, ...]
    layer: LayerName
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    partial: str = ""
    gait: tuple[str, ...] = ()
    kept: bool = False

    def open(self) -> Reconstruction:
        """Open the result; its arrays are read from the file when they are used."""
        return netcdf.read_reconstruction(self.output / RESULT)


def _nothing(_: object) -> Mapping[str, Any]:
    return {}


@dataclass(frozen=True)
class Execution:
    """How a reconstruction runs.

    Attributes:
        jobs: number of processes; "auto" uses the physical cores if the recording is long enough.
        workers: run pieces of a long recording elsewhere, such as on a cluster; None to run everything here.
        remember: called with the finished result before it replaces an earlier one; returns JSON values that are stored
            beside it.
        leave_s: length of a window in seconds, if a run from videos does not reconstruct a recording of two windows or
            more, so that the caller continues it with workers; else None.
    """

    jobs: JobCount = 1
    workers: Workers | None = None
    remember: Callable[[Reconstruction], Mapping[str, Any]] = _nothing
    leave_s: float | None = None


@checked
def reconstruct_recording(
    recording: str | Path,
    output: str | Path,
    options: Options | None = None,
    *,
    inputs: RecordingInputs | None = None,
    also: tuple[str, ...] = (),
    overwrite: bool = False,
    progress: Progress | None = None,
    jobs: JobCount = 1,
) -> Outcome:
    """Reconstruct a recording and write every output into a folder.

    A recording of more than ``chunk_frames`` frames is reconstructed chunk by chunk. Finished chunks are stored in
    ``output/.parts`` until the result is complete; after an interruption of any kind the same call resumes from them.
    On KeyboardInterrupt the finished chunks become a partial result, and :attr:`Outcome.partial` says so. If the folder
    already contains the result of the same inputs and options, nothing is done, and :attr:`Outcome.kept` says so.

    Args:
        recording: folder of the recording.
        output: folder for the result; created if absent.
        options: options of the reconstruction.
        inputs: paths of inputs that are not found in the folder or are ambiguous there, edits to apply, and the board
            of a recording that has images of it instead of a calibration.
        also: other formats to write, see ``posefuse formats``.
        overwrite: whether to replace an earlier result in the folder, whatever its inputs and options.
        progress: receives the progress.
        jobs: number of processes; "auto" uses the physical cores if the recording is long enough. The files do not
            depend on it.

    Returns:
        The files written, the findings of the recording check, and notes.

    Raises:
        OptionsError: if ``jobs`` is less than 1, or a folder is a URL.
        OutputExistsError: if the folder contains a result of other inputs, options or versions.
        PosefuseError: if the recording cannot be read, reconstructed or written.
        KeyboardInterrupt: if the run is interrupted before the first chunk is finished.
    """
    require_local(recording, output)
    request = Request(Path(recording), Path(output), options or Options(), inputs or RecordingInputs(), also, overwrite)
    return carry_out(request, progress or Silent(), Execution(jobs))


@dataclass(frozen=True)
class Request:
    """A reconstruction to carry out; the attributes are the arguments of :func:`reconstruct_recording`."""

    folder: Path
    output: Path
    options: Options
    inputs: RecordingInputs = field(default_factory=RecordingInputs)
    also: tuple[str, ...] = ()
    overwrite: bool = False

    def digests(self) -> dict[str, str]:
        """Return the digests of the inputs as they are now."""
        return input_digests(self.folder, self.inputs, self.options)

    def keys(self, workers: Workers | None, digests: Mapping[str, str] | None = None) -> RecordingKeys:
        """Return the keys of the inputs as they are now, or of given digests, for workers elsewhere or None."""
        window_s = None if workers is None else workers.window_s
        digests = self.digests() if digests is None else digests
        return recording_keys(digests, self.options, edits=self.inputs.edits, also=self.also, window_s=window_s)


def carry_out(request: Request, progress: Progress, execution: Execution) -> Outcome:
    """Carry out a request; see :func:`reconstruct_recording`.

    Args:
        request: what to reconstruct, and where to write it.
        progress: receives the progress.
        execution: how it runs.
    """
    number_of_jobs(execution.jobs, useful=1)
    require_known_formats(request.also)
    ensure_calibration(request.folder, request.inputs, progress)
    output = request.output
    mark = (
        None
        if request.overwrite or not is_occupied(output)
        else find_earlier(output, [request.keys(execution.workers)])
    )
    if mark is not None:
        return kept_outcome(output, mark)
    after = ExitStack()
    with (
        _announce_checkpoint(output / CHECKPOINT_FOLDER),
        replacing_folder(output, MARK if (output / MARK).exists() else RESULT, after=after) as staging,
    ):
        outcome, checkpoint = _Run(staging, request, progress, execution).reconstruct()
        files, remarks = write_other_formats(staging, request.also)
        outcome = replace(outcome, files=(*outcome.files, *files), remarks=(*outcome.remarks, *remarks))
        if not outcome.partial:
            outcome = replace(outcome, files=(*outcome.files, MARK))
            result = netcdf.read_reconstruction(staging / RESULT)
            keys = _unchanged_keys(request, result, execution.workers)
            remembered = execution.remember(result)

            @after.callback
            def finish() -> None:
                # The mark comes last, but before the checkpoint is removed: an interruption leaves one of the two.
                write_mark(output, keys.result, outcome.files, remembered)
                if checkpoint is not None:
                    checkpoint.remove()

    return outcome


def _unchanged_keys(request: Request, result: Reconstruction, workers: Workers | None) -> RecordingKeys:
    """Return the keys of a result.

    Raises:
        RecordingError: if an input is not the one that the result was computed from.
    """
    digests = request.digests()
    edits = request.inputs.edits
    now = {*digests.values(), *(() if edits is None else (digest_path(edits),))}
    if not set(result.provenance.inputs.values()) <= now:
        remove_parts(request.output / CHECKPOINT_FOLDER)
        raise RecordingError(_CHANGED)
    return request.keys(workers, digests)


def kept_outcome(output: Path, mark: Mark) -> Outcome:
    """Return the outcome for a folder that already contains the result.

    Args:
        output: folder of the result.
        mark: its mark.
    """
    # A run may have ended after writing the mark and before removing its checkpoint.
    remove_parts(output / CHECKPOINT_FOLDER)
    result = netcdf.read_reconstruction(output / RESULT)
    layer, _ = result.best_layer(result.options.layer)
    return Outcome(output, mark.files, layer, result.findings, result.provenance.notes, kept=True)


@contextmanager
def _announce_checkpoint(folder: Path) -> Iterator[None]:
    """Warn of the checkpoint that an interrupted run leaves."""
    try:
        yield
    except KeyboardInterrupt:
        if folder.exists():
            _warn(f"Finished parts are stored in {folder}; run the same command again to resume.")
        raise


def _warn(text: str) -> None:
    warnings.warn(text, PosefuseWarning, stacklevel=3)


@dataclass(frozen=True)
class _Run:
    """One run of the recipe.

    Attributes:
        staging: folder to write into.
        request: what to reconstruct.
        progress: receives the progress.
        execution: how it runs.
    """

    staging: Path
    request: Request
    progress: Progress
    execution: Execution

    def reconstruct(self) -> tuple[Outcome, CheckpointFolder | None]:
        """Read, reconstruct and write a recording.

        Returns:
            The outcome, and the checkpoint to remove when the files are in place, if there is one.
        """
        request, options = self.request, self.request.options
        opened = open_recording(request.folder, request.inputs, options, self.progress, timed=True)
        require_possible_formats(request.also, opened.rig, opened.detections, options)
        edits = None if request.inputs.edits is None else Edits.read(request.inputs.edits)
        if options.skeleton is not None:
            # The result stores the whole skeleton; the path of its file differs between machines.
            options = replace(options, skeleton=opened.detections.skeleton.name)
        workers = self.execution.workers
        window_s = None if workers is None else workers.window_s
        stored = open_checkpoint(request.output / CHECKPOINT_FOLDER, opened, options, self.progress, window_s)
        checkpoint = None if opened.detections.n_frames <= options.chunk_frames and workers is None else stored
        with Jobs(number_of_jobs(self.execution.jobs, useful_jobs(opened.detections))) as jobs:
            make = partial(self._make, opened, options, checkpoint, jobs)
            plan = _load_or_make(checkpoint, self.staging / RESULT, make)
            return self._write(plan, edits, jobs), stored

    def _write(self, plan: Plan | None, edits: Edits | None, jobs: Jobs) -> Outcome:
        """Apply edits to ``reconstruction.nc``, and write the other files."""
        path = self.staging / RESULT
        if edits is not None:
            unedited = path.rename(self.staging / "unedited.nc")
            write_edited(netcdf.read_reconstruction(unedited), edits, path)
            unedited.unlink()
        result = netcdf.read_reconstruction(path)
        name = self.request.folder.resolve().name
        written = write_outputs(result, self.staging, self.progress, name, jobs)
        debug = () if plan is None else write_debug_figures(plan, result, self.staging, self.progress)
        files = (RESULT, *written.files, *debug)
        notes, partial_remark = result.provenance.notes, _partial_remark(result)
        return Outcome(
            self.request.output, files, written.layer, result.findings, notes, written.remarks, partial_remark,
            written.gait,
        )  # fmt: skip

    def _make(self, opened: OpenedRecording, options: Options, checkpoint: CheckpointFolder | None, jobs: Jobs) -> Plan:
        """Write ``reconstruction.nc`` and return its plan."""
        recording, parts = (opened.rig, opened.detections, options), checkpoint or NO_CHECKPOINT
        path, workers, runner = self.staging / RESULT, self.execution.workers, None
        if workers is not None:
            assert checkpoint is not None
            runner = PieceRunner(checkpoint, workers)
            plan = prepare_distributed(*recording, runner, self.progress)
        else:
            plan = prepare(*recording, self.progress, parts, jobs=jobs)
        plan = replace(plan, provenance=replace(plan.provenance, inputs=opened.digests))
        release_free_memory()
        findings = begin_check(plan, jobs)
        plan = replace(with_layer_scores(plan, jobs), findings=findings())
        release_free_memory()
        if runner is not None:
            netcdf.write(reconstruct_distributed(plan, runner, self.progress), path)
        else:
            _write_chunks(plan, self.progress, parts, path, jobs)
        release_free_memory()
        return plan


def _load_or_make(checkpoint: CheckpointFolder | None, path: Path, make: Callable[[], Plan]) -> Plan | None:
    """Write ``reconstruction.nc``, or restore it from the checkpoint of an earlier run that finished it.

    A finished file replaces the parts of the checkpoint, with the warnings of the run that made it.

    Returns:
        The plan, or None if the file was restored; files with debug figures are never stored.
    """
    if checkpoint is None:
        return make()
    texts = checkpoint.load_file(path)
    if texts is not None:
        for text in texts:
            _warn(text)
        return None
    heard, show = [], warnings.showwarning

    def hear(text: str) -> None:
        heard.append(text)
        show(PosefuseWarning(text), PosefuseWarning, __file__, 0)

    with handle_warnings(hear):
        plan = make()
    if find_debug_figure(plan) is None and not _partial_remark(netcdf.read_reconstruction(path)):
        checkpoint.save_file(path, tuple(heard))
    return plan


def _write_chunks(plan: Plan, progress: Progress, checkpoint: Checkpoint, path: Path, jobs: Jobs) -> None:
    """Write the reconstruction; if it is interrupted, write the chunks that are finished."""
    try:
        netcdf.write(reconstruct_chunks(plan, progress, checkpoint, jobs), path)
    except KeyboardInterrupt:
        progress.finish()
        if next(finished_chunks(plan, checkpoint), None) is None:
            raise
        _warn("Interrupted: the result contains the finished chunks. Press Ctrl-C again to stop at once.")
        netcdf.write(finished_chunks(plan, checkpoint), path)


def _partial_remark(result: Reconstruction) -> str:
    """Return the note of a partial result; empty if the result is complete."""
    return next((note for note in result.provenance.notes if note.startswith(PARTIAL)), "")
