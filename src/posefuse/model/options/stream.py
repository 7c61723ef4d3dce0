"""What a user can choose about a live stream: how long it waits, how much it takes, what it does when it is behind."""

import math
from dataclasses import dataclass, fields
from typing import Literal, get_args

from posefuse.errors import OptionsError, suggestion

StreamClock = Literal["arrival", "messages"]
WhenBehind = Literal["drop", "wait"]


@dataclass(frozen=True)
class StreamOptions:
    """How the views of a live stream become frames.

    Attributes:
        max_wait_s: How long a frame waits for its views, from the first on. It waits less where a later frame has all
            of its own.
        same_time_s: Views whose times differ by no more are of one frame; less than half the time between frames.
        silent_after_s: A camera that has said nothing for this long is not waited for until it is heard again.
        max_jump_s: Times farther than this from what the others' led to expect are early or late, and dropped; where
            most cameras have jumped alike, the stream has, and is followed.
        clock: What deadlines go by: when messages arrive, or the times they carry (for replays: the same lines give
            the same output, and no latency is told).
        when_behind: What happens when lines come faster than they can be worked on: the oldest frames are dropped and
            counted (drop; for networks), or the sender waits (wait; for stdin). By default what suits the input.
        queue_frames: So many frames may wait to be worked on; of more, the oldest are dropped.
        queue_messages: So many messages may wait to be read; of more, the oldest are dropped.
        open_frames: So many frames may wait for their views; of more, the oldest goes on without.
        max_line_bytes: A longer message is dropped.
        max_view_people: A message with more people in one view is dropped.
        max_messages_hz: Messages a second of one connection, on average over a second; more are dropped.
        max_connections: So many senders at a time; more are turned away.
        report_every_s: How often a line tells what was counted so far.
    """

    max_wait_s: float = 0.05
    same_time_s: float = 0.005
    silent_after_s: float = 0.5
    max_jump_s: float = 1.0
    clock: StreamClock = "arrival"
    when_behind: WhenBehind | None = None
    queue_frames: int = 8
    queue_messages: int = 4096
    open_frames: int = 64
    max_line_bytes: int = 1 << 20
    max_view_people: int = 64
    max_messages_hz: float = 5000.0
    max_connections: int = 64
    report_every_s: float = 10.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float | int) and not (math.isfinite(value) and value > 0):
                raise OptionsError(f"{field.name} must be a finite number of more than 0, got {value}.")
        for name, allowed in (("clock", get_args(StreamClock)), ("when_behind", get_args(WhenBehind))):
            value = getattr(self, name)
            if value is not None and value not in allowed:
                raise OptionsError(f"{name}: no {value!r}. {suggestion(str(value), allowed)}")
        if self.max_jump_s <= self.max_wait_s:
            raise OptionsError(
                f"max_jump_s ({self.max_jump_s}) must be more than max_wait_s ({self.max_wait_s}): views that are "
                "waited for have not jumped."
            )
