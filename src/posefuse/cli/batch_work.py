"""One recording of a batch, done in whatever process: nothing is printed, whatever happens is told."""

import contextlib
import io
import math
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from posefuse.batch.fingerprints import MARK, RESULT, kept, key_of, remove_mark, write_mark
from posefuse.cli.console import Bars, handle_warnings
from posefuse.cli.reading import digest, timestamps_of
from posefuse.diagnostics.findings import NOTE_PREFIX
from posefuse.errors import PosefuseError, RecordingError
from posefuse.io.checkpoints import remove_parts
from posefuse.io.files import PARTS, must_exist, replacing_folder
from posefuse.io.recording import choose_calibration, choose_keypoints, find_recording
from posefuse.model.batch import Job, Numbers, Outcome
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.distributed import Do
from posefuse.progress import Silent

if TYPE_CHECKING:
    from posefuse.pipeline.measured_layer import Plan

_T = TypeVar("_T")
_ONE_AT_A_TIME = threading.Lock()
"""What is printed and warned of belongs to a process, so that a process does one recording at a time."""
_CHANGED = "Its files changed while it was reconstructed. The same command does it anew."


Make = Callable[[Path, Job, Path, Path], Callable[[], None]]
"""Writes a result: into which folder, of which job, from which calibration and keypoints. Gives what is to be called
when the result is in its place: what was kept to go on from is not needed any more."""


def do_job(job: Job) -> Outcome:
    """Reconstruct a recording, if it has to be; what came of it. Raises nothing that is an error."""
    with _ONE_AT_A_TIME, _quiet() as said:
        return _answered(job, lambda: _kept(job) or _done(job, said, _whole, None))


def do_unless_long(job: Job) -> Outcome | None:
    """The same; None of a recording that is to be divided."""
    with _ONE_AT_A_TIME, _quiet() as said:
        return _answered(
            job, lambda: _kept(job) or (None if _is_long(job) else _done(job, said, _whole, None))
        )  # fmt: skip


def do_divided(job: Job, do: Do) -> Outcome:
    """Reconstruct a long recording in pieces, which others do; what came of it. Raises nothing that is an error."""
    with _ONE_AT_A_TIME, _quiet() as said:
        return _answered(job, lambda: _done(job, said, partial(_in_pieces, do), job.window_s))


def _answered(job: Job, work: Callable[[], _T]) -> _T | Outcome:
    """What comes of some work; of an error, its reason."""
    try:
        return work()
    except PosefuseError as error:
        return _failed(job, str(error))
    except OSError as error:
        named = f"{Path(error.filename).name}: " if error.filename else ""
        return _failed(job, f"{named}{error.strerror or error}.")
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}, line {last.lineno}"
        what = " ".join(str(error).split())[:200]
        return _failed(job, f"Unforeseen, please report it: {type(error).__name__}: {what} ({where})")


def _failed(job: Job, why: str) -> Outcome:
    """Where recordings lie is nobody's business: paths begin at the recording's folder, or the one above."""
    for path, shown in ((job.folder, job.folder.name), (job.output, job.name), (job.folder.parent, "..")):
        why = why.replace(str(path), shown)
    return Outcome(job.name, "failed", why)


def _inputs(job: Job) -> tuple[Path, Path]:
    """The calibration and the keypoints of a recording."""
    recording = find_recording(job.folder)
    calibration = must_exist(job.calibration, "calibration") if job.calibration else choose_calibration(recording)
    return calibration, choose_keypoints(recording)


def _kept(job: Job) -> Outcome | None:
    """What an earlier run made of the same, in one go or divided alike."""
    if job.again or not (job.output / MARK).is_file():
        return None
    inputs = _digests(job)
    keys = (_key(job, inputs, window_s) for window_s in dict.fromkeys((None, job.window_s)))
    found = next((found for key in keys if (found := kept(job.name, job.output, key, digest))), None)
    if found is not None:
        # Of a run that was ended between its mark and their end.
        remove_parts(job.output / PARTS)
    return found


def _is_long(job: Job) -> bool:
    from posefuse.cli.reading import read_inputs
    from posefuse.pipeline.distributed import is_long

    inputs = read_inputs(job.folder, *_inputs(job), job.options, Silent())
    return job.window_s is not None and is_long(inputs.detections, job.options, job.window_s)


def _done(job: Job, said: list[str], make: Make, window_s: float | None) -> Outcome:
    from posefuse.io.results import netcdf

    marker = MARK if (job.output / MARK).exists() else RESULT
    after = contextlib.ExitStack()
    with replacing_folder(job.output, marker, after=after) as staging:
        forget = make(staging, job, *_inputs(job))
        result = netcdf.read_reconstruction(staging / RESULT)
        said += [note for note in result.provenance.notes if note.startswith(NOTE_PREFIX)]
        inputs = _digests(job)
        if not set(result.provenance.inputs.values()) <= set(inputs.values()):
            forget()
            raise RecordingError(_CHANGED)
        outcome = Outcome(job.name, "done", "", _numbers(result), tuple(said))

        @after.callback
        def finish() -> None:
            # Before the parts go: whoever is ended in between has one or the other.
            write_mark(job.output, _key(job, inputs, window_s), outcome, digest)
            forget()

        # From here on the folder is another result, and not a whole one until its mark is there.
        remove_mark(job.output)
    return outcome


def _whole(folder: Path, job: Job, calibration: Path, keypoints: Path) -> Callable[[], None]:
    from posefuse.cli.reconstruct import reconstruct_into

    made = reconstruct_into(folder, job.folder, calibration, keypoints, job.options, parts=job.output / PARTS)
    return made.done


def _in_pieces(do: Do, folder: Path, job: Job, calibration: Path, keypoints: Path) -> Callable[[], None]:
    """As :func:`reconstruct_into`, with pieces that others do; those that are done are kept until the result is."""
    from posefuse.cli.reading import must_have_rate, read_inputs
    from posefuse.cli.reconstruct import parts_of, write_beside, write_debug, write_once
    from posefuse.io.results import netcdf
    from posefuse.pipeline.diagnose import with_health
    from posefuse.pipeline.distributed import Team, prepare_divided, reconstruct_divided

    progress, options = Bars(), job.options
    inputs = read_inputs(job.folder, calibration, keypoints, options, progress)
    must_have_rate(inputs.detections)
    if options.skeleton is not None:
        options = replace(options, skeleton=inputs.detections.skeleton.name)
    assert job.window_s is not None
    parts = parts_of(job.output / PARTS, inputs, options, job.window_s)
    team = Team(parts, do, job.window_s)

    def make(path: Path) -> "Plan":
        plan = with_health(prepare_divided(inputs.rig, inputs.detections, options, team, progress))
        plan = replace(plan, provenance=replace(plan.provenance, inputs=inputs.digests))
        netcdf.write(reconstruct_divided(plan, team, progress), path)
        return plan

    plan = write_once(parts, folder / RESULT, make)
    result = netcdf.read_reconstruction(folder / RESULT)
    write_beside(result, folder, progress)
    if plan is not None:
        write_debug(plan, result, folder, progress)
    return parts.remove


def _digests(job: Job) -> dict[str, str]:
    """What is read of a recording: what it is for and its name, to the digest of its content."""
    calibration, keypoints = _inputs(job)
    files = {"calibration": calibration, "keypoints": keypoints}
    stamps = timestamps_of(job.folder, keypoints, job.options)
    if stamps is not None:
        files["timestamps"] = stamps
    return {f"{what} {path.name}": digest(path) for what, path in files.items()}


def _key(job: Job, inputs: Mapping[str, str], window_s: float | None) -> str:
    options = job.options
    skeleton = Path(options.skeleton) if options.skeleton and options.skeleton.endswith(".toml") else None
    own = digest(skeleton) if skeleton is not None and skeleton.is_file() else ""
    return key_of(inputs, options, own, window_s)


def _numbers(result: Reconstruction) -> Numbers:
    from posefuse.report.summary import summarize

    layer, _ = result.best_layer(result.options.layer)
    summary = summarize(result.chunks(), layer)
    there = sum(n for code, n in summary.status_counts.items() if code.has_point)
    return Numbers(
        frames=result.n_frames,
        seconds=result.n_frames / result.rate_hz if result.rate_hz else None,
        cameras=len(result.rig),
        people=len(result.person_ids),
        points_share=there / summary.n_points if summary.n_points else None,
        median_px=_known(summary.error_px.median),
        p90_px=_known(summary.error_px.p90),
        sd_mm=_known(summary.sd_mm.median),
    )


def _known(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None


@contextlib.contextmanager
def _quiet() -> Iterator[list[str]]:
    """Nothing is printed; the list gets what was warned of, each once."""
    said: list[str] = []
    with (
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()),
        handle_warnings(said.append),
    ):
        yield said


def as_before(job: Job, outcome: Outcome) -> Outcome:
    """A failure, with a word on the result of an earlier run that is still there."""
    if outcome.state in ("failed", "not done") and (job.output / RESULT).exists():
        return replace(outcome, why=f"{outcome.why} ({job.name} holds an earlier result.)")
    return outcome
