"""Warnings about cameras during a stream: once when a fault begins and once when it ends."""

from posefuse.live.camera_warnings import CameraWarnings
from posefuse.live.statistics import ViewCounts

GOOD = [False, False]


def test_silent_camera_is_reported_once_and_again_on_its_return():
    monitor, counts = CameraWarnings(["left", "right"]), [ViewCounts(), ViewCounts()]

    def second(*sends: bool) -> list[str]:
        for count, sent in zip(counts, sends, strict=True):
            count.received += 25 * sent
            count.used += 25 * sent
        return monitor.check(counts, [not sent for sent in sends], 0)

    assert second(True, True) == []
    assert second(True, False) == ["right sends nothing; people are tracked without it."]
    assert second(True, False) == []
    assert second(True, True) == ["right sends again and is used."]
    assert second(True, True) == []
    # Without active cameras the stream has ended or is paused.
    assert second(False, False) == []
    messages = [sentence for _ in range(4) for sends in (False, True) for sentence in second(True, sends)]
    assert len(messages) == 3
    assert messages[-1].endswith("Further changes are only counted.")


def test_wrong_clock_is_reported_as_early_or_late():
    monitor, counts = CameraWarnings(["left", "right"]), [ViewCounts(), ViewCounts()]
    for count, used in ((counts[0], 25), (counts[1], 0)):
        count.received, count.used, count.early = 25, used, 25 - used
    assert monitor.check(counts, GOOD, 0) == ["right sends times ahead of the other clocks; its messages are dropped."]
    counts[1].received, counts[1].late = 50, 25
    assert monitor.check(counts, GOOD, 0) == [
        "right sends times behind the other clocks, or too late; its messages are dropped."
    ]
    counts[1].received, counts[1].late = 52, 27
    assert monitor.check(counts, GOOD, 0) == []


def test_milliseconds_in_place_of_seconds_are_reported():
    monitor, counts = CameraWarnings(["left"]), [ViewCounts(received=1, used=1)]
    messages = [monitor.check(counts, [False], jumps) for jumps in (25, 50, 75)]
    assert [len(each) for each in messages] == [0, 1, 0]
    assert "is it in milliseconds" in messages[1][0]
