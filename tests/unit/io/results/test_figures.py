"""Results that cannot be written as animated figures."""

from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.errors import ResultError
from posefuse.io.results.figures import has_figures, write_figure
from tests.figures import model_layer, places, posed

SKELETONS = ["body_20", "coco_17", "coco_wholebody_133", "mouse_22", "fly_38"]


@pytest.fixture(scope="module", params=SKELETONS)
def result(request):
    return posed(request.param)


class TestWhatCannotBeWritten:
    @pytest.mark.parametrize("end", ["bvh", "glb"])
    def test_result_without_poses_is_refused(self, end, tmp_path):
        bare = replace(posed("body_20"), poses=None)
        with pytest.raises(ResultError, match="this result has none.*`bodies='fit'`"):
            posefuse.write(bare, tmp_path / f"a.{end}")
        assert list(tmp_path.iterdir()) == []
        assert not has_figures(bare)

    @pytest.mark.parametrize("end", ["bvh", "glb", "gltf"])
    def test_absent_person_is_refused(self, end, tmp_path):
        with pytest.raises(ResultError, match="person_1 is absent in all frames"):
            posefuse.write(posed(away=(slice(0, 30),)), tmp_path / f"a.{end}")
        assert list(tmp_path.iterdir()) == []

    def test_uneven_times_are_refused_in_bvh(self, tmp_path):
        result = posed("body_20", 4)
        with pytest.raises(ResultError, match="A BVH file needs evenly spaced frames"):
            posefuse.write(replace(result, rate_hz=None, time_s=np.array([0, 1, 3, 4.0])), tmp_path / "a.bvh")

    def test_poses_of_another_skeleton_are_refused(self, tmp_path):
        poses = posed("mouse_22").poses
        with pytest.raises(ResultError, match="do not match its skeleton 'body_20'"):
            posefuse.write(replace(posed("body_20"), poses=poses), tmp_path / "a.bvh")

    def test_several_people_are_written_to_one_file_each(self, tmp_path):
        result = posed(people=2)
        result = replace(result, rig=replace(result.rig, up_axis=None))
        done = posefuse.write(result, tmp_path / "a.bvh")
        assert any("up axis is unknown" in note for note in done.notes)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a_person_1.bvh", "a_person_2.bvh"]

    def test_folder_has_both_formats_of_every_person_present(self, tmp_path):
        result = posed(people=2)
        turns, points = np.array(result.poses.turns), np.array(result.layers["model"].points_m)
        turns[:, 1], points[:, 1] = np.nan, np.nan
        layers = {"model": model_layer(points)}
        gone = replace(result, poses=replace(result.poses, turns=turns), layers=layers)
        assert has_figures(gone)
        assert write_figure("person_1", "a", gone, tmp_path) == (["a.bvh", "a.glb"], [])
        why = "person_2 is absent in all frames: no BVH or glTF was written for person_2."
        assert write_figure("person_2", "b", gone, tmp_path) == ([], [why])
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a.bvh", "a.glb"]


def test_helper_kinematics_of_the_rest_pose_match_hand_computed_values(tmp_path):
    """The kinematics of the test helper give the expected positions of a standing adult."""
    skeleton = posed("body_20").skeleton
    tree = skeleton.tree
    turns = np.tile(np.eye(3), (1, len(tree.segments), 1, 1))
    actual = places(skeleton, np.array([[0.0, 0.0, 1.0]]), turns, tree.rest[None], tree.shape_m)[0]
    np.testing.assert_allclose(actual[skeleton.index("left_ankle")], [0.0, 0.10, 1.0 - 0.43 - 0.41], atol=1e-12)
    np.testing.assert_allclose(actual[skeleton.index("right_wrist")], [0.0, -0.175, 1.48 - 0.29 - 0.26], atol=1e-12)
