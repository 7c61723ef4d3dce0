"""Group views into frames by their times, with a bounded wait, in the order of time.

A state machine: every call receives the current time, and nothing reads a clock, so the same calls give the same
frames.

Two times are distinguished. Sender time is that of the messages. Stream time only moves forward and never jumps: it is
sender time, shifted when the clocks of most cameras jumped alike.
"""

import math
from bisect import insort
from collections import deque
from dataclasses import dataclass, field
from typing import Literal

from posefuse.live.statistics import ViewCounts
from posefuse.model.options.stream import StreamOptions
from posefuse.model.view_message import SeenView

Reason = Literal["complete", "overtaken", "waited", "crowded", "ended"]
"""Why a frame was released: all active cameras have it; a later one is complete; its wait expired; too many frames
wait; the stream jumped or ended."""
_REMEMBERED = 256
_PERIODS = 3.0
"""Frame intervals without a message after which a camera does not contribute to the stream time."""


@dataclass(frozen=True)
class Group:
    """The views of one frame.

    Attributes:
        time_s: sender time of the first view that arrived.
        shift_s: offset from sender time to stream time.
        views: views by camera, None if missing.
        first_s: arrival of the first view.
        due_s: end of the wait.
        reason: why the frame was released.
    """

    time_s: float
    shift_s: float
    views: tuple[SeenView | None, ...]
    first_s: float
    due_s: float
    reason: Reason

    @property
    def complete(self) -> bool:
        """Whether the frame has every camera."""
        return all(view is not None for view in self.views)


@dataclass(order=True)
class _Open:
    """A frame that waits for its views."""

    time_s: float
    first_s: float = field(compare=False)
    last_s: float = field(compare=False)
    views: dict[int, SeenView] = field(compare=False)
    reached_s: float | None = field(default=None, compare=False)
    """When most cameras had reached this time."""


@dataclass(frozen=True)
class _Held:
    """A message with an unexpected time, and its arrival."""

    seen: SeenView
    now_s: float


class Grouper:
    """Collect views as they arrive and release frames in the order of their times.

    Args:
        n_views: number of cameras.
        options: stream options.
    """

    def __init__(self, n_views: int, options: StreamOptions) -> None:
        self.options = options
        self.counts = [ViewCounts() for _ in range(n_views)]
        self.jumps = 0
        self.shift_s = 0.0
        self._by_messages = options.clock == "messages"
        # With the clock of the messages, a camera ahead of the others must not make them silent.
        self._silent_after_s = options.silent_after_s + (options.max_jump_s if self._by_messages else 0.0)
        self._open: list[_Open] = []
        self._ready: list[Group] = []
        self._past: deque[tuple[float, frozenset[int]]] = deque(maxlen=_REMEMBERED)
        self._heard_s = [-math.inf] * n_views
        self._newest_s = [-math.inf] * n_views
        self._held: dict[int, _Held] = {}
        self._led_s: tuple[float, float] | None = None
        """Sender time that most cameras have reached, and when."""
        self._top_s = -math.inf
        """Newest accepted time."""
        self._last_s = -math.inf
        """Last arrival."""
        self._period_s = options.max_wait_s
        self._gone_s = -math.inf
        """Stream time of the last released frame."""

    def take(self, seen: SeenView, now_s: float) -> None:
        """Process an arriving view.

        Args:
            seen: the view.
            now_s: current time of a monotonic clock.
        """
        self.counts[seen.view].received += 1
        self._hear(seen, now_s)
        if self._off_clock(seen, now_s):
            self._hold(seen, now_s)
        else:
            self._let_go(seen.view)
            self._enter(seen, now_s)
        self._settle(now_s)

    def tick(self, now_s: float) -> None:
        """Advance the time without a message."""
        self._lead(now_s)
        self._settle(now_s)

    def end(self, now_s: float) -> None:
        """End the input."""
        # Accept cameras a frame or two ahead of the others now; all cameras if too few arrived.
        led_s = self._top_s if self._led_s is None else self._led_s[0] + 2.0 * self._period_s
        self._led_s = (led_s, now_s)
        for view in list(self._held):
            self._let_go(view)
        self._close_all(now_s)

    def ready(self) -> list[Group]:
        """Return the frames released since the last call, in the order of their times."""
        ready, self._ready = self._ready, []
        return ready

    def wakes_at_s(self) -> float | None:
        """Return when the next frame expires without further messages; None if no frame waits."""
        return self._up_s(self._open[0]) if self._open and not self._by_messages else None

    def silent(self, now_s: float) -> list[bool]:
        """Return which cameras are silent and not waited for."""
        now_s = self._top_s if self._by_messages else now_s
        return [now_s - heard > self._silent_after_s for heard in self._heard_s]

    def _hear(self, seen: SeenView, now_s: float) -> None:
        """Mark a camera as active; after a pause of all cameras, those active before it are waited for again."""
        if self._by_messages:
            return
        if now_s - self._last_s > self._silent_after_s:
            self._expect(now_s, self._last_s)
        self._last_s = self._heard_s[seen.view] = now_s

    def _expect(self, from_s: float, last_s: float) -> None:
        """Wait for all cameras that were active at a time, or for all at the start."""
        first = not math.isfinite(max(self._heard_s))
        self._heard_s = [
            from_s if first or last_s - heard <= self._silent_after_s else heard for heard in self._heard_s
        ]

    # Clocks that jump.

    def _off_clock(self, seen: SeenView, now_s: float) -> bool:
        """Return whether a time is neither near the newest time nor where that should be by now."""
        if self._led_s is None:
            return False
        time_s, (newest_s, arrived_s), most_s = seen.time_s, self._led_s, self.options.max_jump_s
        if self._by_messages and 0.0 < time_s - self._newest_s[seen.view] <= most_s:
            # The camera continues as before: most others may have failed, since its messages are so far ahead.
            return time_s > newest_s + self._silent_after_s + 2.0 * self._period_s
        gone_s = 0.0 if self._by_messages else now_s - arrived_s
        return not newest_s - most_s <= time_s <= newest_s + gone_s + most_s

    def _hold(self, seen: SeenView, now_s: float) -> None:
        """Hold the message until it is clear whether its camera's clock is wrong or all others jumped too."""
        self._let_go(seen.view)
        mine = self._held[seen.view] = _Held(seen, now_s)
        like = [view for view, held in self._held.items() if self._agree(held, mine)]
        alive = len(self._heard_s) - sum(self.silent(now_s))
        if 2 * len(like) > alive:
            self._jump([self._held.pop(view) for view in sorted(like)], now_s)

    def _agree(self, one: _Held, other: _Held) -> bool:
        apart_s = one.seen.time_s - other.seen.time_s
        if not self._by_messages:
            apart_s -= one.now_s - other.now_s
        return abs(apart_s) <= self.options.max_jump_s

    def _let_go(self, view: int) -> None:
        """Drop and count the held message of a camera."""
        held = self._held.pop(view, None)
        if held is None:
            return
        ahead = self._led_s is None or held.seen.time_s > self._led_s[0]
        self.counts[view].early += ahead
        self.counts[view].late += not ahead

    def _jump(self, held: list[_Held], now_s: float) -> None:
        """Continue with the new sender time; the stream time continues without a jump."""
        assert self._led_s is not None
        newest_s, arrived_s = self._led_s
        self._close_all(now_s)
        newest_s = max(newest_s, self._past[-1][0] if self._past else -math.inf)
        first = min(held, key=lambda each: each.seen.time_s)
        # In replays only messages define the time: a gap is a gap, and time that goes back continues after one frame.
        ahead_s = first.seen.time_s - newest_s if self._by_messages else first.now_s - arrived_s
        if not (self._by_messages and ahead_s >= self._period_s):
            self.shift_s += newest_s + max(ahead_s, self._period_s) - first.seen.time_s
            self.jumps += 1
        self._past.clear()
        self._newest_s = [-math.inf] * len(self._newest_s)
        if self._by_messages:
            self._expect(first.seen.time_s, self._top_s)
        self._led_s, self._top_s = None, -math.inf
        for each in sorted(held, key=lambda each: each.seen.time_s):
            self._enter(each.seen, each.now_s)

    # Grouping.

    def _enter(self, seen: SeenView, now_s: float) -> None:
        self._top_s = max(self._top_s, seen.time_s)
        if self._by_messages:
            if not math.isfinite(max(self._heard_s)):
                self._expect(seen.time_s, seen.time_s)
            self._heard_s[seen.view] = max(self._heard_s[seen.view], seen.time_s)
        count, newest_s = self.counts[seen.view], self._newest_s[seen.view]
        self._newest_s[seen.view] = seen.time_s
        self._lead(now_s)
        place = self._of_time(seen.time_s)
        if place is None:
            past = self._past_of(seen.time_s)
            if past is not None:
                count.duplicate += seen.view in past
                count.late += seen.view not in past
                return
            place = _Open(seen.time_s, now_s, now_s, {})
            insort(self._open, place)
        if seen.view in place.views:
            count.duplicate += 1
            return
        place.views[seen.view], place.last_s = seen, now_s
        count.used += 1
        count.out_of_order += seen.time_s < newest_s

    def _of_time(self, time_s: float) -> _Open | None:
        """Return the waiting frame of a time, or None."""
        near = [each for each in self._open if abs(each.time_s - time_s) <= self.options.same_time_s]
        return min(near, key=lambda each: abs(each.time_s - time_s), default=None)

    def _past_of(self, time_s: float) -> frozenset[int] | None:
        """Return the cameras of the released frame of a time; an empty set for an earlier time without a frame."""
        if time_s + self.shift_s > self._gone_s + self.options.same_time_s:
            return None
        near = [each for each in self._past if abs(each[0] - time_s) <= self.options.same_time_s]
        return min(near, key=lambda each: abs(each[0] - time_s))[1] if near else frozenset()

    def _settle(self, now_s: float) -> None:
        """Release frames whose wait has expired."""
        for frame in self._open:
            if frame.reached_s is None and self._reached(frame):
                frame.reached_s = now_s
        while self._open:
            head, silent = self._open[0], self.silent(now_s)
            if self._has_all(head, silent):
                self._close(head, head.last_s, "complete")
            elif any(self._has_all(each, silent) for each in self._open[1:]):
                self._close(head, min(now_s, self._up_s(head)), "overtaken")
            elif self._waited(head, now_s):
                self._close(head, self._up_s(head), "waited")
            elif len(self._open) > self.options.open_frames:
                self._make_room(now_s)
            else:
                return

    def _make_room(self, now_s: float) -> None:
        """If too many frames wait, release the first; but first drop times that only one camera has reached.

        Its clock is ahead: the others' frames are not to suffer from that.
        """
        last = self._open[-1]
        if self._by_messages or self._reached(last):
            self._close(self._open[0], now_s, "crowded")
        else:
            self._drop(last)

    def _lead(self, now_s: float) -> None:
        """Find the time that half of the active cameras, and at least two, have reached."""
        lately_s = self.options.max_wait_s + _PERIODS * self._period_s
        times_s = sorted(
            self._newest_s[view]
            for view, quiet in enumerate(self.silent(now_s))
            if not (quiet or view in self._held) and (self._by_messages or now_s - self._heard_s[view] <= lately_s)
        )
        most = min(max(2, (len(times_s) + 1) // 2), len(times_s))
        agreed_s = times_s[-most] if most else -math.inf
        if most == 1 and self._led_s is not None and not self._by_messages:
            # A single camera defines the time only as far as the clock has advanced.
            agreed_s = min(agreed_s, self._led_s[0] + now_s - self._led_s[1])
        if agreed_s > (-math.inf if self._led_s is None else self._led_s[0]):
            self._led_s = (agreed_s, now_s)

    def _waited(self, head: _Open, now_s: float) -> bool:
        """Return whether a frame has expired and is not a time that only one camera, ahead of the others, has reached."""
        if self._by_messages:
            return self._led_s is not None and self._led_s[0] >= head.time_s + self.options.max_wait_s
        return head.reached_s is not None and now_s >= self._up_s(head)

    def _up_s(self, frame: _Open) -> float:
        """Return when a frame expires: counted from its first view, or from when most cameras reached it if later."""
        wait_s = self.options.max_wait_s
        reached_s = frame.first_s if frame.reached_s is None else frame.reached_s
        return (reached_s if reached_s > frame.first_s + wait_s else frame.first_s) + wait_s

    def _reached(self, frame: _Open) -> bool:
        return self._led_s is not None and self._led_s[0] >= frame.time_s - self.options.same_time_s

    def _has_all(self, frame: _Open, silent: list[bool]) -> bool:
        if len(frame.views) + sum(silent) < len(silent):
            return False
        if all(silent) and not self._by_messages and not self._reached(frame):
            # Only one camera reached it, and now all are silent, which does not confirm its clock.
            return False
        return all(view in frame.views or quiet for view, quiet in enumerate(silent))

    def _close_all(self, now_s: float) -> None:
        """Release all waiting frames, except times that only one camera has reached."""
        for frame in list(self._open):
            if self._reached(frame):
                self._close(frame, now_s, "ended")
        for frame in list(self._open):
            self._drop(frame)

    def _drop(self, frame: _Open) -> None:
        """Discard a frame that was not one."""
        self._open.remove(frame)
        for view in frame.views:
            self.counts[view].early += 1
            self.counts[view].used -= 1

    def _close(self, frame: _Open, due_s: float, reason: Reason) -> None:
        self._open.remove(frame)
        if self._past and self._past[-1][0] < frame.time_s:
            self._period_s = min(frame.time_s - self._past[-1][0], self.options.max_jump_s)
        self._past.append((frame.time_s, frozenset(frame.views)))
        self._gone_s = frame.time_s + self.shift_s
        views = tuple(frame.views.get(view) for view in range(len(self.counts)))
        for count, view in zip(self.counts, views, strict=True):
            count.missing += view is None
        self._ready.append(Group(frame.time_s, self.shift_s, views, frame.first_s, due_s, reason))
