"""What is written for OpenSim, and points projected as OpenPose JSON."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError, ResultError
from posefuse.io.recording import find_recording
from posefuse.io.results import openpose, opensim, trc
from posefuse.io.results.axes import y_up_from_world
from posefuse.io.results.opensim_model import MARKERS, MEASUREMENTS
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import Options
from posefuse.model.options.subject import SubjectOptions
from posefuse.skeleton.skeletons import shipped_skeleton, shipped_skeletons
from tests.figures import model_layer, posed

HUMANS = [name for name in shipped_skeletons() if name not in ("mouse_22", "fly_38")]


def texts(path, tag: str) -> list[str]:
    return [element.text for element in ElementTree.parse(path).iter(tag)]


class TestOpenSim:
    @pytest.mark.parametrize("name", HUMANS)
    def test_every_human_skeleton_has_limbs_on_the_model(self, name):
        markers = opensim.marker_names(shipped_skeleton(name))
        assert len(set(markers.values())) == len(markers)
        limbs = {f"{s}{part}" for s in "RL" for part in ("Hip", "Knee", "Ankle", "Shoulder", "Elbow", "Wrist")}
        assert limbs <= set(markers.values())

    def test_left_is_the_mirror_image_of_right(self):
        for name, marker in MARKERS.items():
            if name.startswith("R"):
                other = MARKERS[f"L{name[1:]}"]
                assert other.place_m == (*marker.place_m[:2], -marker.place_m[2])
                assert other.body == (marker.body[:-2] + "_l" if marker.body.endswith("_r") else marker.body)

    def test_measurements_are_between_markers_and_scale_each_body_along_each_axis_once(self):
        scaled = [(body, axis) for each in MEASUREMENTS for body in each.bodies for axis in each.axes.split()]
        assert len(set(scaled)) == len(scaled)
        assert {name for each in MEASUREMENTS for pair in each.pairs for name in pair} <= set(MARKERS)
        assert {marker.body for marker in MARKERS.values()} <= {body for body, _ in scaled}

    def test_the_folder(self, tmp_path):
        result = replace(posed("halpe_26", people=2), options=Options(subject=SubjectOptions(mass_kg=71.5)))
        notes = opensim.write(result, result.person_ids, tmp_path / "o", "model")
        assert sorted(path.name for path in (tmp_path / "o").iterdir()) == [
            "markers.xml", "person_1.trc", "person_1_ik.xml", "person_1_scaling.xml",
            "person_2.trc", "person_2_ik.xml", "person_2_scaling.xml",
        ]  # fmt: skip
        assert any("the model has no marker for nose" in note for note in notes)
        found = trc.read(tmp_path / "o" / "person_2.trc")
        expected = np.asarray(result.layers["model"].points_m)[:, 1] @ y_up_from_world("z").T
        np.testing.assert_allclose(found.points_m, expected, atol=5e-7)
        on_model = {e.get("name") for e in ElementTree.parse(tmp_path / "o" / "markers.xml").iter("Marker")}
        assert on_model <= set(found.names)
        assert texts(tmp_path / "o" / "person_1_scaling.xml", "mass") == ["71.5"]
        assert texts(tmp_path / "o" / "person_1_scaling.xml", "time_range") == ["7.000000 7.580000"]
        tasks = {e.get("name") for e in ElementTree.parse(tmp_path / "o" / "person_1_ik.xml").iter("IKMarkerTask")}
        assert tasks == on_model

    def test_scaling_takes_the_longest_stretch_and_angles_the_whole_life(self, tmp_path):
        result = posed("coco_17", away=(slice(0, 4), slice(9, 11), slice(27, 30)))
        opensim.write(result, result.person_ids, tmp_path / "o", "model")
        assert texts(tmp_path / "o" / "person_1_scaling.xml", "time_range") == [f"{7 + 11 / 50:f} {7 + 26 / 50:f}"]
        assert texts(tmp_path / "o" / "person_1_ik.xml", "time_range") == [f"{7 + 4 / 50:f} {7 + 26 / 50:f}"]

    def test_an_animal_has_no_place_on_it(self, tmp_path):
        with pytest.raises(ResultError, match="needs the markers RHip, LHip, RKnee, LKnee; skeleton 'mouse_22'"):
            posefuse.write(posed("mouse_22"), tmp_path / "o", "opensim")
        assert not (tmp_path / "o").exists()

    def test_what_is_not_known_is_said(self, tmp_path):
        result = posed("coco_17")
        result = replace(result, rig=replace(result.rig, up_axis=None))
        said = " ".join(posefuse.write(result, tmp_path / "o", "opensim").notes)
        assert "mass of person_1 is unknown (--subject.mass-kg)" in said
        assert "the up axis is unknown" in said

    def test_other_peoples_files_stay(self, tmp_path):
        (tmp_path / "thesis.docx").write_text("years of work")
        with pytest.raises(FileError, match="already contains other files"):
            opensim.write(posed("coco_17"), ("person_1",), tmp_path, "model")
        assert [path.name for path in tmp_path.iterdir()] == ["thesis.docx"]


class TestOpenPose:
    def test_our_reader_finds_the_projections(self, tmp_path):
        result = posed("coco_17", 6, people=2, away=(slice(2, 3),))
        openpose.write(result, tmp_path / "o", "model")
        found = posefuse.read_detections(tmp_path / "o", "coco_17")
        assert found.view_names == tuple(f"{name}_json" for name in result.rig.names)
        np.testing.assert_array_equal(found.frame_numbers, result.frame_numbers)
        points = np.asarray(result.layers["model"].points_m)
        for f in range(6):
            for v, camera in enumerate(result.rig.cameras):
                row = f * 3 + v
                seen = np.asarray(found.keypoints_px[found.offsets[row] : found.offsets[row + 1]])
                expected, _ = camera.project(points[f])
                size = np.array(camera.size_px)
                outside = ~((expected >= -0.5) & (expected <= size - 0.5)).all(axis=-1)
                expected[outside] = np.nan
                expected = expected[np.isfinite(expected).any(axis=(1, 2))]
                np.testing.assert_allclose(seen, expected, atol=5.1e-4)

    def test_outside_the_image_there_is_nothing(self, tmp_path):
        result = posed("coco_17", 1)
        points = np.array(result.layers["model"].points_m)
        points[0, 0, 3] += 100.0
        openpose.write(replace(result, layers={"model": model_layer(points)}), tmp_path / "o", "model")
        content = json.loads((tmp_path / "o" / "cam_0_json" / "cam_0_000000000100_keypoints.json").read_text())
        (person,) = content["people"]
        assert person["pose_keypoints_2d"][9:12] == [0.0, 0.0, 0.0]
        assert person["pose_keypoints_2d"][2] == 1.0
        assert person["posefuse"]["status"][0] == "ok"
        assert person["posefuse"]["source"] == ["modeled"] * 17

    @pytest.mark.parametrize("name", ["../../etc", "a/b", "..", ".hidden"])
    def test_a_hostile_camera_stays_inside(self, name, tmp_path):
        result = posed("coco_17", 1)
        cameras = (replace(result.rig.cameras[0], name=name), *result.rig.cameras[1:])
        with pytest.raises(FileError, match="is not a valid file name"):
            openpose.write(replace(result, rig=CameraRig(cameras, up_axis="z")), tmp_path / "o", "model")
        assert list(tmp_path.iterdir()) == []

    def test_an_image_plane_is_not_projected(self, tmp_path):
        with pytest.raises(ResultError, match="it has no 3D points to project"):
            openpose.write(replace(posed("coco_17", 1), unit="px"), tmp_path / "o", "model")

    def test_a_result_in_a_recordings_folder_is_not_taken_for_what_was_recorded(self, tmp_path):
        result = posed("coco_17", 3)
        openpose.write(result, tmp_path / "pose", "model")
        openpose.write(result, tmp_path / "out" / "openpose", "model")
        posefuse.write(result, tmp_path / "out" / "reconstruction.nc")
        assert [found.path for found in find_recording(tmp_path).keypoints] == [tmp_path / "pose"]
