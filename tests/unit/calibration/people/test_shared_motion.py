"""Views that share no motion: other people, other times, or people who hardly move."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.simulated_rigs import RigOptions, simulate_rig

from posefuse.calibration.people.match import match_views
from posefuse.calibration.people.shared_motion import backward
from posefuse.calibration.people.tracks import tracks_in_views
from posefuse.calibration.people.views import PeopleViews
from posefuse.errors import CalibrationError
from tests.unit.calibration.people.matched_scenes import walking_person

NO_AGREEMENT = "does not agree: people move less than .* Film one person who walks"


def simulated(options: RigOptions) -> PeopleViews:
    """Return the views of a simulated recording, with known lenses."""
    case = simulate_rig(options)
    return tracks_in_views(case.detections, case.lenses().cameras, True)


def test_two_views_of_different_people_are_refused():
    people = simulated(RigOptions(cameras=2, unrelated=True, duration_s=10.0, seed=2))
    with pytest.raises(CalibrationError, match=NO_AGREEMENT):
        match_views(people)


def test_standing_still_before_a_noisy_detector_is_refused():
    """Slow errors of a detector look like motion in each view, but views do not share them."""
    matched, _ = walking_person(cameras=2, duration_s=10.0)
    still = []
    for view in matched.views:
        pixels = view.keypoints_px
        # The errors of the walking person around the place of one moment.
        smooth = np.stack([_smoothed(pixels[:, 0, k]) for k in range(pixels.shape[2])], axis=1)[:, None]
        noisy = np.nanmedian(pixels[:25], axis=0) + 2.0 * (pixels - smooth)
        camera = replace(view.camera, camera_from_world=np.eye(4))
        still.append(replace(view, camera=camera, keypoints_px=noisy))
    with pytest.raises(CalibrationError, match=NO_AGREEMENT + "|do not determine"):
        match_views(PeopleViews(matched.skeleton, tuple(still)))


def _smoothed(pixels: np.ndarray) -> np.ndarray:
    """Return a path without its errors of up to seconds: polynomials of its coordinates."""
    time = np.linspace(-1.0, 1.0, len(pixels))
    out = np.full_like(pixels, np.nan)
    for axis in range(2):
        seen = np.isfinite(pixels[:, axis])
        out[seen, axis] = np.polynomial.polynomial.Polynomial.fit(time[seen], pixels[seen, axis], 30)(time[seen])
    return out


@pytest.mark.long
def test_wrong_one_of_three_views_is_left_out():
    people = simulated(RigOptions(cameras=3, unrelated=True, duration_s=10.0, seed=0))
    assert list(match_views(people).left_out) == ["cam_2"]


def test_backward_keeps_people_apart():
    person = np.array([0, 0, 0, 1, 1, 1, 1])
    np.testing.assert_array_equal(backward(person), [2, 1, 0, 6, 5, 4, 3])
    np.testing.assert_array_equal(backward(person, 0.5)[3:], [4, 3, 6, 5])
