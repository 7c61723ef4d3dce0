"""The clock of the tracker moves forward even if cameras drop frames."""

import numpy as np
import pytest

from posefuse.errors import DetectionsError
from posefuse.model.frames import Frame
from posefuse.tracking.frame_clock import FrameClock, view_times

NAN = float("nan")


def frame(number: int, *times_s: float, people: int = 0, recorded: tuple[bool, ...] | None = None) -> Frame:
    """Return a frame whose first view shows some people; a view without a time recorded nothing."""
    times = np.array(times_s)
    return Frame(
        keypoints_px=np.zeros((people, 2, 2)),
        confidence=np.ones((people, 2)),
        view=np.zeros(people, dtype=np.int64),
        track_ids=np.full(people, -1),
        time_s=times,
        recorded=np.isfinite(times) if recorded is None else np.array(recorded),
        number=number,
    )


def after(*frames: Frame) -> FrameClock:
    clock = FrameClock()
    for each in frames:
        clock.advance(each)
    return clock


def test_time_between_frames():
    clock = FrameClock()
    assert [clock.advance(frame(k, 0.1 * k, 0.1 * k)) for k in (3, 4, 6)] == pytest.approx([0.0, 0.1, 0.2])
    assert clock.time_s == pytest.approx(0.6)
    assert clock.period_s == pytest.approx(0.1)
    assert clock.view_dt_s == pytest.approx(0.2)


def test_unrecorded_frame_has_an_extrapolated_time():
    clock = after(frame(0, 0.0, 0.0), frame(1, 0.1, 0.1))
    assert clock.advance(frame(2, NAN, NAN)) == pytest.approx(0.1)
    assert clock.advance(frame(4, NAN, NAN)) == pytest.approx(0.2)
    assert clock.advance(frame(5, 0.5, NAN)) == pytest.approx(0.1)
    messages = frame(6, 0.57, 0.57, recorded=(False, False))
    assert clock.advance(messages) == pytest.approx(0.07)
    assert view_times(frame(7, NAN, NAN), 0.67)[0][0] == 0.67


def test_frames_without_numbers_use_the_frame_period():
    clock = after(frame(0, 0.0, 0.0), frame(0, 0.1, 0.1))
    assert clock.advance(frame(0, NAN, NAN)) == pytest.approx(0.1)


def test_detections_without_a_time_are_an_error():
    clock = after(frame(0, 0.0, 0.0), frame(1, 0.1, 0.1))
    with pytest.raises(DetectionsError, match="Frame 2 has no time"):
        clock.advance(frame(2, NAN, NAN, people=1))
    with pytest.raises(DetectionsError, match="Frame 0 has no time"):
        FrameClock().advance(frame(0, NAN, NAN))


def test_dropped_frame_of_a_late_camera_does_not_reverse_time():
    clock = after(frame(0, 0.0, 0.025), frame(1, 0.02, 0.045))
    assert 0.0 < clock.advance(frame(2, 0.04, NAN, people=1)) < 1e-3
    # The age of the view's information does not change: its own last frame was 20 ms before.
    assert clock.view_dt_s == pytest.approx(0.02)
    assert clock.advance(frame(3, 0.06, 0.085)) == pytest.approx(0.04, abs=1e-3)


def test_frames_must_be_in_order():
    clock = after(frame(0, 0.0, 0.0), frame(1, 0.1, 0.1))
    for late in (frame(2, 0.1, 0.1), frame(2, 0.05, 0.05), frame(2, 0.05, NAN)):
        with pytest.raises(DetectionsError, match=r"Frame 2 is at 0\.\d+ s, after a frame at 0\.1000 s"):
            clock.advance(late)


def test_views_are_processed_in_order_of_time():
    parts = view_times(frame(0, 0.1, 0.12, NAN, 0.1002), 0.12)
    assert [(time_s, views.tolist()) for time_s, views in parts] == [
        (0.1002, [True, False, True, True]),
        (0.12, [False, True, False, False]),
    ]
