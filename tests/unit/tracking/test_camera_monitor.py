"""Detection of silent cameras."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.options.tracking_stages import CameraMonitorOptions
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.crowd_options import NO_FAULTS, CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd
from posefuse.synthetic.options import CLEAN
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.camera_monitor import CameraMonitor
from posefuse.tracking.settings import TrackerSettings
from tests.unit.tracking.stage_runs import (
    assert_equal_people,
    assert_equal_results,
    clean_scene,
    events_of,
    frames_and_views,
    run_without,
    select_rows,
)

VIEWS = 3
ALL = np.ones(VIEWS, dtype=bool)


@pytest.fixture(scope="module")
def settings() -> TrackerSettings:
    rig = build_rig("ring", VIEWS)
    return TrackerSettings.of(rig, shipped_skeleton("body_20"), NoiseModel(np.full(VIEWS, 4.5), 1.0), TrackerOptions())


def run(settings: TrackerSettings, seconds, dt_s: float = 0.04) -> list[tuple[float, int, bool, str]]:
    """Return the changes and their times for frames given by (duration, recorded, detections, people due)."""
    monitor, changes, time_s = CameraMonitor.new(VIEWS), [], 0.0
    for length_s, recorded, shown, due in seconds:
        for _ in range(round(length_s / dt_s)):
            time_s += dt_s
            monitor.n_due[:] = due
            options = settings.options.camera_monitor
            actual = monitor.update_silence(np.array(recorded), np.array(shown), dt_s, options)
            changes.extend((round(time_s, 3), view, kind == "camera_silent", reason) for view, kind, reason in actual)
    return changes


@pytest.mark.parametrize("dt_s", [0.01, 0.04])
def test_camera_without_frames_is_silent(settings, dt_s):
    gone = np.array([True, False, True])
    output = run(settings, [(1.0, ALL, [1, 1, 1], [1, 1, 1]), (5.0, gone, [1, 0, 1], [1, 0, 1]),
                          (1.0, ALL, [1, 1, 1], [1, 1, 1])], dt_s)  # fmt: skip
    assert [(view, silent) for _, view, silent, _ in output] == [(1, True), (1, False)]
    assert [when for when, *_ in output] == pytest.approx([3.0, 6.2], abs=dt_s + 1e-9)
    assert output[0][3] == "no usable frame for 2.0 s"


def test_camera_without_people_whom_others_show_is_silent(settings):
    output = run(settings, [(1.0, ALL, [2, 2, 2], [2, 2, 2]), (4.0, ALL, [2, 2, 0], [2, 2, 2]),
                          (1.0, ALL, [2, 2, 2], [2, 2, 2])])  # fmt: skip
    assert [(view, silent) for _, view, silent, _ in output] == [(2, True), (2, False)]
    assert "other cameras show people in its image" in output[0][3]


def test_cameras_of_an_empty_room_are_not_silent(settings):
    assert run(settings, [(10.0, ALL, [0, 0, 0], [0, 0, 0])]) == []
    assert run(settings, [(10.0, ALL, [2, 2, 0], [2, 2, 0])]) == []


def test_short_gaps_do_not_make_a_camera_silent(settings):
    pieces = [(1.9, [True, False, True], [1, 0, 1], [1, 0, 1]), (0.04, ALL, [1, 1, 1], [1, 1, 1])]
    assert run(settings, pieces * 4) == []
    short = replace(
        settings, options=replace(settings.options, camera_monitor=CameraMonitorOptions(silent_after_s=0.5))
    )
    assert run(short, pieces[:1])[0][:3] == (0.52, 1, True)


def test_single_detection_does_not_end_the_silence(settings):
    dark = (2.0, ALL, [1, 1, 0], [1, 1, 1])
    output = run(settings, [dark, (0.04, ALL, [1, 1, 1], [1, 1, 1]), dark, dark])
    assert [(view, silent) for _, view, silent, _ in output] == [(2, True)]


def test_alternating_views_are_not_silent(settings):
    turns = [(0.01, np.arange(VIEWS) == v, np.arange(VIEWS) == v, [0, 0, 0]) for _ in range(200) for v in range(VIEWS)]
    assert run(settings, turns, 0.01) == []


@pytest.fixture(scope="module")
def moved_camera() -> CrowdScene:
    """Return two people in three views, of which the first is shifted from 0.4 s on; the second enters at 5 s."""
    options = CrowdOptions(people=2, cameras=3, duration_s=8.0, seed=1, detector=CLEAN, faults=NO_FAULTS)
    scene = simulate_crowd(options)
    frame, view = frames_and_views(scene.detections)
    pixels = np.array(scene.detections.keypoints_px)
    pixels[(frame >= 10) & (view == 0), :, 0] += 300.0
    detections = replace(scene.detections, keypoints_px=pixels)
    return replace(scene, detections=select_rows(detections, (scene.owner == 0) | (frame >= 125)))


def test_stage_rejects_a_camera_that_moved(moved_camera: CrowdScene):
    """A rejected camera no longer counts against a person who enters."""
    on, off = run_without(moved_camera), run_without(moved_camera, "camera_monitor")
    assert [(event.person, event.what) for event in events_of(on, "camera_rejected")] == [("cam_0", "camera_rejected")]
    assert not [event for event in events_of(off) if event.what.startswith("camera")]
    entered_s = [events_of(results, "confirmed")[1].time_s for results in (on, off)]
    assert entered_s[0] < entered_s[1] - 0.3


def test_stage_reports_a_silent_camera():
    scene = clean_scene(people=1, duration_s=4.0)
    frame, view = frames_and_views(scene.detections)
    detections = select_rows(scene.detections, (view != 1) | (frame < 25))
    on, off = (run_without(scene, *stages, detections=detections) for stages in ((), ("camera_monitor",)))
    silent = [event for event in events_of(on) if event.what.startswith("camera")]
    assert [(event.person, event.what) for event in silent] == [("cam_1", "camera_silent")]
    assert silent[0].time_s == pytest.approx(3.0, abs=0.1)
    assert not [event for event in events_of(off) if event.what.startswith("camera")]
    for one, other in zip(on, off, strict=True):
        assert_equal_people(one, other)


def test_stage_does_not_change_results_of_good_cameras():
    scene = clean_scene(people=2, duration_s=3.0)
    assert_equal_results(run_without(scene), run_without(scene, "camera_monitor"))
