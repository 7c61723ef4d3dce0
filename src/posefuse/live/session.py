"""One stream from lines to lines: read, grouped, followed, counted. Told what time it is; reads and writes nothing."""

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
from posefuse.live.messages import person_record, told_events
from posefuse.live.statistics import Latencies, StreamCounts, ViewCounts
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.stream import StreamOptions
from posefuse.pipeline.track_live import Tracker
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.tracking.records import People

_TOLD_FAULTS = 5
_OF_RECORDINGS = (
    "people", "person", "bodies", "pick", "rate_hz", "third_channel", "camera_order", "start_s", "end_s", "layer",
    "sides", "pair_search", "side_search", "solve", "trajectory", "postprocess", "subject", "align",
    "chunk_frames",
)  # fmt: skip
"""Options that do nothing live."""


def warn_of_unused_options(options: Options) -> None:
    """Warn once of all options that do nothing in a stream."""
    usual = Options()
    idle = [name for name in _OF_RECORDINGS if getattr(options, name) != getattr(usual, name)]
    idle += ["tracker.smoother"] if options.tracker.smoother != usual.tracker.smoother else []
    idle += ["pairs"] if options.pairs not in (None, "labels") else []
    if idle:
        said = f"These options are of recordings and do nothing in a stream: {', '.join(idle)}. Leave them out."
        warnings.warn(said, PosefuseWarning, stacklevel=3)


class Session:
    """Follows people through a stream of lines.

    Args:
        rig: calibrated cameras; messages name them.
        skeleton: of the keypoints.
        options: of the tracker, as :class:`posefuse.Tracker` takes them; and how keypoints are measured.
        stream: how views become frames.

    Raises:
        OptionsError: if there are fewer than two cameras.
        SkeletonError: if the skeleton has no tree.
    """

    def __init__(self, rig: CameraRig, skeleton: Skeleton | str, options: Options, stream: StreamOptions) -> None:
        if len(rig) < 2:
            raise OptionsError(f"People are followed by two cameras or more; this calibration has {len(rig)}.")
        warn_of_unused_options(options)
        self.rig, self.skeleton, self.stream = rig, find_skeleton(skeleton), stream
        self.counts = StreamCounts()
        self.grouper = Grouper(len(rig), stream)
        self._alarms = CameraWarnings(rig.names)
        self._reader = LineReader(rig.names, len(self.skeleton), stream.max_view_people)
        self._tracker = Tracker(rig, self.skeleton, options)
        self._measuring = PointTriangulator.of(rig, self.skeleton, options)
        self._queue: deque[Group] = deque()
        self._frames = 0
        self.drops = stream.when_behind == "drop"

    def start_line(self) -> bytes:
        """The first line: what the numbers of the others mean."""
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
        """Read a line; what is wrong with it, in a sentence, if it is one of the first few with that."""
        self.counts.lines += 1
        found = self._reader.read(line)
        if not isinstance(found, RejectedLine):
            self.grouper.take(found, now_s)
            self._line_up()
            return None
        self.counts.malformed[found.fault] += 1
        if found.view is not None:
            self.grouper.counts[found.view].malformed += 1
        times = self.counts.malformed[found.fault]
        if times > _TOLD_FAULTS:
            return None
        return (
            found.reason
            if times < _TOLD_FAULTS
            else f"{found.reason} More like this ({found.fault}) are counted alone."
        )

    def tick(self, now_s: float) -> None:
        """Time goes on without a line."""
        self.grouper.tick(now_s)
        self._line_up()

    def end(self, now_s: float) -> None:
        """No more lines."""
        self.grouper.end(now_s)
        self._line_up()

    @property
    def waiting(self) -> int:
        """How many frames are ready to be followed."""
        return len(self._queue)

    def follow(self, clock: Callable[[], float]) -> bytes | None:
        """Follow everybody into the next frame that is ready; the line that says where they are, None without one.

        Args:
            clock: the time, by the same clock as of the lines.
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
        measured = self._measuring.points(frame, people)
        told = [person_record(person, i, measured, self.rig.names) for i, person in enumerate(people.people)]
        latency_s = None if self.stream.clock == "messages" else max(0.0, clock() - group.due_s)
        self._count(group, latency_s)
        return self._line(group, people, told, latency_s)

    def alarms(self, now_s: float) -> list[str]:
        """What has gone wrong since the last call, or is over, in sentences."""
        return self._alarms.check(self.grouper.counts, self.grouper.silent(now_s), self.grouper.jumps)

    def report_line(self, *, last: bool) -> bytes:
        """What was counted so far.

        Args:
            last: whether the stream has ended.
        """
        return encoded({"type": "report", "last": last, **self.report()})

    def report(self) -> dict[str, object]:
        """What was counted so far, by name."""
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
            "latencies_s": {"complete": _shown(counts.complete_s), "incomplete": _shown(counts.incomplete_s)},
            "cameras": {name: asdict(each) for name, each in self.by_camera()},
        }  # fmt: skip

    def by_camera(self) -> list[tuple[str, ViewCounts]]:
        """Names and counts."""
        return list(zip(self.rig.names, self.grouper.counts, strict=True))

    def _line_up(self) -> None:
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

    def _line(self, group: Group, people: People, told: list[dict[str, object]], latency_s: float | None) -> bytes:
        missing = [name for name, view in zip(self.rig.names, group.views, strict=True) if view is None]
        return encoded(
            {
                "type": "frame",
                "frame": people.number,
                "time_s": group.time_s,
                "complete": group.complete,
                "missing": missing,
                "latency_s": latency_s,
                "people": told,
                "events": told_events(people.events),
            }
        )


def _frame_of(group: Group, number: int) -> Frame:
    """What the tracker takes."""
    views = group.views
    return Frame.of_people(
        [None if view is None else view.keypoints_px for view in views],
        [None if view is None else view.confidence for view in views],
        [np.nan if view is None else view.time_s + group.shift_s for view in views],
        [[] if view is None else view.track_ids.tolist() for view in views],
        number,
    )


def _shown(latencies: Latencies) -> dict[str, float | None]:
    numbers = {"p50": latencies.quantile_s(0.5), "p99": latencies.quantile_s(0.99), "most": latencies.most_s}
    return {name: None if not len(latencies) else value for name, value in numbers.items()}
