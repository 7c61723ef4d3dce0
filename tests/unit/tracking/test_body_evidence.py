"""Evidence of detections for the bone lengths of one person."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from posefuse.tracking.body_evidence import log_evidence, person_lengths
from posefuse.tracking.body_states import empty_state
from posefuse.tracking.lifecycle import LifecycleThresholds, new_track
from posefuse.tracking.records import Observation
from posefuse.tracking.settings import TrackerSettings
from tests.unit.tracking.test_track_initiation import settings_with, standing_still

_SD_PX = 4.0


def noisy(settings: TrackerSettings, views: tuple[int, ...], seed: int, size: float = 1.0) -> Observation:
    """Return detections of a person of a size in some views, with errors."""
    seen = standing_still(settings, np.zeros(1), size)[0]
    shown = np.isin(np.arange(len(seen.rows)), views)
    errors = _SD_PX * np.random.default_rng(seed).standard_normal(seen.keypoints_px.shape)
    pixels = np.where(shown[:, None, None], seen.keypoints_px + errors, np.nan)
    return replace(seen, keypoints_px=pixels, rows=np.where(shown, seen.rows, -1))


def odds(settings: TrackerSettings, observation: Observation, size: float = 1.0) -> float:
    """Return the log odds of the lengths of a person of a size, known to 1 %."""
    tree = settings.tree
    track = new_track(1, 0.0, LifecycleThresholds(3.0, -2.0, 6.0))
    track.known_shape = (size * tree.shape_m, np.diag((0.01 * tree.shape_m) ** 2))
    own = log_evidence(observation, *person_lengths(track, empty_state(tree), 0, settings), settings)
    return own - log_evidence(observation, tree.shape_m, tree.shape_covariance, settings)


@pytest.mark.parametrize("views", list(combinations(range(4), 2)))
def test_two_views_favor_the_own_lengths(views: tuple[int, ...]) -> None:
    """Lengths that two views measure are too large on average; the fit with the known ones is not."""
    settings = settings_with()
    found = [odds(settings, noisy(settings, views, seed)) for seed in range(6)]
    assert np.mean(found) > 1.0
    assert min(found) > -1.0


@pytest.mark.parametrize("size", [0.88, 1.12])
def test_all_views_contradict_the_lengths_of_another_size(size: float) -> None:
    settings = settings_with()
    found = [odds(settings, noisy(settings, (0, 1, 2, 3), seed, size)) for seed in range(4)]
    assert max(found) < -2.0
