"""Each stage of the tracker is called if its option is on, and not called if it is off."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.people import default_noise, tracker_of
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd
from posefuse.tracking.records import People
from posefuse.tracking.tracker import ArticulatedTracker

STAGES = {
    "fast_motion": ("posefuse.tracking.associate.assign_fast_motion",),
    "partial_detections": ("posefuse.tracking.associate.merge_partial_detections",),
    "single_view": (
        "posefuse.tracking.update.apply_posture_prior",
        "posefuse.tracking.update.apply_height_prior",
        "posefuse.tracking.update.observe_posture",
        "posefuse.tracking.update.observe_height",
    ),
    "reinitialization": (
        "posefuse.tracking.update.is_long_gap",
        "posefuse.tracking.update._reinitialize_displaced_limbs",
    ),
    "camera_monitor": ("posefuse.tracking.manage._monitor_cameras",),
    "identity_audit": ("posefuse.tracking.manage._audit",),
}
FRAMES = 30


@pytest.fixture(scope="module")
def scene() -> CrowdScene:
    return simulate_crowd(CrowdOptions(people=2, duration_s=FRAMES / 25.0, seed=3))


def tracker_without(scene: CrowdScene, *stages: str) -> ArticulatedTracker:
    """Return a tracker with some stages off."""
    options = TrackerOptions()
    for stage in stages:
        options = replace(options, **{stage: replace(getattr(options, stage), enabled=False)})
    whole = Options(tracker=options)
    return tracker_of(scene.rig, scene.detections.skeleton, default_noise(scene.rig, whole), whole)


def run(tracker: ArticulatedTracker, scene: CrowdScene) -> list[People]:
    return [tracker.update(Frame.of(scene.detections, i)) for i in range(FRAMES)]


def counted(monkeypatch: pytest.MonkeyPatch, name: str, calls: list[str]) -> None:
    """Count the calls of a function under its full name."""
    module, function = name.rsplit(".", 1)
    original: Callable[..., object] = getattr(__import__(module, fromlist=[function]), function)

    def wrapper(*args: object, **kwargs: object) -> object:
        calls.append(name)
        return original(*args, **kwargs)

    monkeypatch.setattr(name, wrapper)


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_that_is_off_is_not_called(stage: str, scene: CrowdScene, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    for functions in STAGES.values():
        for name in functions:
            counted(monkeypatch, name, calls)
    run(tracker_without(scene, stage), scene)
    expected = {name for other, functions in STAGES.items() if other != stage for name in functions}
    assert set(calls) == expected


@pytest.mark.parametrize("stage", ["camera_monitor", "identity_audit"])
def test_a_stage_without_a_reason_to_act_changes_nothing(stage: str, scene: CrowdScene) -> None:
    """No camera moved and no people met, so that the tracks are the same with and without the stage."""
    on, off = run(tracker_without(scene), scene), run(tracker_without(scene, stage), scene)
    for one, other in zip(on, off, strict=True):
        assert [person.name for person in one.people] == [person.name for person in other.people]
        for mine, theirs in zip(one.people, other.people, strict=True):
            np.testing.assert_array_equal(mine.points_m, theirs.points_m)


def test_cameras_are_rejected_only_by_the_monitor(scene: CrowdScene) -> None:
    """A view whose pixels are shifted by a large part of the image contradicts the others."""
    kinds = []
    for stages in ((), ("camera_monitor",)):
        tracker, found = tracker_without(scene, *stages), set()
        for i in range(120):
            frame = Frame.of(scene.detections, i % FRAMES if (i // FRAMES) % 2 == 0 else FRAMES - 1 - i % FRAMES)
            pixels = np.where((frame.view == 0)[:, None, None], frame.keypoints_px + 250.0, frame.keypoints_px)
            shifted = replace(frame, keypoints_px=pixels if i > 20 else frame.keypoints_px)
            people = tracker.update(replace(shifted, number=i, time_s=np.full(len(scene.rig), i / 25.0)))
            found |= {event.what for event in people.events}
        kinds.append(found)
    assert "camera_rejected" in kinds[0]
    assert not any(kind.startswith("camera") for kind in kinds[1])
