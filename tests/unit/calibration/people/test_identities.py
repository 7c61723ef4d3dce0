"""Identities of people in several views, without a calibration."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.people.identities import identify_people, strangers, useful_jobs, with_common_people
from posefuse.calibration.people.match import match_views
from posefuse.errors import CalibrationError
from posefuse.parallel import Jobs
from tests.filmed_people import pose_errors
from tests.unit.calibration.people.crowd_views import crowd_views


@pytest.fixture(scope="module")
def crowd():
    return crowd_views(2, people=3, cameras=3)


@pytest.fixture(scope="module")
def found(crowd):
    return identify_people(crowd.people)


def test_groups_hold_one_person_each(crowd, found):
    tracks = [track for group in found.people for track in group]
    assert len(set(tracks)) == len(tracks)
    owners = [[crowd.owner[v][t] for v, t in group] for group in found.people]
    wrong = sum(len(group) - max(group.count(each) for each in group) for group in owners)
    assert wrong <= 0.03 * len(tracks)
    assert len(tracks) > 0.9 * sum(map(len, crowd.owner))
    assert {v for pair in found.relations for v in pair} == {0, 1, 2}


def test_person_axes_agree(crowd, found):
    people = with_common_people(crowd.people)
    for v, view in enumerate(people.views):
        assert view.keypoints_px.shape[1] == len(found.people)
        for person, group in enumerate(found.people):
            for w, track in group:
                if w == v:
                    there = np.isfinite(crowd.people.views[v].keypoints_px[:, track, :, 0]).any(axis=1)
                    kept = crowd.people.views[v].keypoints_px[there, track]
                    np.testing.assert_array_equal(view.keypoints_px[there, person], kept)
        assert np.isfinite(view.confidence).sum() == np.isfinite(view.keypoints_px[..., 0]).sum()


@pytest.mark.long
def test_view_of_other_people_has_no_part(crowd):
    """A camera in another room, which agrees by chance with some tracks of each view."""
    elsewhere = crowd_views(11, people=3, cameras=2)
    views = (*crowd.people.views[:2], elsewhere.people.views[0])
    found = identify_people(replace(crowd.people, views=views))
    assert set(found.relations) == {(0, 1)}
    assert {v for group in found.people for v, _ in group} == {0, 1}


def test_cameras_of_a_crowd_are_matched(crowd):
    """Unknown people, clocks and poses."""
    matched = match_views(crowd.people)
    rotations_deg, _, scale = pose_errors(crowd.rig, matched)
    assert np.median(rotations_deg) < 2.0
    assert scale == pytest.approx(1.0, abs=0.12)
    np.testing.assert_allclose(matched.offset_s, crowd.offset_s - crowd.offset_s[0], atol=0.05)


@pytest.mark.long
def test_matched_views_do_not_depend_on_the_number_of_processes(crowd):
    alone = match_views(crowd.people)
    with Jobs(2) as jobs:
        together = match_views(crowd.people, jobs=jobs)
    np.testing.assert_array_equal(together.offset_s, alone.offset_s)
    for view, expected in zip(together.views, alone.views, strict=True):
        assert view.camera == expected.camera
        np.testing.assert_array_equal(view.keypoints_px, expected.keypoints_px)


def test_single_person_needs_no_processes(crowd):
    assert useful_jobs(crowd.people) > 1
    views = [replace(view, keypoints_px=view.keypoints_px[:, :1]) for view in crowd.people.views]
    assert useful_jobs(replace(crowd.people, views=tuple(views))) == 1


def test_people_who_have_nothing_in_common(crowd):
    """One view is replaced by people elsewhere: two cameras without a common person."""
    quiet = replace(crowd.people.views[1], keypoints_px=np.full_like(crowd.people.views[1].keypoints_px, np.nan))
    with pytest.raises(CalibrationError, match="No person is recognized in two of the cameras cam_0, cam_1"):
        match_views(replace(crowd.people, views=(crowd.people.views[0], quiet)))


def test_camera_that_sees_other_people_is_named(crowd):
    left = replace(crowd.people.views[2], keypoints_px=np.full_like(crowd.people.views[2].keypoints_px, np.nan))
    common = replace(crowd.people, views=(*crowd.people.views[:2], left))
    found = strangers(crowd.people, common, ["cam_1", "cam_2"])
    assert list(found) == ["cam_2"]
    assert "recognized in another camera" in found["cam_2"]
