"""Files above recordings on an object store."""

from pathlib import Path

import pytest

from posefuse.batch import above
from posefuse.batch.above import with_files_above
from posefuse.errors import CalibrationError, PosefuseWarning
from posefuse.io.calibration import anipose
from posefuse.io.object_stores import name_of, read_stored, write_stored
from posefuse.model.batch import Job
from posefuse.model.options.options import Options
from posefuse.model.options.run import RunOptions
from posefuse.progress import Silent
from posefuse.synthetic.rigs import build_rig
from tests.object_stores import upload_folder


def job(folder, run=None) -> Job:
    return Job("rec", folder, Path("out"), None, Options(), run=run)


def names(jobs) -> list[list[str]]:
    return [sorted(name_of(file.url) for file in each.above) for each in jobs]


def calibration(folder) -> Path:
    folder.mkdir()
    anipose.write(build_rig("ring", 3), folder / "calibration.toml")
    return folder


def test_settings_and_calibrations_above_are_found(bucket, tmp_path):
    for name in ("Config.toml", "notes.txt", "session/board.toml", "session/calib/cam1.mp4", "session/walk/a.json"):
        write_stored(f"{bucket}/{name}", b"x")
    upload_folder(calibration(tmp_path / "calib"), f"{bucket}/session/calib")
    local = job(tmp_path)
    found = with_files_above([job(f"{bucket}/session/walk"), local], None, Silent())
    assert names(found) == [["Config.toml", "board.toml", "calibration.toml"], []]
    assert found[1] is local
    # Videos of the board are needed where a run calibrates by them, although there is a calibration.
    runs = [RunOptions(), RunOptions(calibration="board")]
    found = with_files_above([job(f"{bucket}/session/walk", run) for run in runs[:1]], None, Silent())
    assert names(found)[0][2:] == ["calibration.toml"]
    found = with_files_above([job(f"{bucket}/session/walk", run) for run in runs[1:]], None, Silent())
    assert names(found)[0][2:] == ["calibration.toml", "cam1.mp4"]


def test_cameras_are_calibrated_once_beside_the_images(bucket, tmp_path, monkeypatch):
    write_stored(f"{bucket}/session/calibration/cam1.mp4", b"video")
    calls = []

    def calibrate(images: Path, board: str, target: Path, _: object) -> Path:
        calls.append((images.name, board, (images / "cam1.mp4").read_bytes()))
        target.write_bytes((calibration(tmp_path / "made") / "calibration.toml").read_bytes())
        target.with_suffix(".html").write_text("report")
        return target

    monkeypatch.setattr(above, "calibrate_images", calibrate)
    todo = [job(f"{bucket}/session/{name}") for name in ("walk", "run")]
    for _ in range(2):
        found = with_files_above(todo, "charuco:7x5,square=30mm", Silent())
        assert names(found) == 2 * [["calibration.html", "calibration.toml"]]
    assert calls == [("calibration", "charuco:7x5,square=30mm", b"video")]
    assert read_stored(f"{bucket}/session/calibration/calibration.html") == b"report"


def test_images_that_do_not_determine_the_cameras_are_a_warning(bucket, monkeypatch):
    write_stored(f"{bucket}/session/calibration/cam1.mp4", b"video")

    def fail(images: Path, *_: object) -> None:
        raise CalibrationError(f"{images} shows no board.")

    monkeypatch.setattr(above, "calibrate_images", fail)
    with pytest.warns(PosefuseWarning, match=f"not calibrated: {bucket}/session/calibration shows no board"):
        found = with_files_above([job(f"{bucket}/session/walk")], "charuco:7x5,square=30mm", Silent())
    assert names(found) == [[]]
