"""Jobs of a batch, one per recording, and their results."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from posefuse.model.options.options import Options
from posefuse.model.options.run import RunOptions

Place = Path | str
"""A local path, or the URL of a file or folder on an object store."""

JobState = Literal["done", "kept", "failed", "failed check", "not done"]
"""Reconstructed in this run; unchanged since an earlier run; without a result; with a result that is certainly wrong;
not reached before the batch was interrupted."""


@dataclass(frozen=True)
class JobTreatment:
    """What a batch does with earlier and with wrong results.

    Attributes:
        again: whether to reconstruct recordings that have not changed.
        overwrite: whether to replace results of other inputs, options or versions.
        accept_findings: whether a result that is certainly wrong counts as done.
    """

    again: bool = False
    overwrite: bool = False
    accept_findings: bool = False


@dataclass(frozen=True)
class StoredFile:
    """A file on an object store, as the store lists it.

    Attributes:
        url: its URL.
        size: its size in bytes.
        version: a text that changes with the content, such as an ETag.
    """

    url: str
    size: int
    version: str


@dataclass(frozen=True)
class Job:
    """One recording to reconstruct.

    Attributes:
        name: name of the result, unique in the batch.
        folder: absolute path or URL of the recording.
        output: absolute path or URL of the result's folder.
        calibration: calibration of all recordings, or None where each has its own.
        options: options of the reconstruction.
        treatment: what happens to earlier and to wrong results.
        window_s: on a cluster, length of the windows into which a recording of at least two windows is divided; None
            to divide no recording.
        run: options of a run from videos; None to reconstruct from 2D keypoints.
        board: board of a recording that has images of it instead of a calibration, or None.
        above: files in the folders above a recording on an object store that belong to it, such as a calibration.
    """

    name: str
    folder: Place
    output: Place
    calibration: Place | None
    options: Options
    treatment: JobTreatment = JobTreatment()
    window_s: float | None = None
    run: RunOptions | None = None
    board: str | None = None
    above: tuple[StoredFile, ...] = ()


@dataclass(frozen=True)
class ResultStatistics:
    """Statistics of a result; None where a value does not exist.

    Attributes:
        frames: number of frames.
        seconds: length of the recording, None without a frame rate.
        cameras: number of cameras.
        people: number of people.
        points_share: fraction of the points of present people that have coordinates.
        median_px: median reprojection error.
        p90_px: 90th percentile of the reprojection errors.
        sd_mm: standard deviation of a typical point, as the result states it.
    """

    frames: int
    seconds: float | None
    cameras: int
    people: int
    points_share: float | None
    median_px: float | None
    p90_px: float | None
    sd_mm: float | None


@dataclass(frozen=True)
class JobResult:
    """The result of a job.

    Attributes:
        name: name of the job.
        state: whether there is a result.
        why: what went wrong, in a sentence; empty where nothing did.
        statistics: statistics of the result, None where there is none.
        warnings: warnings given while the recording was reconstructed.
        report: name of the report in the folder of the result.
        transient: whether a failed job may succeed if it is run again, because its cause lies outside the recording.
    """

    name: str
    state: JobState
    why: str = ""
    statistics: ResultStatistics | None = None
    warnings: tuple[str, ...] = ()
    report: str = "report.html"
    transient: bool = False
