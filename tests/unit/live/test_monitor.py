"""What is told of cameras while a stream runs: once when it goes wrong, once when it is over."""

from posefuse.live.monitor import StreamMonitor
from posefuse.live.statistics import ViewCounts

GOOD = [False, False]


def test_a_silent_camera_is_told_once_and_when_it_is_back():
    alarms, counts = StreamMonitor(["left", "right"]), [ViewCounts(), ViewCounts()]

    def second(*sends: bool) -> list[str]:
        for count, sent in zip(counts, sends, strict=True):
            count.received += 25 * sent
            count.used += 25 * sent
        return alarms.check(counts, [not sent for sent in sends], 0)

    assert second(True, True) == []
    assert second(True, False) == ["right sends nothing; people are followed without it."]
    assert second(True, False) == []
    assert second(True, True) == ["right is heard again, and used."]
    assert second(True, True) == []
    # With nobody there, the stream is over, or everybody takes a break.
    assert second(False, False) == []
    said = [sentence for _ in range(4) for sends in (False, True) for sentence in second(True, sends)]
    assert len(said) == 3
    assert said[-1].endswith("More about it is counted alone.")


def test_a_wrong_clock_is_told_as_what_it_is():
    alarms, counts = StreamMonitor(["left", "right"]), [ViewCounts(), ViewCounts()]
    for count, used in ((counts[0], 25), (counts[1], 0)):
        count.received, count.used, count.early = 25, used, 25 - used
    assert alarms.check(counts, GOOD, 0) == ["right sends times ahead of the others' clocks; its messages are dropped."]
    counts[1].received, counts[1].late = 50, 25
    assert alarms.check(counts, GOOD, 0) == [
        "right sends times behind the others, or too late; its messages are dropped."
    ]
    counts[1].received, counts[1].late = 52, 27
    assert alarms.check(counts, GOOD, 0) == []


def test_milliseconds_for_seconds_are_noticed():
    alarms, counts = StreamMonitor(["left"]), [ViewCounts(received=1, used=1)]
    said = [alarms.check(counts, [False], jumps) for jumps in (25, 50, 75)]
    assert [len(each) for each in said] == [0, 1, 0]
    assert "is it in milliseconds" in said[1][0]
