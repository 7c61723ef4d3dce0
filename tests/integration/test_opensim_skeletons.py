"""The marker set of every human skeleton: scaled models whose markers reach the points in OpenSim."""

import importlib.util
import xml.etree.ElementTree as ElementTree

import pytest

import posefuse
from posefuse.biomechanics.marker_model import is_human
from posefuse.skeleton.skeletons import shipped_skeleton, shipped_skeletons
from tests.opensim_people import FRAMES, model_of, recorded

HUMANS = [name for name in shipped_skeletons() if is_human(shipped_skeleton(name))]
pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("opensim") is None,
    reason="the package opensim is not installed: pip install 'posefuse[opensim]'",
)


def test_all_shipped_skeletons_but_animals_are_human():
    assert set(shipped_skeletons()) - set(HUMANS) == {"fly_38", "mouse_22"}


@pytest.mark.parametrize("skeleton", HUMANS)
def test_markers_of_a_scaled_model_reach_virtual_ones(skeleton, tmp_path):
    recorded(tmp_path / "walk", skeleton=skeleton)
    outcomes, notes = posefuse.opensim_results([tmp_path / "walk"], tmp_path / "out")
    assert notes == ()
    assert outcomes[0].n_frames == FRAMES
    assert outcomes[0].marker_rms_m < 0.001
    lines = (tmp_path / "out" / "anna_ik_marker_errors.sto").read_text("utf-8").splitlines()
    titles = lines[lines.index("endheader") + 1].split("\t")
    worst = max(
        float(line.split("\t")[titles.index("marker_error_max")]) for line in lines[lines.index("endheader") + 2 :]
    )
    assert worst < 0.002
    angles = {each.angle: each.rmse_deg for each in outcomes[0].comparison.angles}
    assert max(angles[f"{name}_{side}"] for name in ("hip_flexion", "knee_angle", "arm_flex") for side in "rl") < 2.0
    markers = ElementTree.parse(tmp_path / "out" / "anna.osim").getroot().iter("Marker")
    assert {each.get("name") for each in markers} == set(model_of(skeleton).keypoints)
