"""The project file of a run."""

import tomllib

import pytest

from posefuse import Options
from posefuse.errors import OptionsError
from posefuse.io.options import read_options
from posefuse.io.project import PROJECT_FILE, project_to_toml, read_run
from posefuse.model.options.calibration import CalibrateOptions, PeopleOptions
from posefuse.model.options.detection import DetectOptions
from posefuse.model.options.run import RunInputs, RunOptions

RUN = RunOptions(
    calibration="board", board="charuco:7x5,square=30mm", videos=("a=videos/a=1.mp4",), max_offset_s=3.0,
    detect=DetectOptions(detector="mediapipe", crop=("a=0,0,9,9",)), by_board=CalibrateOptions(lens="fisheye"),
    by_people=PeopleOptions(stature_m=1.8), inputs=RunInputs(("videos/a=1.mp4=00ff",)),
)  # fmt: skip


def test_round_trip(tmp_path):
    path, options = tmp_path / PROJECT_FILE, Options(people="one", rate_hz=60.0)
    path.write_text(project_to_toml(RUN, options))
    assert read_run(path) == (RUN, options)
    assert read_options(path) == options


def test_every_option_of_a_run_is_written():
    written = tomllib.loads(project_to_toml(RunOptions(), Options()))["run"]
    assert {"calibration", "synchronize", "max_offset_s", "videos", "detect", "by_board", "by_people"} <= set(written)


def test_wrong_entries_are_named(tmp_path):
    path = tmp_path / "posefuse.toml"
    path.write_text('[run]\ncalibrate = "board"\n[run.detect]\nevery = 0\n')
    with pytest.raises(OptionsError, match=r"(?s)calibrate.*every must be"):
        read_run(path)
    path.write_text("run = 3\n")
    with pytest.raises(OptionsError, match="must be a table"):
        read_run(path)
