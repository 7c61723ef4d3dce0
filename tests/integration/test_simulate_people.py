"""``posefuse simulate-people``: files that the readers take back as they were made."""

import numpy as np

import posefuse


def test_simulated_files_are_read_back(run, tmp_path):
    folder = tmp_path / "scene"
    flags = ["--scenario", "bumped", "--duration-s", "12", "--people", "2", "--seed", "3", "--faults.track-ids"]
    code, output, _ = run("simulate-people", folder, *flags)
    assert code == 0
    assert "bumped: 2 people, 300 frames at 25 Hz, 5 cameras" in output
    assert "to the end" in output
    assert sorted(entry.name for entry in folder.iterdir()) == ["calibration.toml", "keypoints.nc", "truth.nc"]
    options = posefuse.CrowdOptions("bumped", people=2, duration_s=12.0, seed=3)
    made = posefuse.simulate_crowd(options)
    truth = posefuse.read_reconstruction(folder / "truth.nc")
    assert truth.person_ids == ("person_1", "person_2")
    expected = made.truth.layers["measured"].points_m
    np.testing.assert_allclose(truth.layers["measured"].points_m[:], expected, atol=1e-6)
    assert (np.asarray(posefuse.read_detections(folder / "keypoints.nc").track_ids[:]) >= 0).all()


def test_invalid_scenes_are_refused(run, tmp_path):
    code, _, output = run("simulate-people", tmp_path / "scene", "--scenario", "hug", "--people", "3")
    assert code == 2
    assert "Scenario hug needs 2 people, got 3" in output
