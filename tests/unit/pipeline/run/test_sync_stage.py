"""Evidence on the start of a run's videos."""

from dataclasses import replace

import posefuse
from posefuse.model.clock_evidence import ClockEvidence
from posefuse.model.options.run import RunOptions
from posefuse.pipeline.run import sync_stage
from posefuse.pipeline.run.inputs import with_inputs
from posefuse.pipeline.run.sync_stage import hear, known_starts
from posefuse.progress import Silent
from tests.tagged_videos import tagged_video


def test_tags_of_videos_give_start_times_that_can_be_wrong(tmp_path):
    for name, created in (("a", "2026-05-01T10:20:30Z"), ("b", "2026-05-01T10:20:38Z")):
        tagged_video(tmp_path / f"{name}.mp4", created=created, n_frames=250)
    plan = posefuse.plan_run(tmp_path, detector=lambda image: None, skeleton="coco_17")
    assert next(stage.text for stage in plan.stages if stage.name == "synchronize") == "by sound, start tags, keypoints"
    evidence = hear(plan, ("a", "b"), Silent())
    first, without = known_starts(plan, evidence)
    assert dict(zip(first.cameras, first.offset_s, strict=True)) == {"b": 8.0}
    assert without.does_nothing
    heard = tuple(ClockEvidence(name, "sound", late, 0.01, 0.0, "") for name, late in (("a", 0.0), ("b", 7.3)))
    (sound,) = known_starts(plan, (*evidence, *heard))
    assert sound.offset_s == (7.3,)
    trusted = posefuse.plan_run(
        tmp_path, RunOptions(synchronize="off"), detector=lambda image: None, skeleton="coco_17"
    )
    assert hear(trusted, ("a", "b"), Silent()) == ()


def test_sound_is_measured_once_for_the_same_videos(tmp_path, monkeypatch):
    monkeypatch.setenv("POSEFUSE_CACHE", str(tmp_path / "cache"))
    for name, n_frames in (("a", 30), ("b", 40)):
        tagged_video(tmp_path / "take" / f"{name}.mp4", n_frames=n_frames)
    plan = posefuse.plan_run(tmp_path / "take", detector=lambda image: None, skeleton="coco_17")
    plan = replace(plan, choices=with_inputs(plan))
    calls = []

    def measured(videos, progress):
        calls.append(tuple(videos))
        return tuple(ClockEvidence(name, "sound", 0.5, 0.01, 0.0, "heard") for name in videos)

    monkeypatch.setattr(sync_stage, "sound_evidence", measured)
    first = hear(plan, ("a", "b"), Silent())
    assert hear(plan, ("a", "b"), Silent()) == first
    assert calls == [("a", "b")]
    tagged_video(tmp_path / "take" / "b.mp4", n_frames=41)
    hear(replace(plan, choices=with_inputs(plan)), ("a", "b"), Silent())
    assert len(calls) == 2
