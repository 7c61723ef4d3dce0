"""Timestamps, sound and keypoints are combined, and contradictions are reported."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.fault_scenes import Scene, healthy

from posefuse.diagnostics.recording_check import sync_options
from posefuse.diagnostics.time_offsets import ViewTiming
from posefuse.errors import DetectionsError
from posefuse.model.clock_evidence import ClockEvidence
from posefuse.model.options.options import Options
from posefuse.model.options.sync import SyncOptions
from posefuse.pipeline import sync_evidence
from posefuse.pipeline.sync_evidence import start_times, synchronize

LATE_S = (0.0, 3.21, 0.0, 5.94)
ONE = Options(people="one")


def heard(*offsets_s: float) -> tuple[ClockEvidence, ...]:
    return tuple(
        ClockEvidence(f"cam_{v}", "sound", offset, 0.01 if np.isfinite(offset) else np.nan, 0.0, f"cam_{v}")
        for v, offset in enumerate(offsets_s)
    )


@pytest.fixture(scope="module")
def walk() -> Scene:
    return healthy(3, cameras=4, duration_s=14.0, rate_hz=25.0, activities=("walk",))


@pytest.fixture(scope="module")
def phones(walk):
    """Rig and detections of views that start seconds apart."""
    late = replace(walk, late_s=walk.late_s + np.array(LATE_S))
    return late.watch()


@pytest.fixture(scope="module")
def synchronized(walk):
    return walk.watch()


def offsets_of(sync: SyncOptions) -> dict[str, float]:
    return dict(zip(sync.cameras, sync.offset_s, strict=True))


def test_sound_finds_the_start_and_keypoints_confirm_it(phones):
    found = synchronize(*phones, heard(0.004, 3.205, 0.0, 5.951), ONE)
    assert found.contradictions == ()
    # 4 ms are within the uncertainty of sound, and not corrected.
    assert offsets_of(found.sync) == pytest.approx({"cam_1": 3.21, "cam_3": 5.94}, abs=0.02)
    assert not [finding for finding in found.findings if finding.kind == "time offset"]
    keypoints = {each.view: each.offset_s for each in found.evidence if each.source == "keypoints"}
    assert keypoints == pytest.approx({f"cam_{v}": late for v, late in enumerate(LATE_S)}, abs=0.02)


def tagged(*offsets_s: float) -> tuple[ClockEvidence, ...]:
    return tuple(
        ClockEvidence(f"cam_{v}", "creation time", offset, 1.0, 0.0, "tag") for v, offset in enumerate(offsets_s)
    )


def test_tags_bring_views_near_and_keypoints_measure_the_rest(phones):
    tags = tagged(0.0, 4.0, 0.0, 6.0)
    found = synchronize(*phones, tags, ONE)
    assert found.contradictions == ()
    assert offsets_of(found.sync) == pytest.approx({"cam_1": 3.21, "cam_3": 5.94}, abs=0.02)
    assert sum(each.source == "creation time" for each in found.evidence) == 4


def test_sound_is_preferred_to_tags(phones):
    found = synchronize(*phones, (*tagged(0.0, 30.0, 0.0, 6.0), *heard(0.0, 3.205, 0.0, np.nan)), ONE)
    assert offsets_of(found.sync) == pytest.approx({"cam_1": 3.21, "cam_3": 5.94}, abs=0.02)
    (sentence,) = found.contradictions
    assert sentence == "The creation time of cam_1 is 27 s later than its sound shows. The sound is used."


def test_tags_that_keypoints_contradict_are_not_used(synchronized):
    for wrong_s in (8.0, -5.0):
        found = synchronize(*synchronized, tagged(0.0, wrong_s, 0.0, 0.0), ONE)
        assert found.sync.does_nothing
        assert "not at those by the creation time, which is not used" in found.contradictions[0]


def test_tags_alone_are_too_coarse(synchronized, monkeypatch):
    def fail(*_, **__):
        raise DetectionsError("Nobody moves.")

    monkeypatch.setattr(sync_evidence, "judge_sync", fail)
    tags = tagged(0.0, 4.0, 0.0, 6.0)
    with pytest.raises(DetectionsError, match="Nobody moves"):
        synchronize(*synchronized, tags, ONE)
    found = synchronize(*synchronized, (*tags, *heard(0.0, np.nan, np.nan, 5.94)), ONE)
    assert offsets_of(found.sync) == pytest.approx({"cam_3": 5.94})


def test_wrong_tags_of_views_that_did_not_start_together(walk):
    late = replace(walk, late_s=walk.late_s + np.array((0.0, 1.2, 0.0, 0.0)))
    found = synchronize(*late.watch(), tagged(0.0, 7.0, 0.0, 0.0), ONE)
    assert offsets_of(found.sync) == pytest.approx({"cam_1": 1.2}, abs=0.02)
    assert "which is not used" in found.contradictions[0]


@pytest.mark.long
def test_keypoints_correct_what_sound_missed(phones):
    """The sound of one camera starts 200 ms before its images without saying so."""
    found = synchronize(*phones, heard(0.0, 3.41, 0.0, 5.94), ONE)
    assert offsets_of(found.sync) == pytest.approx({"cam_1": 3.21, "cam_3": 5.94}, abs=0.02)
    (contradiction,) = found.contradictions
    assert "Sound and keypoints contradict each other in cam_1" in contradiction
    assert "earlier than the sound. The keypoints are used." in contradiction


@pytest.mark.long
def test_dubbed_sound_of_people_who_walk_is_not_used(synchronized):
    found = synchronize(*synchronized, heard(0.0, 6.0, 3.0, 9.0), ONE)
    assert found.sync.does_nothing
    (contradiction,) = found.contradictions
    assert "the sound is not used" in contradiction


def verdicts(monkeypatch, *by_call: dict[str, float]) -> None:
    """Replace the examination of keypoints by wrong offsets of views, call by call."""
    remaining = list(by_call)

    def judge(rig, detections, options, **_):
        wrong = remaining.pop(0)
        timings = tuple(
            ViewTiming(name, (0.0,), (wrong.get(name, 0.0),), (0.0,), 0.002, 1.0, name in wrong) for name in rig.names
        )
        return timings, sync_options(timings), ()

    monkeypatch.setattr(sync_evidence, "judge_sync", judge)


def test_keypoints_decide_against_sound_that_is_late(synchronized, monkeypatch):
    verdicts(monkeypatch, {"cam_1": -0.2}, {"cam_1": 1.5})
    found = synchronize(*synchronized, heard(0.0, 3.41, 0.0, 5.94), ONE)
    assert offsets_of(found.sync) == pytest.approx({"cam_1": 3.21, "cam_3": 5.94})
    (contradiction,) = found.contradictions
    assert "cam_1: the keypoints show it 200 ms earlier than the sound. The keypoints are used." in contradiction


def test_sound_that_explains_nothing_is_not_used(synchronized, monkeypatch):
    verdicts(monkeypatch, {"cam_1": 0.9}, {})
    found = synchronize(*synchronized, heard(0.0, 6.0, 3.0, 9.0), ONE)
    assert found.sync.does_nothing
    (contradiction,) = found.contradictions
    assert "the sound is not used" in contradiction


def test_offset_that_begins_later_is_on_the_clock_of_the_view(synchronized, monkeypatch):
    """Keypoints count time after the start by sound; rows of the result count the timestamps of the view."""

    def judge(rig, detections, options, **_):
        timing = ViewTiming("cam_1", (0.0, 7.0), (0.0, 0.04), (0.0, 0.0), 0.002, 1.0, True)
        return (timing,), sync_options((timing,)), ()

    monkeypatch.setattr(sync_evidence, "judge_sync", judge)
    sync = synchronize(*synchronized, heard(0.0, 3.0, 0.0, 0.0), ONE).sync
    assert sync.start_s == (0.0, 4.0)
    assert sync.offset_s == pytest.approx((3.0, 3.04))


def test_timestamps_are_kept_and_compared_with_the_sound(synchronized):
    found = synchronize(*synchronized, heard(2.0, 2.0, 2.01, 2.31), ONE, timestamps="times.csv")
    assert found.sync.does_nothing
    (contradiction,) = found.contradictions
    assert "Sound and timestamps contradict each other in cam_3" in contradiction
    assert "305 ms later than times.csv states" in contradiction
    assert {each.source for each in found.of("cam_0")} == {"timestamps", "sound", "keypoints"}


def test_keypoints_alone_give_what_sync_measured_before(synchronized):
    found = synchronize(*synchronized, (), ONE)
    assert found.sync.does_nothing
    assert {each.source for each in found.evidence} == {"keypoints"}


def test_sound_alone_is_enough_without_calibration():
    found = synchronize(None, None, heard(0.0, 3.2, float("nan")))
    assert offsets_of(found.sync) == {"cam_1": 3.2}
    assert found.timings == ()


def test_keypoints_without_agreement_leave_the_sound(walk):
    rig, detections = walk.watch()
    rng = np.random.default_rng(0)
    pixels = detections.dense()[0]
    scattered = replace(detections, keypoints_px=rng.permutation(pixels.reshape(-1, *pixels.shape[-2:])))
    with pytest.raises(DetectionsError, match="do not agree"):
        synchronize(rig, scattered, heard(*[float("nan")] * 4), ONE)
    found = synchronize(rig, scattered, heard(0.0, 0.5, 0.0, 0.0), ONE)
    assert offsets_of(found.sync) == {"cam_1": 0.5}
    assert all("do not agree" in each.reason for each in found.evidence if each.source == "keypoints")


def test_small_offsets_are_within_the_uncertainty_of_sound():
    assert start_times(heard(0.0, 0.025, -0.02)).does_nothing
    assert start_times(heard(0.0, 0.035)).cameras == ("cam_1",)


def test_views_that_no_source_shows_are_unknown():
    def timing(name: str, sd_s: float) -> ViewTiming:
        return ViewTiming(name, (0.0,), (0.0,), (0.0,), sd_s, 1.0)

    timings = (timing("cam_0", 0.001), timing("cam_1", np.inf), timing("cam_2", np.inf))
    assert sync_evidence.Synchronization(SyncOptions(), SyncOptions(), (), timings=timings).unknown == (
        "cam_1",
        "cam_2",
    )
    found = sync_evidence.Synchronization(SyncOptions(), SyncOptions(), heard(np.nan, 0.0, np.nan), timings=timings)
    assert found.unknown == ("cam_2",)
    assert sync_evidence.Synchronization(SyncOptions(), SyncOptions(), heard(np.nan, 0.0)).unknown == ("cam_0",)
