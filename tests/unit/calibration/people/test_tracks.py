"""2D tracks inside each view, before the cameras are known."""

import numpy as np
import pytest

import posefuse
from posefuse.calibration.people.tracks import MOST_FRAMES, MOST_TRACKS, tracks_in_views
from posefuse.errors import DetectionsError
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.crowds import simulate_crowd


def crowd(**options):
    return simulate_crowd(posefuse.CrowdOptions(people=3, cameras=3, duration_s=20.0, **options))


def test_people_views_hold_long_tracks_at_the_times_of_each_view():
    scene = crowd(seed=1)
    times = np.array(scene.detections.time_s)
    times[:, 1] += 0.37
    shifted = posefuse.Detections(**{**vars_of(scene.detections), "time_s": times})
    people = tracks_in_views(shifted, scene.rig.cameras, focal_known=[True, False, True])
    assert people.tracked
    assert [view.focal_known for view in people.views] == [True, False, True]
    np.testing.assert_array_equal(people.views[1].time_s, times[:, 1])
    for view in people.views:
        seen = np.isfinite(view.keypoints_px[..., 0])
        assert 1 <= seen.shape[1] <= MOST_TRACKS
        for person in range(seen.shape[1]):
            frames = np.flatnonzero(seen[:, person].any(axis=1))
            assert view.time_s[frames[-1]] - view.time_s[frames[0]] > 0.49
        np.testing.assert_array_equal(np.isfinite(view.confidence), seen)


def vars_of(detections: Detections) -> dict:
    return {name: getattr(detections, name) for name in detections.__dataclass_fields__}


def one_person(n_frames: int = 30, **options) -> Detections:
    rng = np.random.default_rng(2)
    skeleton = find_skeleton("body_20")
    return Detections.from_dense(
        skeleton, ("a", "b"), rng.uniform(0.0, 500.0, (n_frames, 2, len(skeleton), 2)), **options
    )


def test_single_detections_are_one_track_whatever_they_do():
    """They jump at random: nothing is linked, but there is nobody else."""
    scene = crowd()
    people = tracks_in_views(one_person(rate_hz=30.0), scene.rig.cameras[:2])
    assert people.tracked
    assert [view.keypoints_px.shape[:2] for view in people.views] == [(30, 1), (30, 1)]
    assert people.notes == ()


def test_rate_is_assumed_without_times():
    people = tracks_in_views(one_person(), crowd().rig.cameras[:2])
    assert np.diff(people.views[0].time_s) == pytest.approx(1.0 / 30.0)
    assert people.notes == ("The keypoints have no times: 30 frames per second are assumed.",)


def test_pictures_far_apart_are_not_linked():
    scene = crowd(seed=2)
    stills = scene.detections.pieces([(f, f + 1) for f in range(0, 500, 50)])
    people = tracks_in_views(stills, scene.rig.cameras)
    assert not people.tracked
    counts = [np.isfinite(view.keypoints_px[..., 0]).any(axis=2).sum(axis=1) for view in people.views]
    np.testing.assert_array_equal(np.stack(counts, axis=1), stills.people_counts)


def test_long_recordings_are_sampled():
    n = 3 * MOST_FRAMES
    people = tracks_in_views(one_person(n, rate_hz=30.0), crowd().rig.cameras[:2])
    times = people.views[0].time_s
    assert len(times) == MOST_FRAMES
    assert times[0] == 0.0
    assert times[-1] == pytest.approx((n - 1) / 30.0)
    assert f"{MOST_FRAMES} of {n} frames" in people.notes[0]


def test_nobody_and_wrong_number_of_cameras():
    scene = crowd()
    empty = Detections.from_dense(find_skeleton("body_20"), ("a", "b"), np.zeros((0, 2, 20, 2)), rate_hz=30.0)
    with pytest.raises(DetectionsError, match="No person was detected"):
        tracks_in_views(empty, scene.rig.cameras[:2])
    with pytest.raises(DetectionsError, match="2 views, but 3 cameras"):
        tracks_in_views(one_person(), scene.rig.cameras)


def test_pictures_without_times_are_not_linked():
    """Their numbers follow each other in number only."""
    scene = crowd(seed=2)
    stills = scene.detections.pieces([(f, f + 1) for f in range(0, 500, 50)])
    unknown = np.full_like(stills.time_s, np.nan)
    numbered = Detections(**{**vars_of(stills), "frame_numbers": np.arange(10), "time_s": unknown, "rate_hz": None})
    people = tracks_in_views(numbered, scene.rig.cameras)
    assert not people.tracked
    assert np.diff(people.views[0].time_s).min() > 1.0
    assert people.notes == ("People are not linked over time: the frames are unrelated pictures.",)
