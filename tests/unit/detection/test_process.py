"""A detector in a worker process returns what it would return in this one, and no failure of it is silent."""

import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from posefuse.detection.process import WorkerProcess, WorkerSettings
from posefuse.errors import DetectorError
from tests.conftest import ROOT
from tests.workers import BRIGHTNESS, FAILING, worker_command


def images(*values, size=(6, 8)):
    return [np.full((*size, 3), value, dtype=np.uint8) for value in values]


def found(detections):
    return [each.keypoints_px.tolist() for each in detections]


def open_files():
    return len(os.listdir("/proc/self/fd"))


def test_the_answers_are_those_of_the_worker_file(tmp_path):
    worker = WorkerProcess(worker_command(tmp_path, BRIGHTNESS))
    assert (worker.name, worker.version, worker.batch_size) == ("own", "test 1", 4)
    assert worker.skeleton.keypoints == ("left_end", "right_end")
    assert worker.skeleton.pairs == (("left_end", "right_end"),)
    assert found(worker.detect(images(10, 20))) == [[[[10, 1], [8, 6]]], [[[20, 2], [8, 6]]]]
    # Other sizes, smaller and larger, and one array instead of a list.
    assert found(worker.detect(np.array(images(30, size=(3, 2))))) == [[[[30, 3], [2, 3]]]]
    assert found(worker.detect(images(*range(40), size=(50, 60))))[39] == [[[39, 43], [60, 50]]]
    assert worker.detect([]) == []
    worker.reset()
    answer = worker.detect(images(7))
    assert found(answer) == [[[[7, 1], [8, 6]]]]
    assert answer[0].confidence.tolist() == [[1.0, 0.5]]
    worker.close()
    with pytest.raises(DetectorError, match="is closed"):
        worker.detect(images(1))


def test_images_of_another_form_are_refused(tmp_path):
    worker = WorkerProcess(worker_command(tmp_path, BRIGHTNESS))
    for wrong in (images(1, 2)[:1] + images(1, size=(2, 2)), [np.zeros((4, 4, 3))], [np.zeros((4, 4), np.uint8)]):
        with pytest.raises(DetectorError, match=r"Images must have one shape \(height, width, 3\) and type uint8"):
            worker.detect(wrong)
    worker.close()


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("exception", r"failed: ValueError: the image is too green \(own\.py, line \d+\)\."),
        ("segfault", r"crashed \(SIGSEGV\)\. Its last message: about to crash"),
        ("killed", r"was killed \(SIGKILL\), possibly because the memory was exhausted\."),
        ("exit", r"ended with exit code 3\."),
        ("memory", r"failed: MemoryError"),
        ("hang", r"did not answer within 1 s\."),
        ("shape", r"returned an array of shape \(1, 5, 3\) for an image\. Expected .*\(person, 2, 3\)"),
        ("count", r"failed: ValueError: detect returned 0 results for 1 images"),
        ("infinite", r"returned an infinite number"),
        ("text", r"failed: detect returned str for an image"),
    ],
)
def test_a_failure_is_one_sentence_and_the_worker_can_start_again(tmp_path, how, message):
    worker = WorkerProcess(worker_command(tmp_path, FAILING), WorkerSettings(model=how), timeout_s=1.0)
    assert found(worker.detect(images(5))) == [[[[5, 5], [5, 5]]]]
    with pytest.raises(DetectorError, match=f"The detector own {message}") as raised:
        worker.detect(images(200))
    assert "\n" not in str(raised.value)
    worker.reset()
    assert found(worker.detect(images(6))) == [[[[6, 6], [6, 6]]]]
    worker.close()


def test_missing_points_and_people_are_left_out(tmp_path):
    worker = WorkerProcess(worker_command(tmp_path, FAILING), WorkerSettings(model="missing"))
    answer = worker.detect(images(200))[0]
    np.testing.assert_array_equal(answer.keypoints_px, [[[np.nan, np.nan], [1.0, 2.0]]])
    assert answer.boxes_px is not None
    assert answer.boxes_px.tolist() == [[0, 0, 1, 1]]
    worker.close()


def test_an_environment_that_lacks_the_detector_is_named(tmp_path):
    with pytest.raises(DetectorError, match=r"own failed: ImportError: No module named 'mmpose' \(own\.py, line"):
        WorkerProcess(worker_command(tmp_path, FAILING), WorkerSettings(model="constructor"))


def test_an_interpreter_that_is_none_is_named(tmp_path):
    command = worker_command(tmp_path, BRIGHTNESS)
    with pytest.raises(DetectorError, match=r"own cannot start: .*nowhere: No such file or directory"):
        WorkerProcess(replace(command, python=tmp_path / "nowhere"))
    other = tmp_path / "other"
    other.write_text("#!/bin/sh\necho this is no Python >&2\n")
    other.chmod(0o755)
    with pytest.raises(DetectorError, match=r"ended with exit code 0. Its last message: this is no Python"):
        WorkerProcess(replace(command, python=other))


def test_text_that_the_environment_prints_first_is_skipped(tmp_path):
    noisy = tmp_path / "noisy"
    noisy.write_text(f'#!/bin/sh\necho a greeting\nprintf "without end of line"\nexec {sys.executable} "$@"\n')
    noisy.chmod(0o755)
    worker = WorkerProcess(replace(worker_command(tmp_path, BRIGHTNESS), python=noisy))
    assert len(worker.detect(images(1))) == 1
    worker.close()


def test_nothing_remains_after_closing(tmp_path):
    WorkerProcess(worker_command(tmp_path, BRIGHTNESS)).close()
    before = open_files()
    for _ in range(3):
        worker = WorkerProcess(worker_command(tmp_path, BRIGHTNESS))
        worker.detect(images(1, size=(100, 100)))
        worker.close()
    del worker
    time.sleep(0.1)
    assert open_files() <= before


def test_workers_end_with_the_process_that_started_them(tmp_path):
    """Killed, posefuse cannot close its workers: they end because their pipe does."""
    command = worker_command(tmp_path, BRIGHTNESS)
    script = (
        "import os, signal, sys; from pathlib import Path\n"
        "from posefuse.detection.process import WorkerCommand, WorkerProcess\n"
        f"worker = WorkerProcess(WorkerCommand('own', Path(sys.executable), Path({str(command.file)!r})))\n"
        "print(worker._process.pid, flush=True); os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    ended = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
    pid = int(ended.stdout)
    for _ in range(100):
        status = Path(f"/proc/{pid}/stat")
        if not status.exists() or status.read_text().split()[2] == "Z":
            return
        time.sleep(0.05)
    pytest.fail("the worker is still running")
