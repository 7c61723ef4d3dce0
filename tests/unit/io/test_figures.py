"""Animated figures as files: independent readers find the model layer's points in them."""

import json
import struct
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import posefuse
from posefuse.biomechanics.animation_figures import figure_of_person
from posefuse.errors import ResultError
from posefuse.io.results import bvh, clips, gltf
from posefuse.io.results.axes import minimal_y_up_from_world
from posefuse.io.results.figures import write_figures
from posefuse.model.cameras import UP_AXES, up_vector
from tests.figures import RATE_HZ, Bvh, Gltf, model_layer, places, posed
from tests.laws import examples

SKELETONS = ["body_20", "coco_17", "coco_wholebody_133", "mouse_22", "fly_38"]
BVH_M, GLTF_M = 1e-6, 5e-6
"""A BVH has six decimals of a cm and a degree, glTF single precision: down a chain of some meters."""


def expected(result, person: int = 0) -> np.ndarray:
    """Points of the model layer in the file's axes."""
    turn = minimal_y_up_from_world(result.rig.up_axis)
    return np.asarray(result.layers["model"].points_m)[:, person] @ turn.T


def joints_of(result, names: list[str], person: str = "person_1") -> tuple[np.ndarray, list[int]]:
    """Keypoints that have a joint, and which that is in the file."""
    figure = figure_of_person(result, person).figure
    keypoints = np.flatnonzero(figure.keypoint_joints >= 0)
    return keypoints, [names.index(figure.joints[j].name) for j in figure.keypoint_joints[keypoints]]


@pytest.fixture(scope="module", params=SKELETONS)
def result(request):
    return posed(request.param)


class TestBvh:
    def test_an_independent_reader_finds_the_points(self, result, tmp_path):
        assert bvh.write(result, "person_1", tmp_path / "a.bvh") == []
        found = Bvh(tmp_path / "a.bvh")
        keypoints, joints = joints_of(result, found.names)
        assert len(keypoints) == np.isfinite(result.layers["model"].points_m[0, 0, :, 0]).sum()
        assert (found.frames, found.step_s) == (result.n_frames, 1.0 / RATE_HZ)
        np.testing.assert_allclose(0.01 * found.places()[:, joints], expected(result)[:, keypoints], atol=BVH_M)
        assert len(set(found.names)) == len(found.names)
        assert found.offsets[0] == [0.0, 0.0, 0.0]

    def test_every_branch_ends(self, result, tmp_path):
        bvh.write(result, "person_1", tmp_path / "a.bvh")
        found = Bvh(tmp_path / "a.bvh")
        assert len(found.ends) == len(set(range(len(found.names))) - set(found.parents))

    def test_at_rest_a_human_stands_and_faces_z_with_the_arms_out(self, tmp_path):
        bvh.write(posed("body_20"), "person_1", tmp_path / "a.bvh")
        found = Bvh(tmp_path / "a.bvh")
        rest = dict(zip(found.names, found.places(np.zeros((1, found.rows.shape[1])))[0], strict=True))
        arm = rest["left_wrist"] - rest["left_shoulder"]
        assert arm[0] > 30.0
        np.testing.assert_allclose(arm[1:], 0.0, atol=1e-4)
        np.testing.assert_allclose(rest["right_wrist"] * [-1, 1, 1], rest["left_wrist"], atol=1e-4)
        assert rest["left_ankle"][1] < -50.0 < 0.0 < rest["neck" if "neck" in rest else "head"][1]
        assert rest["nose"][2] > 5.0

    def test_lengths_are_the_persons_own(self, tmp_path):
        result = posed("body_20", people=2)
        for p, person in enumerate(result.person_ids):
            bvh.write(result, person, tmp_path / "a.bvh")
            found = Bvh(tmp_path / "a.bvh")
            shin = result.poses.shape_m[p, result.poses.shape_names.index("left_ankle")]
            np.testing.assert_allclose(found.offsets[found.names.index("left_ankle")], [0, -100 * shin, 0], atol=1e-6)

    @given(st.sampled_from(UP_AXES), st.integers(0, 2**32 - 1))
    @examples(8)
    def test_y_is_up_whatever_the_worlds_up(self, tmp_path_factory, up, seed):
        result = posed("coco_17", 5, seed=seed)
        result = replace(result, rig=replace(result.rig, up_axis=up))
        path = tmp_path_factory.mktemp("bvh") / "a.bvh"
        bvh.write(result, "person_1", path)
        found = Bvh(path)
        keypoints, joints = joints_of(result, found.names)
        np.testing.assert_allclose(0.01 * found.places()[:, joints], expected(result)[:, keypoints], atol=BVH_M)

    def test_away_the_last_pose_is_held_and_that_is_said(self, tmp_path):
        result = posed(away=(slice(0, 3), slice(10, 14), slice(28, 30)))
        notes = bvh.write(result, "person_1", tmp_path / "a.bvh")
        assert notes == [
            "person_1: the first frame of the BVH is frame 103 of the recording.",
            "person_1 is absent in frames 110 to 113: BVH cannot omit frames, so the last pose is held.",
        ]
        found = Bvh(tmp_path / "a.bvh")
        keypoints, joints = joints_of(result, found.names)
        truth = expected(result)[3:28, keypoints]
        truth[7:11] = truth[6]
        np.testing.assert_allclose(0.01 * found.places()[:, joints], truth, atol=BVH_M)

    def test_ranges_of_frames_make_no_difference(self, tmp_path):
        result = posed("mediapipe_holistic_543", 20, away=(slice(9, 13),))
        result = replace(result, frame_numbers=np.arange(20) + np.where(np.arange(20) > 15, 2, 0))
        bvh.write(result, "person_1", tmp_path / "a.bvh")
        gltf.write(result, "person_1", tmp_path / "a.glb")
        with mock.patch.object(clips, "CHUNK_FRAMES", 6):
            bvh.write(result, "person_1", tmp_path / "b.bvh")
            gltf.write(result, "person_1", tmp_path / "b.glb")
        assert Bvh(tmp_path / "b.bvh").frames == 22
        np.testing.assert_allclose(Bvh(tmp_path / "b.bvh").rows, Bvh(tmp_path / "a.bvh").rows, atol=1e-5)
        one, other = (Gltf(tmp_path / f"{name}.glb").worlds(np.array([0.3])) for name in "ab")
        np.testing.assert_allclose(one, other, atol=1e-6)

    def test_angles_do_not_jump(self, tmp_path):
        result = posed("body_20", 400, seed=3)
        bvh.write(result, "person_1", tmp_path / "a.bvh")
        angles = Bvh(tmp_path / "a.bvh").rows[:, 3:6]
        turn = np.asarray(result.poses.turns)[:, 0, 0]
        fastest = np.degrees((Rotation.from_matrix(turn[1:]) * Rotation.from_matrix(turn[:-1]).inv()).magnitude().max())
        # Near a quarter turn about x the other two angles run; half a turn is what a jump would be.
        assert np.abs(np.diff(angles, axis=0)).max() < 90.0 + fastest
        assert np.abs(angles).max() > 180.0

    def test_a_hand_that_is_not_followed_stays(self, tmp_path):
        result = posed("coco_wholebody_133")
        skeleton, poses = result.skeleton, result.poses
        hand = [part.name for part in skeleton.parts].index("left_hand")
        names = [name for name in poses.segments if name == "left_palm"]
        turns, ways = np.array(poses.turns), np.array(poses.directions)
        points = np.array(result.layers["model"].points_m)
        turns[12:20, :, poses.segments.index(names[0])] = np.nan
        fingers = [poses.bones.index(name) for name in skeleton.parts[hand].tree.bones]
        ways[12:20][:, :, fingers] = np.nan
        points[12:20][:, :, skeleton.parts[hand].keypoints] = np.nan
        lost = replace(
            result, poses=replace(poses, turns=turns, directions=ways), layers={"model": model_layer(points)}
        )
        (note,) = bvh.write(lost, "person_1", tmp_path / "a.bvh")
        assert "hands or face are not tracked in all frames" in note
        found = Bvh(tmp_path / "a.bvh")
        keypoints, joints = joints_of(lost, found.names)
        there = np.isfinite(expected(lost)[:, keypoints])
        np.testing.assert_allclose(
            (0.01 * found.places()[:, joints])[there], expected(lost)[:, keypoints][there], atol=BVH_M
        )
        fore, tip = (found.names.index(name) for name in ("left_elbow", "left_index_finger_4"))
        reach = np.linalg.norm(found.places()[:, tip] - found.places()[:, fore], axis=1)
        np.testing.assert_allclose(reach[12:20], reach[11], atol=1e-4)

    def test_where_lengths_are_not_one_for_all_frames_it_is_said(self, tmp_path):
        result = posed("body_20")
        shape = 1.1 * np.asarray(result.poses.shape_m)
        (note,) = bvh.write(replace(result, poses=replace(result.poses, shape_m=shape)), "person_1", tmp_path / "a.bvh")
        assert "bones of an animation skeleton have constant lengths" in note

    def test_where_up_is_unknown_it_is_said(self, tmp_path):
        result = posed("body_20")
        (note,) = bvh.write(replace(result, rig=replace(result.rig, up_axis=None)), "person_1", tmp_path / "a.bvh")
        assert "the up axis is unknown (--up)" in note


class TestGltf:
    @pytest.mark.parametrize("end", ["glb", "gltf"])
    def test_an_independent_reader_finds_the_points(self, end, result, tmp_path):
        path = tmp_path / f"a.{end}"
        assert gltf.write(result, "person_1", path) == []
        found = Gltf(path)
        keypoints, joints = joints_of(result, found.names)
        seconds = result.time_s - result.time_s[0]
        worlds = found.worlds(seconds)[..., :3, 3][:, joints]
        np.testing.assert_allclose(worlds, expected(result)[:, keypoints], atol=GLTF_M)

    def test_the_skin_binds_the_figure_at_rest(self, result, tmp_path):
        gltf.write(result, "person_1", tmp_path / "a.glb")
        found = Gltf(tmp_path / "a.glb")
        inverse = found.numbers(found.skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
        rest = found.worlds(None)[0]
        assert found.skin.joints == list(range(len(inverse)))
        np.testing.assert_allclose(
            inverse @ rest[found.skin.joints], np.tile(np.eye(4), (len(inverse), 1, 1)), atol=1e-6
        )
        lowest = rest[found.skin.joints, 1, 3].min()
        assert lowest == pytest.approx(0.0, abs=1e-6)

    def test_the_mesh_moves_with_its_joints(self, result, tmp_path):
        gltf.write(result, "person_1", tmp_path / "a.glb")
        found = Gltf(tmp_path / "a.glb")
        for primitive in found.file.meshes[0].primitives:
            parts = primitive.attributes
            corners, normals, joints, weights = (
                found.numbers(each) for each in (parts.POSITION, parts.NORMAL, parts.JOINTS_0, parts.WEIGHTS_0)
            )
            low = found.file.accessors[parts.POSITION].min
            np.testing.assert_allclose(corners.min(axis=0), low, atol=1e-7)
            np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
            assert (weights == [1, 0, 0, 0]).all()
            assert joints.max() < len(found.skin.joints)
            triangle = corners.astype(float)[found.numbers(primitive.indices)[:, 0]].reshape(-1, 3, 3)
            across = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
            assert (np.einsum("ti,ti->t", across, normals[::3]) > 0).all()
            # Sticks are closed and seen from outside: their volume is positive.
            assert np.einsum("ti,ti->t", triangle[:, 0], across).sum() > 0

    def test_away_there_are_no_keys_and_nothing_is_shown(self, tmp_path):
        result = posed(away=(slice(0, 3), slice(10, 14), slice(28, 30)))
        (note,) = gltf.write(result, "person_1", tmp_path / "a.glb")
        assert note == (
            "person_1 is absent in frames 110 to 113: the glTF has no keys there, and the skeleton is scaled to zero."
        )
        found = Gltf(tmp_path / "a.glb")
        seconds, scales, kind = found.channel(0, "scale")
        np.testing.assert_allclose(seconds * RATE_HZ, [0, 3, 10, 14, 28], atol=1e-5)
        np.testing.assert_array_equal(scales[:, 0], [0, 1, 0, 1, 0])
        assert kind == "STEP"
        keys = found.channel(0, "translation")[0]
        present = np.isfinite(result.layers["model"].points_m[:, 0, 0, 0])
        np.testing.assert_allclose(keys, np.flatnonzero(present) / RATE_HZ, atol=1e-6)

    def test_neighboring_keys_are_on_one_side(self, tmp_path):
        gltf.write(posed("body_20", 300, seed=5), "person_1", tmp_path / "a.glb")
        found = Gltf(tmp_path / "a.glb")
        for node in range(len(found.names)):
            if (turn := found.channel(node, "rotation")) is not None:
                assert (np.einsum("fi,fi->f", turn[1][1:], turn[1][:-1]) > 0.0).all()

    def test_the_file_is_laid_out_as_the_specification_says(self, tmp_path):
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

    def test_the_same_bytes_each_time(self, tmp_path):
        for name in "ab":
            gltf.write(posed("body_20"), "person_1", tmp_path / f"{name}.glb")
        assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()

    def test_uneven_times_are_kept(self, tmp_path):
        result = posed("body_20", 6)
        times = np.array([2.0, 2.1, 2.15, 2.4, 2.5, 2.9])
        gltf.write(replace(result, time_s=times, rate_hz=None), "person_1", tmp_path / "a.glb")
        np.testing.assert_allclose(Gltf(tmp_path / "a.glb").channel(0, "translation")[0], times - 2.0, atol=1e-6)


class TestWhatCannotBeWritten:
    @pytest.mark.parametrize("end", ["bvh", "glb"])
    def test_without_bodies(self, end, tmp_path):
        bare = replace(posed("body_20"), poses=None)
        with pytest.raises(ResultError, match="this result has none.*--bodies fit"):
            posefuse.write(bare, tmp_path / f"a.{end}")
        assert list(tmp_path.iterdir()) == []
        assert write_figures(bare, bare.person_ids, tmp_path) == ([], [])

    @pytest.mark.parametrize("end", ["bvh", "glb", "gltf"])
    def test_nobody_in_any_frame(self, end, tmp_path):
        with pytest.raises(ResultError, match="person_1 is absent in all frames"):
            posefuse.write(posed(away=(slice(0, 30),)), tmp_path / f"a.{end}")
        assert list(tmp_path.iterdir()) == []

    def test_an_uneven_bvh(self, tmp_path):
        result = posed("body_20", 4)
        with pytest.raises(ResultError, match="A BVH file needs evenly spaced frames"):
            posefuse.write(replace(result, rate_hz=None, time_s=np.array([0, 1, 3, 4.0])), tmp_path / "a.bvh")

    def test_poses_of_another_body(self, tmp_path):
        poses = posed("mouse_22").poses
        with pytest.raises(ResultError, match="do not match its skeleton 'body_20'"):
            posefuse.write(replace(posed("body_20"), poses=poses), tmp_path / "a.bvh")

    def test_several_people_are_a_file_each(self, tmp_path):
        result = posed(people=2)
        result = replace(result, rig=replace(result.rig, up_axis=None))
        done = posefuse.write(result, tmp_path / "a.bvh")
        assert any("up axis is unknown" in note for note in done.notes)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a_person_1.bvh", "a_person_2.bvh"]

    def test_a_folder_gets_both_formats_of_everybody_who_is_there(self, tmp_path):
        result = posed(people=2)
        turns, points = np.array(result.poses.turns), np.array(result.layers["model"].points_m)
        turns[:, 1], points[:, 1] = np.nan, np.nan
        layers = {"model": model_layer(points)}
        gone = replace(result, poses=replace(result.poses, turns=turns), layers=layers)
        files, notes = write_figures(gone, gone.person_ids, tmp_path)
        assert files == ["person_1.bvh", "person_1.glb"]
        assert notes == ["person_2 is absent in all frames: no BVH or glTF was written for person_2."]


@pytest.mark.parametrize("up", UP_AXES)
def test_up_becomes_y_by_the_least_turn(up):
    turn = minimal_y_up_from_world(up)
    np.testing.assert_allclose(turn @ up_vector(up), [0, 1, 0])
    np.testing.assert_allclose(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)
    between = np.arccos(up_vector(up)[1])
    assert Rotation.from_matrix(turn).magnitude() == pytest.approx(between)


def test_the_truth_of_these_tests_is_a_body_at_rest(tmp_path):
    """The helper's own kinematics, by hand: an adult who stands straight."""
    skeleton = posed("body_20").skeleton
    tree = skeleton.tree
    turns = np.tile(np.eye(3), (1, len(tree.segments), 1, 1))
    found = places(skeleton, np.array([[0.0, 0.0, 1.0]]), turns, tree.rest[None], tree.shape_m)[0]
    np.testing.assert_allclose(found[skeleton.index("left_ankle")], [0.0, 0.10, 1.0 - 0.43 - 0.41], atol=1e-12)
    np.testing.assert_allclose(found[skeleton.index("right_wrist")], [0.0, -0.175, 1.48 - 0.29 - 0.26], atol=1e-12)
