"""Interrupted work resumes to the same bytes, and parts of other work are not used."""

import errno
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posefuse
from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.errors import FileError
from posefuse.io.checkpoints import CheckpointFolder
from posefuse.io.part_content import Packed
from posefuse.io.results import netcdf
from posefuse.model.lenses import LensModel
from posefuse.model.options.options import Options
from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.parallel import Jobs
from posefuse.pipeline.measured_layer import PARTIAL, finished_chunks, reconstruct_chunks
from posefuse.pipeline.people import track_recording
from posefuse.pipeline.reconstruct import prepare
from posefuse.progress import Silent
from posefuse.synthetic.crowd_options import NO_FAULTS, CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate

CHUNK = 16
MANY = Options(people="many", solve="frame", chunk_frames=CHUNK, noise_scale_px=8.0)
ONE = Options(people="one", solve="trajectory", chunk_frames=CHUNK, noise_scale_px=8.0)
SMOOTHED = replace(MANY, postprocess=PostprocessOptions(smooth=("butterworth",)))


class AsAttribute:
    """Is pickled as an attribute of an object."""

    def __init__(self, owner, name):
        self._given = owner, name

    def __reduce__(self):
        return getattr, self._given


class Ended(BaseException):
    """An exception that no code catches or cleans up after."""


class Ending:
    """A checkpoint that ends the work at a certain part, before or after it is stored."""

    enabled = True

    def __init__(self, checkpoint: Checkpoint, left: list[int], how: type[BaseException], *, after: bool) -> None:
        self.checkpoint, self.left, self.how, self.after = checkpoint, left, how, after

    def save(self, name: str, value: Any) -> Any:
        self.left[0] -= 1
        if self.left[0] == 0 and not self.after:
            raise self.how
        kept = self.checkpoint.save(name, value)
        if self.left[0] == 0:
            raise self.how
        return kept

    def child(self, name: str) -> "Ending":
        return Ending(self.checkpoint.child(name), self.left, self.how, after=self.after)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.checkpoint, name)


@pytest.fixture(scope="module")
def crowd():
    """Two people in 40 frames of four cameras."""
    options = CrowdOptions(people=2, cameras=4, duration_s=1.6, skeleton="coco_17", faults=NO_FAULTS)
    scene = simulate_crowd(options)
    return scene.rig, scene.detections


@pytest.fixture(scope="module")
def walker():
    """One subject in 40 frames of three cameras."""
    scene = simulate(SceneOptions(cameras=3, duration_s=4 / 3))
    return scene.rig, scene.detections


def made(recording, options: Options, path: Path, checkpoint: Checkpoint = NO_CHECKPOINT) -> bytes:
    plan = prepare(*recording, options, Silent(), checkpoint)
    netcdf.write(reconstruct_chunks(plan, Silent(), checkpoint), path)
    return path.read_bytes()


@pytest.fixture(scope="module")
def whole(crowd, tmp_path_factory) -> bytes:
    """Of the crowd, in one go."""
    return made(crowd, MANY, tmp_path_factory.mktemp("whole") / "made.nc")


@pytest.mark.parametrize(("who", "options", "moments", "after"), [
    ("crowd", MANY, (2, 3, 4), True), ("crowd", SMOOTHED, (2, 4, 4), False), ("walker", ONE, (2, 2), False),
])  # fmt: skip
def test_work_interrupted_at_any_moment_resumes_to_the_same_bytes(request, tmp_path, who, options, moments, after):
    """During tracking, measuring, smoothing and solving."""
    recording = request.getfixturevalue(who)
    whole = request.getfixturevalue("whole") if options is MANY else made(recording, options, tmp_path / "whole.nc")
    checkpoint = CheckpointFolder(tmp_path / "parts", "key")
    for moment in moments:
        with pytest.raises(Ended):
            made(recording, options, tmp_path / "made.nc", Ending(checkpoint, [moment], Ended, after=after))
        assert not (tmp_path / "made.nc").exists()
    assert made(recording, options, tmp_path / "made.nc", checkpoint) == whole
    checkpoint.remove()
    assert not (tmp_path / "parts").exists()


def test_finished_work_is_not_repeated(crowd, whole, tmp_path, monkeypatch):
    checkpoint = CheckpointFolder(tmp_path / "parts", "key")
    assert made(crowd, MANY, tmp_path / "made.nc", checkpoint) == whole
    monkeypatch.setattr("posefuse.pipeline.measured_layer.measure", None)
    monkeypatch.setattr("posefuse.tracking.tracker.ArticulatedTracker.track_bodies", None)
    assert made(crowd, MANY, tmp_path / "made.nc", checkpoint) == whole


@pytest.mark.parametrize(("moment", "frames"), [(3, 32), (7, 16)])
def test_interruption_keeps_finished_work(crowd, whole, tmp_path, moment, frames):
    """During tracking the recording ends there; later, the finished chunks become a partial result."""
    checkpoint = CheckpointFolder(tmp_path / "parts", "key")
    ending = Ending(checkpoint, [moment], KeyboardInterrupt, after=False)
    if moment == 3:
        with pytest.warns(UserWarning, match="tracked through 32 of 40 frames"):
            made(crowd, MANY, tmp_path / "part.nc", ending)
    else:
        plan = prepare(*crowd, MANY, Silent(), ending)
        with pytest.raises(KeyboardInterrupt):
            netcdf.write(reconstruct_chunks(plan, Silent(), ending), tmp_path / "part.nc")
        netcdf.write(finished_chunks(plan, checkpoint), tmp_path / "part.nc")
    part = netcdf.read_reconstruction(tmp_path / "part.nc")
    assert part.n_frames == frames
    assert part.provenance.notes[0].startswith(f"{PARTIAL}made of the first {frames} of 40 frames")
    assert {event.number for event in part.events} <= set(part.frame_numbers.tolist())
    assert made(crowd, MANY, tmp_path / "made.nc", checkpoint) == whole


def test_interruption_without_a_checkpoint_is_raised(crowd, monkeypatch):
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("posefuse.tracking.tracker.ArticulatedTracker.track_bodies", interrupted)
    with pytest.raises(KeyboardInterrupt):
        prepare(*crowd, MANY, Silent())


@pytest.fixture
def interruptible():
    """Let SIGINT raise KeyboardInterrupt; a shell starts commands in the background with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no signals for threads")
@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("full", [False, True])
def test_second_interruption_while_a_thread_stores_ends_the_run(crowd, whole, tmp_path, monkeypatch, full):
    """The state is stored all the same; where the disk is full, the error says so."""
    checkpoint, write = CheckpointFolder(tmp_path / "parts", "key"), CheckpointFolder._write
    wait, waits = track_recording._Store.wait, threading.Event()
    interrupt = partial(signal.pthread_kill, threading.main_thread().ident, signal.SIGINT)

    def interrupting(*arguments: Any) -> None:
        time.sleep(0.5)
        interrupt()
        assert waits.wait(60.0)
        if full:
            raise OSError(errno.ENOSPC, "No space left on device")
        time.sleep(0.3)
        interrupt()
        time.sleep(0.3)
        write(*arguments)

    def announced(store: Any) -> None:
        waits.set()
        wait(store)

    with monkeypatch.context() as patch, Jobs(2) as jobs:
        patch.setattr(CheckpointFolder, "_write", interrupting)
        patch.setattr(track_recording._Store, "wait", announced)
        with pytest.raises(FileError, match="No space left") if full else pytest.raises(KeyboardInterrupt):
            track_recording.track_people(*crowd, MANY, Silent(), checkpoint, jobs=jobs)
    stage = checkpoint.load("tracking")
    assert stage is None if full else stage.done == CHUNK
    assert made(crowd, MANY, tmp_path / "made.nc", checkpoint) == whole


KILLED = """
from pathlib import Path
import numpy as np
from posefuse.io.checkpoints import CheckpointFolder
parts = CheckpointFolder(Path({folder!r}), "key")
parts.save("first", np.arange(3))
while True:
    parts.save("second", np.random.default_rng(0).random(3_000_000))
"""


def test_part_is_complete_or_absent(tmp_path):
    """At any time of a SIGKILL."""
    process = subprocess.Popen([sys.executable, "-c", KILLED.format(folder=str(tmp_path / "parts"))])
    until = time.monotonic() + 120.0
    while not (tmp_path / "parts" / "second.part").exists():
        assert process.poll() is None
        assert time.monotonic() < until
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    parts = CheckpointFolder(tmp_path / "parts", "key")
    np.testing.assert_array_equal(parts.load("first"), np.arange(3))
    np.testing.assert_array_equal(parts.load("second"), np.random.default_rng(0).random(3_000_000))


def with_parts(folder: Path) -> CheckpointFolder:
    """CheckpointFolder, in a folder of their own and with a spool, and a file that is made of them."""
    parts = CheckpointFolder(folder / "parts", "key")
    parts.spool("a.b").add([1])
    parts.save("a", [1.0])
    parts.child("frames_2").save("c", [2.0])
    (folder / "made").write_bytes(b"all of it")
    return parts


def test_finished_file_replaces_its_parts(tmp_path):
    parts = with_parts(tmp_path)
    assert parts.load_file(tmp_path / "nothing") is None
    parts.save_file(tmp_path / "made", ("a warning",))
    assert {path.name for path in parts.folder.rglob("*")} == {"manifest.json", "whole.file", "whole.part"}
    (tmp_path / "made").unlink()
    again, others = CheckpointFolder.opened(parts.folder, "key")
    assert again.load_file(tmp_path / "again") == ("a warning",)
    assert ((tmp_path / "again").read_bytes(), others) == (b"all of it", 0)


def test_damaged_or_foreign_finished_file_is_not_restored(tmp_path):
    parts = with_parts(tmp_path)
    parts.save_file(tmp_path / "made")
    assert CheckpointFolder(parts.folder, "other").load_file(tmp_path / "again") is None
    (parts.folder / "whole.file").write_bytes(b"all of 1t")
    assert parts.load_file(tmp_path / "again") is None
    assert not (tmp_path / "again").exists()


def test_parts_are_kept_without_hard_links(tmp_path, monkeypatch):
    parts = with_parts(tmp_path)

    def refused(*_: object) -> None:
        raise PermissionError("no links here")

    monkeypatch.setattr(os, "link", refused)
    parts.save_file(tmp_path / "made")
    assert parts.load("a") == [1.0]
    assert parts.load_file(tmp_path / "again") is None


def test_reconstruct_in_python_resumes_from_parts(tmp_path):
    scene = simulate(SceneOptions(duration_s=2.0, cameras=3, seed=2))
    options = Options(solve="frame", pairs="labels", chunk_frames=20)
    whole = posefuse.reconstruct(scene.rig, scene.detections, options)
    checkpoint = CheckpointFolder(tmp_path / "parts", "key")
    assert posefuse.reconstruct(scene.rig, scene.detections, options, checkpoint=checkpoint) == whole
    parts = sorted((tmp_path / "parts").rglob("measured_*.part"))
    assert len(parts) == -(-scene.detections.n_frames // 20)
    parts[1].unlink()
    before = {path: path.stat().st_mtime_ns for path in parts if path != parts[1]}
    assert posefuse.reconstruct(scene.rig, scene.detections, options, checkpoint=checkpoint) == whole
    assert before == {path: path.stat().st_mtime_ns for path in before}
    assert parts[1].exists()


class TestParts:
    """Parts that a folder returns, and parts that it does not."""

    def test_saved_parts_are_loaded(self, tmp_path):
        parts = CheckpointFolder(tmp_path / "parts", "key")
        assert not parts.contains("a")
        assert parts.load("a") is None
        kept = parts.save("a", {"x": np.arange(5.0)})
        np.testing.assert_array_equal(kept["x"], np.arange(5.0))
        np.testing.assert_array_equal(CheckpointFolder(tmp_path / "parts", "key").load("a")["x"], np.arange(5.0))
        assert parts.child("b").load("a") is None

    def test_parts_of_other_work_are_removed(self, tmp_path):
        CheckpointFolder(tmp_path / "parts", "key").child("sub").save("a", 1)
        parts, others = CheckpointFolder.opened(tmp_path / "parts", "key")
        assert (parts.child("sub").load("a"), others) == (1, 0)
        parts, others = CheckpointFolder.opened(tmp_path / "parts", "another")
        assert (parts.child("sub").load("a"), others) == (None, 1)
        assert not (tmp_path / "parts").exists()

    def test_part_of_another_key_is_not_loaded(self, tmp_path):
        CheckpointFolder(tmp_path / "parts", "key").save("a", 1)
        assert CheckpointFolder(tmp_path / "parts", "another").load("a") is None

    @pytest.mark.parametrize("change", [lambda b: b[:-1], lambda b: b[:-1] + bytes([b[-1] ^ 1]), lambda _: b""])
    def test_damaged_part_is_not_loaded(self, tmp_path, change: Callable[[bytes], bytes]):
        parts = CheckpointFolder(tmp_path / "parts", "key")
        parts.save("a", 1)
        file = tmp_path / "parts" / "a.part"
        file.write_bytes(change(file.read_bytes()))
        assert parts.load("a") is None

    def test_other_files_are_not_removed(self, tmp_path):
        (tmp_path / "parts").mkdir()
        (tmp_path / "parts" / "thesis.txt").write_text("mine")
        with pytest.raises(FileError, match="not parts of a reconstruction"):
            CheckpointFolder.opened(tmp_path / "parts", "key")
        assert (tmp_path / "parts" / "thesis.txt").exists()

    @pytest.mark.parametrize("evil", [os.system, eval, pickle.loads, subprocess.Popen])
    def test_only_records_and_arrays_are_unpickled(self, tmp_path, evil):
        parts = CheckpointFolder(tmp_path / "parts", "key")
        with pytest.raises(pickle.UnpicklingError, match="cannot hold"):
            parts.save("a", evil)
        assert not parts.contains("a")
        parts._store("a", Packed.of(pickle.dumps(evil)))
        with pytest.raises(FileError, match="Its origin is unknown"):
            parts.load("a")

    def test_members_of_enumerations_are_unpickled_as_attributes_of_their_class(self, tmp_path):
        """Early releases of Python 3.11, such as 3.11.2 of Debian 12, store them so."""
        parts = CheckpointFolder(tmp_path / "parts", "key")
        parts.save("a", AsAttribute(LensModel, "FISHEYE"))
        assert parts.load("a") is LensModel.FISHEYE
        for owner, name in ((LensModel, "__class__"), (CheckpointFolder, "save"), (os, "system")):
            with pytest.raises((pickle.UnpicklingError, TypeError), match="cannot (hold|pickle)"):
                parts.save("b", AsAttribute(owner, name))

    def test_part_damaged_at_any_byte_is_not_loaded(self, tmp_path):
        parts = CheckpointFolder(tmp_path / "parts", "key")
        parts.spool("a.b").add(np.arange(3))
        parts.save("a", np.arange(5))
        path = tmp_path / "parts" / "a.part"
        whole = path.read_bytes()
        for at in range(len(whole)):
            path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
            assert parts.load("a") is None, at
        path.write_bytes(whole)
        np.testing.assert_array_equal(parts.load("a"), np.arange(5))

    @pytest.mark.parametrize("at", [0, 9, 17, 40])
    def test_damaged_spool_is_an_error(self, tmp_path, at):
        spool = CheckpointFolder(tmp_path / "parts", "key").spool("a.b")
        place = spool.add(np.arange(3))
        path = tmp_path / "parts" / "a.b.spool"
        damaged = bytearray(path.read_bytes())
        damaged[at] ^= 1
        path.write_bytes(damaged)
        with pytest.raises(FileError, match="damaged at byte 0. Remove .*parts"):
            spool.read(place)

    def test_thread_stores_the_same_part(self, tmp_path):
        parts = CheckpointFolder(tmp_path / "parts", "key")
        spool, value = parts.spool("a.b"), {"numbers": np.arange(3.0)}
        spool.add(1)
        with ThreadPoolExecutor(1) as thread:
            kept, wait = parts.begin_save("a", value, thread)
            later = thread.submit(spool.add, "what no part knows of")
            wait()
        value["numbers"][:] = 0.0
        for each in (kept, parts.load("a")):
            np.testing.assert_array_equal(each["numbers"], np.arange(3.0))
        assert (tmp_path / "parts" / "a.b.spool").stat().st_size == later.result()
        assert NO_CHECKPOINT.begin_save("a", value, thread)[0] is value

    def test_spool_is_truncated_to_the_length_of_its_part(self, tmp_path):
        parts = CheckpointFolder(tmp_path / "parts", "key")
        spool = parts.spool("a.b")
        first = spool.add(np.arange(3))
        parts.save("a", first)
        size = (tmp_path / "parts" / "a.b.spool").stat().st_size
        spool.add("what no part knows of")
        again = CheckpointFolder(tmp_path / "parts", "key")
        place = again.load("a")
        assert (tmp_path / "parts" / "a.b.spool").stat().st_size == size
        np.testing.assert_array_equal(again.spool("a.b").read(place), np.arange(3))
        (tmp_path / "parts" / "a.b.spool").write_bytes(b"short")
        assert again.load("a") is None
        assert not again.contains("a")
