"""Jobs' work for tests, importable by other processes."""

import os
import signal
import time
from pathlib import Path

from posefuse.model.batch import Job, JobResult, ResultStatistics
from posefuse.model.options.options import Options


def do(job: Job) -> JobResult:
    """Succeed, or fail or kill the process always or at the first attempt, depending on the folder's name."""
    word = job.folder.name.partition("_")[0]
    mark = job.output / job.name
    first = not mark.exists()
    mark.touch()
    if word == "dies" or (word == "diesonce" and first):
        os.kill(os.getpid(), signal.SIGKILL)
    if word == "wrong" or word == "unreachable" or (word == "unreachableonce" and first):
        return JobResult(job.name, "failed", f"{word}.", transient=word != "wrong")
    if word == "slow":
        time.sleep(0.5)
    return JobResult(job.name, "done", statistics=ResultStatistics(len(job.name), None, 2, 1, None, None, None, None))


def jobs(folder: Path, *names: str) -> list[Job]:
    return [Job(name, Path(name), folder, None, Options()) for name in names]
