"""Calibrate the cameras of a batch before its jobs run, once for the recordings of a session."""

from collections.abc import Sequence
from pathlib import Path

from posefuse.batch.work import failed
from posefuse.errors import PosefuseError
from posefuse.io.board_images import find_board_folder
from posefuse.io.open_recording import RecordingInputs
from posefuse.model.batch import Job, JobResult
from posefuse.pipeline.calibrate_recording import ensure_calibration
from posefuse.progress import Progress


def calibrate_jobs(jobs: Sequence[Job], board: str | None, progress: Progress) -> list[JobResult]:
    """Calibrate the cameras of recordings that have images of a board instead of a calibration.

    The first recording of a session writes the calibration that the others find.

    Args:
        jobs: the jobs of a batch; those of local recordings count that are reconstructed from 2D keypoints.
        board: description of the board, or its file; None to use those beside the images.
        progress: receives the progress.

    Returns:
        Results of the jobs whose cameras could not be calibrated, with the reason.
    """
    out: list[JobResult] = []
    reasons: dict[Path | None, str] = {}
    for job in jobs:
        # A run from videos calibrates by itself, and so does a worker that has a copy of a recording.
        if job.run is not None or isinstance(job.folder, str):
            continue
        images = find_board_folder(job.folder)
        if images not in reasons:
            try:
                given = None if job.calibration is None else Path(job.calibration)
                ensure_calibration(job.folder, RecordingInputs(given, board=board), progress)
                continue
            except PosefuseError as error:
                reasons[images] = str(error)
        out.append(failed(job, reasons[images]))
    return out
