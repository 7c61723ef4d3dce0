"""Alignment of the world: floor, axes, size, and their application."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posefuse
from posefuse.alignment.apply import align, in_calibration_world, scaled_rig
from posefuse.alignment.feet import floor_from_feet
from posefuse.alignment.size import estimate_height_m, scale_factor
from posefuse.alignment.world_axes import find_alignment
from posefuse.diagnostics.floor import floor_findings
from posefuse.errors import DetectionsError, OptionsError, ResultError
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import up_vector
from posefuse.model.options.alignment import PRESETS, AlignOptions
from posefuse.model.options.options import Options
from posefuse.pipeline import reconstruct as recipe
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.people import crowd, followed
from tests.scenes import ring

MOVED = Alignment(Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([1.0, -2.0, 3.0]), 2.5, "y", "z")


@pytest.fixture(scope="module")
def walker():
    """Simulate a person who walks for 6 s on a floor at z = 0."""
    return simulate(SceneOptions(duration_s=6, cameras=4, detector=CLEAN))


@pytest.fixture(scope="module")
def true_points(walker):
    return np.asarray(walker.truth.layers["model" if "model" in walker.truth.layers else "measured"].points_m)


def turned(points: np.ndarray, rotation: np.ndarray, shift: np.ndarray) -> np.ndarray:
    return points @ rotation.T + shift


def test_alignment_can_be_undone(walker):
    result = followed(crowd())
    there = align(result, MOVED)
    assert there.alignment == MOVED
    assert there.rig.up_axis == "y"
    for name, layer in result.layers.items():
        points = np.asarray(layer.points_m)
        np.testing.assert_allclose(
            there.rig.project(np.asarray(there.layers[name].points_m)), result.rig.project(points), atol=1e-6
        )
    turns, before = np.asarray(there.poses.turns), np.asarray(result.poses.turns)
    np.testing.assert_allclose(turns, MOVED.rotation @ before, atol=1e-12)
    np.testing.assert_allclose(np.asarray(there.poses.shape_m), 2.5 * np.asarray(result.poses.shape_m))
    back = in_calibration_world(there)
    assert back.alignment is None
    assert back.rig.up_axis == "z"
    for name, layer in result.layers.items():
        np.testing.assert_allclose(np.asarray(back.layers[name].points_m), np.asarray(layer.points_m), atol=1e-12)
        np.testing.assert_allclose(
            np.asarray(back.layers[name].covariance_m2), np.asarray(layer.covariance_m2), rtol=1e-9, atol=1e-15
        )
    np.testing.assert_allclose(
        back.rig.cameras[1].camera_from_world, result.rig.cameras[1].camera_from_world, atol=1e-12
    )


def test_covariances_rotate_with_their_points():
    rng = np.random.default_rng(0)
    result = followed(crowd())
    layer = result.layers["model"]
    root = rng.normal(size=(3, 3)) * 0.01
    full = root @ root.T
    entries = np.broadcast_to(full[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]], layer.covariance_m2.shape).copy()
    told = replace(result, layers={"model": replace(layer, covariance_m2=entries)})
    found = np.asarray(align(told, MOVED).layers["model"].covariance_m2)[0, 0, 0]
    by_hand = 2.5**2 * MOVED.rotation @ full @ MOVED.rotation.T
    np.testing.assert_allclose(found, by_hand[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]])


def test_mirroring_alignment_is_an_error():
    with pytest.raises(ResultError, match="rotation"):
        Alignment(np.diag([1.0, 1.0, -1.0]), np.zeros(3))


@pytest.mark.parametrize("seed", range(3))
def test_floor_is_found_in_any_world(walker, true_points, seed):
    rng = np.random.default_rng(seed)
    rotation, shift = Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3)
    noisy = turned(true_points, rotation, shift) + 0.004 * rng.normal(size=true_points.shape)
    wild = rng.random(true_points.shape[:3]) < 0.05
    noisy[wild] += rng.normal(size=(int(wild.sum()), 3))
    plane = floor_from_feet([noisy], walker.truth.skeleton, None)
    assert np.degrees(np.arccos(plane.normal @ rotation[:, 2])) < 1.0
    # Toes and heels are a few centimeters above their soles.
    assert abs((shift - plane.point_m) @ plane.normal) < 0.06


def test_feet_in_one_place_need_an_up_axis(walker, true_points):
    standing = np.broadcast_to(true_points[:1, :, 11:17], (60, 1, 6, 3))
    skeleton = replace(
        walker.truth.skeleton,
        keypoints=walker.truth.skeleton.keypoints[11:17],
        edges=(),
        rigid=(),
        pairs=(),
        chains={},
        derived={},
        plausible_m=(),
        names={},
        core=(),
        tree=None,
        parts=(),
    )
    noisy = standing + 0.002 * np.random.default_rng(0).normal(size=standing.shape)
    with pytest.raises(DetectionsError, match="one line"):
        floor_from_feet([noisy], skeleton, None)
    plane = floor_from_feet([noisy], skeleton, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(plane.normal, [0, 0, 1])
    assert abs(plane.point_m[2]) < 0.1


UP = np.array([0.0, 0.0, 1.0])


def tilt_deg(normal: np.ndarray, up: np.ndarray = UP) -> float:
    return float(np.degrees(np.arccos(min(normal @ up, 1.0))))


def lasting(points: np.ndarray, size_m: float, seed: int) -> np.ndarray:
    """Return errors with a correlation time of about half a second at 30 Hz."""
    rng = np.random.default_rng(seed)
    errors = [rng.normal(size=points.shape[1:])]
    for _ in points[1:]:
        errors.append(0.94 * errors[-1] + np.sqrt(1.0 - 0.94**2) * rng.normal(size=points.shape[1:]))
    return points + size_m * np.array(errors)


@pytest.mark.parametrize("seed", range(3))
def test_uncertain_feet_are_combined_with_the_calibrated_up(walker, true_points, seed):
    noisy, skeleton = lasting(true_points, 0.03, seed), walker.truth.skeleton
    alone = floor_from_feet([noisy], skeleton, None)
    both = floor_from_feet([noisy], skeleton, UP)
    assert alone.tilt_sd_deg > 0.5
    assert tilt_deg(alone.normal) < 3.0 * alone.tilt_sd_deg
    assert both.uses_up
    assert tilt_deg(both.normal) < tilt_deg(alone.normal)
    assert tilt_deg(both.normal) < 2.0
    # A wrong up axis contradicts the feet and is ignored.
    leaning = np.array([np.sin(0.5), 0.0, np.cos(0.5)])
    against = floor_from_feet([noisy], skeleton, leaning)
    assert not against.uses_up
    np.testing.assert_array_equal(against.normal, alone.normal)


def test_certain_feet_override_the_calibrated_up(walker, true_points):
    leaning = np.array([0.0, np.sin(np.radians(2.0)), np.cos(np.radians(2.0))])
    plane = floor_from_feet([true_points], walker.truth.skeleton, leaning)
    assert plane.tilt_sd_deg < 1.0
    assert tilt_deg(plane.normal) < 1.0
    for turn_deg, says in ((0.0, "which is combined with the feet"), (20.0, "which contradicts the feet")):
        rotation = Rotation.from_euler("x", turn_deg, degrees=True).as_matrix()
        steps = find_alignment(
            [true_points @ rotation.T], walker.truth.skeleton, walker.rig, AlignOptions(floor="feet")
        ).steps
        assert says in steps[0]


@pytest.mark.parametrize("preset", list(PRESETS))
def test_axes_of_presets(walker, true_points, preset):
    options = AlignOptions(floor="feet", origin="subject", forward="walk", preset=preset)
    rotation = Rotation.from_rotvec([0.3, 0.2, -2.0]).as_matrix()
    points = turned(true_points, rotation, np.array([3.0, 1.0, -1.0]))
    rig = align(walker.truth, Alignment(rotation, np.array([3.0, 1.0, -1.0]), 1.0, None, None)).rig
    found = find_alignment([points], walker.truth.skeleton, rig, options)
    new = found.points(points)
    up, ahead = (np.array(up_vector(axis)) for axis in PRESETS[preset])
    skeleton = walker.truth.skeleton
    heads = np.nanmedian(new[:, 0, skeleton.index("nose")] @ up)
    assert 1.2 < heads < 1.9
    feet = new[:, 0, [skeleton.index("left_heel"), skeleton.index("right_heel")]] @ up
    assert abs(np.nanquantile(feet, 0.1)) < 0.05
    hips = new[:, 0, skeleton.index("left_hip")]
    way = hips[-1] - hips[0]
    assert way @ ahead > 0.9 * np.linalg.norm(way)
    assert np.linalg.norm(hips[0] - (hips[0] @ up) * up) < 0.4
    assert found.up_axis == PRESETS[preset][0]
    assert (preset == "unreal") == any("left-handed" in step for step in found.steps)


def test_floor_from_three_points_and_a_direction(walker, true_points):
    options = AlignOptions(
        floor_points_m=(0, 0, 0, 0, 1, 0, 1, 0, 0), origin_m=(1, 2, 9),
        forward_m=(0, 1, 0.5),
    )  # fmt: skip
    found = find_alignment([true_points], walker.truth.skeleton, walker.rig, options)
    np.testing.assert_allclose(found.points(np.array([1.0, 2.0, 0.0])), 0.0, atol=1e-12)
    np.testing.assert_allclose(found.points(np.array([1.0, 3.0, 0.0])), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found.points(np.array([1.0, 2.0, 1.0])), [0, 0, 1], atol=1e-12)


def test_forward_is_the_facing_direction(walker, true_points):
    found = find_alignment([true_points[:30]], walker.truth.skeleton, walker.rig, AlignOptions(forward="subject"))
    new = found.points(true_points[:30])
    skeleton = walker.truth.skeleton
    across = np.nanmean(new[:, 0, skeleton.index("left_hip")] - new[:, 0, skeleton.index("right_hip")], axis=0)
    assert across[1] > 5 * abs(across[0])


def test_scale_from_height_or_distance(walker, true_points):
    skeleton = walker.truth.skeleton
    length = np.median(
        np.linalg.norm(
            true_points[:, 0, skeleton.index("left_hip")] - true_points[:, 0, skeleton.index("left_knee")], axis=-1
        )
    )
    options = AlignOptions(length_m=2 * length, length_between=("left_hip", "left_knee"))
    assert scale_factor([true_points], skeleton, options) == pytest.approx(2.0)
    height = estimate_height_m([true_points], skeleton)
    assert estimate_height_m([2 * true_points], skeleton) == pytest.approx(2 * height)
    top = true_points[:, 0, skeleton.index("head_top"), 2]
    assert height == pytest.approx(np.nanmax(top), rel=0.08)


class TestPipeline:
    def test_floor_origin_and_scale_are_applied_and_recorded(self, walker):
        align = AlignOptions(floor="feet", origin="subject", preset="opensim", height_m=0.9)
        result = posefuse.reconstruct(walker.rig, walker.detections, Options(align=align))
        plain = posefuse.reconstruct(walker.rig, walker.detections)
        assert result.rig.up_axis == "y"
        assert result.alignment.scale == pytest.approx(0.5, rel=0.1)
        assert any("Lengths are multiplied" in note for note in result.provenance.notes)
        assert any("feet stand still" in note for note in result.provenance.notes)
        back = in_calibration_world(result)
        np.testing.assert_allclose(
            np.asarray(back.layers["measured"].points_m), np.asarray(plain.layers["measured"].points_m), atol=1e-5
        )
        np.testing.assert_allclose(
            np.asarray(result.layers["measured"].reprojection_error_px),
            np.asarray(plain.layers["measured"].reprojection_error_px),
            atol=1e-3,
        )

    def test_scale_is_estimated_in_one_pass(self, walker, monkeypatch):
        """No finding concerns the calibrated scale, because the options correct it."""
        looks = []
        estimate = recipe.estimate_noise
        monkeypatch.setattr(recipe, "estimate_noise", lambda *given: looks.append(1) or estimate(*given))
        rig = scaled_rig(walker.rig, 1000.0)
        with pytest.warns(posefuse.PosefuseWarning, match="scale is wrong"):
            posefuse.reconstruct(rig, walker.detections)
        looks.clear()
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            result = posefuse.reconstruct(rig, walker.detections, Options(align=AlignOptions(height_m=1.75)))
        assert looks == [1]
        assert not any("scale is wrong" in note for note in result.provenance.notes)
        plain = posefuse.reconstruct(walker.rig, walker.detections, Options(align=AlignOptions(height_m=1.75)))
        np.testing.assert_allclose(
            np.asarray(result.layers["measured"].points_m), np.asarray(plain.layers["measured"].points_m), atol=1e-5
        )

    def test_alignment_survives_a_file(self, walker, tmp_path):
        result = posefuse.reconstruct(walker.rig, walker.detections, Options(align=AlignOptions(forward="walk")))
        posefuse.write(result, tmp_path / "reconstruction.nc")
        assert posefuse.read_reconstruction(tmp_path / "reconstruction.nc") == result

    def test_missing_up_axis_is_an_error(self, walker):
        rig = replace(walker.rig, up_axis=None)
        with pytest.raises(OptionsError, match="--up"):
            posefuse.reconstruct(rig, walker.detections, Options(align=AlignOptions(forward="walk")))


class TestFindings:
    def test_no_findings_for_a_correct_world(self, walker, true_points):
        assert floor_findings([true_points], walker.truth.skeleton, walker.rig) == (None,)

    def test_upside_down_people_are_reported(self, walker, true_points):
        rig = replace(walker.rig, up_axis="-z")
        (finding,) = floor_findings([true_points], walker.truth.skeleton, rig)
        assert "upside down" in finding
        assert "--up z" in finding

    def test_camera_below_the_floor_is_reported(self, walker, true_points):
        pose = walker.rig.cameras[0].camera_from_world.copy()
        low = pose.copy()
        low[:3, 3] = -pose[:3, :3] @ np.array([4.0, 0.0, -1.5])
        rig = replace(
            walker.rig, cameras=(replace(walker.rig.cameras[0], camera_from_world=low), *walker.rig.cameras[1:])
        )
        (finding,) = floor_findings([true_points], walker.truth.skeleton, rig)
        assert "cam_0 is below" in finding

    def test_no_findings_without_an_up_axis(self, true_points, walker):
        assert floor_findings([true_points], walker.truth.skeleton, replace(ring(), up_axis=None)) == (None,)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"floor_points_m": (1.0,)}, "9 finite numbers"),
        ({"origin_m": (1.0, 2.0, 3.0), "origin": "subject"}, "exclude each other"),
        ({"floor": "feat"}, "Did you mean 'feet'"),
        ({"height_m": -1.0}, "must be a finite number above 0 m"),
        ({"height_m": 1.7, "length_m": 0.4, "length_between": ("a", "b")}, "one of them"),
    ],
)
def test_invalid_options_are_errors(change, says):
    with pytest.raises(OptionsError, match=says):
        AlignOptions(**change)
