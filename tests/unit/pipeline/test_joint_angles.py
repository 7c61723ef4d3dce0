"""Joint angles of reconstructions: errors and intervals on replayed motion, statuses, static trials, and animals."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.replayed_angles import detect_replay, errors, estimate, replay, scores

from posefuse.errors import OptionsError
from posefuse.model.joint_angles import ISB, KEYPOINTS, OPENSIM, AngleStatus
from posefuse.model.options.options import Options
from posefuse.model.options.subject import SubjectOptions
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline import joint_angles as recipe
from posefuse.pipeline.joint_angles import with_joint_angles
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.scenes import truth_of


def exact(motion: str, seed: int = 1, skeleton: str = "halpe_26") -> tuple[Reconstruction, dict[str, np.ndarray]]:
    """Return a result whose points are exact, with standard deviations of 5 mm, and true angles."""
    data = replay(motion, 2.0, seed, skeleton)
    result = truth_of(build_rig("ring", 3), find_skeleton(skeleton), data.points_m, 60.0)
    layer = result.layers["measured"]
    covariance = np.where(np.isfinite(layer.covariance_m2), [25e-6, 0.0, 0.0, 25e-6, 0.0, 25e-6], np.nan)
    return replace(result, layers={"measured": replace(layer, covariance_m2=covariance)}), dict(data.degrees)


@pytest.mark.parametrize(
    ("motion", "cameras", "most_deg"),
    [
        pytest.param("walk", 5, 8.0, marks=pytest.mark.long),
        ("squat", 2, 15.0),
    ],
)
def test_replayed_motion_is_within_stated_intervals(motion, cameras, most_deg):
    runs = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for seed in (100, 101):
            data = replay(motion, 3.0, seed)
            runs.append(errors(data, estimate(*detect_replay(data, cameras, seed))))
    found = scores(runs)
    for group in ("hip flexion", "hip adduction", "knee", "ankle", "pelvis tilt"):
        error, inside, _ = found[group]
        assert error < most_deg, (group, error)
        assert inside > 0.75, (group, inside)


@pytest.mark.parametrize("motion", ["walk", "squat", "reach"])
def test_exact_points_give_angles_within_the_spread_of_people(motion):
    result, truth = exact(motion)
    angles = with_joint_angles(result).joint_angles
    assert angles is not None
    for name, most_deg in (("knee_angle_r", 6.0), ("hip_adduction_l", 5.0), ("arm_flex_r", 8.0)):
        i = angles.index(name, OPENSIM)
        error = angles.degrees[:, 0, i] - truth[name]
        assert np.abs(error).mean() < most_deg, name
        assert (np.abs(error) < 3.0 * angles.sd_deg[:, 0, i]).all(), name
        # What remains is constant: places of keypoints on this person.
        assert error.std() < 2.5, name


def test_the_direction_that_a_person_faces_changes_the_pelvis_rotation_only():
    result, _ = exact("walk")
    layer = result.layers["measured"]
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = replace(result, layers={"measured": replace(layer, points_m=np.asarray(layer.points_m) @ quarter.T)})
    before, after = (with_joint_angles(each).joint_angles for each in (result, turned))
    assert before is not None
    assert after is not None
    change = (after.degrees - before.degrees + 180.0) % 360.0 - 180.0
    rotation = before.index("pelvis_rotation")
    assert np.allclose(change[..., rotation], 90.0, atol=0.05)
    assert np.nanmax(np.abs(np.delete(change, rotation, axis=2))) < 0.1


def test_absent_people_and_unknown_verticals_have_no_values():
    result, _ = exact("walk")
    layer = result.layers["measured"]
    points = np.asarray(layer.points_m).copy()
    points[10:20] = np.nan
    result = replace(result, layers={"measured": replace(layer, points_m=points)})
    level = with_joint_angles(result).joint_angles
    assert level is not None
    assert (level.status[10:20] == AngleStatus.ABSENT).all()
    assert np.isnan(level.degrees[10:20]).all()
    assert (level.status[:10, 0, level.index("knee_angle_r")] == AngleStatus.OK).all()
    free = with_joint_angles(replace(result, rig=replace(result.rig, up_axis=None))).joint_angles
    assert free is not None
    assert (free.status[:10, 0, free.index("pelvis_tilt")] == AngleStatus.NO_VERTICAL).all()
    knee = free.index("knee_angle_r")
    assert free.degrees[:10, 0, knee] == pytest.approx(level.degrees[:10, 0, knee], abs=1.0)


def test_angles_that_no_keypoint_shows_are_left_out():
    angles = with_joint_angles(exact("walk", skeleton="coco_17")[0]).joint_angles
    assert angles is not None
    assert {"knee_angle_r", "arm_flex_l", "lumbar_bending"} <= set(angles.names)
    assert not {"ankle_angle_r", "mtp_angle_l", "wrist_flex_r", "pro_sup_l"} & set(angles.names)
    whole = with_joint_angles(exact("reach", skeleton="coco_wholebody_133")[0]).joint_angles
    assert whole is not None
    assert {"ankle_angle_r", "wrist_flex_r", "pro_sup_l"} <= set(whole.names)
    assert set(whole.conventions) == {OPENSIM, ISB}


def test_numbers_do_not_depend_on_what_is_in_memory(monkeypatch):
    result, _ = exact("walk")
    whole = list(recipe.joint_angles(result))
    assert len(whole) == 1
    monkeypatch.setattr(recipe, "_WINDOW", 50)
    parts = list(recipe.joint_angles(result))
    assert [each.n_frames for each in parts] == [50, 50, 20]
    joined = np.concatenate([each.degrees for each in parts])
    assert np.nanmax(np.abs(joined - whole[0].degrees)) < 0.05


def test_animals_keep_angles_between_keypoints():
    skeleton = find_skeleton("mouse_22")
    points = np.random.default_rng(0).normal(0.0, 0.05, (5, len(skeleton), 3))
    result = truth_of(build_rig("ring", 3), skeleton, points, 60.0)
    assert with_joint_angles(result).joint_angles is None
    angles = with_joint_angles(replace(result, layers={"solved": result.layers["measured"]})).joint_angles
    assert angles is not None
    assert set(angles.conventions) == {KEYPOINTS}


def test_a_static_trial_is_a_range_of_frames():
    result, _ = exact("reach")
    names = {}
    for text in (None, "0:20"):
        options = Options(subject=SubjectOptions(static=text))
        angles = with_joint_angles(replace(result, options=options)).joint_angles
        assert angles is not None
        names[text] = angles.degrees[:, 0, angles.index("ankle_angle_r")]
    assert np.abs(names[None] - names["0:20"]).max() > 0.05
    with pytest.raises(OptionsError, match="has no such frames"):
        with_joint_angles(replace(result, options=Options(subject=SubjectOptions(static="900:950"))))
    with pytest.raises(OptionsError, match="START:STOP"):
        with_joint_angles(replace(result, options=Options(subject=SubjectOptions(static="nowhere.nc"))))
