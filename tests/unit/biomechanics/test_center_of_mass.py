"""Centers of mass and segment lengths."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from posefuse.biomechanics.center_of_mass import centers_of_mass
from posefuse.errors import SkeletonError
from posefuse.model.options.subject import MassTable
from posefuse.model.status import Source
from posefuse.skeleton.masses import mass_table
from posefuse.skeleton.skeletons import find_skeleton

SHIFT = np.array([1.0, 2.0, 3.0])


TABLES = [name for name in get_args(MassTable) if name != "none"]


@pytest.mark.parametrize("name", TABLES)
def test_masses_add_up_to_the_whole_body(name):
    table = mass_table(name)
    assert sum(segment.mass for segment in table.segments) == pytest.approx(1.0, abs=2e-3)
    assert table.source
    assert {s.name.replace("left_", "right_") for s in table.segments} >= {
        s.name for s in table.segments if "right" in s.name
    }


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("skeleton", ["halpe_26", "coco_17", "body_25", "mediapipe_33", "h36m_17"])
def test_human_skeletons_have_all_segments(name, skeleton):
    mass_table(name).check(find_skeleton(skeleton))


@pytest.mark.parametrize("name", TABLES)
def test_center_of_mass_of_a_standing_person_is_above_the_hips(name, truth, layer):
    actual = centers_of_mass(layer, truth.skeleton, mass_table(name))
    points = np.asarray(layer.points_m)[:, 0]
    height = np.nanmax(points[..., 2], axis=1)
    assert actual.xyz_m.shape == (15, 1, 3)
    # 55 to 57 % of the height in the literature; in walking a little less.
    assert ((actual.xyz_m[:, 0, 2] / height > 0.5) & (actual.xyz_m[:, 0, 2] / height < 0.62)).all()
    np.testing.assert_allclose(actual.known_share, 1.0)
    np.testing.assert_allclose(actual.filled_share, 0.0)


def test_center_of_mass_moves_with_the_body(truth, layer):
    moved = replace(layer, points_m=np.asarray(layer.points_m) + SHIFT)
    table = mass_table("winter")
    before, after = (centers_of_mass(each, truth.skeleton, table).xyz_m for each in (layer, moved))
    np.testing.assert_allclose(after, before + SHIFT, atol=1e-9)


def test_missing_mass_and_filled_share(truth, layer):
    wrist, hip = truth.skeleton.index("left_wrist"), truth.skeleton.index("left_hip")
    points, source = np.array(layer.points_m), np.array(layer.source)
    points[0, 0, wrist] = np.nan
    points[1, 0, hip] = np.nan
    source[2, 0, wrist] = Source.FILLED
    actual = centers_of_mass(replace(layer, points_m=points, source=source), truth.skeleton, mass_table("winter"))
    assert actual.known_share[0, 0] == pytest.approx(1 - 0.022)
    assert np.isfinite(actual.xyz_m[0, 0]).all()
    assert actual.known_share[1, 0] == pytest.approx(1 - 0.497 - 0.1)
    assert np.isnan(actual.xyz_m[1, 0]).all()
    assert actual.filled_share[2, 0] == pytest.approx(0.022)


def test_animals_have_no_mass_table(truth, layer):
    with pytest.raises(SkeletonError, match="needs the segment"):
        mass_table("winter").check(find_skeleton("mouse_22"))
