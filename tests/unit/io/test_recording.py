"""Search of a recording for calibrations and keypoints, and result folders."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from posefuse.errors import FileError, RecordingError
from posefuse.io.calibration import anipose
from posefuse.io.files import natural_key, replacing_folder
from posefuse.io.folder_locks import exclusive_folder
from posefuse.io.keypoints import native
from posefuse.io.recording import (
    InputPaths,
    camera_like,
    choose_calibration,
    choose_keypoints,
    find_inputs,
    find_recording,
)
from posefuse.model.options.options import Options
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.files import qualisys_xml, write_openpose
from tests.scenes import ring

SCENE = simulate(SceneOptions(skeleton="body_25", duration_s=0.2, cameras=2))


def test_files_in_the_folder_are_found(tmp_path):
    anipose.write(SCENE.rig, tmp_path / "calibration.toml")
    native.write(SCENE.detections, tmp_path / "keypoints.nc")
    recording = find_recording(tmp_path)
    assert choose_calibration(recording) == tmp_path / "calibration.toml"
    assert choose_keypoints(recording) == tmp_path / "keypoints.nc"


def test_layout_of_pose2sim_is_found(tmp_path):
    (tmp_path / "calibration").mkdir()
    (tmp_path / "calibration" / "Calib.qca.txt").write_text(qualisys_xml(ring(2)))
    trial = tmp_path / "trial_1"
    write_openpose(trial / "pose", SCENE.detections)
    (trial / "Config.toml").write_text("[project]\nframe_rate = 30\n")
    recording = find_recording(trial)
    assert choose_calibration(recording).name == "Calib.qca.txt"
    assert choose_keypoints(recording) == trial / "pose"
    assert choose_keypoints(find_recording(tmp_path)) == trial / "pose"


def test_several_candidates_are_listed_with_their_option(tmp_path):
    write_openpose(tmp_path / "pose", SCENE.detections)
    write_openpose(tmp_path / "pose-associated", SCENE.detections)
    anipose.write(SCENE.rig, tmp_path / "old.toml")
    anipose.write(SCENE.rig, tmp_path / "new.toml")
    recording = find_recording(tmp_path)
    with pytest.raises(RecordingError) as error:
        choose_calibration(recording)
    assert "2 calibrations" in str(error.value)
    assert f"`calibration={str(tmp_path / 'new.toml')!r}`  (anipose)" in str(error.value)
    with pytest.raises(RecordingError, match="`keypoints=.*pose-associated'`  .openpose."):
        choose_keypoints(recording)


def test_missing_input_is_an_error_with_the_option(tmp_path):
    (tmp_path / "videos").mkdir()
    (tmp_path / "videos" / "cam.mp4").touch()
    np.save(tmp_path / "lengths.npy", np.zeros((3, 4)))
    recording = find_recording(tmp_path)
    with pytest.raises(RecordingError, match="No calibrations found in .*Set `calibration` to its path"):
        choose_calibration(recording)
    with pytest.raises(RecordingError, match="has a video, but no 2D keypoints.*posefuse run"):
        choose_keypoints(recording)
    (tmp_path / "videos" / "cam.mp4").unlink()
    with pytest.raises(RecordingError, match="No sets of 2D keypoints found in .*Set `keypoints` to its path"):
        choose_keypoints(recording)
    with pytest.raises(FileError, match="No recording at"):
        find_recording(tmp_path / "nowhere")
    (tmp_path / "notes.md").touch()
    with pytest.raises(FileError, match="is neither a calibration nor keypoints"):
        find_recording(tmp_path / "notes.md")


def test_calibration_file_alone_has_no_keypoints(tmp_path):
    anipose.write(SCENE.rig, tmp_path / "calibration.toml")
    recording = find_recording(tmp_path / "calibration.toml")
    assert choose_calibration(recording) == tmp_path / "calibration.toml"
    with pytest.raises(
        RecordingError, match=r"calibration.toml is a file without sets of 2D keypoints\. .*`keypoints`"
    ):
        choose_keypoints(recording)


def test_broken_file_is_skipped_and_others_are_found(tmp_path):
    (tmp_path / "broken.toml").write_text("[cam")
    anipose.write(SCENE.rig, tmp_path / "calibration.toml")
    assert choose_calibration(find_recording(tmp_path)).name == "calibration.toml"


def test_calibration_that_cannot_be_read_is_reported_as_such(tmp_path):
    (tmp_path / "calibration.toml").write_text("[cam_0]\nname = ")
    with pytest.raises(RecordingError, match="which cannot be read.*calibration.toml is not valid TOML"):
        choose_calibration(find_recording(tmp_path))


def test_names_are_sorted_by_number():
    names = ["cam_10", "cam_2", "Cam_1", "cam_a"]
    assert sorted(names, key=natural_key) == ["Cam_1", "cam_2", "cam_10", "cam_a"]


class TestResultFolder:
    def write(self, folder: Path, **files: str) -> None:
        with replacing_folder(folder) as staging:
            for name, text in files.items():
                (staging / name.replace("_", ".")).write_text(text)

    def test_appears_when_complete(self, tmp_path):
        out = tmp_path / "out"
        with replacing_folder(out) as staging:
            (staging / "reconstruction.nc").write_text("1")
            assert not out.exists()
        assert [entry.name for entry in out.iterdir()] == ["reconstruction.nc"]

    def test_is_removed_after_an_error(self, tmp_path):
        out = tmp_path / "out"
        with pytest.raises(RuntimeError), replacing_folder(out) as staging:
            (staging / "reconstruction.nc").write_text("1")
            raise RuntimeError
        assert list(tmp_path.iterdir()) == []

    def test_failed_second_run_leaves_the_first(self, tmp_path):
        out = tmp_path / "out"
        self.write(out, reconstruction_nc="1")
        with pytest.raises(RuntimeError), replacing_folder(out):
            raise RuntimeError
        assert (out / "reconstruction.nc").read_text() == "1"
        assert [entry.name for entry in tmp_path.iterdir()] == ["out"]

    def test_files_of_an_earlier_run_are_removed_and_other_files_stay(self, tmp_path):
        out = tmp_path / "out"
        self.write(out, reconstruction_nc="1", person2_trc="old")
        (out / "my_notes.txt").write_text("mine")
        self.write(out, reconstruction_nc="2")
        assert sorted(entry.name for entry in out.iterdir()) == ["my_notes.txt", "reconstruction.nc"]
        assert (out / "reconstruction.nc").read_text() == "2"

    def test_folders_with_other_files_are_refused(self, tmp_path):
        (tmp_path / "thesis.docx").write_text("precious")
        with pytest.raises(FileError, match=r"already contains other files \(thesis.docx\)"):
            self.write(tmp_path, reconstruction_nc="1")
        with pytest.raises(FileError, match="is a file. Specify a folder"):
            self.write(tmp_path / "thesis.docx", reconstruction_nc="1")


def test_two_runs_do_not_write_to_one_folder(tmp_path):
    """The second fails at once, and the first loses nothing."""
    out = tmp_path / "out"
    with replacing_folder(out) as staging:
        (staging / "reconstruction.nc").write_text("first")
        with (
            pytest.raises(FileError, match="another posefuse process is writing to this folder"),
            replacing_folder(out),
        ):
            pass
    assert (out / "reconstruction.nc").read_text() == "first"
    with replacing_folder(out) as staging:
        (staging / "reconstruction.nc").write_text("third")
    assert (out / "reconstruction.nc").read_text() == "third"


def test_folder_is_locked_until_cleanup_is_done(tmp_path):
    out, after, observed = tmp_path / "out", contextlib.ExitStack(), []

    def read_during_replacement() -> None:
        observed.append((out / "reconstruction.nc").read_text())
        with pytest.raises(FileError, match="another posefuse"), replacing_folder(out):
            pass

    after.callback(read_during_replacement)
    with replacing_folder(out, after=after) as staging:
        (staging / "reconstruction.nc").write_text("1")
    assert observed == ["1"]
    assert list(tmp_path.iterdir()) == [out]


def test_folder_that_disappeared_is_busy(tmp_path):
    out, staging = tmp_path / "out", tmp_path / ".out.partial"
    with pytest.raises(FileError, match="another posefuse"), exclusive_folder(staging, out):
        pass


def test_result_can_be_written_to_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path / "out")
    with replacing_folder(Path()) as staging:
        (staging / "reconstruction.nc").write_text("1")
    assert (tmp_path / "out" / "reconstruction.nc").read_text() == "1"
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("moved", [0, 1, 2])
def test_folder_whose_move_was_interrupted_is_still_a_result(tmp_path, monkeypatch, moved):
    """This also holds for a folder with another marker."""
    out, replace, left = tmp_path / "out", os.replace, [moved]

    def write(text: str) -> None:
        with replacing_folder(out, "batch.json" if (out / "batch.json").exists() else "reconstruction.nc") as staging:
            for name in ("a.csv", "b.trc", "reconstruction.nc"):
                (staging / name).write_text(text)
            (out / "batch.json").unlink(missing_ok=True)

    def ended(*paths: str) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        replace(*paths)

    write("1")
    (out / "batch.json").touch()
    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", ended)
        with pytest.raises(KeyboardInterrupt):
            write("2")
    write("3")
    assert {path.name: path.read_text() for path in out.iterdir()} == dict.fromkeys(
        ("a.csv", "b.trc", "reconstruction.nc"), "3"
    )


def test_lock_of_a_killed_process_is_released(tmp_path):
    out = tmp_path / "out"
    program = (
        "import os, signal, sys; from pathlib import Path; from posefuse.io.files import replacing_folder\n"
        "with replacing_folder(Path(sys.argv[1])): os.kill(os.getpid(), signal.SIGKILL)"
    )
    ended = subprocess.run([sys.executable, "-c", program, str(out)], check=False)
    assert ended.returncode == -signal.SIGKILL
    assert (tmp_path / ".out.partial").is_dir()
    with replacing_folder(out) as staging:
        (staging / "reconstruction.nc").write_text("next")
    assert not (tmp_path / ".out.partial").exists()


class TestFindInputs:
    """Missing choices are reported together, with what to pass."""

    @pytest.fixture
    def ambiguous(self, tmp_path):
        """Return a folder with two calibrations and two sets of keypoints without a frame rate."""
        scene = simulate(SceneOptions(duration_s=0.2, cameras=2, detector=CLEAN))
        for name in ("a", "b"):
            anipose.write(scene.rig, tmp_path / f"{name}.toml")
            write_openpose(tmp_path / name, scene.detections)
        return tmp_path

    def test_all_missing_choices_are_in_one_message(self, ambiguous):
        with pytest.raises(RecordingError) as caught:
            find_inputs(ambiguous)
        message = str(caught.value)
        for words in ("2 calibrations", "2 sets of 2D keypoints", "Add `rate_hz`"):
            assert words in message
        for path in ("a.toml", "b.toml"):
            assert f"`calibration={str(ambiguous / path)!r}`" in message
        for path in ("a", "b"):
            assert f"`keypoints={str(ambiguous / path)!r}`" in message

    def test_choices_that_are_made_are_not_reported(self, ambiguous):
        with pytest.raises(RecordingError) as caught:
            find_inputs(ambiguous, keypoints=ambiguous / "a", options=Options(rate_hz=30.0))
        assert "keypoints" not in str(caught.value)
        assert "`rate_hz`" not in str(caught.value)
        actual = find_inputs(ambiguous, ambiguous / "b.toml", ambiguous / "a")
        assert actual == InputPaths(ambiguous / "b.toml", ambiguous / "a")

    def test_empty_folder(self, tmp_path):
        with pytest.raises(RecordingError, match=r"(?s)No calibrations.*No sets of 2D keypoints"):
            find_inputs(tmp_path)


def test_folder_of_videos_and_other_files_is_searched(tmp_path):
    for name in ("cam_0.avi", "cam_1.MOV", "cam_2.mp4"):
        (tmp_path / name).touch()
    assert camera_like(tmp_path)
    (tmp_path / "calibration.toml").touch()
    assert not camera_like(tmp_path)
