"""Relative pose and time offset of two views."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.people.bearings import bearings_of
from posefuse.calibration.people.pairs import relate_pair
from posefuse.synthetic.rigs import build_rig
from tests.filmed_people import angle_deg, filmed_person, relative_rotation

ADJACENT = build_rig("ring", 4).select(["cam_0", "cam_1"])


def related(people, **options):
    a, b = (bearings_of(view, people.skeleton) for view in people.views)
    return relate_pair(a, b, **options)


def swap_sides(view, skeleton, frames):
    pixels = view.keypoints_px.copy()
    pixels[frames] = pixels[frames][:, :, skeleton.mirror]
    return replace(view, keypoints_px=pixels)


def check(rig, geometry, max_deg=6.0):
    assert angle_deg(geometry.rotation, relative_rotation(rig, 0, 1)) < max_deg
    a, b = rig.cameras
    translation = b.translation_m - relative_rotation(rig, 0, 1) @ a.translation_m
    assert geometry.translation @ translation > 0.98 * np.linalg.norm(translation)


@pytest.mark.parametrize("offset_s", [0.0, 0.74])
def test_pose_and_offset_are_found(rng, offset_s):
    best = related(filmed_person(ADJACENT, rng, offsets_s=(0.0, offset_s), sigma_px=2.0))[0]
    check(ADJACENT, best)
    assert best.offset_s == pytest.approx(offset_s, abs=0.03)
    assert best.mirrored == 0.0
    assert best.support > 0.5 * best.n_points


@pytest.mark.parametrize("share", [0.33, 1.0])
def test_exchanged_sides_of_one_view_are_recognized(rng, share):
    people = filmed_person(ADJACENT, rng, sigma_px=2.0)
    view = people.views[1]
    frames = np.arange(len(view.time_s)) < share * len(view.time_s)
    people = replace(people, views=(people.views[0], swap_sides(view, people.skeleton, frames)))
    best = related(people, offsets_s=())[0]
    check(ADJACENT, best)
    assert best.offset_s == 0.0
    assert best.mirrored == pytest.approx(share, abs=0.05)


def test_same_input_gives_same_geometry(rng):
    people = filmed_person(ADJACENT, rng)
    first, second = (related(people, offsets_s=(0.0,))[0] for _ in range(2))
    assert first.rotation.tobytes() == second.rotation.tobytes()
    assert first.cost == second.cost


def test_views_without_shared_time_have_no_geometry(rng):
    people = filmed_person(ADJACENT, rng, duration_s=1.0)
    late = replace(people.views[1], time_s=people.views[1].time_s + 100.0)
    assert related(replace(people, views=(people.views[0], late))) == []
