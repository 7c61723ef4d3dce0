"""Coarse start times by the tags of videos."""

import math

import pytest

from posefuse.model.clock_evidence import ClockEvidence
from posefuse.pipeline.start_tag_evidence import start_tag_evidence
from tests.tagged_videos import tagged_video


def made(folder, kind, *texts):
    return {f"cam_{v}": tagged_video(folder / f"cam_{v}.mp4", n_frames=250, **{kind: text})
            for v, text in enumerate(texts)}  # fmt: skip


def starts_of(evidence):
    return {each.view: each.offset_s for each in evidence}


def test_views_count_from_the_first_one(tmp_path):
    videos = made(tmp_path, "created", "2026-05-01T10:20:33Z", "2026-05-01T10:20:30Z", "")
    found = start_tag_evidence(videos)
    assert starts_of(found) == {"cam_0": 3.0, "cam_1": 0.0}
    assert {each.source for each in found} == {"creation time"}
    assert all(each.sd_s == 1.0 for each in found)


def test_timecodes_return_to_zero_at_midnight(tmp_path):
    videos = made(tmp_path, "timecode", "23:59:58:00", "00:00:02:00")
    assert starts_of(start_tag_evidence(videos)) == pytest.approx({"cam_0": 0.0, "cam_1": 4.0})


def test_tags_take_the_clock_of_the_sound(tmp_path):
    videos = made(tmp_path, "created", "2026-05-01T10:20:33Z", "2026-05-01T10:20:30Z")
    heard = (ClockEvidence("cam_0", "sound", 0.2, 0.01, 0.0, ""),)
    assert starts_of(start_tag_evidence(videos, heard)) == pytest.approx({"cam_0": 0.2, "cam_1": -2.8})


def test_tags_further_apart_than_the_videos_last_are_no_evidence(tmp_path):
    videos = made(tmp_path, "created", "2026-05-01T10:20:33Z", "2026-05-01T11:20:33Z")
    found = start_tag_evidence(videos)
    assert all(math.isnan(each.offset_s) for each in found)
    assert "3600 s apart, but the shortest video lasts 10 s" in found[0].reason


def test_one_tag_says_nothing(tmp_path):
    assert start_tag_evidence(made(tmp_path, "created", "2026-05-01T10:20:33Z", "")) == ()
