"""Squats need a person who stands before and after, and a depth relative to the leg."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.biomechanics.foot_paths import FootPaths
from posefuse.biomechanics.repetitions import find_repetitions

RATE_HZ = 60.0
THIGH_M, SHANK_M = 0.43, 0.42
LEG_M = THIGH_M + SHANK_M
NO_CONTACT = [[[], []], [[], []]]


def person(height_m):
    """Return paths of a person whose pelvis has a height in m above feet at rest, and whose knees follow."""
    height = np.minimum(height_m, LEG_M)
    time_s = np.arange(len(height)) / RATE_HZ
    cosine = (height**2 - THIGH_M**2 - SHANK_M**2) / (2.0 * THIGH_M * SHANK_M)
    knees = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    hips = np.zeros((len(time_s), 2, 3))
    hips[..., 2] = height_m[:, None]
    hips[:, 0, 1], hips[:, 1, 1] = 0.1, -0.1
    feet = np.zeros((len(time_s), 2, 2, 3))
    legs = np.full((len(time_s), 2), LEG_M)
    return FootPaths(time_s, feet, np.zeros_like(feet), hips, np.repeat(knees[:, None], 2, axis=1), legs)


def bobbing(base_m, depth_m, seconds=12.0, period_s=4.0):
    """Return heights that are lower by a depth once per period, for 0.5 to 2.5 s of it."""
    time_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    inside = np.clip((time_s % period_s - 0.5) / 2.0, 0.0, 1.0)
    return base_m - depth_m * np.sin(np.pi * inside) ** 2


def kinds(paths):
    return [each.kind for each in find_repetitions(paths, NO_CONTACT, [])]


@pytest.mark.parametrize("depth", [0.2, 0.4])
def test_a_person_who_stands_before_and_after_squats(depth):
    found = find_repetitions(person(bobbing(0.97 * LEG_M, depth)), NO_CONTACT, [])
    assert [each.kind for each in found] == ["squat"] * 3
    assert [each.size_m for each in found] == pytest.approx([depth] * 3, abs=0.02)


@pytest.mark.parametrize("base", [0.15, 0.45, 0.55])
@pytest.mark.parametrize("depth", [0.07, 0.14])
def test_a_seated_person_does_not_squat(base, depth):
    assert kinds(person(bobbing(base, depth))) == []


def test_a_seated_person_with_straight_legs_does_not_squat():
    paths = person(bobbing(0.4, 0.14))
    assert kinds(replace(paths, knee_deg=np.full_like(paths.knee_deg, 10.0))) == []


@pytest.mark.parametrize("depth", [0.03, 0.1])
def test_small_movements_of_the_pelvis_are_no_squats(depth):
    assert kinds(person(bobbing(0.97 * LEG_M, depth))) == []


def test_depth_is_relative_to_the_segments_of_the_leg():
    """A person of half the size squats half as deep."""
    small = person(bobbing(0.97 * LEG_M, 0.2))
    small = replace(small, hips_m=0.5 * small.hips_m, leg_m=0.5 * small.leg_m)
    assert kinds(small) == ["squat"] * 3
    assert kinds(replace(small, leg_m=4.0 * small.leg_m)) == []


def test_one_squat_of_a_person_who_mostly_sits_is_found():
    seated, standing = np.full(2400, 0.4), bobbing(0.97 * LEG_M, 0.3, seconds=4.0)
    rise = np.linspace(0.4, 0.97 * LEG_M, 60)
    assert kinds(person(np.concatenate([seated, rise, standing, standing[:60]]))) == ["squat"]


def test_a_person_who_sits_down_for_good_neither_squats_nor_rises():
    standing, down = np.full(120, 0.97 * LEG_M), np.linspace(0.97 * LEG_M, 0.4, 40)
    lifted = 0.4 + 0.2 * np.sin(np.linspace(0.0, np.pi, 60))
    heights = np.concatenate([standing, down, np.full(120, 0.4), lifted, np.full(120, 0.4)])
    assert kinds(person(heights)) == []


@pytest.mark.parametrize("first_s", [0.0, 2.3])
def test_knees_that_are_bent_before_or_after_show_no_squat(first_s):
    """The first lowering lasts from 0.5 to 2.5 s; its neighbors are found."""
    paths = person(bobbing(0.97 * LEG_M, 0.3))
    bent = (paths.time_s >= first_s) & (paths.time_s < first_s + 1.0)
    found = find_repetitions(replace(paths, knee_deg=np.where(bent[:, None], 90.0, paths.knee_deg)), NO_CONTACT, [])
    assert [each.start_s > 4.0 for each in found] == [True, True]


def test_without_knees_nothing_shows_a_squat():
    paths = person(bobbing(0.97 * LEG_M, 0.4))
    assert kinds(replace(paths, knee_deg=np.full_like(paths.knee_deg, np.nan))) == []
