"""Options of a live stream: how views are combined into frames, what limits apply, and what happens under overload."""

from dataclasses import dataclass
from typing import Literal

from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option

StreamClock = Literal["arrival", "messages"]
WhenBehind = Literal["drop", "wait"]


@dataclass(frozen=True)
class StreamOptions:
    """Options of the assembly of a live stream's views into frames.

    Attributes:
        max_wait_s: Maximum time that a frame waits for its views. The time counts from the first view, and ends early
            once a later frame is complete.
        same_time_s: Maximum time difference between the views of one frame; set it below half the frame period.
        silent_after_s: Time without messages after which frames no longer wait for a camera, until it sends again.
        max_jump_s: Deviation from the expected time beyond which a view is dropped; if most cameras jump alike, the
            stream follows the jump.
        clock: Clock for deadlines: arrival times of messages, or the times in the messages (for reproducible replays;
            latency is then not reported).
        when_behind: Behavior under overload: drop or wait. Drop discards and counts the oldest frames, wait makes the
            sender wait; the default is drop for network input and wait for stdin.
        queue_frames: Maximum number of frames waiting to be processed; beyond it, the oldest are dropped.
        queue_messages: Maximum number of messages waiting to be parsed; beyond it, the oldest are dropped.
        queue_lines: Maximum number of output lines waiting for a consumer; beyond it, the oldest are dropped and
            counted.
        open_frames: Maximum number of frames that wait for views; the oldest is processed without the missing ones.
        max_line_bytes: Maximum length of a message; longer ones are dropped.
        max_view_people: Maximum number of people in one view of a message; messages with more are dropped.
        max_messages_hz: Maximum rate of messages per connection, averaged over one second; the excess is dropped.
        max_connections: Maximum number of simultaneous senders; further connections are refused.
        report_every_s: Interval between lines that report the counters.
    """

    max_wait_s: float = option(0.05, above=0.0, common=True)
    same_time_s: float = option(0.005, above=0.0)
    silent_after_s: float = option(0.5, above=0.0)
    max_jump_s: float = option(1.0, above=0.0)
    clock: StreamClock = "arrival"
    when_behind: WhenBehind | None = option(None, common=True)
    queue_frames: int = option(8, at_least=1)
    queue_messages: int = option(4096, at_least=1)
    queue_lines: int = option(1024, at_least=1)
    open_frames: int = option(64, at_least=1)
    max_line_bytes: int = option(1 << 20, at_least=1, unit="bytes")
    max_view_people: int = option(64, at_least=1)
    max_messages_hz: float = option(5000.0, above=0.0)
    max_connections: int = option(64, at_least=1)
    report_every_s: float = option(10.0, above=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "")
        if self.max_jump_s <= self.max_wait_s:
            raise OptionsError(
                f"max_jump_s ({self.max_jump_s}) must be above max_wait_s ({self.max_wait_s}): a view that a frame is "
                "still waiting for must not count as a jump."
            )
