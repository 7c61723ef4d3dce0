"""Process one stream from input lines to output lines: parse, group, track and count.

The session receives the current time with every call and performs no input or output.
"""

import warnings
from collections import deque
from collections.abc import Callable
from dataclasses import asdict

import numpy as np

from posefuse.errors import OptionsError, PosefuseError, PosefuseWarning
from posefuse.io.stream import PROTOCOL, LineReader, RejectedLine, encoded
from posefuse.live.camera_warnings import CameraWarnings
from posefuse.live.grouping import Group, Grouper
from posefuse.live.measured_points import PointTriangulator
from posefuse.live.messages import event_messages, person_message
from posefuse.live.statistics import Latencies, StreamCounts, ViewCounts
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.stream import StreamOptions
from posefuse.pipeline.track_live import Tracker
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.tracking.records import People

_MAX_REPORTED_FAULTS = 5
_RECORDING_OPTIONS = (
    "people", "person", "bodies", "pick", "rate_hz", "third_channel", "camera_order", "start_s", "end_s", "layer",
    "sides", "pair_search", "side_search", "solve", "trajectory", "postprocess", "session_start", "subject", "align",
    "chunk_frames",
)  # fmt: skip
"""Options that have no effect in a stream."""


def warn_of_recording_options(options: Options) -> None:
    """Warn once of all options that have no effect in a stream."""
    default = Options()
    unused = [name for name in _RECORDING_OPTIONS if getattr(options, name) != getattr(default, name)]
    unused += ["tracker.smoother"] if options.tracker.smoother != default.tracker.smoother else []
    unused += ["pairs"] if options.pairs not in (None, "labels") else []
    if unused:
        text = f"These options are for recordings and have no effect in a stream: {', '.join(unused)}. Remove them."
        warnings.warn(text, PosefuseWarning, stacklevel=3)


class Session:
    """Tracks people through a stream of lines.

    Args:
        rig: calibrated cameras; messages name them.
        skeleton: skeleton of the keypoints.
        options: options of the tracker, as :class:`posefuse.Tracker` takes them, and of triangulation.
        stream: options of the stream.

    Raises:
        OptionsError: if there are fewer than two cameras.
        SkeletonError: if the skeleton has no kinematic tree.
    """

    def __init__(self, rig: CameraRig, skeleton: Skeleton | str, options: Options, stream: StreamOptions) -> None:
        if len(rig) < 2:
            raise OptionsError(f"Tracking needs two cameras or more; this calibration has {len(rig)}.")
        warn_of_recording_options(options)
        self.rig, self.skeleton, self.stream = rig, find_skeleton(skeleton), stream
        self.counts = StreamCounts()
        self.grouper = Grouper(len(rig), stream)
        self._monitor = CameraWarnings(rig.names)
        self._reader = LineReader(rig.names, len(self.skeleton), stream.max_view_people)
        self._tracker = Tracker(rig, self.skeleton, options)
        self._triangulator = PointTriangulator.of(rig, self.skeleton, options)
        self._queue: deque[Group] = deque()
        self._frames = 0
        self.drops = stream.when_behind == "drop"

    def start_line(self) -> bytes:
        """Return the first output line, which describes the others."""
        return encoded(
            {
                "type": "start",
                "protocol": PROTOCOL,
                "skeleton": self.skeleton.name,
                "keypoints": self.skeleton.keypoints,
                "cameras": self.rig.names,
                "up": self.rig.up_axis,
            }
        )

    def take(self, line: bytes, now_s: float) -> str | None:
        """Process an input line; return its fault in a sentence if it is one of the first few of its kind."""
        self.counts.lines += 1
        found = self._reader.read(line)
        if not isinstance(found, RejectedLine):
            self.grouper.take(found, now_s)
            self._enqueue_ready()
            return None
        self.counts.malformed[found.fault] += 1
        if found.view is not None:
            self.grouper.counts[found.view].malformed += 1
        times = self.counts.malformed[found.fault]
        if times > _MAX_REPORTED_FAULTS:
            return None
        return (
            found.reason
            if times < _MAX_REPORTED_FAULTS
            else f"{found.reason} Further lines with this fault ({found.fault}) are only counted."
        )

    def tick(self, now_s: float) -> None:
        """Advance the time without a line."""
        self.grouper.tick(now_s)
        self._enqueue_ready()

    def end(self, now_s: float) -> None:
        """Process the end of the input."""
        self.grouper.end(now_s)
        self._enqueue_ready()

    @property
    def waiting(self) -> int:
        """Number of frames that are ready to be processed."""
        return len(self._queue)

    def process_frame(self, clock: Callable[[], float]) -> bytes | None:
        """Track people in the next frame that is ready, and return its output line; None without a frame.

        Args:
            clock: returns the current time, by the same clock as the times of lines.
        """
        if not self._queue:
            return None
        group = self._queue.popleft()
        frame = _frame_of(group, self._frames)
        try:
            people = self._tracker.update(frame)
        except PosefuseError:
            self.counts.refused += 1
            return None
        self._frames += 1
        measured = self._triangulator.points(frame, people)
        messages = [person_message(person, i, measured, self.rig.names) for i, person in enumerate(people.people)]
        latency_s = None if self.stream.clock == "messages" else max(0.0, clock() - group.due_s)
        self._count(group, latency_s)
        return self._line(group, people, messages, latency_s)

    def check_cameras(self, now_s: float) -> list[str]:
        """Return sentences on problems of cameras that began or ended since the last call."""
        return self._monitor.check(self.grouper.counts, self.grouper.silent(now_s), self.grouper.jumps)

    def report_line(self, *, last: bool) -> bytes:
        """Return the output line with the counts so far.

        Args:
            last: whether the stream has ended.
        """
        return encoded({"type": "report", "last": last, **self.report()})

    def report(self) -> dict[str, object]:
        """Return the counts so far, by name."""
        counts = self.counts
        return {
            "lines": counts.lines,
            "malformed": dict(sorted(counts.malformed.items())),
            "lost": dict(sorted(counts.lost.items())),
            "frames": {
                "complete": counts.complete, "incomplete": counts.incomplete, "dropped": counts.frames_dropped,
                "refused": counts.refused,
            },
            "clock_jumps": self.grouper.jumps,
            "latencies_s": {"complete": _quantiles(counts.complete_s), "incomplete": _quantiles(counts.incomplete_s)},
            "cameras": {name: asdict(each) for name, each in self.by_camera()},
        }  # fmt: skip

    def by_camera(self) -> list[tuple[str, ViewCounts]]:
        """Return names and counts of all cameras."""
        return list(zip(self.rig.names, self.grouper.counts, strict=True))

    def _enqueue_ready(self) -> None:
        self._queue.extend(self.grouper.ready())
        while self.drops and len(self._queue) > self.stream.queue_frames:
            self._queue.popleft()
            self.counts.frames_dropped += 1

    def _count(self, group: Group, latency_s: float | None) -> None:
        counts = self.counts
        counts.complete += group.complete
        counts.incomplete += not group.complete
        if latency_s is not None:
            (counts.complete_s if group.complete else counts.incomplete_s).add(latency_s)

    def _line(self, group: Group, people: People, messages: list[dict[str, object]], latency_s: float | None) -> bytes:
        missing = [name for name, view in zip(self.rig.names, group.views, strict=True) if view is None]
        return encoded(
            {
                "type": "frame",
                "frame": people.number,
                "time_s": group.time_s,
                "complete": group.complete,
                "missing": missing,
                "latency_s": latency_s,
                "people": messages,
                "events": event_messages(people.events),
            }
        )


def _frame_of(group: Group, number: int) -> Frame:
    """Return the frame that the tracker takes."""
    views = group.views
    return Frame.of_people(
        [None if view is None else view.keypoints_px for view in views],
        [None if view is None else view.confidence for view in views],
        [np.nan if view is None else view.time_s + group.shift_s for view in views],
        [[] if view is None else view.track_ids.tolist() for view in views],
        number,
    )


def _quantiles(latencies: Latencies) -> dict[str, float | None]:
    numbers = {"p50": latencies.quantile_s(0.5), "p99": latencies.quantile_s(0.99), "most": latencies.most_s}
    return {name: None if not len(latencies) else value for name, value in numbers.items()}
