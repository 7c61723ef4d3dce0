"""``posefuse compare``, and the figure of the percentile filter, from files to files."""

import csv
import subprocess
import sys

import numpy as np
import pytest

import posefuse
from posefuse.io.keypoints import native
from posefuse.model.options.triangulation import METHODS
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate

FILES = ["comparison.csv", "comparison.png", "comparison.svg"]
FIGURE = "debug/percentile_filter.png"


@pytest.fixture(scope="module")
def ugly_scene():
    """The detector errs as a real one: something to reject."""
    return simulate(SceneOptions(duration_s=1, cameras=4))


@pytest.fixture
def ugly_recording(recording, ugly_scene):
    native.write(ugly_scene.detections, recording / "keypoints.nc")
    return recording


def rows_of(folder):
    with (folder / "comparison.csv").open(encoding="utf-8", newline="") as file:
        return {row["method"]: row for row in csv.DictReader(file)}


def files_in(folder):
    return sorted(entry.relative_to(folder).as_posix() for entry in folder.rglob("*") if entry.is_file())


def test_compare_prints_a_table_and_writes_three_files(run, ugly_recording, tmp_path, ugly_scene, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    posefuse.write(ugly_scene.truth, tmp_path / "truth.nc", overwrite=True)
    out = tmp_path / "out"
    code, output, warned = run("compare", ugly_recording, "-o", out, "--truth", tmp_path / "truth.nc")
    assert (code, warned) == (0, "")
    assert files_in(out) == FILES
    assert all(len(line) <= 80 for line in output.splitlines() if not line.startswith("to /"))
    output = " ".join(output.split())
    for words in ("30 frames at 30 Hz, 4 cameras, 26 keypoints", "it favors methods that reject views",
                  "infinitely large", "CPU: triangulation only", "Against the truth", *METHODS):  # fmt: skip
        assert words in output
    rows = rows_of(out)
    assert list(rows) == list(METHODS)
    for row in rows.values():
        assert float(row["used_views_median_reprojection_error_px"]) > 0
        assert 0 < float(row["cpu_time_ms_per_frame"]) < 1000
        assert 0 < float(row["median_error_against_truth_mm"]) < float(row["p99_error_against_truth_mm"])
    assert float(rows["simple"]["rejected_observations_percent"]) == 0
    assert float(rows["consensus"]["rejected_observations_percent"]) > 0
    assert (rows["simple"]["min_views"], rows["consensus"]["min_views"]) == ("3", "2")


def test_numbers_equal_those_of_reconstruct_and_evaluate(run, ugly_recording, tmp_path, ugly_scene):
    posefuse.write(ugly_scene.truth, tmp_path / "truth.nc", overwrite=True)
    run("compare", ugly_recording, "-o", tmp_path / "out", "--methods", "simple", "--truth", tmp_path / "truth.nc")
    row = rows_of(tmp_path / "out")["simple"]
    run("reconstruct", ugly_recording, "-o", tmp_path / "one", "--triangulation.method", "simple")
    result = posefuse.read_reconstruction(tmp_path / "one" / "reconstruction.nc")
    layer = result.layers["measured"]
    used = layer.view_error_px[:][np.asarray(layer.view_status[:]) == 0]
    assert float(row["used_views_median_reprojection_error_px"]) == pytest.approx(np.median(used), rel=4e-3)
    distance_mm = 1000 * np.linalg.norm(layer.points_m[:] - ugly_scene.truth.layers["measured"].points_m, axis=-1)
    assert float(row["median_error_against_truth_mm"]) == pytest.approx(np.nanmedian(distance_mm), rel=1e-5)


def test_output_is_reproducible_except_for_run_times(run, ugly_recording, tmp_path):
    for name in ("one", "two"):
        arguments = ["-o", tmp_path / name, "--methods", "consensus,simple", "--no-timing"]
        assert run("compare", ugly_recording, *arguments)[0] == 0
    for file in FILES:
        content = (tmp_path / "one" / file).read_bytes()
        assert content == (tmp_path / "two" / file).read_bytes(), file
        assert str(tmp_path).encode() not in content
    assert "cpu_time_ms_per_frame" not in (tmp_path / "one" / "comparison.csv").read_text()
    run("compare", ugly_recording, "-o", tmp_path / "one", "--methods", "consensus", "simple", "--overwrite")
    timed, untimed = rows_of(tmp_path / "one"), rows_of(tmp_path / "two")
    assert list(timed) == ["consensus", "simple"]
    for method, row in timed.items():
        assert float(row.pop("cpu_time_ms_per_frame")) > 0
        assert row == untimed[method]


def test_figures_are_equal_in_another_process(run, ugly_recording, tmp_path):
    arguments = ["compare", str(ugly_recording), "--methods", "simple", "--no-timing", "-o"]
    run(*arguments, tmp_path / "one")
    program = "import sys; from posefuse.cli.main import main; main(sys.argv[1:])"
    subprocess.run([sys.executable, "-c", program, *arguments, str(tmp_path / "two")], check=True, capture_output=True)
    for file in FILES:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes(), file


def test_recording_without_rate_is_compared(run, ugly_recording, tmp_path, ugly_scene):
    keypoints, confidence = (np.moveaxis(array, 1, 0) for array in ugly_scene.detections.dense())
    (ugly_recording / "keypoints.nc").unlink()
    np.savez(ugly_recording / "points.npz", keypoints=keypoints, confidence=confidence, names=ugly_scene.rig.names)
    code, output, _ = run("compare", ugly_recording, "-o", tmp_path / "out", "--methods", "consensus,simple")
    assert code == 0
    assert "jitter" not in output
    assert "median_acceleration_m_per_s2" not in rows_of(tmp_path / "out")["simple"]


def test_method_without_effect_gives_a_note(run, ugly_recording, tmp_path):
    cameras = ["--cameras", "cam_0", "cam_1", "cam_2"]
    code, output, _ = run("compare", ugly_recording, "-o", tmp_path / "out", *cameras)
    output = " ".join(output.split())
    assert code == 0
    assert output.count("weighted_subsets drops no camera: min_views is 3 and the rig has 3 cameras") == 1
    assert output.count("percentile_filter does not run: min_views_left is 3 and the rig has 3 cameras") == 1
    code, output, _ = run(
        "reconstruct", ugly_recording, "-o", tmp_path / "o", "--triangulation.method", "weighted_subsets", *cameras
    )
    assert " ".join(output.split()).count("weighted_subsets drops no camera") == 1


class TestRefused:
    """Errors name fault, location, valid choices and remedy, and leave no partial files."""

    @pytest.fixture
    def refused(self, run, recording, tmp_path):
        def check(*arguments: object, words: list[str], code: int = 1) -> None:
            before = sorted(tmp_path.rglob("*"))
            actual, _, output = run("compare", recording, *arguments)
            assert actual == code
            for word in words:
                assert word in output, output
            assert sorted(tmp_path.rglob("*")) == before

        return check

    def test_misspelled_method_gets_a_suggestion(self, refused, tmp_path):
        words = [
            "unknown method 'simpel'",
            "Did you mean 'simple'?",
            "The methods are: consensus, simple, weighted_subsets",
        ]
        refused("-o", tmp_path / "o", "--methods", "consensus,simpel", words=words, code=2)

    def test_unknown_method_lists_the_valid_ones(self, refused, tmp_path):
        words = ["unknown method 'dlt-svd'", "Choose one of: consensus, simple"]
        refused("-o", tmp_path / "o", "--methods", "dlt-svd", words=words, code=2)

    def test_single_camera(self, refused, tmp_path):
        refused("--cameras", "cam_1", "-o", tmp_path / "o", words=["Only one camera is used", "needs two or more"])

    def test_no_truth(self, refused, tmp_path):
        refused("-o", tmp_path / "o", "--truth", tmp_path / "nowhere.nc", words=["No truth at", "nowhere.nc"])

    def test_output_that_is_not_a_result(self, refused, recording):
        refused("-o", recording, words=["already contains other files"])


class TestFilterFigure:
    def test_figure_is_written_only_for_the_percentile_filter(self, run, ugly_recording, tmp_path):
        out = tmp_path / "out"
        code, output, _ = run("reconstruct", ugly_recording, "-o", out, "--triangulation.method", "percentile_filter")
        assert code == 0
        assert FIGURE in output
        assert (out / FIGURE).read_bytes().startswith(b"\x89PNG")
        first = (out / FIGURE).read_bytes()
        run("reconstruct", ugly_recording, "-o", out, "--triangulation.method", "percentile_filter", "--overwrite")
        assert (out / FIGURE).read_bytes() == first
        code, output, _ = run("reconstruct", ugly_recording, "-o", out, "--overwrite")
        assert FIGURE not in output
        assert not (out / "debug").exists()

    def test_other_files_in_the_folder_are_kept(self, run, ugly_recording, tmp_path):
        out = tmp_path / "out"
        run("reconstruct", ugly_recording, "-o", out, "--triangulation.method", "percentile_filter")
        (out / "debug" / "notes.txt").write_text("mine")
        run("reconstruct", ugly_recording, "-o", out, "--triangulation.method", "percentile_filter", "--overwrite")
        assert sorted(entry.name for entry in (out / "debug").iterdir()) == ["notes.txt", "percentile_filter.png"]
        run("reconstruct", ugly_recording, "-o", out, "--overwrite")
        assert [entry.name for entry in (out / "debug").iterdir()] == ["notes.txt"]

    def test_no_figure_if_nothing_is_filtered(self, run, ugly_recording, tmp_path):
        few = ["--cameras", "cam_0", "cam_1", "cam_2", "--triangulation.method", "percentile_filter"]
        code, output, _ = run("reconstruct", ugly_recording, "-o", tmp_path / "out", *few)
        assert code == 0
        assert "percentile_filter does not run" in output
        assert FIGURE not in files_in(tmp_path / "out")
