"""Axes of the aligned world, and the alignment of a reconstruction."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posefuse
from posefuse.alignment.apply import align, in_calibration_world, scaled_rig
from posefuse.alignment.world_axes import find_alignment
from posefuse.errors import OptionsError
from posefuse.io.results.rounding import rounded
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import up_vector
from posefuse.model.findings import FindingKind
from posefuse.model.options.alignment import PRESETS, AlignOptions
from posefuse.model.options.options import Options
from posefuse.pipeline import reconstruct as recipe

from .conftest import rotate_points


@pytest.mark.parametrize("preset", list(PRESETS))
def test_axes_of_presets(walker, true_points, preset):
    options = AlignOptions(floor="feet", origin="subject", forward="walk", preset=preset)
    rotation = Rotation.from_rotvec([0.3, 0.2, -2.0]).as_matrix()
    points = rotate_points(true_points, rotation, np.array([3.0, 1.0, -1.0]))
    rig = align(walker.truth, Alignment(rotation, np.array([3.0, 1.0, -1.0]), 1.0, None, None)).rig
    actual = find_alignment([points], walker.truth.skeleton, rig, options)
    new = actual.points(points)
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
    assert actual.up_axis == PRESETS[preset][0]
    assert (preset == "unreal") == any("left-handed" in step for step in actual.steps)


def test_floor_from_three_points_and_a_direction(walker, true_points):
    options = AlignOptions(
        floor_points_m=(0, 0, 0, 0, 1, 0, 1, 0, 0), origin_m=(1, 2, 9),
        forward_m=(0, 1, 0.5),
    )  # fmt: skip
    actual = find_alignment([true_points], walker.truth.skeleton, walker.rig, options)
    np.testing.assert_allclose(actual.points(np.array([1.0, 2.0, 0.0])), 0.0, atol=1e-12)
    np.testing.assert_allclose(actual.points(np.array([1.0, 3.0, 0.0])), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(actual.points(np.array([1.0, 2.0, 1.0])), [0, 0, 1], atol=1e-12)


def test_forward_is_the_facing_direction(walker, true_points):
    actual = find_alignment([true_points[:30]], walker.truth.skeleton, walker.rig, AlignOptions(forward="subject"))
    new = actual.points(true_points[:30])
    skeleton = walker.truth.skeleton
    across = np.nanmean(new[:, 0, skeleton.index("left_hip")] - new[:, 0, skeleton.index("right_hip")], axis=0)
    assert across[1] > 5 * abs(across[0])


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
        assert not any(finding.kind == FindingKind.SCALE for finding in result.findings)
        plain = posefuse.reconstruct(walker.rig, walker.detections, Options(align=AlignOptions(height_m=1.75)))
        np.testing.assert_allclose(
            np.asarray(result.layers["measured"].points_m), np.asarray(plain.layers["measured"].points_m), atol=1e-5
        )

    def test_alignment_survives_a_file(self, walker, tmp_path):
        result = posefuse.reconstruct(walker.rig, walker.detections, Options(align=AlignOptions(forward="walk")))
        posefuse.write(result, tmp_path / "reconstruction.nc")
        assert posefuse.read_reconstruction(tmp_path / "reconstruction.nc") == rounded(result)

    def test_missing_up_axis_is_an_error(self, walker):
        rig = replace(walker.rig, up_axis=None)
        with pytest.raises(OptionsError, match="`up`"):
            # In so few frames, people do not show what is up.
            posefuse.reconstruct(rig, walker.detections, Options(align=AlignOptions(forward="walk"), end_s=0.2))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"floor_points_m": (1.0,)}, "9 finite numbers"),
        ({"origin_m": (1.0, 2.0, 3.0), "origin": "subject"}, "exclude each other"),
        ({"floor": "feat"}, "Did you mean 'feet'"),
        ({"height_m": -1.0}, "must be a finite number above 0 and at most 100 m"),
        ({"height_m": 1.7, "length_m": 0.4, "length_between": ("a", "b")}, "one of them"),
    ],
)
def test_invalid_options_are_errors(change, says):
    with pytest.raises(OptionsError, match=says):
        AlignOptions(**change)
