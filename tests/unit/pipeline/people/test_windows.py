"""Windows cover a recording, and the frames that influence their bodies; tracking continues from any frame."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.io.checkpoints import CheckpointFolder, digest_of
from posefuse.io.part_content import Packed
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.people.track_recording import (
    continue_tracking,
    first_tracker,
    frame_times,
    track_people,
    tracker_name,
)
from posefuse.pipeline.people.windows import windows_of
from posefuse.progress import Silent
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from tests.properties import examples


@given(
    st.integers(1, 5000), st.floats(5.0, 120.0), st.floats(0.5, 100.0), st.floats(0.01, 40.0), st.integers(1, 600),
    st.integers(0, 99),
)  # fmt: skip
@examples(100)
def test_windows_cover_the_recording_and_the_frames_that_influence_bodies(
    n, rate_hz, window_s, look_ahead_s, chunk, seed
):
    """At a frame rate that varies by a factor of 100."""
    steps_s = np.exp(np.random.default_rng(seed).uniform(-2.3, 2.3, n)) / rate_hz
    times_s = np.cumsum(steps_s)
    actual = windows_of(
        times_s, rate_hz, window_s, Options(chunk_frames=chunk, tracker=TrackerOptions(look_ahead_s=look_ahead_s))
    )
    assert [each.start for each in actual] == [0, *(each.stop for each in actual[:-1])]
    assert actual[-1].stop == n
    for each in actual:
        assert 0 <= each.first <= each.start < each.stop <= each.last <= n
        assert each.start % chunk == 0
        before_s, after_s = max(30.0, look_ahead_s), look_ahead_s + 10.0
        assert each.first == 0 or times_s[each.first - 1] < times_s[each.start] - before_s
        assert each.last == n or times_s[each.last] > times_s[each.stop - 1] + after_s
        assert abs((each.stop - each.start) - n / len(actual)) <= max(chunk, 0.5 * n / len(actual)) + 1


@pytest.mark.parametrize("first", [1, 2, 3, 12])
def test_tracking_continues_while_a_person_is_tentative(first):
    """The person is confirmed in a window, by observations before its first frame."""
    scene = simulate_crowd(CrowdOptions("crowd", people=1, cameras=4, duration_s=2.0, seed=3))
    rig, detections, options = scene.rig, scene.detections, Options(people="many", noise_scale_px=14.0)
    whole = track_people(rig, detections, options, Silent())
    tracker = first_tracker(rig, detections, options)
    for i in range(first):
        tracker.process(Frame.of(detections, i))
    rest = continue_tracking(tracker, detections.frames(first, detections.n_frames), frame_times(detections)[first:])
    expected = np.asarray(whole.recording_tracks.detection)[first:]
    seen = np.asarray(rest.recording_tracks.detection) >= 0
    assert seen[5:].any(axis=(1, 2)).all()
    np.testing.assert_array_equal(np.asarray(rest.recording_tracks.detection)[seen], expected[seen])


@pytest.mark.parametrize("part", ["tracking", "tracking_part_1"])
def test_resumed_run_keeps_stored_trackers(part, tmp_path, monkeypatch):
    """A run is killed when hands and faces are stored, but not the bodies; a tracker was stored in between."""
    scene = simulate_crowd(CrowdOptions(people=2, cameras=4, duration_s=2.0, seed=3, skeleton="coco_wholebody_133"))
    options = Options(people="many", noise_scale_px=14.0, chunk_frames=20)
    place, store = 33, CheckpointFolder._store
    calls: list[str] = []

    def track(folder: Path) -> CheckpointFolder:
        checkpoint = CheckpointFolder(folder, digest_of({}))
        track_people(scene.rig, scene.detections, options, Silent(), checkpoint, stored=(0, place))
        return checkpoint

    def killed(self: CheckpointFolder, name: str, content: Packed) -> None:
        calls.append(name)
        if calls.count(part) == 2:
            raise RuntimeError("killed")
        store(self, name, content)

    whole = track(tmp_path / "whole")
    with monkeypatch.context() as patched:
        patched.setattr(CheckpointFolder, "_store", killed)
        with pytest.raises(RuntimeError, match="killed"):
            track(tmp_path / "resumed")
    assert tracker_name(place) in calls
    resumed = track(tmp_path / "resumed")
    trackers = [checkpoint.load(tracker_name(place)) for checkpoint in (whole, resumed)]
    for one, other in zip(*(tracker.parts for tracker in trackers), strict=True):
        assert len(one.tracks) == 2
        for first, second in zip(one.state, other.state, strict=True):
            np.testing.assert_array_equal(first, second)
