"""A real recording: four cameras, OpenPose, one person balancing; another tool's result as reference."""

import csv
import json

import ezc3d
import numpy as np
import pytest

import posefuse
from posefuse.cli.main import main


@pytest.fixture
def trial(shared_data):
    return shared_data("pose2sim") / "balancing_one_person"


def test_both_calibration_files_give_the_same_rig(shared_data):
    """K, R and t agree; the TOML's distortion is the Qualisys file's divided by 64, its converter's slip."""
    folder = shared_data("pose2sim") / "calibration"
    qualisys = posefuse.read_cameras(folder / "Calib.qca.txt")
    toml = posefuse.read_cameras(folder / "Calib_qualisys.toml")
    assert qualisys.names == toml.names
    assert qualisys.up_axis == toml.up_axis == "z"
    for a, b in zip(qualisys.cameras, toml.cameras, strict=True):
        np.testing.assert_allclose(a.matrix, b.matrix, atol=1e-9)
        np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=1e-9)
        assert a.size_px == b.size_px == (1088, 1920)
        np.testing.assert_allclose(np.array(a.distortion), 64.0 * np.array(b.distortion), atol=1e-12)


@pytest.mark.parametrize("calibration", ["Calib.qca.txt", "Calib_qualisys.toml"])
def test_reconstruction_agrees_with_the_reference(calibration, shared_data, trial, tmp_path):
    # The reference weights all cameras alike.
    main(
        [
            "reconstruct", str(trial), "--output", str(tmp_path / "out"), "--rate-hz", "60", "--noise-scale-px", "12",
            "--calibration", str(shared_data("pose2sim") / "calibration" / calibration),
            "--keypoints", str(trial / "pose-associated"),
        ]
    )  # fmt: skip
    reference = trial / "pose-3d" / "S00_P00_T01_BalancingTrial_0-100.trc"
    # The reference consists of points of single frames.
    main(["evaluate", str(tmp_path / "out"), str(reference), "--layer", "measured"])
    numbers = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert len(numbers["median_mm_of"]) == 21
    assert numbers["median_mm"] <= 15
    assert numbers["reprojection_median_px"] <= 14
    result = posefuse.read_reconstruction(tmp_path / "out" / "reconstruction.nc")
    assert np.nanmedian(result.layers["measured"].reprojection_error_px[:]) <= 14
    assert result.skeleton.name == "body_25b"
    assert (result.n_frames, result.rate_hz) == (100, 60)


def test_other_programs_read_rate_units_and_axes_of_exports(shared_data, trial, tmp_path):
    main(
        [
            "reconstruct", str(trial), "--output", str(tmp_path / "out"), "--rate-hz", "60",
            "--calibration", str(shared_data("pose2sim") / "calibration" / "Calib.qca.txt"),
            "--keypoints", str(trial / "pose-associated"),
        ]
    )  # fmt: skip
    lines = (tmp_path / "out" / "person_1.trc").read_text().splitlines()
    header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
    assert (header["DataRate"], header["Units"], header["NumFrames"]) == ("60", "m", "100")
    names = [name for name in lines[3].split("\t")[2:] if name]
    rows = np.array([[float(cell or "nan") for cell in line.split("\t")] for line in lines[6:]])
    heights = np.nanmedian(rows[:, 2:].reshape(100, len(names), 3)[..., 1], axis=0)
    # y is up in a TRC: the head is on top, the heels are at the bottom.
    assert heights[names.index("head_top")] == pytest.approx(heights.max())
    assert heights[names.index("head_top")] - heights[names.index("left_heel")] == pytest.approx(1.6, abs=0.2)
    actual = ezc3d.c3d(str(tmp_path / "out" / "person_1.c3d"))
    point = actual["parameters"]["POINT"]
    assert (point["RATE"]["value"][0], point["UNITS"]["value"]) == (60.0, ["mm"])
    assert point["Y_SCREEN"]["value"] == ["+Z"]
    z = np.nanmedian(actual["data"]["points"][2], axis=1)
    np.testing.assert_allclose(z, 1000 * heights, atol=0.5)


def test_largest_person_is_the_subject(shared_data, trial):
    """The folder before association has up to three people a view; the subject is the one in front."""
    rig = posefuse.read_cameras(shared_data("pose2sim") / "calibration" / "Calib.qca.txt")
    everyone = posefuse.read_detections(trial / "pose")
    alone = posefuse.read_detections(trial / "pose-associated")
    picked = posefuse.reconstruct(rig, everyone, posefuse.Options(pick="largest")).layers["measured"]
    result = posefuse.reconstruct(rig, alone).layers["measured"]
    distance = np.linalg.norm(picked.points_m - result.points_m, axis=-1)
    assert np.nanmedian(distance) < 0.02


def test_two_people_are_distinguished_by_list_index(shared_data):
    detections = posefuse.read_detections(shared_data("pose2sim") / "two_people" / "pose-associated")
    assert set(np.asarray(detections.track_ids).tolist()) == {0, 1}
    assert detections.people_counts.max() == 2


def test_methods_are_compared(shared_data, trial, tmp_path):
    """Views are noisy but right: consensus leaves little out, and the methods that need three views miss a tenth."""
    main(
        [
            "compare", str(trial), "--output", str(tmp_path / "out"), "--rate-hz", "60",
            "--calibration", str(shared_data("pose2sim") / "calibration" / "Calib.qca.txt"),
            "--keypoints", str(trial / "pose-associated"),
            "--methods", "consensus,simple", "--no-timing",
        ]
    )  # fmt: skip
    with (tmp_path / "out" / "comparison.csv").open(encoding="utf-8", newline="") as file:
        consensus, simple = csv.DictReader(file)
    assert float(consensus["missing_points_percent"]) < 1
    assert float(consensus["rejected_observations_percent"]) < 1
    assert float(simple["missing_points_percent"]) > 8
    for row in (consensus, simple):
        assert float(row["used_views_median_reprojection_error_px"]) < 14
        assert float(row["all_detections_median_reprojection_error_px"]) < 15
