"""Blender and OpenSim read the exported files, if they are installed (``bpy``, ``opensim``)."""

import numpy as np
import pytest

from posefuse.biomechanics.animation_figures import figure_of_person
from posefuse.io.results import bvh, gltf, opensim
from tests.figures import posed

pytestmark = pytest.mark.long

MODEL_JOINTS = [
    # Joint, body it hangs on, place there (right side), body; Rajagopal's names and sizes, to the mm.
    ("hip", "pelvis", (-0.056, -0.078, 0.077), "femur"),
    ("knee", "femur", (-0.005, -0.410, -0.002), "tibia"),
    ("patellofemoral", "femur", (0.040, -0.400, 0.0), "patella"),
    ("ankle", "tibia", (-0.010, -0.400, 0.0), "talus"),
    ("subtalar", "talus", (-0.049, -0.042, 0.008), "calcn"),
    ("mtp", "calcn", (0.179, -0.002, 0.001), "toes"),
    ("acromial", "torso", (0.003, 0.372, 0.170), "humerus"),
    ("elbow", "humerus", (0.013, -0.286, -0.010), "ulna"),
    ("radioulnar", "ulna", (-0.007, -0.013, 0.026), "radius"),
    ("radius_hand", "radius", (-0.009, -0.236, 0.014), "hand"),
]


# Blender's reader of BVH leaves its file to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
class TestBlender:
    @pytest.fixture
    def bpy(self):
        bpy = pytest.importorskip("bpy", reason="Blender as a module: pip install bpy")
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.context.scene.render.fps = 50
        return bpy

    def places(self, bpy, names: list[str], frames: range) -> np.ndarray:
        """Shape (frame, joint, 3): heads of bones in Blender's world."""
        (armature,) = (each for each in bpy.data.objects if each.type == "ARMATURE")
        actual = []
        for frame in frames:
            bpy.context.scene.frame_set(frame)
            actual.append([tuple(armature.matrix_world @ armature.pose.bones[name].head) for name in names])
        return np.array(actual)

    @pytest.mark.parametrize("name", ["body_20", "coco_wholebody_133", "mouse_22"])
    @pytest.mark.parametrize("form", ["bvh", "glb", "gltf"])
    def test_joints_in_blender_match_the_model_layer(self, bpy, form, name, tmp_path):
        result = posed(name)
        path = tmp_path / f"a.{form}"
        if form == "bvh":
            bvh.write(result, "person_1", path)
            bpy.ops.import_anim.bvh(filepath=str(path), global_scale=0.01, frame_start=1)
        else:
            gltf.write(result, "person_1", path)
            bpy.ops.import_scene.gltf(filepath=str(path))
        figure = figure_of_person(result, "person_1").figure
        keypoints = np.flatnonzero(figure.keypoint_joints >= 0)
        names = [figure.joints[j].name for j in figure.keypoint_joints[keypoints]]
        expected = np.asarray(result.layers["model"].points_m)[:, 0, keypoints]
        frames = range(1, 31) if form == "bvh" else range(30)
        np.testing.assert_allclose(self.places(bpy, names, frames), expected, atol=1e-4)


class TestOpenSim:
    @pytest.fixture
    def osim(self):
        osim = pytest.importorskip("opensim", reason="OpenSim: pip install opensim")
        osim.Logger.setLevelString("error")
        return osim

    def model(self, osim):
        """Bodies of the full-body model, in ball joints, without muscles."""
        model, bodies = osim.Model(), {}
        nought = osim.Vec3(0)
        for name in ["pelvis", "torso", *(f"{joint[3]}_{side}" for joint in MODEL_JOINTS for side in "rl")]:
            bodies[name] = osim.Body(name, 3.0, nought, osim.Inertia(0.1, 0.1, 0.1))
            model.addBody(bodies[name])
        model.addJoint(osim.FreeJoint("ground_pelvis", model.getGround(), bodies["pelvis"]))
        back = osim.Vec3(-0.101, 0.082, 0.0)
        model.addJoint(osim.BallJoint("back", bodies["pelvis"], back, nought, bodies["torso"], nought, nought))
        for joint, near, (x, y, z), far in MODEL_JOINTS:
            for side, sign in (("r", 1), ("l", -1)):
                parent = bodies[near if near in bodies else f"{near}_{side}"]
                kind = osim.BallJoint if joint in ("hip", "knee", "ankle", "acromial", "elbow") else osim.WeldJoint
                place = osim.Vec3(x, y, sign * z)
                model.addJoint(kind(f"{joint}_{side}", parent, place, nought, bodies[f"{far}_{side}"], nought, nought))
        model.finalizeConnections()
        return model

    def test_opensim_reads_tables_and_markers(self, osim, tmp_path):
        result = posed("halpe_26", away=(slice(0, 3), slice(20, 22)))
        opensim.write(result, result.person_ids, tmp_path / "o", "model")
        table = osim.TimeSeriesTableVec3(str(tmp_path / "o" / "person_1.trc"))
        assert (table.getNumRows(), table.getNumColumns()) == (30, 26)
        assert np.isnan(table.getRowAtIndex(0)[25][0])
        names = opensim.marker_names(result.skeleton)
        x, y, z = result.layers["model"].points_m[5, 0, result.skeleton.index("left_knee")]
        column = list(table.getColumnLabels()).index(names["left_knee"])
        actual = table.getRowAtIndex(5)[column]
        np.testing.assert_allclose([actual[i] for i in range(3)], [y, z, x], atol=1e-6)
        assert osim.MarkerSet(str(tmp_path / "o" / "markers.xml")).getSize() == 20

    def test_scaling_and_inverse_kinematics_run(self, osim, tmp_path, monkeypatch):
        result = posed("coco_17", 10)
        opensim.write(result, result.person_ids, tmp_path / "o", "model")
        monkeypatch.chdir(tmp_path / "o")
        model = self.model(osim)
        model.printToXML(opensim.MODEL)
        assert osim.ScaleTool("person_1_scaling.xml").run()
        assert osim.InverseKinematicsTool("person_1_ik.xml").run()
        scaled = osim.Model("person_1_scaled.osim")
        state = scaled.initSystem()
        knee, hip = (scaled.getMarkerSet().get(name).getLocationInGround(state) for name in ("RKnee", "RHip"))
        thigh = np.linalg.norm([knee[i] - hip[i] for i in range(3)])
        own = result.poses.shape_m[0, result.poses.shape_names.index("left_knee")]
        assert thigh == pytest.approx(own, rel=0.02)
        assert osim.Storage("person_1_ik.mot").getSize() == 10
