"""Images of long videos are chosen where the board shows something new."""

import numpy as np

from posefuse.calibration.boards.choose_frames import (
    MAX_IMAGES,
    N_QUICK,
    QuickLook,
    choose_periods,
    choose_poses,
    numbers_in_periods,
    quick_numbers,
)
from posefuse.calibration.boards.observations import corner_observations
from tests.boards import BOARD, SIZE_PX, board_detections, board_rig

TEN_MINUTES = np.arange(0, 600, 1 / 30)


def look(places):
    """A camera that sees a small board at some places (image, 2) in px, NaN where it does not."""
    times = TEN_MINUTES[quick_numbers(len(TEN_MINUTES))]
    corners = np.array([[-50.0, -50], [50, -50], [50, 50], [-50, 50]])
    return QuickLook(times, places[:, None] + corners, (640, 480))


def test_ten_minutes_are_examined_in_bounded_time():
    rng = np.random.default_rng(0)
    places = rng.uniform(60, 400, (N_QUICK, 2))
    starts = choose_periods([look(places), look(places[::-1].copy())])
    numbers = numbers_in_periods(TEN_MINUTES, starts)
    assert len(numbers) + N_QUICK <= MAX_IMAGES
    assert len(numbers) > 800
    # Images in a period are close enough to follow the motion of the board.
    assert np.median(np.diff(TEN_MINUTES[numbers])) < 0.11


def test_rare_places_and_shared_periods_are_chosen():
    """The board rests for 9 of 10 minutes; only for 20 s do two cameras see it together."""
    resting = np.full((N_QUICK, 2), 100.0)
    times = look(resting).time_s
    moving = (times > 300) & (times < 360)
    first = np.where(moving[:, None], np.stack([times % 7 * 80 + 60, times % 5 * 70 + 60], axis=1), resting)
    second = np.where(((times > 500) & (times < 520))[:, None], resting, np.nan)
    starts = choose_periods([look(first), look(second)])
    assert ((starts > 294) & (starts < 360)).sum() >= 5
    assert ((starts > 494) & (starts < 520)).any()


def test_periods_without_the_board_are_not_examined():
    places = np.full((N_QUICK, 2), np.nan)
    places[100:120] = 200.0
    starts = choose_periods([look(places), look(places)])
    times = look(places).time_s
    assert len(starts) < 10
    assert starts.min() > times[100] - 6.0
    assert starts.max() <= times[119]


def test_cameras_of_other_rates_keep_the_same_instants():
    starts = np.array([12.0, 60.0])
    a, b = (np.arange(0, 100, 1 / rate) for rate in (30, 60))
    assert np.abs(a[numbers_in_periods(a, starts)] - b[numbers_in_periods(b, starts)]).max() < 0.03


def test_poses_are_chosen_in_runs():
    rig = board_rig()
    corners = corner_observations(board_detections(rig, n_frames=120), BOARD)
    chosen = choose_poses(corners, [SIZE_PX] * 3, 40)
    assert 36 <= chosen.sum() <= 40
    runs = chosen[: len(chosen) // 4 * 4].reshape(-1, 4)
    assert np.all(runs.all(axis=1) == runs.any(axis=1))
    assert choose_poses(corners, [SIZE_PX] * 3, 500).all()
