"""Statistics by keypoint and camera against direct counts."""

import numpy as np
import pytest

from posefuse.model.status import ViewStatus
from posefuse.model.tracks import TrackState
from posefuse.report.heat_map import gather_heat_map
from tests.people import simulate_walkers, track_perfectly


@pytest.fixture(scope="module")
def result():
    return track_perfectly(simulate_walkers(people=3, seconds=2.0))


def test_shares_and_errors_match_counts(result):
    heat_map = gather_heat_map(result.chunks(16), "measured", result.n_frames)
    layer = result.layers["measured"]
    present = np.asarray(result.tracks.state) != TrackState.ABSENT
    status = np.asarray(layer.view_status)[present]
    error = np.asarray(layer.view_error_px)[present]
    for k, v in ((0, 0), (7, 2)):
        used = status[:, k, v] == ViewStatus.USED
        assert heat_map.shares[k, v, 1] == pytest.approx(used.mean())
        assert heat_map.error_px[k, v] == pytest.approx(np.median(error[used, k, v]), rel=1e-5)
    np.testing.assert_allclose(heat_map.shares.sum(axis=-1), 1.0)


def test_worst_frames_have_the_largest_errors(result):
    worst = gather_heat_map(result.chunks(), "measured", result.n_frames).worst["error"]
    error = np.asarray(result.layers["measured"].view_error_px)
    for k, v in ((0, 0), (7, 2)):
        assert worst.error_px[k, v, 0] == pytest.approx(np.nanmax(error[:, :, k, v]))
        assert error[worst.frame_index[k, v, 0], worst.person[k, v, 0], k, v] == worst.error_px[k, v, 0]
        assert (np.diff(worst.error_px[k, v]) <= 0).all()
        assert len(set(worst.frame_index[k, v])) == 3
