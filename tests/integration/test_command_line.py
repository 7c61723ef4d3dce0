"""The command line from files to files, and a sentence for every bad input."""

import importlib
import json
import os
import re
import shutil
import subprocess
import sys

import ezc3d
import numpy as np
import pytest

import posefuse
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.io.results import trc
from posefuse.model.cameras import CameraRig
from tests.files import anipose_toml, write_openpose

OUTPUTS = [
    "angles.csv", "com.csv", "fingerprint.json", "keypoints.csv", "lengths.csv", "person_1.c3d", "person_1.mot",
    "person_1.trc", "reconstruction.nc", "report.html", "solved.csv",
]  # fmt: skip


def test_reconstruct_writes_a_result_of_files(run, recording, tmp_path):
    out = tmp_path / "out"
    code, output, _ = run("reconstruct", recording, "--output", out, "--solve", "trajectory", "--verbose")
    assert code == 0
    assert sorted(entry.name for entry in out.iterdir()) == OUTPUTS
    assert "30 frames at 30 Hz, 4 cameras, 26 keypoints" in output
    assert "layer solved" in output
    assert "% trajectory" in output
    code, output, _ = run("evaluate", out, tmp_path / "truth.nc")
    assert code == 0
    assert "mean error (MPJPE)" in output
    numbers = json.loads((out / "evaluation.json").read_text())
    assert numbers["median_mm"] < 10
    assert trc.read(out / "person_1.trc").rate_hz == 30
    assert ezc3d.c3d(str(out / "person_1.c3d"))["parameters"]["POINT"]["RATE"]["value"][0] == 30
    assert [line for line in output.splitlines() if len(line) > 80 and str(tmp_path) not in line] == []


def test_same_input_gives_the_same_bytes(run, recording, tmp_path):
    for name in ("one", "two"):
        assert run("reconstruct", recording, "-o", tmp_path / name, "--solve", "trajectory")[0] == 0
    for output in OUTPUTS:
        assert (tmp_path / "one" / output).read_bytes() == (tmp_path / "two" / output).read_bytes(), output
    content = b"".join((tmp_path / "one" / output).read_bytes() for output in OUTPUTS if output != "report.html")
    assert str(tmp_path).encode() not in content


def test_running_again_replaces_the_result_if_asked_to(run, recording, tmp_path):
    out = tmp_path / "out"
    assert run("reconstruct", recording, "-o", out)[0] == 0
    assert run("reconstruct", recording, "-o", out, "--end-s", "0.5")[0] == 1
    assert run("reconstruct", recording, "-o", out, "--end-s", "0.5", "--overwrite")[0] == 0
    assert posefuse.read_reconstruction(out / "reconstruction.nc").n_frames == 15


def test_evaluate_accepts_a_trc_as_truth(run, recording, tmp_path):
    out = tmp_path / "out"
    run("reconstruct", recording, "-o", out)
    posefuse.write(posefuse.read_reconstruction(tmp_path / "truth.nc"), tmp_path / "truth.trc")
    code, output, _ = run("evaluate", out, tmp_path / "truth.trc", "--json", tmp_path / "numbers.json")
    assert code == 0
    assert "against the ground truth, by order: 30 frames" in output
    from_trc = json.loads((tmp_path / "numbers.json").read_text())
    run("evaluate", out, tmp_path / "truth.nc")
    from_nc = json.loads((out / "evaluation.json").read_text())
    assert from_trc["mpjpe_mm"] == pytest.approx(from_nc["mpjpe_mm"], abs=1e-3)


def test_flag_overrides_the_options_file(run, recording, tmp_path):
    path = tmp_path / "options.toml"
    path.write_text("end_s = 0.5\n[triangulation]\nmin_views = 4\n")
    assert run("--options", path, "reconstruct", recording, "-o", tmp_path / "a")[0] == 0
    result = posefuse.read_reconstruction(tmp_path / "a" / "reconstruction.nc")
    assert (result.n_frames, result.options.triangulation.min_views) == (15, 4)
    flags = ["--triangulation.min-views", "2"]
    assert run("--options", path, "reconstruct", recording, "-o", tmp_path / "b", *flags)[0] == 0
    result = posefuse.read_reconstruction(tmp_path / "b" / "reconstruction.nc")
    assert (result.n_frames, result.options.triangulation.min_views) == (15, 2)
    assert run("reconstruct", recording, "-o", tmp_path / "c", "--options", path)[0] == 0
    assert posefuse.read_reconstruction(tmp_path / "c" / "reconstruction.nc").n_frames == 15


def test_cameras_can_be_selected(run, recording, tmp_path):
    assert run("reconstruct", recording, "-o", tmp_path / "a", "--cameras", "cam_3", "cam_0", "cam_1")[0] == 0
    assert posefuse.read_reconstruction(tmp_path / "a" / "reconstruction.nc").rig.names == ("cam_3", "cam_0", "cam_1")
    assert run("reconstruct", recording, "-o", tmp_path / "b", "--exclude-camera", "cam_2")[0] == 0
    assert posefuse.read_reconstruction(tmp_path / "b" / "reconstruction.nc").rig.names == ("cam_0", "cam_1", "cam_3")


def test_calibrated_noise_is_used(run, recording, tmp_path):
    code, out, _ = run("calibrate-noise", recording, "-o", tmp_path / "noise.toml")
    assert code == 0
    assert "cam_3" in out
    assert "Student t" in out
    code, _, _ = run("--options", tmp_path / "noise.toml", "reconstruct", recording, "--output", tmp_path / "out")
    assert code == 0
    noise = posefuse.read_reconstruction(tmp_path / "out" / "reconstruction.nc").noise
    written = posefuse.read_options(tmp_path / "noise.toml")
    assert noise.origin == "calibrated"
    assert tuple(noise.scale_px) == written.noise.scale_px
    assert noise.exponent == written.triangulation.confidence_exponent
    assert (noise.spread, noise.nu) == (written.noise.spread, written.noise.nu)


def test_init_writes_every_option_once(run, tmp_path):
    path = tmp_path / "posefuse.toml"
    assert run("init", path)[0] == 0
    assert "[triangulation]" in path.read_text()
    code, _, output = run("init", path)
    assert code == 1
    assert "already exists" in output


def test_simulate_and_report(run, tmp_path):
    folder = tmp_path / "scene"
    flags = ["--duration-s", "0.5", "--cameras", "3", "--lens", "barrel", "--detector.noise", "gaussian"]
    code, output, _ = run("simulate", "-o", folder, *flags)
    assert code == 0
    assert "15 frames at 30 Hz, 3 cameras, 26 keypoints" in output
    assert sorted(entry.name for entry in folder.iterdir()) == ["calibration.toml", "keypoints.nc", "truth.nc"]
    assert run("reconstruct", folder, "-o", tmp_path / "out")[0] == 0
    assert run("report", tmp_path / "out", "--truth", folder / "truth.nc", "-o", tmp_path / "page.html")[0] == 0
    assert "Comparison with the ground truth" in (tmp_path / "page.html").read_text()


def test_demo(run, tmp_path):
    code, output, _ = run("demo", "-o", tmp_path / "demo")
    assert code == 0
    assert "The report: file://" in output
    words = " ".join(output.split())
    assert "a detector like RTMPose" in words
    assert "half of what was measured on OpenPose" in words
    # The first number that a newcomer reads.
    assert float(re.search(r"beyond 5 cm ([\d.]+) %", words).group(1)) < 5.0
    assert re.search(r"gait: person_1: \d+ steps, .* \(from \d+ strides\)", words)
    assert "Comparison with the ground truth" in (tmp_path / "demo" / "result" / "report.html").read_text()


def test_inspect(run, recording, tmp_path, clean_scene):
    code, output, _ = run("inspect", recording)
    assert code == 0
    for words in ("(anipose)", "up axis z", "(posefuse)", "skeleton halpe_26", "30 Hz", "4 views match 4 cameras"):
        assert words in output
    (recording / "old.toml").write_text("[cam_0]\nmatrix = 3\n")
    code, output, _ = run("inspect", recording)
    assert code == 0
    assert "cannot be read" in " ".join(output.split())
    code, _, output = run("inspect", tmp_path / "recording" / "..")
    assert code == 0
    code, _, output = run("inspect", recording, "--calibration", recording / "old.toml")
    assert code == 1
    assert "The calibration cannot be read" in " ".join(output.split())


def test_formats_and_methods_are_listed(run):
    assert "consensus (default)" in run("methods")[1]
    assert "openpose (read and written)" in run("formats")[1]


def test_flag_value_may_start_with_a_hyphen(run, recording, tmp_path):
    code, _, output = run("reconstruct", recording, "-o", tmp_path / "o", "--up", "-y")
    assert code == 0
    assert "or up is not -y" in " ".join(output.split())  # which it is not
    assert posefuse.read_reconstruction(tmp_path / "o" / "reconstruction.nc").rig.up_axis == "-y"


def test_closed_output_pipe_does_not_lose_the_result(recording, tmp_path):
    code = "import sys; from posefuse.cli.main import main; main(sys.argv[1:])"
    command = (
        f'"{sys.executable}" -c "{code}" reconstruct "{recording}" -o "{tmp_path / "o"}" --solve trajectory | true'
    )
    subprocess.run(["sh", "-c", command], check=True, capture_output=True)
    assert sorted(entry.name for entry in (tmp_path / "o").iterdir()) == OUTPUTS


def test_single_camera_result_is_labeled(run, recording, tmp_path):
    code, output, _ = run("reconstruct", recording, "-o", tmp_path / "o", "--cameras", "cam_1")
    assert code == 0
    assert "1 camera," in output
    assert "coordinates are pixels" in output
    assert "person_1.c3d" not in [entry.name for entry in (tmp_path / "o").iterdir()]
    code, _, output = run("evaluate", tmp_path / "o", tmp_path / "truth.nc")
    assert code == 1
    assert "The result is in px" in output
    layer = posefuse.read_reconstruction(tmp_path / "o" / "reconstruction.nc").layers["measured"]
    points = trc.read(tmp_path / "o" / "person_1.trc").points_m
    np.testing.assert_allclose(points, layer.points_m[:, 0], atol=1e-5)


def test_views_matched_to_wrong_cameras_are_reported(run, recording, tmp_path):
    order = ["cam_1", "cam_0", "cam_2", "cam_3"]
    code, _, output = run("reconstruct", recording, "-o", tmp_path / "o", "--camera-order", *order)
    assert code == 0
    assert "The views do not agree" in output


def test_path_of_a_skeleton_file_is_not_stored(run, recording, tmp_path):
    from posefuse.skeleton.skeletons import find_skeleton

    names = find_skeleton("halpe_26").keypoints
    (tmp_path / "own.toml").write_text(f'name = "own"\nkeypoints = {json.dumps(names)}\n')
    assert run("reconstruct", recording, "-o", tmp_path / "o", "--skeleton", tmp_path / "own.toml")[0] == 0
    for name in ("reconstruction.nc", "keypoints.csv"):
        assert str(tmp_path).encode() not in (tmp_path / "o" / name).read_bytes()


class TestBadInput:
    """Each invalid input gives one sentence with fault, location and remedy, and leaves no partial files."""

    @pytest.fixture
    def refused(self, run, tmp_path):
        def check(*arguments: object, words: list[str], code: int = 1) -> None:
            before = sorted(tmp_path.rglob("*"))
            actual, _, output = run(*arguments)
            assert actual == code
            for word in words:
                assert word in output, output
            assert "Traceback" not in output
            assert sorted(tmp_path.rglob("*")) == before

        return check

    def test_missing_folder(self, refused, tmp_path):
        refused("reconstruct", tmp_path / "nowhere", "-o", tmp_path / "o", words=["No recording at", "nowhere"])

    def test_unwritable_output(self, refused, recording, tmp_path):
        (tmp_path / "file").write_text("mine")
        (tmp_path / "folder").mkdir()
        for place in (tmp_path / "file" / "x", tmp_path / "file"):
            refused("reconstruct", recording, "-o", place, words=["error:", "file"])
            refused("simulate", place, "--duration-s", "0.2", words=["error:", "file"])
        refused("init", tmp_path / "file" / "o.toml", words=["cannot be written"])
        refused("init", tmp_path / "folder", words=["is a folder"])

    def test_no_calibration(self, refused, recording, tmp_path):
        (recording / "calibration.toml").unlink()
        refused(
            "reconstruct",
            recording,
            "-o",
            tmp_path / "o",
            words=["No calibrations found in", "Set --calibration to"],
        )

    def test_no_keypoints(self, refused, recording, tmp_path):
        (recording / "keypoints.nc").unlink()
        refused(
            "reconstruct",
            recording,
            "-o",
            tmp_path / "o",
            words=["No sets of 2D keypoints", "Set --keypoints to"],
        )

    def test_two_calibrations(self, refused, recording, tmp_path):
        (recording / "other.toml").write_text((recording / "calibration.toml").read_text())
        words = ["2 calibrations", "Choose one", "--calibration", "other.toml"]
        refused("reconstruct", recording, "-o", tmp_path / "o", words=words)

    def test_cameras_of_other_names(self, refused, recording, tmp_path):
        text = (recording / "calibration.toml").read_text()
        (recording / "calibration.toml").write_text(re.sub(r'name = "cam_(\d)"', r'name = "gopro \1"', text))
        words = ["View 'cam_0' matches no camera by name", "gopro 0", "--camera-order"]
        refused("reconstruct", recording, "-o", tmp_path / "o", words=words)

    def test_fewer_cameras_than_views(self, refused, recording, tmp_path, clean_scene):
        anipose.write(clean_scene.rig.select(["cam_0", "cam_1", "cam_2"]), recording / "calibration.toml")
        refused("reconstruct", recording, "-o", tmp_path / "o", words=["View 'cam_3' matches no camera by name"])

    def test_truncated_json(self, refused, recording, tmp_path, clean_scene):
        (recording / "keypoints.nc").unlink()
        write_openpose(recording / "pose", clean_scene.detections)
        broken = recording / "pose" / "cam_2_json" / "cam_2_000000000007_keypoints.json"
        broken.write_text(broken.read_text()[:200])
        words = ["cam_2_000000000007_keypoints.json is not complete JSON (200 bytes)", "truncated"]
        refused("reconstruct", recording, "-o", tmp_path / "o", "--rate-hz", "30", words=words)

    def test_no_frame_rate(self, refused, recording, tmp_path, clean_scene):
        (recording / "keypoints.nc").unlink()
        write_openpose(recording / "pose", clean_scene.detections)
        refused("reconstruct", recording, "-o", tmp_path / "o", words=["do not specify their frame rate", "--rate-hz"])

    def test_empty_recording(self, refused, recording, tmp_path):
        (recording / "keypoints.nc").unlink()
        np.save(recording / "points.npy", np.zeros((4, 0, 17, 2)))
        words = ["empty"]
        arguments = ["--skeleton", "coco_17", "--rate-hz", "30", "--camera-order", "cam_0", "cam_1", "cam_2", "cam_3"]
        refused("reconstruct", recording, "-o", tmp_path / "o", *arguments, words=words)

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("1200.0", "0.0", ["'cam_0'", "focal lengths must be positive"]),
            ("1200.0", "nan", ["'cam_0'", "not finite"]),
            ("[cam_0]", "[cam_0", ["calibration.toml is not valid TOML", "truncated"]),
        ],
    )
    def test_broken_calibration(self, old, new, words, refused, recording, tmp_path):
        path = recording / "calibration.toml"
        path.write_text(path.read_text().replace(old, new))
        arguments = ["-o", tmp_path / "o", "--calibration", path]
        refused("reconstruct", recording, *arguments, words=words)

    def test_invalid_rotation_matrix(self, refused, recording, tmp_path, clean_scene):
        text = anipose_toml(clean_scene.rig)
        line = next(line for line in text.splitlines() if line.startswith("rotation"))
        (recording / "calibration.toml").write_text(text.replace(line, "rotation = [[2, 0, 0], [0, 1, 0], [0, 0, 1]]"))
        refused(
            "reconstruct",
            recording,
            "-o",
            tmp_path / "o",
            words=["'cam_0'", "the rotation matrix is not a proper rotation"],
        )

    def test_skeleton_with_other_keypoints(self, refused, recording, tmp_path, clean_scene):
        (recording / "keypoints.nc").unlink()
        write_openpose(recording / "pose", clean_scene.detections)
        arguments = ["--rate-hz", "30", "--skeleton", "coco_17"]
        words = ["has 26 keypoints per person, but skeleton coco_17 has 17"]
        refused("reconstruct", recording, "-o", tmp_path / "o", *arguments, words=words)

    def test_output_that_is_not_a_result(self, refused, recording, tmp_path):
        refused("reconstruct", recording, "-o", recording, words=["already contains other files", "empty folder"])

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (["--triangulation.method", "simpel"], ["got 'simpel'", "Did you mean 'simple'"]),
            (["--pick", "tallest"], ["tallest"]),
            (["--min-vews", "3"], ["--min-vews", "Did you mean --triangulation.min-views?"]),
            (["--fps", "60"], ["--fps", "Did you mean --rate-hz?"]),
            (["--rate-hz", "nan"], ["--rate-hz must be a finite number above 0 Hz, got nan"]),
            (["--rate-hz", "fast"], ["fast"]),
            (["--people", "some"], ["some"]),
        ],
    )
    def test_wrong_flags(self, arguments, words, refused, recording, tmp_path):
        refused("reconstruct", recording, "-o", tmp_path / "o", *arguments, words=words, code=2)

    def test_unknown_keys_in_the_options_file(self, refused, recording, tmp_path):
        path = tmp_path / "options.toml"
        path.write_text("[triangulation]\nmin_vews = 3\n")
        words = ["options.toml: unknown option 'triangulation.min_vews'", "Did you mean 'triangulation.min_views'"]
        refused("--options", path, "reconstruct", recording, "-o", tmp_path / "o", words=words, code=2)

    def test_no_result(self, refused, tmp_path):
        refused("evaluate", tmp_path, tmp_path / "truth.nc", words=["No"])
        refused("report", tmp_path / "nowhere", words=["No result at"])


def test_detections_outside_the_image_are_used(run, recording, tmp_path, clean_scene):
    """Some detectors extrapolate beyond the edge; such keypoints are valid observations."""
    keypoints = np.array(clean_scene.detections.dense()[0])
    keypoints[:, 0] += [5000.0, 0.0]
    from posefuse.model.detections import Detections

    moved = Detections.from_dense(clean_scene.detections.skeleton, clean_scene.rig.names, keypoints, rate_hz=30)
    native.write(moved, recording / "keypoints.nc")
    assert run("reconstruct", recording, "-o", tmp_path / "o")[0] == 0


_HEAVY = ("ezc3d", "h5py", "matplotlib", "numba", "scipy")


def _loaded_of(names, program):
    """Return which of the modules are loaded after a program, and what it printed."""
    program += f"\nimport sys; print('loaded:', *sorted(set({names!r}) & set(sys.modules)))"
    environment = {**os.environ, "COLUMNS": "80"}
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment
    ).stdout
    shown, _, loaded = done.rpartition("loaded:")
    return loaded.split(), shown


@pytest.mark.parametrize("code", ["import posefuse", "import posefuse; posefuse.Options(); posefuse.Camera"])
def test_importing_starts_no_compiler(code):
    assert _loaded_of(_HEAVY, code)[0] == []


@pytest.mark.parametrize("arguments", [["--help"], ["reconstruct", "--help"], ["simulate", "--help"], ["--version"]])
def test_help_starts_no_compiler(arguments):
    program = (
        "from posefuse.cli.main import main\n"
        f"try: main({arguments!r})\n"
        "except SystemExit: pass"
    )  # fmt: skip
    loaded, shown = _loaded_of(_HEAVY, program)
    assert loaded == []
    assert all(len(line) <= 80 for line in shown.splitlines())


def test_list_of_commands_loads_no_options():
    """They load NumPy, which takes as long as the rest."""
    names = ("numpy", "posefuse.model.options.options")
    assert _loaded_of(names, "from posefuse.cli.main import main; main(['--help'])")[0] == []


def test_reconstructing_loads_no_board_calibration():
    program = "import posefuse.pipeline.reconstruct_recording"
    names = ("posefuse.calibration.boards", "posefuse.calibration.people", "matplotlib", "cv2")
    assert _loaded_of(names, program)[0] == []


@pytest.mark.parametrize(("given", "threads"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")])
def test_linear_algebra_has_one_thread_unless_the_user_asks_for_more(given, threads):
    """NumPy reads the variable when it is first imported."""
    program = "import posefuse.cli, os, sys; print('numpy' in sys.modules, os.environ['OPENBLAS_NUM_THREADS'])"
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    actual = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment | given
    ).stdout
    assert actual.split() == ["False", threads]


def test_every_public_name_exists():
    for name in dir(posefuse):
        assert getattr(posefuse, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'recontruct'"):
        _ = posefuse.recontruct


def test_one_person_of_several_stays_longest_in_the_common_volume(run, recording, tmp_path, clean_scene):
    (recording / "keypoints.nc").unlink()
    write_openpose(recording / "pose", clean_scene.detections)
    path = recording / "pose" / "cam_2_json" / "cam_2_000000000007_keypoints.json"
    frame = json.loads(path.read_text())
    frame["people"].append(frame["people"][0])
    path.write_text(json.dumps(frame))
    code, output, _ = run("reconstruct", recording, "-o", tmp_path / "o", "--people", "one", "--rate-hz", "30")
    assert code == 0
    assert "the subject stays longest in the common volume" in " ".join(output.split())
    assert (tmp_path / "o" / "person_1.trc").is_file()


def test_deep_inspection_of_one_camera_states_that_nothing_was_checked(tmp_path, clean_scene, run):
    anipose.write(CameraRig(clean_scene.rig.cameras[:1]), tmp_path / "calibration.toml")
    native.write(clean_scene.detections.views(clean_scene.rig.names[:1]), tmp_path / "keypoints.nc")
    code, out, err = run("inspect", tmp_path, "--deep")
    assert code == 0, err
    assert "nothing checked" in out
    assert "no faults found" not in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("report",), "RESULT is missing. posefuse report --help describes it."),
        (("plot", "out"), "--output is missing. posefuse plot --help describes it."),
        (("plot", "out", "--outptu", "figures"), "Unknown option: --outptu. Did you mean '--output'?"),
        (("calibrate", "a", "b", "-o", "c.toml"), "Unexpected: 'b'. posefuse calibrate --help"),
        (("inspect", "absent"), "This folder is empty."),
        (("inspect", "/absent/folder"), "error: No recording at /absent/folder. / contains:"),
        (("inspect", "s3://bucket/take_1"), "error: s3://bucket/take_1 is a URL, which only posefuse batch"),
        (("demo", "--output=gs://bucket/demo"), "error: gs://bucket/demo is a URL, which only posefuse batch"),
        (("warm-up", "--jobs", "1.5"), "--jobs must be an integer, got '1.5'."),
        (("inspect", ".", "--jobs", "many"), "--jobs must be an integer or 'auto', got 'many'."),
        (("inspect", ".", "--jobs", "0"), '--jobs must be at least 1 or "auto", got 0.'),
        (("inspect", ".", "--chunk-frames", "99.9"), "--chunk-frames must be an integer of at least"),
        (("simulate-people", "s", "--people", "two"), "--people must be an integer, got 'two'."),
    ],
)
def test_beginners_calls_are_explained(words, message, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(*words)
    assert code in (1, 2)
    assert message in " ".join(err.split())


@pytest.mark.parametrize(("command", "resumes"), [("detect", True), ("inspect", False)])
def test_an_interruption_is_stated(command, resumes, run, tmp_path, monkeypatch):
    from posefuse.io import files

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(files, "must_exist", interrupt)
    for name in ("posefuse.io.view_images", "posefuse.io.recording", "posefuse.pipeline.detect"):
        module = importlib.import_module(name)
        if hasattr(module, "must_exist"):
            monkeypatch.setattr(module, "must_exist", interrupt)
    code, _, err = run(command, tmp_path / "absent", *(["-o", tmp_path / "out"] if command == "detect" else []))
    assert code == 130
    assert "Interrupted; no result was written." in err
    assert ("The same command resumes." in " ".join(err.split())) == resumes


def test_inspection_of_many_inputs_fits_a_screen(run, recording):
    for number in range(4):
        shutil.copy(recording / "calibration.toml", recording / f"calibration_{number}.toml")
        shutil.copy(recording / "keypoints.nc", recording / f"keypoints_{number}.nc")
    output = run("inspect", recording)[1]
    assert len(output.splitlines()) <= 25
    assert "25 of 25 pairs match" in output
    assert len(run("inspect", recording, "--verbose")[1].splitlines()) > 100
