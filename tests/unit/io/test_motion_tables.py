"""Reading of OpenSim's tables: degrees, radians, names of states, and broken files."""

from pathlib import Path

import numpy as np
import pytest

from posefuse.errors import FileError
from posefuse.io.motion_tables import read_joint_angles

HEADER = "Coordinates\nversion=1\nnRows=2\nnColumns=4\ninDegrees={}\n\nUnits are S.I.\nendheader\n"


def write(folder: Path, text: str) -> Path:
    path = folder / "walk.mot"
    path.write_text(text, "utf-8")
    return path


def test_degrees_are_read_without_translations(tmp_path):
    rows = "time\tpelvis_tilt\tpelvis_tx\tknee_angle_r\n0.0\t-3\t0.1\t10\n0.1\t-4\t0.2\t20\n"
    read = read_joint_angles(write(tmp_path, HEADER.format("yes") + rows))
    assert read.angles == ("pelvis_tilt", "knee_angle_r")
    np.testing.assert_allclose(read.time_s, [0.0, 0.1])
    np.testing.assert_allclose(read.degrees, [[-3.0, 10.0], [-4.0, 20.0]])
    assert read.name == "walk.mot"


def test_radians_and_paths_of_states_are_converted(tmp_path):
    rows = "time /jointset/knee_r/knee_angle_r/value /jointset/knee_r/knee_angle_r/speed\n0 0.5 9\n0.1 1.0 9\n"
    read = read_joint_angles(write(tmp_path, HEADER.format("no") + rows))
    assert read.angles == ("knee_angle_r",)
    np.testing.assert_allclose(read.degrees[:, 0], np.degrees([0.5, 1.0]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time\tknee_angle_r\n0\t1\n", "no line endheader"),
        (HEADER.format("yes"), "no rows"),
        (HEADER.format("yes") + "time knee_angle_r\n0 one\n", "expected numbers"),
        (HEADER.format("yes") + "time knee_angle_r\n0 1 2\n", "expected 2 numbers per row"),
        (HEADER.format("yes") + "frame knee_angle_r\n0 1\n", "no column time"),
        (HEADER.format("yes") + "time pelvis_tx\n0 1\n", "no joint angles"),
    ],
)
def test_other_files_are_refused(tmp_path, text, message):
    with pytest.raises(FileError, match=message):
        read_joint_angles(write(tmp_path, text))
