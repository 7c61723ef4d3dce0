"""Trajectories of real recordings predict a held-out camera."""

from dataclasses import replace

import pytest
from benchmarks import held_out


@pytest.mark.parametrize(
    ("recording", "frames", "most"),
    [
        ("fly_3cam", 120, 1.02),
        # The rate of 30 Hz is nominal and the edges are not rigid, which limits the gain of smoothing.
        ("sleap_mouse", 60, 1.08),
    ],
)
def test_trajectory_predicts_a_held_out_camera_and_reduces_bone_variation(recording, frames, most, shared_data):
    folder = shared_data(recording).parent
    case = held_out.RECORDINGS[recording](folder)
    case = replace(case, detections=case.detections.frames(0, frames))
    figures = held_out.compare(case, [held_out.over_time])
    actual, each = figures["solved"], figures["measured"]
    assert actual.median_px <= most * each.median_px
    assert actual.p90_px <= max(most, 1.05) * each.p90_px
    assert actual.predicted > 0.8
    assert actual.bones < 0.5 * each.bones
