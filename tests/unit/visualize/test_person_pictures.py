"""Pictures show people where they are large, whole and alone."""

import io
from dataclasses import replace

import numpy as np
from PIL import Image

from posefuse.model.tracks import TrackState
from posefuse.visualize.person_pictures import best_moments, cut_out
from tests.videos import moving_sticks


def test_each_person_has_moments_of_different_views():
    result = moving_sticks()
    people = best_moments(result, "measured", range(2), 3)
    assert all(sorted(moment.view for moment in moments) == [0, 1] for moments in people)
    for person, moments in enumerate(people):
        for moment in moments:
            camera = result.rig.cameras[moment.view]
            points = np.asarray(result.layers["measured"].points_m)[moment.frame_index, person]
            pixels = camera.project(points)[0]
            assert (pixels >= np.array(moment.box_px[:2]) - 1e-6).all()
            assert (pixels <= np.array(moment.box_px[2:]) + 1e-6).all()
        assert moments[0].score >= moments[-1].score > 0


def test_frames_in_which_a_person_is_lost_or_overlapped_are_avoided():
    result = moving_sticks()
    assert result.tracks is not None
    state = np.array(result.tracks.state)
    state[:, 1] = TrackState.LOST
    state[7, 1] = TrackState.ACTIVE
    lost = replace(result, tracks=replace(result.tracks, state=state))
    assert {moment.frame_index for moment in best_moments(lost, "measured", [0], 3)[1]} == {7}
    points = np.array(result.layers["measured"].points_m)
    # The two people are in one place except in frame 4.
    points[:, 1] = points[:, 0]
    points[4, 1] += [0.0, 0.0, 0.8]
    together = replace(result, layers={"measured": replace(result.layers["measured"], points_m=points)})
    assert {moment.frame_index for moment in best_moments(together, "measured", [0], 3)[0]} == {4}


def test_views_that_may_not_be_used_and_absent_people_have_no_moment():
    result = moving_sticks()
    assert {m.view for moments in best_moments(result, "measured", [1], 3) for m in moments} == {1}
    points = np.array(result.layers["measured"].points_m)
    points[:, 1] = np.nan
    absent = replace(result, layers={"measured": replace(result.layers["measured"], points_m=points)})
    assert best_moments(absent, "measured", range(2), 3)[1] == []


def test_cut_out_stays_inside_the_image_and_is_small():
    image = np.zeros((1000, 800, 3), dtype=np.uint8)
    image[:, 400:] = 255
    content, size = cut_out(image, (600.0, 10.0, 790.0, 990.0))
    with Image.open(io.BytesIO(content)) as picture:
        assert picture.size == size
        assert size[1] == 320
        assert np.asarray(picture)[160, -2].min() > 240
    assert cut_out(image, (5.0, 5.0, 6.0, 6.0))[1][0] > 5
