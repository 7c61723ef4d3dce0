"""glTF files: independent readers find the points of the model layer."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from posefuse.io.results import gltf
from tests.figures import RATE_HZ, Gltf, joints_of, points_in_file_axes, posed

SKELETONS = ["body_20", "coco_17", "coco_wholebody_133", "mouse_22", "fly_38"]
BVH_M, GLTF_M = 1e-6, 5e-6
"""A BVH has six decimals of a cm and a degree, glTF single precision: down a chain of some meters."""


@pytest.fixture(scope="module", params=SKELETONS)
def result(request):
    return posed(request.param)


class TestGltf:
    @pytest.mark.parametrize("end", ["glb", "gltf"])
    def test_independent_reader_finds_the_points(self, end, result, tmp_path):
        path = tmp_path / f"a.{end}"
        assert gltf.write(result, "person_1", path) == []
        actual = Gltf(path)
        keypoints, joints = joints_of(result, actual.names)
        seconds = result.time_s - result.time_s[0]
        worlds = actual.worlds(seconds)[..., :3, 3][:, joints]
        np.testing.assert_allclose(worlds, points_in_file_axes(result)[:, keypoints], atol=GLTF_M)

    def test_skin_is_bound_in_the_rest_pose(self, result, tmp_path):
        gltf.write(result, "person_1", tmp_path / "a.glb")
        actual = Gltf(tmp_path / "a.glb")
        inverse = actual.numbers(actual.skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
        rest = actual.worlds(None)[0]
        assert actual.skin.joints == list(range(len(inverse)))
        np.testing.assert_allclose(
            inverse @ rest[actual.skin.joints], np.tile(np.eye(4), (len(inverse), 1, 1)), atol=1e-6
        )
        lowest = rest[actual.skin.joints, 1, 3].min()
        assert lowest == pytest.approx(0.0, abs=1e-6)

    def test_mesh_moves_with_its_joints(self, result, tmp_path):
        gltf.write(result, "person_1", tmp_path / "a.glb")
        actual = Gltf(tmp_path / "a.glb")
        for primitive in actual.file.meshes[0].primitives:
            parts = primitive.attributes
            corners, normals, joints, weights = (
                actual.numbers(each) for each in (parts.POSITION, parts.NORMAL, parts.JOINTS_0, parts.WEIGHTS_0)
            )
            low = actual.file.accessors[parts.POSITION].min
            np.testing.assert_allclose(corners.min(axis=0), low, atol=1e-7)
            np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
            assert (weights == [1, 0, 0, 0]).all()
            assert joints.max() < len(actual.skin.joints)
            triangle = corners.astype(float)[actual.numbers(primitive.indices)[:, 0]].reshape(-1, 3, 3)
            across = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
            assert (np.einsum("ti,ti->t", across, normals[::3]) > 0).all()
            # Sticks are closed surfaces with outward normals, so that their volume is positive.
            assert np.einsum("ti,ti->t", triangle[:, 0], across).sum() > 0

    def test_absence_has_no_keys_and_hides_the_figure(self, tmp_path):
        result = posed(away=(slice(0, 3), slice(10, 14), slice(28, 30)))
        (note,) = gltf.write(result, "person_1", tmp_path / "a.glb")
        assert note == (
            "person_1 is absent in frames 110 to 113: the glTF has no keys there, and the skeleton is scaled to zero."
        )
        actual = Gltf(tmp_path / "a.glb")
        seconds, scales, kind = actual.channel(0, "scale")
        np.testing.assert_allclose(seconds * RATE_HZ, [0, 3, 10, 14, 28], atol=1e-5)
        np.testing.assert_array_equal(scales[:, 0], [0, 1, 0, 1, 0])
        assert kind == "STEP"
        keys = actual.channel(0, "translation")[0]
        present = np.isfinite(result.layers["model"].points_m[:, 0, 0, 0])
        np.testing.assert_allclose(keys, np.flatnonzero(present) / RATE_HZ, atol=1e-6)

    def test_consecutive_quaternions_are_in_one_hemisphere(self, tmp_path):
        gltf.write(posed("body_20", 300, seed=5), "person_1", tmp_path / "a.glb")
        actual = Gltf(tmp_path / "a.glb")
        for node in range(len(actual.names)):
            if (turn := actual.channel(node, "rotation")) is not None:
                assert (np.einsum("fi,fi->f", turn[1][1:], turn[1][:-1]) > 0.0).all()

    def test_binary_layout_follows_the_specification(self, tmp_path):
        gltf.write(posed("body_20"), "person_1", tmp_path / "a.glb")
        data = (tmp_path / "a.glb").read_bytes()
        magic, version, size, text_size, text_kind = struct.unpack_from("<4sIII4s", data)
        assert (magic, version, size, text_kind) == (b"glTF", 2, len(data), b"JSON")
        content = json.loads(data[20 : 20 + text_size])
        bin_size, bin_kind = struct.unpack_from("<I4s", data, 20 + text_size)
        assert (bin_kind, bin_size) == (b"BIN\0", content["buffers"][0]["byteLength"])
        assert 28 + text_size + bin_size == len(data)
        assert all(view["byteOffset"] % 4 == 0 for view in content["bufferViews"])
        inputs = {each["input"] for each in content["animations"][0]["samplers"]}
        assert all({"min", "max"} <= content["accessors"][each].keys() for each in inputs)

    def test_same_input_gives_the_same_bytes(self, tmp_path):
        for name in "ab":
            gltf.write(posed("body_20"), "person_1", tmp_path / f"{name}.glb")
        assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()

    def test_uneven_times_are_preserved(self, tmp_path):
        result = posed("body_20", 6)
        times = np.array([2.0, 2.1, 2.15, 2.4, 2.5, 2.9])
        gltf.write(replace(result, time_s=times, rate_hz=None), "person_1", tmp_path / "a.glb")
        np.testing.assert_allclose(Gltf(tmp_path / "a.glb").channel(0, "translation")[0], times - 2.0, atol=1e-6)
