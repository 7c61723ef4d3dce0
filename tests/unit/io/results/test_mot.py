"""MOT files: OpenSim's coordinates of a person, and refusals."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posefuse
from posefuse.errors import ResultError
from posefuse.io.results import mot, netcdf, netcdf_angles
from posefuse.io.results.rounding import rounded
from posefuse.pipeline.joint_angles import joint_angles, with_joint_angles
from tests.unit.pipeline.test_joint_angles import exact


def table(path) -> dict[str, np.ndarray]:
    """Return the columns of a MOT file."""
    lines = path.read_text().splitlines()
    names = lines[lines.index("endheader") + 1].split("\t")
    values = np.array([[float(cell) for cell in line.split("\t")] for line in lines[lines.index("endheader") + 2 :]])
    return dict(zip(names, values.T, strict=True))


def test_the_pelvis_turns_in_the_order_of_opensim(tmp_path):
    result = with_joint_angles(exact("walk")[0])
    angles = result.joint_angles
    assert angles is not None
    written = posefuse.write(result, tmp_path / "a.mot")
    found = table(tmp_path / "a.mot")
    assert written.files == (tmp_path / "a.mot",)
    rotation, to_list, tilt = (angles.degrees[:, 0, angles.index(f"pelvis_{n}")] for n in ("rotation", "list", "tilt"))
    ours = Rotation.from_euler("YXZ", np.stack([rotation, to_list, tilt], axis=1), degrees=True)
    theirs = Rotation.from_euler(
        "ZXY", np.stack([found[f"pelvis_{name}"] for name in ("tilt", "list", "rotation")], axis=1), degrees=True
    )
    between = theirs * ours.inv()
    # The horizontal axes of the file may differ from ours by a constant turn about the vertical.
    assert np.abs(between.as_rotvec()[:, [0, 2]]).max() < 1e-4
    assert np.ptp(np.unwrap(between.as_rotvec()[:, 1])) < 1e-4
    assert found["knee_angle_r"] == pytest.approx(angles.degrees[:, 0, angles.index("knee_angle_r")], abs=1e-4)
    assert 0.6 < found["pelvis_ty"].mean() < 1.3
    assert found["time"][1] == pytest.approx(1.0 / 60.0, abs=1e-6)
    assert "wrist_flex_r" not in found


def test_what_a_file_cannot_hold_is_refused(tmp_path):
    result = exact("walk")[0]
    with pytest.raises(ResultError, match="joint angles"):
        posefuse.write(result, tmp_path / "a.mot")
    angles = with_joint_angles(result)
    with pytest.raises(ResultError, match="up axis"):
        posefuse.write(replace(angles, rig=replace(result.rig, up_axis=None)), tmp_path / "a.mot")
    assert not mot.has_coordinates(result)
    assert not list(tmp_path.iterdir())


def test_netcdf_holds_angles_written_with_it_or_added_to_it(tmp_path):
    result = exact("walk")[0]
    whole = with_joint_angles(result)
    netcdf.write(whole.chunks(50), tmp_path / "with.nc")
    netcdf.write(result.chunks(50), tmp_path / "added.nc")
    netcdf_angles.add(joint_angles(result), tmp_path / "added.nc")
    for name in ("with.nc", "added.nc"):
        assert netcdf.read_reconstruction(tmp_path / name).joint_angles == rounded(whole).joint_angles
    netcdf.write(result.chunks(), tmp_path / "without.nc")
    netcdf_angles.add(iter(()), tmp_path / "without.nc")
    assert netcdf.read_reconstruction(tmp_path / "without.nc").joint_angles is None
