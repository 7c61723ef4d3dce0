"""Files for OpenSim."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError, ResultError
from posefuse.io.results import opensim, trc
from posefuse.io.results.axes import y_up_from_world
from posefuse.io.results.opensim_model import MARKERS, MEASUREMENTS
from posefuse.model.options.options import Options
from posefuse.model.options.subject import SubjectOptions
from posefuse.skeleton.skeletons import shipped_skeleton, shipped_skeletons
from tests.figures import posed

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

    def test_every_body_axis_is_scaled_by_one_measurement(self):
        scaled = [(body, axis) for each in MEASUREMENTS for body in each.bodies for axis in each.axes.split()]
        assert len(set(scaled)) == len(scaled)
        assert {name for each in MEASUREMENTS for pair in each.pairs for name in pair} <= set(MARKERS)
        assert {marker.body for marker in MARKERS.values()} <= {body for body, _ in scaled}

    def test_folder_contains_all_files(self, tmp_path):
        result = replace(posed("halpe_26", people=2), options=Options(subject=SubjectOptions(mass_kg=71.5)))
        notes = opensim.write(result, result.person_ids, tmp_path / "o", "model")
        assert sorted(path.name for path in (tmp_path / "o").iterdir()) == [
            "markers.xml", "person_1.trc", "person_1_ik.xml", "person_1_scaling.xml",
            "person_2.trc", "person_2_ik.xml", "person_2_scaling.xml",
        ]  # fmt: skip
        assert any("the model has no marker for nose" in note for note in notes)
        actual = trc.read(tmp_path / "o" / "person_2.trc")
        expected = np.asarray(result.layers["model"].points_m)[:, 1] @ y_up_from_world("z").T
        np.testing.assert_allclose(actual.points_m, expected, atol=5e-7)
        on_model = {e.get("name") for e in ElementTree.parse(tmp_path / "o" / "markers.xml").iter("Marker")}
        assert on_model <= set(actual.names)
        assert texts(tmp_path / "o" / "person_1_scaling.xml", "mass") == ["71.5"]
        assert texts(tmp_path / "o" / "person_1_scaling.xml", "time_range") == ["7.000000 7.580000"]
        tasks = {e.get("name") for e in ElementTree.parse(tmp_path / "o" / "person_1_ik.xml").iter("IKMarkerTask")}
        assert tasks == on_model

    def test_scaling_uses_the_longest_range_and_angles_use_all_frames(self, tmp_path):
        result = posed("coco_17", away=(slice(0, 4), slice(9, 11), slice(27, 30)))
        opensim.write(result, result.person_ids, tmp_path / "o", "model")
        assert texts(tmp_path / "o" / "person_1_scaling.xml", "time_range") == [f"{7 + 11 / 50:f} {7 + 26 / 50:f}"]
        assert texts(tmp_path / "o" / "person_1_ik.xml", "time_range") == [f"{7 + 4 / 50:f} {7 + 26 / 50:f}"]

    def test_animals_are_refused(self, tmp_path):
        with pytest.raises(ResultError, match="needs the markers RHip, LHip, RKnee, LKnee; skeleton 'mouse_22'"):
            posefuse.write(posed("mouse_22"), tmp_path / "o", "opensim")
        assert not (tmp_path / "o").exists()

    def test_unknown_values_give_notes(self, tmp_path):
        result = posed("coco_17")
        result = replace(result, rig=replace(result.rig, up_axis=None))
        messages = " ".join(posefuse.write(result, tmp_path / "o", "opensim").notes)
        assert "mass of person_1 is unknown (`subject.mass_kg`)" in messages
        assert "the up axis is unknown" in messages

    def test_files_of_other_people_are_kept(self, tmp_path):
        (tmp_path / "thesis.docx").write_text("years of work")
        with pytest.raises(FileError, match="already contains other files"):
            opensim.write(posed("coco_17"), ("person_1",), tmp_path, "model")
        assert [path.name for path in tmp_path.iterdir()] == ["thesis.docx"]
