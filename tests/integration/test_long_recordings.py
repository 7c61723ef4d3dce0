"""Long recordings on the command line: killed, interrupted, changed, and gone on with."""

import contextlib
import itertools
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import posefuse
from posefuse.cli.main import main
from posefuse.io.calibration import anipose
from posefuse.io.checkpoints import CheckpointFolder
from posefuse.io.files import CHECKPOINT_FOLDER
from posefuse.io.keypoints import detection_tables
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd

SOURCES = Path(__file__).parents[2] / "src"


def write(folder: Path, seconds: float, rate_hz: float = 25.0, seed: int = 0, skeleton: str = "coco_17") -> Path:
    """A recording of two people before four cameras."""
    options = CrowdOptions(
        people=2, cameras=4, duration_s=seconds, rate_hz=rate_hz, skeleton=skeleton, seed=seed
    )  # fmt: skip
    scene = simulate_crowd(options)
    folder.mkdir()
    anipose.write(scene.rig, folder / "calibration.toml")
    detection_tables.write(scene.detections, folder / "keypoints")
    return folder


def start(recording: Path, output: Path, chunk: int, jobs: int = 1) -> subprocess.Popen[str]:
    """The command in a process of its own."""
    command = ["-m", "posefuse", "reconstruct", str(recording), "-o", str(output), "--chunk-frames", str(chunk)]
    command += ["--jobs", str(jobs)]
    return subprocess.Popen(
        [sys.executable, *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "PYTHONPATH": str(SOURCES)},
        # Background processes ignore SIGINT, and so would their children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def signal_when_file_exists(process: subprocess.Popen[str], path: Path, how: signal.Signals) -> str:
    """Send a signal to a process as soon as a file exists, and return its output."""
    until = time.monotonic() + 300.0
    while not path.exists():
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < until
        time.sleep(0.005)
    process.send_signal(how)
    return process.communicate(timeout=300)[0]


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def two_people(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("long") / "recording", 2.4)


@pytest.fixture(scope="module")
def uninterrupted(two_people, tmp_path_factory) -> Path:
    output = tmp_path_factory.mktemp("long") / "uninterrupted"
    process = start(two_people, output, 20)
    text = process.communicate(timeout=1800)[0]
    assert process.returncode == 0, text
    return output


@pytest.mark.parametrize("jobs", [2, pytest.param(3, marks=pytest.mark.long)])
def test_the_number_of_processes_does_not_change_a_byte(two_people, uninterrupted, tmp_path, jobs):
    process = start(two_people, tmp_path / "out", 20, jobs)
    text = process.communicate(timeout=1800)[0]
    assert process.returncode == 0, text
    assert contents(tmp_path / "out") == contents(uninterrupted)


def test_killed_run_with_hands_and_faces_resumes_with_fewer_processes(tmp_path):
    """Other processes track hands and faces behind the bodies, and are killed with the command."""
    path = write(tmp_path / "recording", 2.4, skeleton="coco_wholebody_133")
    text = start(path, tmp_path / "whole", 20).communicate(timeout=1800)[0]
    assert (tmp_path / "whole" / "reconstruction.nc").exists(), text
    output = tmp_path / "out"
    signal_when_file_exists(start(path, output, 20, 2), output / CHECKPOINT_FOLDER / "tracking.part", signal.SIGKILL)
    process = start(path, output, 20)
    text = process.communicate(timeout=1800)[0]
    assert process.returncode == 0, text
    assert "Resuming from the finished parts" in " ".join(text.split())
    assert contents(output) == contents(tmp_path / "whole")


def test_interruption_leaves_a_partial_result_and_the_parts(run, recording, tmp_path, monkeypatch):
    """Of 30 frames in chunks of 10; the third is interrupted."""
    put = CheckpointFolder.save

    def interrupted(parts: CheckpointFolder, name: str, value: object) -> object:
        if name == "measured_000002":
            raise KeyboardInterrupt
        return put(parts, name, value)

    command = ("reconstruct", recording, "-o", tmp_path / "out", "--chunk-frames", 10, "--solve", "frame")
    with monkeypatch.context() as patched:
        patched.setattr(CheckpointFolder, "save", interrupted)
        code, output, wrong = run(*command)
    assert code == 130
    assert "Partial: made of the first 20 of 30 frames" in " ".join(output.split())
    assert "Interrupted" in wrong
    part = posefuse.read_reconstruction(tmp_path / "out" / "reconstruction.nc")
    assert part.n_frames == 20
    assert "Partial: made of the first 20 of 30 frames" in (tmp_path / "out" / "report.html").read_text("utf-8")
    code, output, wrong = run(*command)
    assert (code, wrong) == (0, "")
    assert "Resuming from the finished parts" in " ".join(output.split())
    whole = posefuse.read_reconstruction(tmp_path / "out" / "reconstruction.nc")
    assert whole.n_frames == 30
    assert whole.layers["measured"].frames(0, 20) == part.layers["measured"].frames(0, 20)
    assert "Partial" not in "".join(whole.provenance.notes)
    assert not (tmp_path / "out" / CHECKPOINT_FOLDER).exists()


def test_interruption_while_files_are_written_resumes_from_the_reconstruction(run, recording, tmp_path, monkeypatch):
    command = ("reconstruct", recording, "--chunk-frames", 10, "--triangulation.min-views", 9, "-o")
    code, _, warned = run(*command, tmp_path / "whole")
    assert code == 0
    assert "min_views lowered from 9" in warned

    def ended(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("posefuse.pipeline.reconstruct_recording.write_outputs", ended)
        assert run(*command, tmp_path / "out")[0] == 130
    kept = {path.name for path in (tmp_path / "out" / CHECKPOINT_FOLDER).rglob("*")}
    assert kept == {"manifest.json", "whole.file", "whole.part"}
    with monkeypatch.context() as patched:
        # Nothing is tracked or triangulated again.
        patched.setattr("posefuse.pipeline.reconstruct_recording.prepare", ended)
        code, output, wrong = run(*command, tmp_path / "out")
    assert (code, wrong) == (0, warned)
    assert "Resuming from the finished parts" in " ".join(output.split())
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


@pytest.mark.long
def test_killed_run_resumes_to_the_same_bytes(run, two_people, uninterrupted, tmp_path):
    output = tmp_path / "out"
    signal_when_file_exists(
        start(two_people, output, 20), output / CHECKPOINT_FOLDER / "frames_60" / "measured_000001.part", signal.SIGKILL
    )
    finished = [path for path in (output / CHECKPOINT_FOLDER).rglob("*.part") if path.name != "tracking.part"]
    before = {path: path.stat().st_mtime_ns for path in finished}
    assert len(before) >= 3
    code, text, _ = run("reconstruct", two_people, "-o", output, "--chunk-frames", 20)
    assert code == 0
    assert "Resuming from the finished parts" in " ".join(text.split())
    assert contents(output) == contents(uninterrupted)


@pytest.mark.long
def test_interrupted_run_leaves_a_result_marked_partial(run, tmp_path):
    recording = write(tmp_path / "recording", 12.0)
    # Tracking may finish before the signal arrives; the result is complete then.
    for attempt in range(10):
        output = tmp_path / f"out_{attempt}"
        text = signal_when_file_exists(
            start(recording, output, 20), output / CHECKPOINT_FOLDER / "tracking.part", signal.SIGINT
        )
        if "Partial" in text:
            break
    assert "Partial: made of the first" in " ".join(text.split())
    result = posefuse.read_reconstruction(output / "reconstruction.nc")
    assert 0 < result.n_frames < 300
    assert result.n_frames % 20 == 0
    assert result.provenance.notes[0].startswith(f"Partial: made of the first {result.n_frames} of 300 frames")
    assert {event.number for event in result.events} <= set(result.frame_numbers.tolist())
    assert "Partial: made of the first" in (output / "report.html").read_text("utf-8")
    for made in (output, tmp_path / "whole"):
        assert run("reconstruct", recording, "-o", made, "--chunk-frames", 20)[0] == 0
    assert contents(output) == contents(tmp_path / "whole")


@pytest.mark.long
def test_checkpoints_of_other_input_are_not_used(run, uninterrupted, two_people, tmp_path):
    path, output = write(tmp_path / "recording", 2.4, seed=1), tmp_path / "out"
    signal_when_file_exists(start(path, output, 20), output / CHECKPOINT_FOLDER / "tracking.part", signal.SIGKILL)
    code, _, wrong = run("reconstruct", two_people, "-o", output, "--chunk-frames", 20)
    assert code == 1
    assert "an unfinished reconstruction of other inputs, options or versions" in " ".join(wrong.split())
    assert run("reconstruct", two_people, "-o", output, "--chunk-frames", 20, "--overwrite")[0] == 0
    assert contents(output) == contents(uninterrupted)


def ended_at(n: int, after: bool, recording: Path, output: Path) -> int:
    """The command in a copy of this process that ends just before or after the n-th file takes its place; its code."""
    copy = os.fork()
    if copy:
        return os.waitstatus_to_exitcode(os.waitpid(copy, 0)[1])
    usual, count = os.replace, itertools.count(1)

    def replace(*paths: object, **more: object) -> None:
        number = next(count)
        if number == n and not after:
            os._exit(9)
        usual(*paths, **more)  # type: ignore[arg-type]
        if number == n:
            os._exit(9)

    os.replace = replace  # type: ignore[assignment]
    with contextlib.suppress(BaseException):
        main(["reconstruct", str(recording), "-o", str(output), "--chunk-frames", "20"])
    os._exit(0)


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that are copies of this one")
def test_run_killed_while_files_are_moved_resumes(run, two_people, uninterrupted, tmp_path):
    """Interrupt before or after each rename: of parts, of result files, and of files moved to the output folder."""
    n, output = 1, tmp_path / "out"
    while ended_at(n, n % 2 == 0, two_people, output) == 9:
        assert run("reconstruct", two_people, "-o", output, "--chunk-frames", 20)[0] == 0
        assert contents(output) == contents(uninterrupted)
        shutil.rmtree(output)
        n += 1
    assert n > 30


@pytest.mark.long
def test_run_killed_twenty_times_resumes_to_the_same_bytes(tmp_path):
    """The process is killed at random times: during tracking, triangulation and writing."""
    recording = write(tmp_path / "recording", 300.0)
    whole, output = tmp_path / "whole", tmp_path / "out"
    begin = time.monotonic()
    with start(recording, whole, 256) as process:
        assert process.wait(timeout=3600) == 0
    took_s = time.monotonic() - begin
    draw, kills = random.Random(0), 0
    while kills < 20:
        with start(recording, output, 256) as process:
            try:
                process.wait(timeout=draw.uniform(0.05, 0.5) * took_s)
                # The run finished before it was killed; start the next one.
                assert process.returncode == 0
                assert contents(output) == contents(whole)
            except subprocess.TimeoutExpired:
                process.kill()
                kills += 1
    with start(recording, output, 256) as process:
        assert process.wait(timeout=3600) == 0
    assert contents(output) == contents(whole)


@pytest.mark.long
def test_compiled_and_cached_kernels_give_the_same_bytes(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    recording = write(tmp_path / "recording", seconds=3.0)
    written = []
    for name in ("compiling", "loading"):
        process = start(recording, tmp_path / name, chunk=40)
        output = process.communicate()[0]
        assert process.returncode == 0, output
        written.append(contents(tmp_path / name))
    assert written[0] == written[1]
