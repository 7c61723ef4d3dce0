"""Which video is which camera's, whether it fits, and which of its pictures belongs to a time."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from posefuse.errors import MatchError, ResultError, choices
from posefuse.io.videos.reading import Reading, VideoFacts, VideoImage, open_video
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.options.sync import SyncOptions
from posefuse.visualize.clock import Clock
from posefuse.visualize.overlay.options import OverlayOptions

_SAME_RATE = 0.01
_SEEN_DRIFT_FRAMES = 0.5


@dataclass(frozen=True, eq=False)
class Source:
    """What a camera is drawn on.

    Attributes:
        camera: whose it is.
        view: its place in the rig.
        reading: of its video, or None for a plain background.
        offset_s: the result's time at which the video begins.
        by_number: whether the n-th picture belongs to frame number n.
        sync: how much later than they say views took their pictures, by which the result put them in step.
    """

    camera: Camera
    view: int
    reading: Reading | None = None
    offset_s: float = 0.0
    by_number: bool = False
    sync: SyncOptions = field(default_factory=SyncOptions)

    def true_s(self, said_s: float) -> float:
        """The result's time of a picture that says it is of a time."""
        began_s = said_s + self.offset_s
        return began_s + float(self.sync.offset_at(self.camera.name, np.array(began_s)))

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of its pictures."""
        return self.camera.size_px if self.reading is None else self.reading.facts.size_px

    def images(self, clock: Clock, from_s: float) -> Iterator[tuple[float, VideoImage]]:
        """Pictures with their times in the result, from a time on or somewhat before it."""
        if self.reading is None:
            return
        if self.by_number:
            for image in self.reading.images():
                yield self.true_s(clock.time_of_number(image.number)), image
        else:
            for image in self.reading.images(from_s - max(self.true_s(from_s) - from_s, self.offset_s)):
                yield self.true_s(image.time_s), image

    def remarks(self, clock: Clock, until_s: float) -> list[str]:
        """What is worth saying after it has been read.

        Args:
            clock: of the result.
            until_s: time in the result up to which pictures were wanted.
        """
        if self.reading is None:
            return []
        facts, said = self.reading.facts, []
        last_s = self.reading.last_s
        if self.reading.broken:
            said.append(
                f"{facts.path.name} breaks off after {last_s:.3f} s ({self.reading.n_read} pictures read; "
                f"{self.reading.broken}): what was written ends there."
            )
        elif self.reading.ended and not self.by_number and self.true_s(last_s) < until_s - clock.period_s:
            said.append(
                f"{facts.path.name} ends at {self.true_s(last_s):.3f} s of the result, which goes on to "
                f"{until_s:.3f} s."
            )
        return [*said, *self._drift(facts, clock)]

    def _drift(self, facts: VideoFacts, clock: Clock) -> list[str]:
        """Rates that were meant to be the same, and are not quite."""
        if facts.rate_hz is None or self.by_number or not clock.timed:
            return []
        apart = facts.rate_hz * clock.period_s - 1.0
        frames = abs(apart) * len(clock.time_s)
        if abs(apart) > _SAME_RATE or frames < _SEEN_DRIFT_FRAMES:
            return []
        return [
            f"{facts.path.name} has {facts.rate_hz:.3f} pictures a second, the result {1.0 / clock.period_s:.3f} "
            f"frames: by its end they are {frames:.1f} frames apart. If frames are the video's pictures, say "
            "--match frame."
        ]


def open_sources(
    rig: CameraRig,
    videos: Mapping[str, Path],
    options: OverlayOptions,
    clock_known: bool,
    sync: SyncOptions = SyncOptions(),  # noqa: B008
) -> tuple[Source, ...]:
    """The cameras that are drawn, in the rig's order.

    Args:
        rig: of the result.
        videos: camera to its video.
        options: how they are drawn.
        clock_known: whether the result says when its frames were taken; if not, frames are matched by number.
        sync: by what the result put views in step.

    Raises:
        MatchError: if a video or an offset names no camera, or there is none to draw.
        FileError: if a video cannot be read.
        ResultError: if a video has another size than its camera.
    """
    _check_names(rig, videos, "--video")
    _check_names(rig, options.offset_s, "--offset-s")
    names = [name for name in rig.names if name in videos or options.blank]
    if not names:
        raise MatchError(
            f"No video to draw on. Name one for each camera: --video {rig.names[0]}=FILE; the cameras are "
            f"{choices(rig.names)}. Or draw on a plain background: --blank."
        )
    by_number = options.match == "frame" or not clock_known
    sources = []
    for name in names:
        camera = rig[name]
        reading = open_video(videos[name]) if name in videos else None
        if reading is not None:
            check_size(camera, reading.facts, rescale=options.rescale)
        sources.append(Source(camera, rig.index(name), reading, options.offset_s.get(name, 0.0), by_number, sync))
    return tuple(sources)


def _check_names(rig: CameraRig, names: Mapping[str, object], flag: str) -> None:
    for name in names:
        if name not in rig.names:
            raise MatchError(f"{flag} {name}=...: no such camera. The result's cameras are {choices(rig.names, 30)}.")


def check_size(camera: Camera, facts: VideoFacts, *, rescale: bool) -> None:
    """Refuse a video of another size than the camera was calibrated at.

    Raises:
        ResultError: unless the sizes agree, or the shapes do and ``rescale`` says it is the whole image.
    """
    (width, height), (wide, high) = facts.size_px, camera.size_px
    if (width, height) == (wide, high):
        return
    same_shape = abs(width * high - height * wide) <= max(wide, high)
    if same_shape and rescale:
        return
    turned = (height, width) == (wide, high)
    advice = (
        "If it is the whole image made smaller or larger, say --rescale."
        if same_shape
        else "It is turned by a quarter: calibrate and detect on the video as it is, or turn the video."
        if turned
        else "It is of another shape, so it is cropped or another camera's: give the video that was calibrated."
    )
    raise ResultError(
        f"{facts.path.name} is {width} x {height} px, but camera {camera.name!r} was calibrated at {wide} x {high} px. "
        f"{advice}"
    )


class Follower:
    """A video played along with a clock: at each time its nearest picture, never more than two in memory."""

    def __init__(self, source: Source, clock: Clock, from_s: float) -> None:
        """Play a video from a time in the result on."""
        self._images = source.images(clock, from_s)
        self._tolerance_s = _tolerance_s(source, clock)
        self._now: tuple[float, VideoImage] | None = None
        self._next = next(self._images, None)

    def at(self, time_s: float) -> VideoImage | None:
        """The picture nearest to a time, which is never before the last asked for; None where none is near."""
        while self._next is not None and (self._now is None or self._nearer(self._next[0], self._now[0], time_s)):
            self._now, self._next = self._next, next(self._images, None)
        if self._now is None or abs(self._now[0] - time_s) > self._tolerance_s:
            return None
        return self._now[1]

    @staticmethod
    def _nearer(one_s: float, other_s: float, time_s: float) -> bool:
        return abs(one_s - time_s) <= abs(other_s - time_s)


def _tolerance_s(source: Source, clock: Clock) -> float:
    rate_hz = None if source.reading is None else source.reading.facts.rate_hz
    return 0.51 * max(clock.period_s, 1.0 / rate_hz if rate_hz else 0.0)
