"""Identities of real people in several views, without a calibration."""

import numpy as np
import pytest
from benchmarks.calibration_recordings import recording
from benchmarks.calibration_scores import score_calibration

from posefuse.calibration.people.bearings import bearings_of
from posefuse.calibration.people.estimate import estimate_people
from posefuse.calibration.people.identities import identify_people
from posefuse.calibration.people.match import match_views
from posefuse.calibration.people.pictures import match_pictures
from posefuse.calibration.people.tracks import tracks_in_views
from posefuse.model.cameras import vector_from_rotation


def identified(name: str, shared_data):
    case = recording(name, shared_data("pose2sim").parent)
    people = tracks_in_views(case.detections, case.lenses().cameras)
    return case, people, identify_people(people)


@pytest.mark.long
def test_two_people_and_a_passer_by(shared_data):
    """Both people in all views, the passer-by in two; detections are shuffled and have no identities."""
    case, people, found = identified("two_people", shared_data)
    assert [sorted({v for v, _ in group}) for group in found.people] == [[0, 1, 2, 3], [0, 1, 2, 3], [0, 1]]
    assert sum(map(len, found.people)) == sum(view.keypoints_px.shape[1] for view in people.views)
    assert len(found.relations) == 6
    for (a, b), relation in found.relations.items():
        assert abs(relation.geometry.offset_s) < 0.02
        true = case.rig.cameras[b].rotation @ case.rig.cameras[a].rotation.T
        turn = vector_from_rotation(relation.geometry.rotation @ true.T)
        assert np.degrees(np.linalg.norm(turn)) < 8.0


def test_bystanders_of_one_view_match_nobody(shared_data):
    """The bystanders of two views, each seen by one camera or two, are not the balancing person."""
    _, _, found = identified("balancing_raw", shared_data)
    assert sorted({v for v, _ in found.people[0]}) == [0, 1, 2, 3]
    assert all(len({v for v, _ in group}) <= 2 for group in found.people[1:])


def test_pictures_of_an_operating_room(shared_data):
    """Several people in pictures 75 s apart: relative poses and matches from all frames at once."""
    case = recording("mvor", shared_data("mvor").parent)
    people = tracks_in_views(case.detections, case.lenses().cameras)
    assert not people.tracked
    a, b = (bearings_of(people.views[v], people.skeleton) for v in (0, 1))
    found = match_pictures(a, b)
    assert found is not None
    assert len(found.support) > 380
    true = case.rig.cameras[1].rotation @ case.rig.cameras[0].rotation.T
    turn = vector_from_rotation(found.geometry.rotation @ true.T)
    assert np.degrees(np.linalg.norm(turn)) < 10.0


@pytest.mark.long
@pytest.mark.parametrize(("name", "rotation_deg"), [("two_people", 1.5), ("balancing_raw", 1.5), ("mvor", 3.0)])
def test_cameras_of_people_without_identities(name, rotation_deg, shared_data):
    case = recording(name, shared_data("pose2sim").parent)
    matched = match_views(tracks_in_views(case.detections, case.lenses().cameras))
    score = score_calibration(estimate_people(matched).cameras, case.rig)
    assert score.cameras == len(case.rig)
    assert score.rotation_deg < rotation_deg
