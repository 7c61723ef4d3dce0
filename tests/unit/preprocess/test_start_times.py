"""Views that start seconds apart meet at their true times."""

import numpy as np
import pytest

from posefuse.errors import DetectionsError
from posefuse.model.detections import Detections
from posefuse.model.options.sync import SyncOptions
from posefuse.preprocess.start_times import with_start_times
from posefuse.skeleton.skeletons import find_skeleton

LATE = SyncOptions(("b",), (0.0,), (3.0,), (0.0,))


def clock_views(rate_hz: float | None) -> Detections:
    """Two views whose keypoints show the true time in ms; the second started 3 s later."""
    skeleton = find_skeleton("coco_17")
    pixels = np.zeros((200, 2, len(skeleton), 2))
    pixels[..., 0] = (40.0 * np.arange(200)[:, None] + np.array([0.0, 3000.0]))[..., None]
    return Detections.from_dense(skeleton, ("a", "b"), pixels, rate_hz=rate_hz)


def test_late_view_meets_the_frames_of_its_time_and_no_frame_is_lost():
    moved = with_start_times(clock_views(25.0), LATE)
    shown = moved.dense()[0][..., 0, 0]
    assert moved.n_frames == 275
    assert (np.isfinite(shown).sum(axis=0) == 200).all()
    both = np.isfinite(shown).all(axis=1)
    assert shown[both, 0] == pytest.approx(shown[both, 1])


def test_without_offsets_nothing_changes():
    detections = clock_views(25.0)
    assert with_start_times(detections, SyncOptions()) is detections


def test_unknown_times_are_an_error():
    with pytest.raises(DetectionsError, match="frame rate"):
        with_start_times(clock_views(None), LATE)
