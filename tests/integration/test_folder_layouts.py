"""Recordings in the folder layouts of other programs are found and matched, and other files are reported."""

import pytest

from posefuse import Options, read_cameras, read_detections
from posefuse.cli.main import main
from posefuse.io.recording import choose_calibration, choose_keypoints, find_recording
from posefuse.preprocess.match_cameras import match_views
from tests.layouts import (
    anipose_session,
    caliscope,
    easymocap,
    freemocap,
    opencap,
    opencap_download,
    opencap_pickles,
)

LAYOUTS = {
    freemocap: ("anipose", "freemocap"),
    anipose_session: ("anipose", "deeplabcut"),
    easymocap: ("easymocap", "easymocap"),
    opencap: ("opencap", "openpose"),
    opencap_pickles: ("opencap", "opencap"),
    opencap_download: ("opencap", "opencap"),
    caliscope: ("caliscope", "caliscope"),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_folder_layout_is_recognized_and_views_match_cameras(layout, tmp_path, capsys):
    layout(tmp_path)
    recording = find_recording(tmp_path)
    assert (recording.calibrations[0].format, recording.keypoints[0].format) == LAYOUTS[layout]
    detections = read_detections(choose_keypoints(recording))
    rig, chosen, _ = match_views(read_cameras(choose_calibration(recording)), detections, Options())
    assert (len(rig), chosen.n_views) == (2, 2)
    main(["inspect", str(tmp_path), "--verbose"])
    output = " ".join(capsys.readouterr().out.split())
    assert f"recognized by: {recording.keypoints[0].recognized_by}" in output
    assert "2 views match 2 cameras; posefuse reconstruct can process this folder" in output
    assert "cannot be read" not in output


def test_freemocap_times_start_at_zero(tmp_path, capsys):
    freemocap(tmp_path)
    main(["inspect", str(tmp_path), "--verbose"])
    output = " ".join(capsys.readouterr().out.split())
    assert "times read as nanoseconds" in output
    assert "rate 25 Hz" in output
    assert "frames 0 to 5, 0.000 to 0.203 s" in output
    assert "images and videos" in output
    assert "spatialXYZ.npy: 3D results" in output
