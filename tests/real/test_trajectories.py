"""Real recordings solved as a whole: what a camera that had no part in it sees."""

import pytest
from benchmarks import held_out


@pytest.mark.parametrize(("recording", "frames"), [("fly_3cam", 120), ("sleap_mouse", 60)])
def test_a_camera_left_out_is_foretold_as_well_and_bones_vary_less(recording, frames, shared_data):
    folder = shared_data(recording.partition("/")[0]).parent
    rig, detections = held_out.RECORDINGS[recording](folder)
    figures = held_out.compare(rig, detections.frames(0, frames))
    ours, each = figures["trajectory"], figures["consensus"]
    assert ours.median_px <= 1.02 * each.median_px
    assert ours.foretold > each.foretold - 0.05
    assert ours.bones < 0.5 * each.bones
