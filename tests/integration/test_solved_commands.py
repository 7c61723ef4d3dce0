"""The solved layer, alignment and derived quantities on the command line."""

import csv
from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.io.keypoints import native
from posefuse.io.results import c3d_reading
from posefuse.model.status import Source

SHORT = ("--end-s", "0.6")


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def recording_with_gap(recording):
    """Return the recording with one keypoint missing in all views for four frames."""
    detections = posefuse.read_detections(recording / "keypoints.nc")
    wrist = detections.skeleton.index("left_wrist")
    pixels = np.array(detections.keypoints_px[:])
    starts, views = detections.offsets, detections.n_views
    pixels[starts[6 * views] : starts[10 * views], wrist] = np.nan
    native.write(replace(detections, keypoints_px=pixels), recording / "keypoints.nc")
    return recording


def test_postprocessing_is_recorded_in_all_outputs(run, recording_with_gap, tmp_path):
    out = tmp_path / "out"
    flags = ["--solve", "frame", "--postprocess.fill", "pchip", "--postprocess.smooth", "hampel", "butterworth"]
    code, output, _ = run("reconstruct", recording_with_gap, "-o", out, "--verbose", *SHORT, *flags)
    assert code == 0
    assert "layer solved: triangulated by consensus, then postprocessed" in output.replace("\n", " ")
    assert "% filled" in output
    assert "% smoothed" in output
    wrist = [row for row in rows_of(out / "solved.csv") if row["keypoint"] == "left_wrist"]
    assert [row["source"] for row in wrist[6:10]] == ["filled"] * 4
    assert [row["status"] for row in wrist[6:10]] == ["filled"] * 4
    assert all(row["x_m"] and 0.0 < float(row["sd_x_m"]) < 1.0 for row in wrist[6:10])
    measured = [row for row in rows_of(out / "keypoints.csv") if row["keypoint"] == "left_wrist"]
    assert all(not row["x_m"] for row in measured[6:10])
    assert "layer=solved filled=4" in (out / "person_1.trc").read_text().splitlines()[0]
    residuals = c3d_reading.read(out / "person_1.c3d").residual
    keypoint = posefuse.find_skeleton("halpe_26").index("left_wrist")
    assert (residuals[6:10, keypoint] == 0).all()
    assert (residuals[:6, keypoint] > 0).all()
    assert "% filled" in (out / "report.html").read_text()
    result = posefuse.read_reconstruction(out / "reconstruction.nc")
    assert (result.layers["solved"].source[6:10, 0, keypoint] == Source.FILLED).all()
    code, output, _ = run("explain", out, "--frame", "7", "--person", "person_1", "--recording", recording_with_gap)
    assert code == 0
    assert "1 filled" in output
    assert all(len(line) <= 80 for line in output.splitlines())


def test_aligned_result_is_evaluated_in_the_calibrated_world(run, recording, tmp_path):
    out = tmp_path / "out"
    flags = ["--solve", "frame", "--align", "floor", "--align.preset", "opensim", "--align.origin", "subject"]
    code, output, _ = run("reconstruct", recording, "-o", out, *flags)
    assert code == 0
    assert "feet stand still" in output.replace("\n", " ")
    result = posefuse.read_reconstruction(out / "reconstruction.nc")
    assert result.rig.up_axis == "y"
    assert result.alignment is not None
    nose = result.layers["measured"].points_m[:, 0, result.skeleton.index("nose")]
    assert (nose[:, 1] > 1.2).all()
    code, output, _ = run("evaluate", out, tmp_path / "truth.nc")
    assert code == 0
    assert "compared in the calibration's coordinate system" in output.replace("\n", " ")
    assert "layer measured" in output
    median = next(line for line in output.splitlines() if line.startswith("median "))
    assert float(median.split()[1]) < 10


def test_scaled_result_is_evaluated_at_the_calibrated_scale(run, recording, tmp_path):
    """The given stature is half the true one; errors remain in meters of the calibration."""
    medians, tables = [], []
    for name, flags in (("plain", []), ("small", ["--align", "floor", "--align.height-m", "0.9"])):
        code, output, _ = run("reconstruct", recording, "-o", tmp_path / name, "--solve", "frame", *flags)
        assert code == 0
        code, output, _ = run("evaluate", tmp_path / name, tmp_path / "truth.nc")
        assert code == 0
        medians.append(float(next(line for line in output.splitlines() if line.startswith("median ")).split()[1]))
        code, output, _ = run(
            "compare", recording, "-o", tmp_path / f"compared_{name}", "--truth", tmp_path / "truth.nc",
            "--methods", "consensus,simple", "--no-timing", *flags[2:],
        )  # fmt: skip
        assert code == 0
        tables.append(rows_of(tmp_path / f"compared_{name}" / "comparison.csv"))
    small = posefuse.read_reconstruction(tmp_path / "small" / "reconstruction.nc")
    assert small.alignment is not None
    assert 0.4 < small.alignment.scale < 0.6
    assert medians[0] < 10
    assert medians[1] == pytest.approx(medians[0], abs=0.02)
    assert tables[0] == tables[1]
    assert float(tables[0][0]["median_error_against_truth_mm"]) == pytest.approx(medians[0], rel=0.05)


def test_body_tables_are_written(run, recording, tmp_path):
    out = tmp_path / "out"
    flags = ["--solve", "frame", "--postprocess.smooth", "butterworth", "--subject.mass-table", "winter"]
    code, output, _ = run("reconstruct", recording, "-o", out, *SHORT, *flags, "--subject.mass-kg", "70")
    assert code == 0
    assert "com.csv" in output
    com = rows_of(out / "com.csv")
    assert list(com[0]) == [
        "frame", "time_s", "person", "x_m", "y_m", "z_m", "sd_x_m", "sd_y_m", "sd_z_m", "vx_m_s", "vy_m_s", "vz_m_s",
        "sd_vx_m_s", "sd_vy_m_s", "sd_vz_m_s", "known_share", "filled_share", "layer", "known_mass_kg",
    ]  # fmt: skip
    assert 0.7 < float(com[0]["z_m"]) < 1.2
    assert com[0]["layer"] == "solved"
    assert sum(float(row["mass_kg"]) for row in rows_of(out / "segment_masses.csv")) == pytest.approx(70.0)
    lengths = rows_of(out / "lengths.csv")
    assert {row["near"] for row in lengths} >= {"left_knee", "left_elbow"}
    angles = rows_of(out / "angles.csv")
    assert {row["layer"] for row in angles} == {"solved"}
    knees = [float(row["degrees"]) for row in angles if row["angle"] == "knee_angle_l"]
    assert len(knees) == 18
    assert 0 <= min(knees) <= max(knees) < 120


def test_invalid_requests_are_reported(run, recording, tmp_path):
    code, _, output = run("reconstruct", recording, "-o", tmp_path / "o", "--postprocess.butterworth.cutoff-hz", "20",
                        "--postprocess.smooth", "butterworth")  # fmt: skip
    assert code == 2
    assert "below half the frame rate (15 Hz)" in output
    code, _, output = run("reconstruct", recording, "-o", tmp_path / "o", "--align.forward", "walk", "--up", "z",
                        "--cameras", "cam_1")  # fmt: skip
    assert code == 2
    assert "one camera" in output
