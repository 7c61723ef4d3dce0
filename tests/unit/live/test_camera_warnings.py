"""What is told of cameras while a stream runs: once when it goes wrong, once when it is over."""

from posefuse.live.camera_warnings import CameraWarnings
from posefuse.live.statistics import ViewCounts

GOOD = [False, False]


def test_a_silent_camera_is_reported_once_and_again_when_it_returns():
    warnings, counts = CameraWarnings(["left", "right"]), [ViewCounts(), ViewCounts()]

    def second(*sends: bool) -> list[str]:
        for count, sent in zip(counts, sends, strict=True):
            count.received += 25 * sent
            count.used += 25 * sent
        return warnings.check(counts, [not sent for sent in sends], 0)

    assert second(True, True) == []
    assert second(True, False) == ["right sends nothing; people are tracked without it."]
    assert second(True, False) == []
    assert second(True, True) == ["right is active again and used."]
    assert second(True, True) == []
    # Without any camera, the stream is over or paused.
    assert second(False, False) == []
    messages = [sentence for _ in range(4) for sends in (False, True) for sentence in second(True, sends)]
    assert len(messages) == 3
    assert messages[-1].endswith("Further changes are counted only.")


def test_a_wrong_clock_is_reported_with_its_direction():
    warnings, counts = CameraWarnings(["left", "right"]), [ViewCounts(), ViewCounts()]
    for count, used in ((counts[0], 25), (counts[1], 0)):
        count.received, count.used, count.early = 25, used, 25 - used
    assert warnings.check(counts, GOOD, 0) == [
        "right sends times ahead of the others' clocks; its messages are dropped."
    ]
    counts[1].received, counts[1].late = 50, 25
    assert warnings.check(counts, GOOD, 0) == [
        "right sends times behind the others, or too late; its messages are dropped."
    ]
    counts[1].received, counts[1].late = 52, 27
    assert warnings.check(counts, GOOD, 0) == []


def test_milliseconds_for_seconds_are_noticed():
    warnings, counts = CameraWarnings(["left"]), [ViewCounts(received=1, used=1)]
    messages = [warnings.check(counts, [False], jumps) for jumps in (25, 50, 75)]
    assert [len(each) for each in messages] == [0, 1, 0]
    assert "not in milliseconds" in messages[1][0]
