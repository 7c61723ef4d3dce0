"""BVH files: independent readers find the points of the model layer."""

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from posefuse.io.results import bvh, clips, gltf
from posefuse.model.cameras import UP_AXES
from tests.figures import RATE_HZ, Bvh, Gltf, joints_of, model_layer, points_in_file_axes, posed
from tests.properties import examples

SKELETONS = ["body_20", "coco_17", "coco_wholebody_133", "mouse_22", "fly_38"]
BVH_M, GLTF_M = 1e-6, 5e-6
"""A BVH has six decimals of a cm and a degree, glTF single precision: down a chain of some meters."""


@pytest.fixture(scope="module", params=SKELETONS)
def result(request):
    return posed(request.param)


class TestBvh:
    def test_independent_reader_finds_the_points(self, result, tmp_path):
        assert bvh.write(result, "person_1", tmp_path / "a.bvh") == []
        actual = Bvh(tmp_path / "a.bvh")
        keypoints, joints = joints_of(result, actual.names)
        assert len(keypoints) == np.isfinite(result.layers["model"].points_m[0, 0, :, 0]).sum()
        assert (actual.frames, actual.step_s) == (result.n_frames, 1.0 / RATE_HZ)
        np.testing.assert_allclose(
            0.01 * actual.places()[:, joints], points_in_file_axes(result)[:, keypoints], atol=BVH_M
        )
        assert len(set(actual.names)) == len(actual.names)
        assert actual.offsets[0] == [0.0, 0.0, 0.0]

    def test_every_branch_has_an_end_site(self, result, tmp_path):
        bvh.write(result, "person_1", tmp_path / "a.bvh")
        actual = Bvh(tmp_path / "a.bvh")
        assert len(actual.ends) == len(set(range(len(actual.names))) - set(actual.parents))

    def test_rest_pose_stands_facing_z_with_arms_out(self, tmp_path):
        bvh.write(posed("body_20"), "person_1", tmp_path / "a.bvh")
        actual = Bvh(tmp_path / "a.bvh")
        rest = dict(zip(actual.names, actual.places(np.zeros((1, actual.rows.shape[1])))[0], strict=True))
        arm = rest["left_wrist"] - rest["left_shoulder"]
        assert arm[0] > 30.0
        np.testing.assert_allclose(arm[1:], 0.0, atol=1e-4)
        np.testing.assert_allclose(rest["right_wrist"] * [-1, 1, 1], rest["left_wrist"], atol=1e-4)
        assert rest["left_ankle"][1] < -50.0 < 0.0 < rest["neck" if "neck" in rest else "head"][1]
        assert rest["nose"][2] > 5.0

    def test_bone_lengths_are_those_of_the_person(self, tmp_path):
        result = posed("body_20", people=2)
        for p, person in enumerate(result.person_ids):
            bvh.write(result, person, tmp_path / "a.bvh")
            actual = Bvh(tmp_path / "a.bvh")
            shin = result.poses.shape_m[p, result.poses.shape_names.index("left_ankle")]
            np.testing.assert_allclose(actual.offsets[actual.names.index("left_ankle")], [0, -100 * shin, 0], atol=1e-6)

    @given(st.sampled_from(UP_AXES), st.integers(0, 2**32 - 1))
    @examples(8)
    def test_y_is_up_for_any_up_axis(self, tmp_path_factory, up, seed):
        result = posed("coco_17", 5, seed=seed)
        result = replace(result, rig=replace(result.rig, up_axis=up))
        path = tmp_path_factory.mktemp("bvh") / "a.bvh"
        bvh.write(result, "person_1", path)
        actual = Bvh(path)
        keypoints, joints = joints_of(result, actual.names)
        np.testing.assert_allclose(
            0.01 * actual.places()[:, joints], points_in_file_axes(result)[:, keypoints], atol=BVH_M
        )

    def test_absence_in_a_single_frame_names_this_frame(self, tmp_path):
        result = posed(away=(slice(10, 11), slice(20, 22)))
        (note,) = bvh.write(result, "person_1", tmp_path / "a.bvh")
        assert note.startswith("person_1 is absent in frames 110, 120 to 121: BVH")

    def test_absence_holds_the_last_pose_with_a_note(self, tmp_path):
        result = posed(away=(slice(0, 3), slice(10, 14), slice(28, 30)))
        notes = bvh.write(result, "person_1", tmp_path / "a.bvh")
        assert notes == [
            "person_1: the first frame of the BVH is frame 103 of the recording.",
            "person_1 is absent in frames 110 to 113: BVH cannot omit frames, so the last pose is held.",
        ]
        actual = Bvh(tmp_path / "a.bvh")
        keypoints, joints = joints_of(result, actual.names)
        truth = points_in_file_axes(result)[3:28, keypoints]
        truth[7:11] = truth[6]
        np.testing.assert_allclose(0.01 * actual.places()[:, joints], truth, atol=BVH_M)

    def test_result_is_independent_of_frame_ranges(self, tmp_path):
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

    def test_angles_are_continuous(self, tmp_path):
        result = posed("body_20", 400, seed=3)
        bvh.write(result, "person_1", tmp_path / "a.bvh")
        angles = Bvh(tmp_path / "a.bvh").rows[:, 3:6]
        turn = np.asarray(result.poses.turns)[:, 0, 0]
        fastest = np.degrees((Rotation.from_matrix(turn[1:]) * Rotation.from_matrix(turn[:-1]).inv()).magnitude().max())
        # Close to gimbal lock the other two angles change quickly; a jump would be half a turn.
        assert np.abs(np.diff(angles, axis=0)).max() < 90.0 + fastest
        assert np.abs(angles).max() > 180.0

    def test_untracked_hand_does_not_move(self, tmp_path):
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
        actual = Bvh(tmp_path / "a.bvh")
        keypoints, joints = joints_of(lost, actual.names)
        present = np.isfinite(points_in_file_axes(lost)[:, keypoints])
        np.testing.assert_allclose(
            (0.01 * actual.places()[:, joints])[present], points_in_file_axes(lost)[:, keypoints][present], atol=BVH_M
        )
        fore, tip = (actual.names.index(name) for name in ("left_elbow", "left_index_finger_4"))
        reach = np.linalg.norm(actual.places()[:, tip] - actual.places()[:, fore], axis=1)
        np.testing.assert_allclose(reach[12:20], reach[11], atol=1e-4)

    def test_varying_bone_lengths_give_a_note(self, tmp_path):
        result = posed("body_20")
        shape = 1.1 * np.asarray(result.poses.shape_m)
        (note,) = bvh.write(replace(result, poses=replace(result.poses, shape_m=shape)), "person_1", tmp_path / "a.bvh")
        assert "bones of an animation skeleton have constant lengths" in note

    def test_unknown_up_axis_gives_a_note(self, tmp_path):
        result = posed("body_20")
        (note,) = bvh.write(replace(result, rig=replace(result.rig, up_axis=None)), "person_1", tmp_path / "a.bvh")
        assert "the up axis is unknown (`up`)" in note
