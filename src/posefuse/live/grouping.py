"""Group views into frames by their times, with a bounded wait, in the order of time.

The grouper is a state machine: every call receives the current time and no clock is read, so that the same calls give
the same frames.

Two times are distinguished. Sender time is the time in a view's message. Stream time only increases and never jumps: it
is sender time, shifted where the clocks of most cameras jumped together.
"""

import math
from bisect import insort
from collections import deque
from dataclasses import dataclass, field
from typing import Literal

from posefuse.live.statistics import ViewCounts
from posefuse.model.options.stream import StreamOptions
from posefuse.model.view_message import ViewMessage

Reason = Literal["complete", "overtaken", "waited", "crowded", "ended"]
"""Why a frame was closed: all active cameras have it; a later frame is complete; its wait ended; too many frames are
open; the stream jumped or ended."""
_MAX_PAST_FRAMES = 256
_PERIODS = 3.0
"""A camera without a message for this many frame periods is ignored when the current time is determined."""


@dataclass(frozen=True)
class Group:
    """The views of one frame.

    Attributes:
        time_s: sender time of the first view that arrived.
        shift_s: stream time minus sender time.
        views: view of each camera, or None.
        first_s: arrival of the first view.
        due_s: time at which the frame stopped waiting.
        reason: why the frame was closed.
    """

    time_s: float
    shift_s: float
    views: tuple[ViewMessage | None, ...]
    first_s: float
    due_s: float
    reason: Reason

    @property
    def complete(self) -> bool:
        """Whether every camera of the rig has the frame."""
        return all(view is not None for view in self.views)


@dataclass(order=True)
class _OpenFrame:
    """A frame that waits for views."""

    time_s: float
    first_s: float = field(compare=False)
    last_s: float = field(compare=False)
    views: dict[int, ViewMessage] = field(compare=False)
    reached_s: float | None = field(default=None, compare=False)
    """When most cameras had reached this time, or None."""


@dataclass(frozen=True)
class _HeldMessage:
    """A message with an unexpected time, and its arrival."""

    message: ViewMessage
    now_s: float


class Grouper:
    """Collects views as they arrive and returns frames in the order of their times.

    Args:
        n_views: number of cameras.
        options: options of the stream.
    """

    def __init__(self, n_views: int, options: StreamOptions) -> None:
        self.options = options
        self.counts = [ViewCounts() for _ in range(n_views)]
        self.jumps = 0
        self.shift_s = 0.0
        self._by_messages = options.clock == "messages"
        # If messages define the time, a camera that is ahead of the others does not make them silent.
        self._silent_after_s = options.silent_after_s + (options.max_jump_s if self._by_messages else 0.0)
        self._open: list[_OpenFrame] = []
        self._ready: list[Group] = []
        self._past: deque[tuple[float, frozenset[int]]] = deque(maxlen=_MAX_PAST_FRAMES)
        self._active_s = [-math.inf] * n_views
        self._newest_s = [-math.inf] * n_views
        self._held: dict[int, _HeldMessage] = {}
        self._reached_time_s: tuple[float, float] | None = None
        """The sender time that most cameras have reached, and its arrival."""
        self._newest_time_s = -math.inf
        """The newest accepted sender time."""
        self._last_s = -math.inf
        """Last arrival of any message."""
        self._period_s = options.max_wait_s
        self._closed_time_s = -math.inf
        """Stream time of the last closed frame."""

    def take(self, message: ViewMessage, now_s: float) -> None:
        """Add a view.

        Args:
            message: the view.
            now_s: current time of a monotonic clock.
        """
        self.counts[message.view].received += 1
        self._note_active(message, now_s)
        if self._is_off_clock(message, now_s):
            self._hold_message(message, now_s)
        else:
            self._discard_held(message.view)
            self._enter(message, now_s)
        self._close_due(now_s)

    def tick(self, now_s: float) -> None:
        """Advance the time without a message."""
        self._update_reached_time(now_s)
        self._close_due(now_s)

    def end(self, now_s: float) -> None:
        """Close all frames: no more messages follow."""
        # Accept cameras that are one or two frames ahead of the others, or all cameras with too few messages to judge.
        reached_time_s = (
            self._newest_time_s if self._reached_time_s is None else self._reached_time_s[0] + 2.0 * self._period_s
        )
        self._reached_time_s = (reached_time_s, now_s)
        for view in list(self._held):
            self._discard_held(view)
        self._close_all(now_s)

    def ready(self) -> list[Group]:
        """Return the frames closed since the last call, in the order of their times."""
        ready, self._ready = self._ready, []
        return ready

    def wakes_at_s(self) -> float | None:
        """Return when the next frame stops waiting if nothing arrives; None if no frame waits for time."""
        return self._wait_ends_s(self._open[0]) if self._open and not self._by_messages else None

    def silent(self, now_s: float) -> list[bool]:
        """Return which cameras are silent, so that frames do not wait for them."""
        now_s = self._newest_time_s if self._by_messages else now_s
        return [now_s - heard > self._silent_after_s for heard in self._active_s]

    def _note_active(self, message: ViewMessage, now_s: float) -> None:
        """Note a camera as active; after a pause of all cameras, wait again for those active before it."""
        if self._by_messages:
            return
        if now_s - self._last_s > self._silent_after_s:
            self._expect(now_s, self._last_s)
        self._last_s = self._active_s[message.view] = now_s

    def _expect(self, from_s: float, last_s: float) -> None:
        """Wait for all cameras that were active at a time, or at first for all."""
        first = not math.isfinite(max(self._active_s))
        self._active_s = [
            from_s if first or last_s - heard <= self._silent_after_s else heard for heard in self._active_s
        ]

    # Clock jumps.

    def _is_off_clock(self, message: ViewMessage, now_s: float) -> bool:
        """Return whether a message's time is far from the present stream time."""
        if self._reached_time_s is None:
            return False
        time_s, (newest_s, arrived_s), most_s = message.time_s, self._reached_time_s, self.options.max_jump_s
        if self._by_messages and 0.0 < time_s - self._newest_s[message.view] <= most_s:
            # The camera continues steadily: most others may have stopped, which shows when it is far enough ahead.
            return time_s > newest_s + self._silent_after_s + 2.0 * self._period_s
        elapsed_s = 0.0 if self._by_messages else now_s - arrived_s
        return not newest_s - most_s <= time_s <= newest_s + elapsed_s + most_s

    def _hold_message(self, message: ViewMessage, now_s: float) -> None:
        """Hold a message until it is clear whether its camera's clock is wrong or most clocks jumped."""
        self._discard_held(message.view)
        mine = self._held[message.view] = _HeldMessage(message, now_s)
        like = [view for view, held in self._held.items() if self._agree(held, mine)]
        alive = len(self._active_s) - sum(self.silent(now_s))
        if 2 * len(like) > alive:
            self._jump([self._held.pop(view) for view in sorted(like)], now_s)

    def _agree(self, one: _HeldMessage, other: _HeldMessage) -> bool:
        apart_s = one.message.time_s - other.message.time_s
        if not self._by_messages:
            apart_s -= one.now_s - other.now_s
        return abs(apart_s) <= self.options.max_jump_s

    def _discard_held(self, view: int) -> None:
        """Discard and count the held message of a camera."""
        held = self._held.pop(view, None)
        if held is None:
            return
        ahead = self._reached_time_s is None or held.message.time_s > self._reached_time_s[0]
        self.counts[view].early += ahead
        self.counts[view].late += not ahead

    def _jump(self, held: list[_HeldMessage], now_s: float) -> None:
        """Continue with the senders' new time without a jump of stream time."""
        assert self._reached_time_s is not None
        newest_s, arrived_s = self._reached_time_s
        self._close_all(now_s)
        newest_s = max(newest_s, self._past[-1][0] if self._past else -math.inf)
        first = min(held, key=lambda each: each.message.time_s)
        # In replays messages define the time: a gap stays a gap, and a step back continues after one frame.
        ahead_s = first.message.time_s - newest_s if self._by_messages else first.now_s - arrived_s
        if not (self._by_messages and ahead_s >= self._period_s):
            self.shift_s += newest_s + max(ahead_s, self._period_s) - first.message.time_s
            self.jumps += 1
        self._past.clear()
        self._newest_s = [-math.inf] * len(self._newest_s)
        if self._by_messages:
            self._expect(first.message.time_s, self._newest_time_s)
        self._reached_time_s, self._newest_time_s = None, -math.inf
        for each in sorted(held, key=lambda each: each.message.time_s):
            self._enter(each.message, each.now_s)

    # Grouping.

    def _enter(self, message: ViewMessage, now_s: float) -> None:
        self._newest_time_s = max(self._newest_time_s, message.time_s)
        if self._by_messages:
            if not math.isfinite(max(self._active_s)):
                self._expect(message.time_s, message.time_s)
            self._active_s[message.view] = max(self._active_s[message.view], message.time_s)
        count, newest_s = self.counts[message.view], self._newest_s[message.view]
        self._newest_s[message.view] = message.time_s
        self._update_reached_time(now_s)
        place = self._open_frame_at(message.time_s)
        if place is None:
            past = self._closed_views_at(message.time_s)
            if past is not None:
                count.duplicate += message.view in past
                count.late += message.view not in past
                return
            place = _OpenFrame(message.time_s, now_s, now_s, {})
            insort(self._open, place)
        if message.view in place.views:
            count.duplicate += 1
            return
        place.views[message.view], place.last_s = message, now_s
        count.used += 1
        count.out_of_order += message.time_s < newest_s

    def _open_frame_at(self, time_s: float) -> _OpenFrame | None:
        """Return the open frame of a time, or None."""
        near = [each for each in self._open if abs(each.time_s - time_s) <= self.options.same_time_s]
        return min(near, key=lambda each: abs(each.time_s - time_s), default=None)

    def _closed_views_at(self, time_s: float) -> frozenset[int] | None:
        """Return the views of a closed frame: empty for an earlier time without a frame, None for a later time."""
        if time_s + self.shift_s > self._closed_time_s + self.options.same_time_s:
            return None
        near = [each for each in self._past if abs(each[0] - time_s) <= self.options.same_time_s]
        return min(near, key=lambda each: abs(each[0] - time_s))[1] if near else frozenset()

    def _close_due(self, now_s: float) -> None:
        """Close frames that have waited long enough."""
        for frame in self._open:
            if frame.reached_s is None and self._reached(frame):
                frame.reached_s = now_s
        while self._open:
            head, silent = self._open[0], self.silent(now_s)
            if self._has_all(head, silent):
                self._close(head, head.last_s, "complete")
            elif any(self._has_all(each, silent) for each in self._open[1:]):
                self._close(head, min(now_s, self._wait_ends_s(head)), "overtaken")
            elif self._has_waited(head, now_s):
                self._close(head, self._wait_ends_s(head), "waited")
            elif len(self._open) > self.options.open_frames:
                self._make_room(now_s)
            else:
                return

    def _make_room(self, now_s: float) -> None:
        """Close the first of too many open frames, or drop the last one if only one camera has reached it.

        That camera's clock is ahead, which must not affect the frames of the others.
        """
        last = self._open[-1]
        if self._by_messages or self._reached(last):
            self._close(self._open[0], now_s, "crowded")
        else:
            self._drop(last)

    def _update_reached_time(self, now_s: float) -> None:
        """Determine the time that half of the active cameras, and at least two, have reached."""
        lately_s = self.options.max_wait_s + _PERIODS * self._period_s
        times_s = sorted(
            self._newest_s[view]
            for view, quiet in enumerate(self.silent(now_s))
            if not (quiet or view in self._held) and (self._by_messages or now_s - self._active_s[view] <= lately_s)
        )
        most = min(max(2, (len(times_s) + 1) // 2), len(times_s))
        agreed_s = times_s[-most] if most else -math.inf
        if most == 1 and self._reached_time_s is not None and not self._by_messages:
            # A single camera is trusted only as far as time has passed.
            agreed_s = min(agreed_s, self._reached_time_s[0] + now_s - self._reached_time_s[1])
        if agreed_s > (-math.inf if self._reached_time_s is None else self._reached_time_s[0]):
            self._reached_time_s = (agreed_s, now_s)

    def _has_waited(self, head: _OpenFrame, now_s: float) -> bool:
        """Return whether a frame has waited long enough and more than one camera has reached its time."""
        if self._by_messages:
            return self._reached_time_s is not None and self._reached_time_s[0] >= head.time_s + self.options.max_wait_s
        return head.reached_s is not None and now_s >= self._wait_ends_s(head)

    def _wait_ends_s(self, frame: _OpenFrame) -> float:
        """Return when a frame stops waiting, counted from its first view, or from when most cameras reached it."""
        wait_s = self.options.max_wait_s
        reached_s = frame.first_s if frame.reached_s is None else frame.reached_s
        return (reached_s if reached_s > frame.first_s + wait_s else frame.first_s) + wait_s

    def _reached(self, frame: _OpenFrame) -> bool:
        return self._reached_time_s is not None and self._reached_time_s[0] >= frame.time_s - self.options.same_time_s

    def _has_all(self, frame: _OpenFrame, silent: list[bool]) -> bool:
        if len(frame.views) + sum(silent) < len(silent):
            return False
        if all(silent) and not self._by_messages and not self._reached(frame):
            # Only one camera reached this time before all became silent, so its clock is not confirmed.
            return False
        return all(view in frame.views or quiet for view, quiet in enumerate(silent))

    def _close_all(self, now_s: float) -> None:
        """Close all open frames, and drop those that only one camera has reached."""
        for frame in list(self._open):
            if self._reached(frame):
                self._close(frame, now_s, "ended")
        for frame in list(self._open):
            self._drop(frame)

    def _drop(self, frame: _OpenFrame) -> None:
        """Drop a frame and count its views as early."""
        self._open.remove(frame)
        for view in frame.views:
            self.counts[view].early += 1
            self.counts[view].used -= 1

    def _close(self, frame: _OpenFrame, due_s: float, reason: Reason) -> None:
        self._open.remove(frame)
        if self._past and self._past[-1][0] < frame.time_s:
            self._period_s = min(frame.time_s - self._past[-1][0], self.options.max_jump_s)
        self._past.append((frame.time_s, frozenset(frame.views)))
        self._closed_time_s = frame.time_s + self.shift_s
        views = tuple(frame.views.get(view) for view in range(len(self.counts)))
        for count, view in zip(self.counts, views, strict=True):
            count.missing += view is None
        self._ready.append(Group(frame.time_s, self.shift_s, views, frame.first_s, due_s, reason))
