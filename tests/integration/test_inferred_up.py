"""A calibration without an up axis: up is inferred from people, and every output says so."""

import json
from dataclasses import replace

import ezc3d
import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest

import posefuse
from posefuse.alignment.apply import aligned_rig
from posefuse.biomechanics.tables import keypoint_angles
from posefuse.io.calibration import anipose
from posefuse.io.results.c3d_reading import read as read_c3d
from posefuse.io.results.rounding import rounded
from posefuse.model.alignment import Alignment
from posefuse.model.up_axis import up_vector
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate

FLAGS = ("--bodies", "fit", "--health", "off", "--end-s", "0.6")


@pytest.fixture
def hidden(recording):
    """Return the recording with a calibration that does not state its up axis, z."""
    calibration = recording / "calibration.toml"
    anipose.write(posefuse.read_cameras(calibration).with_up(None), calibration)
    return recording


@pytest.fixture(scope="module")
def walker():
    return simulate(SceneOptions(duration_s=3, cameras=4, detector=CLEAN))


def plain(text: str) -> str:
    return " ".join(text.split())


def test_every_output_labels_an_inferred_axis(run, hidden, tmp_path):
    out = tmp_path / "out"
    code, output, _ = run("reconstruct", hidden, "-o", out, *FLAGS, "--also", "parquet", "--verbose")
    assert code == 0
    assert "note: Up is inferred from people as z: people are upright, and 4 of 4 cameras are level." in plain(output)
    result = posefuse.read_reconstruction(out / "reconstruction.nc")
    assert result.rig.up_text == "z (inferred)"
    assert result.rig.inferred_up is not None
    assert np.dot(result.rig.inferred_up.direction, (0, 0, 1)) > np.cos(np.radians(12))
    with h5py.File(out / "reconstruction.nc") as file:
        assert (file.attrs["up_axis"], file.attrs["up_axis_source"]) == ("z", "inferred")
    assert "The up axis of the world is z (inferred)" in (out / "report.html").read_text("utf-8")
    assert "world_up=z(inferred)" in (out / "person_1.trc").read_text("utf-8").splitlines()[0]
    parameters = ezc3d.c3d(str(out / "person_1.c3d"))["parameters"]
    assert parameters["POSEFUSE"]["UP_AXIS_SOURCE"]["value"] == ["inferred"]
    assert read_c3d(out / "person_1.c3d").up == "z"
    content = (out / "person_1.glb").read_bytes()
    head = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    assert head["asset"]["extras"]["world_up"] == "z (inferred)"
    metadata = json.loads(pq.read_schema(next(out.glob("*.parquet"))).metadata[b"posefuse"])
    assert metadata["inferred_up"]["direction"] == list(result.rig.inferred_up.direction)


def test_a_stated_axis_is_not_inferred(run, hidden, tmp_path):
    out = tmp_path / "out"
    code, output, _ = run("reconstruct", hidden, "-o", out, *FLAGS, "--up", "y")
    assert code == 0
    assert "inferred" not in output
    assert posefuse.read_reconstruction(out / "reconstruction.nc").rig.up_text == "y"
    assert "inferred" not in (out / "person_1.trc").read_text("utf-8").splitlines()[0]


def test_an_unknown_axis_is_reported_on_the_terminal(run, hidden, tmp_path):
    out = tmp_path / "out"
    code, output, _ = run("reconstruct", hidden, "-o", out, "--health", "off", "--end-s", "0.2")
    assert code == 0
    assert "note: The up axis is unknown, so exports are not rotated: too few people stand upright." in plain(output)
    assert posefuse.read_reconstruction(out / "reconstruction.nc").rig.up_text == "unknown"


@pytest.mark.parametrize("floor", ["keep", "feet"])
def test_alignment_levels_a_tilted_world(walker, floor, tmp_path):
    tilt = Alignment(rotation_about_x(25.0), np.ones(3), up_axis="z")
    rig = aligned_rig(walker.rig, tilt).with_up(None)
    align = posefuse.AlignOptions(floor="feet") if floor == "feet" else posefuse.AlignOptions(origin="subject")
    options = posefuse.Options(bodies="fit", health="off")
    found, level = (
        posefuse.reconstruct(rig, walker.detections, each) for each in (options, replace(options, align=align))
    )
    assert found.rig.up_text == "z (inferred)"
    assert found.rig.inferred_up.angle_deg == pytest.approx(25.0, abs=10.0)
    assert level.rig.up_text == "z (inferred)"
    true_up = level.alignment.rotation @ tilt.rotation @ np.array(up_vector("z"))
    assert np.degrees(np.arccos(true_up[2])) < (12.0 if floor == "keep" else 3.0)
    names, degrees, sds = keypoint_angles(level)
    assert names[0] == "mid_hip.heading"
    np.testing.assert_array_equal(np.isfinite(sds), np.isfinite(degrees))
    posefuse.write(level, tmp_path / "result.nc")
    assert posefuse.read_reconstruction(tmp_path / "result.nc") == rounded(level)


def rotation_about_x(deg: float) -> np.ndarray:
    c, s = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
