"""Reconstruct a recording: read it, reconstruct it, write every output. The recipe of every caller."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from posefuse.arguments import checked
from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.errors import PosefuseWarning, handle_warnings
from posefuse.io.checkpoints import CheckpointFolder
from posefuse.io.files import CHECKPOINT_FOLDER, RESULT_FILES, replacing_folder
from posefuse.io.open_recording import OpenedRecording, RecordingInputs, open_recording
from posefuse.io.results import netcdf
from posefuse.model.findings import Finding
from posefuse.model.options.options import LayerName, Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.diagnose import check_recording
from posefuse.pipeline.distributed import PieceRunner, Workers, prepare_distributed, reconstruct_distributed
from posefuse.pipeline.edit_result import Edits, write_edited
from posefuse.pipeline.measured_layer import PARTIAL, finished_chunks, reconstruct_chunks
from posefuse.pipeline.plan import Plan
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

RESULT = RESULT_FILES[0]


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
    """

    output: Path
    files: tuple[str, ...]
    layer: LayerName
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    partial: str = ""

    def open(self) -> Reconstruction:
        """Open the result; its arrays are read from the file when they are used."""
        return netcdf.read_reconstruction(self.output / RESULT)


def _nothing(_: object) -> None:
    """Do nothing."""


@dataclass(frozen=True)
class Delivery:
    """What a caller does when the finished files take their place.

    Attributes:
        marker: name of the file by which the output folder is recognized as a result.
        verify: called with the finished result before it replaces an earlier one; raises to reject it.
        finish: called when all files are in place, before the checkpoint is removed.
    """

    marker: str = RESULT
    verify: Callable[[Reconstruction], None] = _nothing
    finish: Callable[[Outcome], None] = _nothing


@checked
def reconstruct_recording(
    recording: str | Path,
    output: str | Path,
    options: Options | None = None,
    *,
    inputs: RecordingInputs | None = None,
    also: tuple[str, ...] = (),
    progress: Progress | None = None,
    workers: Workers | None = None,
    delivery: Delivery | None = None,
) -> Outcome:
    """Reconstruct a recording and write every output into a folder.

    A recording of more than ``chunk_frames`` frames is reconstructed chunk by chunk. Finished chunks are stored in
    ``output/.parts`` until the result is complete; after an interruption of any kind the same call resumes from them.
    On KeyboardInterrupt the finished chunks become a partial result, and :attr:`Outcome.partial` says so.

    Args:
        recording: folder of the recording.
        output: folder for the result; created if absent. An earlier result in it is replaced.
        options: options of the reconstruction.
        inputs: paths of inputs that are not found in the folder or are ambiguous there, and edits to apply.
        also: other formats to write, see ``posefuse formats``.
        progress: receives the progress.
        workers: run pieces of a long recording elsewhere, such as on a cluster.
        delivery: what else happens when the finished files take their place.

    Returns:
        The files written, the findings of the recording check, and notes.

    Raises:
        PosefuseError: if the recording cannot be read, reconstructed or written.
        KeyboardInterrupt: if the run is interrupted before the first chunk is finished.
    """
    output, delivery = Path(output), delivery or Delivery()
    require_known_formats(also)
    after = ExitStack()
    with (
        _announce_checkpoint(output / CHECKPOINT_FOLDER),
        replacing_folder(output, delivery.marker, after=after) as staging,
    ):
        run = _Run(staging, output, options or Options(), inputs or RecordingInputs(), also, progress or Silent())
        outcome, checkpoint = run.reconstruct(Path(recording), workers)
        files, remarks = write_other_formats(staging, also)
        outcome = replace(outcome, files=(*outcome.files, *files), remarks=(*outcome.remarks, *remarks))
        if not outcome.partial:
            delivery.verify(netcdf.read_reconstruction(staging / RESULT))

            @after.callback
            def finish() -> None:
                delivery.finish(outcome)
                if checkpoint is not None:
                    checkpoint.remove()

    return outcome


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
        output: folder of the result, which holds the checkpoint.
        options: options as requested.
        inputs: paths of inputs.
        also: other formats to write.
        progress: receives the progress.
    """

    staging: Path
    output: Path
    options: Options
    inputs: RecordingInputs
    also: tuple[str, ...]
    progress: Progress

    def reconstruct(self, folder: Path, workers: Workers | None) -> tuple[Outcome, CheckpointFolder | None]:
        """Read, reconstruct and write a recording.

        Returns:
            The outcome, and the checkpoint to remove when the files are in place, if there is one.
        """
        opened = open_recording(folder, self.inputs, self.options, self.progress, timed=True)
        require_possible_formats(self.also, opened.rig, opened.detections, self.options)
        edits = None if self.inputs.edits is None else Edits.read(self.inputs.edits)
        options = self.options
        if options.skeleton is not None:
            # The result stores the whole skeleton; the path of its file differs between machines.
            options = replace(options, skeleton=opened.detections.skeleton.name)
        window_s = None if workers is None else workers.window_s
        stored = open_checkpoint(self.output / CHECKPOINT_FOLDER, opened, options, self.progress, window_s)
        checkpoint = None if opened.detections.n_frames <= options.chunk_frames and workers is None else stored
        path = self.staging / RESULT
        plan = _load_or_make(checkpoint, path, lambda: self._make(opened, options, path, checkpoint, workers))
        if edits is not None:
            unedited = path.rename(self.staging / "unedited.nc")
            write_edited(netcdf.read_reconstruction(unedited), edits, path)
            unedited.unlink()
        result = netcdf.read_reconstruction(path)
        written = write_outputs(result, self.staging, self.progress)
        debug = () if plan is None else write_debug_figures(plan, result, self.staging, self.progress)
        files = (RESULT, *written.files, *debug)
        notes, partial = result.provenance.notes, _partial_remark(result)
        outcome = Outcome(self.output, files, written.layer, result.findings, notes, written.remarks, partial)
        return outcome, stored

    def _make(
        self,
        opened: OpenedRecording,
        options: Options,
        path: Path,
        checkpoint: CheckpointFolder | None,
        workers: Workers | None,
    ) -> Plan:
        """Write ``reconstruction.nc`` and return its plan."""
        recording, parts = (opened.rig, opened.detections, options), checkpoint or NO_CHECKPOINT
        runner = None
        if workers is not None:
            assert checkpoint is not None
            runner = PieceRunner(checkpoint, workers)
            plan = prepare_distributed(*recording, runner, self.progress)
        else:
            plan = prepare(*recording, self.progress, parts)
        plan = check_recording(replace(plan, provenance=replace(plan.provenance, inputs=opened.digests)))
        if runner is not None:
            netcdf.write(reconstruct_distributed(plan, runner, self.progress), path)
        else:
            _write_chunks(plan, self.progress, parts, path)
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


def _write_chunks(plan: Plan, progress: Progress, checkpoint: Checkpoint, path: Path) -> None:
    """Write the reconstruction; if it is interrupted, write the chunks that are finished."""
    try:
        netcdf.write(reconstruct_chunks(plan, progress, checkpoint), path)
    except KeyboardInterrupt:
        progress.finish()
        if next(finished_chunks(plan, checkpoint), None) is None:
            raise
        _warn("Interrupted: the result contains the finished chunks. Press Ctrl-C again to stop at once.")
        netcdf.write(finished_chunks(plan, checkpoint), path)


def _partial_remark(result: Reconstruction) -> str:
    """Return the note of a partial result; empty if the result is complete."""
    return next((note for note in result.provenance.notes if note.startswith(PARTIAL)), "")
