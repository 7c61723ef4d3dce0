"""Tables of segment masses."""

from typing import get_args

import pytest

from posefuse.errors import SkeletonError
from posefuse.model.options.subject import MassTable
from posefuse.skeleton.masses import default_table, mass_table
from posefuse.skeleton.skeletons import find_skeleton

TABLES = [name for name in get_args(MassTable) if name not in ("auto", "none")]


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


def test_the_mean_table_is_halfway_between_the_sexes():
    tables = [mass_table(f"de_leva_{name}").segments for name in ("female", "male", "mean")]
    for female, male, mean in zip(*tables, strict=True):
        assert mean.name == female.name
        assert mean.mass == pytest.approx((female.mass + male.mass) / 2)
        assert [ends[2] for ends in mean.ends] == pytest.approx(
            [(one[2] + two[2]) / 2 for one, two in zip(female.ends, male.ends, strict=True)]
        )
    assert default_table("F").name == "de_leva_female"
    assert default_table("O") == default_table(None) == mass_table("de_leva_mean")


def test_skeletons_without_a_segment_do_not_fit():
    table, mouse = mass_table("winter"), find_skeleton("mouse_22")
    assert table.fits(find_skeleton("coco_17"))
    assert not table.fits(mouse)
    with pytest.raises(SkeletonError, match="needs the segment"):
        table.check(mouse)
