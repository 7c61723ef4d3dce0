"""NWB files: validation and reading by pynwb, reproducible bytes, and errors."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError, ResultError
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus
from tests.properties.test_result_files import some_result
from tests.unit.io.results.test_registry import read_broken

pytest.importorskip("ndx_pose", reason="ndx-pose is an optional package")
pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def people() -> Reconstruction:
    """Two people, one of a name that NWB cannot have; numbers of any kind."""
    return some_result(3, ["anna", "be/n:"], ["nose", "tail", "left/paw", "right_paw"], ["a", "b"], 6)


@pytest.fixture(scope="module")
def file(people, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("nwb") / "points.nwb"
    posefuse.write(people, path)
    return path


def test_validator_reports_no_errors(file):
    import pynwb

    actual = pynwb.validate(path=str(file))
    errors = actual[0] if isinstance(actual, tuple) else actual
    assert list(errors) == []


def test_pynwb_reads_the_written_values(people, file):
    import pynwb

    layer = people.layers["measured"]
    with pynwb.NWBHDF5IO(file, "r") as opened:
        content = opened.read()
        place = content.processing["behavior"]
        assert list(place["Skeletons"]["skeleton"].nodes[:]) == list(people.skeleton.keypoints)
        poses = place["be_n_"]
        series = poses.pose_estimation_series["left_paw"]
        assert (series.unit, series.description, poses.source_software) == ("meters", "left/paw", "posefuse")
        np.testing.assert_array_equal(series.data[:], np.asarray(layer.points_m)[:, 1, 2])
        np.testing.assert_array_equal(series.timestamps[:], people.time_s)
        words = [series.control_description[i] for i in series.control[:]]
        assert words == [PointStatus(code).label for code in np.asarray(layer.status)[:, 1, 2]]
        np.testing.assert_array_equal(place["anna_covariance"].data[:], np.asarray(layer.covariance_m2)[:, 0])
        np.testing.assert_array_equal(place["frame_number"].data[:], people.frame_numbers)
        if hasattr(poses, "pose_estimations"):
            camera = poses.pose_estimations["view_a"].device
            original = people.rig["a"]
            np.testing.assert_allclose(camera.intrinsic_matrix[:], original.matrix, rtol=1e-7)
            np.testing.assert_allclose(camera.rotation_matrix[:], original.rotation, atol=1e-7)
            np.testing.assert_allclose(camera.translation_vector[:], original.translation_m, rtol=1e-6)
            np.testing.assert_allclose(camera.distortion_coefficients[:], original.distortion, rtol=1e-6)


def test_same_result_gives_the_same_bytes(people, file, tmp_path):
    posefuse.write(people, tmp_path / "again.nwb")
    assert (tmp_path / "again.nwb").read_bytes() == file.read_bytes()


def test_names_of_internal_datasets_are_valid(people, tmp_path):
    for names in (["frame_number", "Skeletons"], ["a", "a_covariance"]):
        keypoints = ("view_a", "view_b", "c", "C")
        original = replace(
            people, person_ids=tuple(names), skeleton=replace(people.skeleton, keypoints=keypoints, edges=())
        )
        posefuse.write(original, tmp_path / "x.nwb", overwrite=True)
        points = posefuse.read_points(tmp_path / "x.nwb")
        assert (points.person_ids, points.keypoints) == (tuple(names), keypoints)
        np.testing.assert_array_equal(points.covariance_m2, original.layers["measured"].covariance_m2)
        np.testing.assert_array_equal(points.points_m, original.layers["measured"].points_m)


def test_unrepresentable_results_are_refused(people, tmp_path, monkeypatch):
    untimed = replace(people, time_s=np.full(6, np.nan))
    with pytest.raises(ResultError, match=r"needs the time of every frame.*`rate_hz`"):
        posefuse.write(untimed, tmp_path / "x.nwb")
    monkeypatch.setitem(sys.modules, "ndx_pose", None)
    with pytest.raises(ResultError, match=r"pip install 'posefuse\[nwb\]'"):
        posefuse.write(people, tmp_path / "x.nwb")
    assert list(tmp_path.iterdir()) == []


def test_file_of_another_program_is_refused(tmp_path):
    import h5py

    with h5py.File(tmp_path / "x.nwb", "w") as content:
        content.attrs["nwb_version"] = "2.9.0"
    with pytest.raises(FileError, match="that posefuse did not write; read it with pynwb"):
        posefuse.read_points(tmp_path / "x.nwb")


def test_broken_files_raise_posefuse_errors(tmp_path):
    assert read_broken("nwb", tmp_path / "k", 200) < 200
