"""One recording of a batch, done in whatever process: nothing is printed, whatever happens is told."""

import contextlib
import io
import math
import threading
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from posefuse.batch.marks import MARK, RESULT, kept, key_of, remove_mark, write_mark
from posefuse.cli.reading import digest
from posefuse.errors import PosefuseError, PosefuseWarning
from posefuse.io.files import must_exist, replacing_folder
from posefuse.io.recording import choose_calibration, choose_keypoints, find_recording
from posefuse.model.batch import Job, Numbers, Outcome
from posefuse.model.options import Options
from posefuse.model.reconstruction import Reconstruction

_ONE_AT_A_TIME = threading.Lock()
"""What is printed and warned of belongs to a process, so that a process does one recording at a time."""


def do_job(job: Job) -> Outcome:
    """Reconstruct a recording, if it has to be; what came of it. Raises nothing that is an error."""
    with _ONE_AT_A_TIME, _quiet() as said:
        try:
            outcome = _done(job, said)
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
    return outcome


def _failed(job: Job, why: str) -> Outcome:
    """Where recordings lie is nobody's business: paths begin at the recording's folder, or the one above."""
    for path, shown in ((job.folder, job.folder.name), (job.output, job.name), (job.folder.parent, "..")):
        why = why.replace(str(path), shown)
    return Outcome(job.name, "failed", why)


def _done(job: Job, said: list[str]) -> Outcome:
    from posefuse.cli.reconstruct import reconstruct_into
    from posefuse.io.results import netcdf

    recording = find_recording(job.folder)
    calibration = must_exist(job.calibration, "calibration") if job.calibration else choose_calibration(recording)
    keypoints = choose_keypoints(recording)
    key = _key(calibration, keypoints, job.options)
    before = None if job.again else kept(job.name, job.output, key, digest)
    if before is not None:
        return before
    marker = MARK if (job.output / MARK).exists() else RESULT
    with replacing_folder(job.output, marker) as staging:
        reconstruct_into(staging, job.folder, calibration, keypoints, job.options)
        numbers = _numbers(netcdf.read_reconstruction(staging / RESULT))
        # From here on the folder is another result, and not a whole one until its mark is there.
        remove_mark(job.output)
    outcome = Outcome(job.name, "done", "", numbers, tuple(said))
    write_mark(job.output, key, outcome, digest)
    return outcome


def _key(calibration: Path, keypoints: Path, options: Options) -> str:
    skeleton = Path(options.skeleton) if options.skeleton and options.skeleton.endswith(".toml") else None
    own = digest(skeleton) if skeleton is not None and skeleton.is_file() else ""
    inputs = {f"calibration {calibration.name}": digest(calibration), f"keypoints {keypoints.name}": digest(keypoints)}
    return key_of(inputs, options, own)


def _numbers(result: Reconstruction) -> Numbers:
    from posefuse.report.summary import summarise

    layer, _ = result.best_layer(result.options.layer)
    summary = summarise(result.chunks(), layer)
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
        warnings.catch_warnings(),
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()),
    ):
        warnings.simplefilter("always", PosefuseWarning)
        usual = warnings.showwarning

        def hear(message: Warning | str, category: type[Warning], *rest: object, **named: object) -> None:
            if not issubclass(category, PosefuseWarning):
                usual(message, category, *rest, **named)  # type: ignore[arg-type]
            elif str(message) not in said:
                said.append(str(message))

        warnings.showwarning = hear
        yield said


def as_before(job: Job, outcome: Outcome) -> Outcome:
    """A failure, with a word on the result of an earlier run that is still there."""
    if outcome.state == "failed" and (job.output / RESULT).exists():
        return replace(outcome, why=f"{outcome.why} ({job.name} holds an earlier result.)")
    return outcome
