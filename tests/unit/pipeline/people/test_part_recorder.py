"""Hands and faces tracked behind the bodies: here or in other processes, stored and resumed."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from posefuse.checkpoint import NO_CHECKPOINT
from posefuse.io.checkpoints import CheckpointFolder, digest_of
from posefuse.io.part_content import Packed
from posefuse.model.options.options import Options
from posefuse.parallel import ONE_JOB, Jobs
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.part_recorder import (
    BodyFrames,
    PartFollower,
    PartRecorder,
    frames_of,
    load_parts,
    part_spools,
)
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd

WHOLE = find_skeleton("coco_wholebody_133")
PIECES = ((0, 20), (20, 35), (35, 50))


@pytest.fixture(scope="module")
def tracked() -> tuple[bytes, list[BodyFrames]]:
    """Pickled trackers of parts before the first frame, and the bodies of two people in three pieces."""
    scene = simulate_crowd(CrowdOptions(people=2, cameras=4, duration_s=2.0, skeleton=WHOLE.name))
    tracker = tracker_of(scene.rig, WHOLE, default_noise(scene.rig, Options()), Options())
    parts = pickle.dumps(tracker.parts)
    pieces = []
    for start, stop in PIECES:
        chunk = scene.detections.frames(start, stop)
        times_s = chunk.time_s.max(axis=1)
        found = [tracker.track_bodies(frame).bodies for frame in frames_of(chunk, times_s)]
        pieces.append((chunk, times_s, [each for each in found if each is not None]))
    return parts, pieces


def recorders(parts: bytes, checkpoint) -> list[PartRecorder]:
    trackers = pickle.loads(parts)
    return [PartRecorder(*each) for each in zip(trackers, part_spools(checkpoint, len(trackers)), strict=True)]


def recorded(parts: list[PartRecorder]) -> list[bytes]:
    """All arrays of the records."""
    found = []
    for part in parts:
        for run in part.history.runs(0, part.done):
            found += [np.asarray(each).tobytes() for each in (run.number, run.time_s, *run.state)]
        found += [each.tobytes() for name in sorted(part.shapes) for each in part.shapes[name]]
    assert len(found) > 20
    return found


def checkpoint_in(folder: Path) -> CheckpointFolder:
    return CheckpointFolder(folder / "parts", digest_of({}))


@pytest.fixture(scope="module")
def expected(tracked) -> list[bytes]:
    """What recorders in this process find without a checkpoint."""
    follower = PartFollower(recorders(tracked[0], NO_CHECKPOINT), NO_CHECKPOINT, ONE_JOB)
    for (start, _), piece in zip(PIECES, tracked[1], strict=True):
        follower.follow(start, piece)
    return recorded(follower.wait())


def test_other_processes_find_the_same(tracked, expected, tmp_path):
    checkpoint = checkpoint_in(tmp_path)
    with Jobs(2) as jobs, ThreadPoolExecutor(1) as thread:
        follower = PartFollower(recorders(tracked[0], checkpoint), checkpoint, jobs)
        for (start, _), piece in zip(PIECES, tracked[1], strict=True):
            follower.follow(start, piece)
            follower.begin_save(thread)
        assert recorded(follower.wait()) == expected
    loaded = load_parts(checkpoint, len(WHOLE.parts))
    assert loaded is not None
    assert recorded(loaded) == expected


def test_recorders_ahead_of_the_bodies_wait_for_them(tracked, expected, tmp_path):
    """Hands and faces are stored before the bodies, so an interrupted run can leave them ahead."""
    checkpoint = checkpoint_in(tmp_path)
    follower = PartFollower(recorders(tracked[0], checkpoint), checkpoint, ONE_JOB)
    for (start, _), piece in zip(PIECES[:2], tracked[1], strict=False):
        follower.follow(start, piece)
        follower.save()
    stored = load_parts(checkpoint, len(WHOLE.parts))
    assert stored is not None
    follower = PartFollower(stored, checkpoint, ONE_JOB)
    for (start, _), piece in zip(PIECES[1:], tracked[1][1:], strict=True):
        follower.follow(start, piece)
    assert recorded(follower.wait()) == expected


def test_processes_continue_with_parts_that_are_behind_others(tracked, expected, tmp_path, monkeypatch):
    """A run killed between the stores of two parts leaves only the first one ahead."""
    checkpoint = checkpoint_in(tmp_path)
    follower = PartFollower(recorders(tracked[0], checkpoint), checkpoint, ONE_JOB)
    follower.follow(0, tracked[1][0])
    follower.save()
    follower.follow(20, tracked[1][1])
    store = CheckpointFolder._store

    def killed(self: CheckpointFolder, name: str, content: Packed) -> None:
        if name == "tracking_part_1":
            raise KeyboardInterrupt
        store(self, name, content)

    with monkeypatch.context() as patched:
        patched.setattr(CheckpointFolder, "_store", killed)
        with pytest.raises(KeyboardInterrupt):
            follower.save()
    loaded = load_parts(checkpoint, len(WHOLE.parts))
    assert loaded is not None
    assert [part.done for part in loaded] == [35, 20, 20]
    with Jobs(2) as jobs:
        follower = PartFollower(loaded, checkpoint, jobs)
        for (start, _), piece in zip(PIECES[1:], tracked[1][1:], strict=True):
            follower.follow(start, piece)
        assert recorded(follower.wait()) == expected


def test_interruption_while_results_are_awaited_can_be_repeated(tracked, tmp_path, monkeypatch):
    checkpoint = checkpoint_in(tmp_path)
    with Jobs(2) as jobs:
        follower = PartFollower(recorders(tracked[0], checkpoint), checkpoint, jobs)
        follower.follow(0, tracked[1][0])
        replace, seen = PartFollower._replace, []

        def interrupted(self: PartFollower, i: int, recorder: PartRecorder) -> None:
            seen.append(i)
            if len(seen) == 2:
                raise KeyboardInterrupt
            replace(self, i, recorder)

        monkeypatch.setattr(PartFollower, "_replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            follower.wait()
        follower.wait()
    assert seen == [0, 1, 2]


def test_a_missing_part_is_not_resumed(tracked, tmp_path):
    checkpoint = checkpoint_in(tmp_path)
    PartFollower(recorders(tracked[0], checkpoint), checkpoint, ONE_JOB).save()
    assert load_parts(checkpoint, len(WHOLE.parts)) is not None
    checkpoint.discard("tracking_part_1")
    assert load_parts(checkpoint, len(WHOLE.parts)) is None


def test_bodies_are_not_stored_before_their_parts(tracked, tmp_path, monkeypatch):
    """If parts cannot be stored, the work that needs them does not begin, and the error is raised."""
    checkpoint = checkpoint_in(tmp_path)
    follower = PartFollower(recorders(tracked[0], checkpoint), checkpoint, ONE_JOB)

    def fail(*_: object) -> None:
        raise OSError("full")

    monkeypatch.setattr(CheckpointFolder, "save", fail)
    done = []
    with ThreadPoolExecutor(1) as thread:
        later = follower.begin_save(thread).submit(done.append, 1)
        with pytest.raises(OSError, match="full"):
            later.result()
    assert not done
    with pytest.raises(OSError, match="full"):
        follower.follow(0, tracked[1][0])
