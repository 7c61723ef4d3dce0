"""Short tracks of one view: the kernel against its plain twin."""

import numpy as np
import pytest

from posefuse.kernels.calibration.tracklets import ViewRows, link_detections, remove_duplicates
from tests.reference import tracklets as plain

LIMITS = np.array([0.4, 0.06, 2.0, 0.35, 2.5, 0.5, 3.0, 0.25])
MIRROR = np.array([0, 2, 1, 4, 3])


def crowd(seed: int, frames: int = 60, people: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return starts, times and pixels of people who walk through each other, with gaps and missing keypoints."""
    rng = np.random.default_rng(seed)
    time_s = np.cumsum(rng.uniform(0.02, 0.05, frames))
    body = rng.uniform(-50.0, 50.0, (people, 5, 2))
    start, velocity = rng.uniform(0.0, 600.0, (people, 2)), rng.uniform(-150.0, 150.0, (people, 2))
    rows, counts = [], []
    for now in time_s:
        seen = [p for p in rng.permutation(people) if rng.uniform() < 0.9]
        counts.append(len(seen))
        for p in seen:
            row = body[p] + start[p] + velocity[p] * now + rng.normal(0.0, 2.0, (5, 2))
            row[rng.uniform(size=5) < 0.1] = np.nan
            if rng.uniform() < 0.1:
                row[rng.integers(0, 5, 2)] += rng.normal(0.0, 40.0, (2, 2))
            rows.append(row[MIRROR] if rng.uniform() < 0.1 else row)
    return np.concatenate([[0], np.cumsum(counts)]), time_s, np.array(rows)


@pytest.mark.no_jit
@pytest.mark.parametrize("seed", range(6))
def test_links_agree_with_the_plain_twin(seed):
    starts, time_s, pixels = crowd(seed)
    track = np.full(len(pixels), -1)
    n_tracks = link_detections(starts, time_s, ViewRows(pixels, np.full(len(pixels), -1), MIRROR, LIMITS), track)
    expected = plain.link(starts, time_s, pixels, MIRROR, LIMITS)
    assert n_tracks == len(np.unique(expected))
    for t in range(n_tracks):
        assert len(np.unique(expected[track == t])) == 1
        assert len(np.unique(track[expected == expected[track == t][0]])) == 1


def test_most_complete_of_repeated_detections_is_kept(rng):
    person = rng.uniform(0.0, 100.0, (5, 2))
    poor = person + 1.0
    poor[4] = np.nan
    pixels = np.stack([poor, person + 500.0, person])
    track = np.full(3, -1)
    remove_duplicates(np.array([0, 3]), pixels, MIRROR, 3, 0.06, track)
    np.testing.assert_array_equal(track, [-2, -1, -1])


def test_active_tracks_are_bounded(rng):
    """More people than slots: nobody is lost without a number, and nothing is written out of bounds."""
    person = rng.uniform(0.0, 10.0, (5, 2))
    pixels = np.tile(person + 100.0 * np.arange(40)[:, None, None], (3, 1, 1))
    track = np.full(120, -1)
    n_tracks = link_detections(
        np.array([0, 40, 80, 120]),
        np.array([0.0, 0.03, 0.06]),
        ViewRows(pixels, np.full(120, -1), MIRROR, LIMITS),
        track,
    )
    assert track.min() == 0
    assert track.max() == n_tracks - 1


def test_mistaken_limbs_do_not_end_the_track_of_one_person(rng):
    """Two of five keypoints jump by half the extent in frames 20 to 22, and the person walks on."""
    body = rng.uniform(-50.0, 50.0, (5, 2))
    time_s = np.arange(60) / 30.0
    pixels = body + 60.0 * time_s[:, None, None] * [1.0, 0.0]
    pixels[20:23, 3:] += [0.0, 70.0]
    none = np.full(60, -1)
    track = none.copy()
    assert link_detections(np.arange(61), time_s, ViewRows(pixels, none, MIRROR, LIMITS), track) == 1
    # Another person at twice that distance is a second candidate of no detection.
    both = np.stack([pixels, pixels[:, ::-1] + [400.0, 0.0]], axis=1).reshape(120, 5, 2)
    none = np.full(120, -1)
    track = none.copy()
    assert link_detections(2 * np.arange(61), time_s, ViewRows(both, none, MIRROR, LIMITS), track) <= 4
    assert all(len(np.unique(np.arange(120)[track == t] % 2)) == 1 for t in np.unique(track))
