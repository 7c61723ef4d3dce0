"""Videos of the cameras: checks against the rig, and the images at given times."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from posefuse.errors import MatchError, ResultError, choices
from posefuse.io.videos.info import VideoInfo
from posefuse.io.videos.reader import VideoImage, VideoReader, open_video
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.options.sync import SyncOptions
from posefuse.visualize.frame_times import FrameTimes
from posefuse.visualize.overlay.options import OverlayOptions

_SAME_RATE = 0.01
_NOTABLE_DRIFT_FRAMES = 0.5
_PADDING_PX = 16


@dataclass(frozen=True, eq=False)
class VideoSource:
    """The images of one camera: a video or a plain background.

    Attributes:
        camera: the camera.
        view: index of the camera in the rig.
        reader: reader of its video, or None for a plain background.
        offset_s: start of the video in the result's time.
        by_number: whether image n belongs to frame number n.
        sync: time offsets of the views that the result was corrected for.
    """

    camera: Camera
    view: int
    reader: VideoReader | None = None
    offset_s: float = 0.0
    by_number: bool = False
    sync: SyncOptions = field(default_factory=SyncOptions)

    def synchronized_s(self, video_s: float) -> float:
        """Convert a time in the video to the result's time."""
        nominal_s = video_s + self.offset_s
        return nominal_s + float(self.sync.offset_at(self.camera.name, np.array(nominal_s)))

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the images."""
        return self.camera.size_px if self.reader is None else self.reader.info.size_px

    def images(self, frame_times: FrameTimes, from_s: float) -> Iterator[tuple[float, VideoImage]]:
        """Yield images with their times in the result, starting at or somewhat before ``from_s``."""
        if self.reader is None:
            return
        if self.by_number:
            for image in self.reader.images():
                yield self.synchronized_s(frame_times.time_of_number(image.number)), image
        else:
            for image in self.reader.images(from_s - max(self.synchronized_s(from_s) - from_s, self.offset_s)):
                yield self.synchronized_s(image.time_s), image

    def notes(self, frame_times: FrameTimes, until_s: float) -> list[str]:
        """Return notes for the user after the video has been read.

        Args:
            frame_times: frame times of the result.
            until_s: end of the requested time range in the result.
        """
        if self.reader is None:
            return []
        info, notes = self.reader.info, []
        last_s = self.reader.last_s
        if self.reader.error:
            notes.append(
                f"{info.path.name} cannot be read beyond {last_s:.3f} s ({self.reader.n_read} images read; "
                f"{self.reader.error}). The output ends there."
            )
        elif self.reader.ended and not self.by_number and self.synchronized_s(last_s) < until_s - frame_times.period_s:
            notes.append(
                f"{info.path.name} ends at {self.synchronized_s(last_s):.3f} s, but the result continues to "
                f"{until_s:.3f} s."
            )
        return [*notes, *self._drift_notes(info, frame_times)]

    def _drift_notes(self, info: VideoInfo, frame_times: FrameTimes) -> list[str]:
        """Return a note if the frame rates of the video and the result differ slightly."""
        if info.rate_hz is None or self.by_number or not frame_times.timed:
            return []
        difference = info.rate_hz * frame_times.period_s - 1.0
        frames = abs(difference) * len(frame_times.time_s)
        if abs(difference) > _SAME_RATE or frames < _NOTABLE_DRIFT_FRAMES:
            return []
        return [
            f"{info.path.name} has {info.rate_hz:.3f} images per second and the result "
            f"{1.0 / frame_times.period_s:.3f}, so they are {frames:.1f} frames apart at the end. If every frame of "
            "the result is one image of the video, use `match='frame'`."
        ]


def open_sources(
    rig: CameraRig,
    videos: Mapping[str, Path],
    options: OverlayOptions,
    has_times: bool,
    sync: SyncOptions = SyncOptions(),  # noqa: B008
) -> tuple[VideoSource, ...]:
    """Open the videos of the cameras to draw, in the rig's order.

    Args:
        rig: rig of the result.
        videos: videos by camera name.
        options: options of the overlay.
        has_times: whether the result has times; if not, frames are matched by number.
        sync: time offsets of the views that the result was corrected for.

    Raises:
        MatchError: if a video or an offset names an unknown camera, or there is nothing to draw.
        FileError: if a video cannot be read.
        ResultError: if the size of a video differs from its camera's.
    """
    check_names(rig, videos, "videos")
    check_names(rig, options.offset_s, "offset_s")
    names = [name for name in rig.names if name in videos or options.blank]
    if not names:
        raise MatchError(
            f"No video to draw on. Specify one per camera, such as `videos={{{rig.names[0]!r}: 'FILE'}}`; the cameras "
            f"are {choices(rig.names)}. Or draw on a plain background with `blank=True`."
        )
    by_number = options.match == "frame" or not has_times
    sources = []
    for name in names:
        camera = rig[name]
        reader = open_video(videos[name]) if name in videos else None
        if reader is not None:
            check_size(camera, reader.info, rescale=options.rescale)
        sources.append(VideoSource(camera, rig.index(name), reader, options.offset_s.get(name, 0.0), by_number, sync))
    return tuple(sources)


def check_names(rig: CameraRig, names: Mapping[str, object], argument: str) -> None:
    """Check that the keys of an argument are cameras.

    Raises:
        MatchError: if one is not.
    """
    for name in names:
        if name not in rig.names:
            raise MatchError(f"`{argument}`: there is no camera {name!r}. The cameras are {choices(rig.names, 30)}.")


def check_size(camera: Camera, info: VideoInfo, *, rescale: bool) -> None:
    """Check that a video has the image size of the camera's calibration.

    Raises:
        ResultError: if the sizes differ, unless the aspect ratios agree and ``rescale`` is True.
    """
    (width, height), (calibrated_width, calibrated_height) = info.size_px, camera.size_px
    if (width, height) == (calibrated_width, calibrated_height):
        return
    difference = abs(width * calibrated_height - height * calibrated_width)
    same_shape = difference <= max(calibrated_width, calibrated_height)
    if same_shape and rescale:
        return
    is_rotated = (height, width) == (calibrated_width, calibrated_height)
    advice = (
        "If it is the full image at another resolution, use `rescale=True`."
        if same_shape
        else "It is rotated by 90 degrees. Calibrate and detect on the video as it is, or rotate the video."
        if is_rotated
        else "Its aspect ratio differs, so it is cropped or from another camera. Use the video of the calibration."
    )
    raise ResultError(
        f"{info.path.name} is {width} x {height} px, but camera {camera.name!r} was calibrated at "
        f"{calibrated_width} x {calibrated_height} px. {advice}"
    )


def shown_area_px(camera: Camera, info: VideoInfo) -> tuple[int, int]:
    """Return the width and height of the calibrated image that a video shows, from its top left corner.

    Encoders pad images to whole blocks, and some programs calibrate on the padded image, so the video may be some
    pixels smaller or larger. Otherwise it is the full image at any resolution.

    Raises:
        ResultError: if the shapes differ by more.
    """
    differences = [abs(a - b) for a, b in zip(info.size_px, camera.size_px, strict=True)]
    if 0 < max(differences) < _PADDING_PX:
        return info.size_px
    check_size(camera, info, rescale=True)
    return camera.size_px


class VideoCursor:
    """Read the image nearest to each of a sequence of ascending times; at most two images are in memory.

    Args:
        source: the video.
        frame_times: frame times of the result.
        from_s: the first time.
    """

    def __init__(self, source: VideoSource, frame_times: FrameTimes, from_s: float) -> None:
        self._images = source.images(frame_times, from_s)
        self._tolerance_s = _tolerance_s(source, frame_times)
        self._now: tuple[float, VideoImage] | None = None
        self._next = next(self._images, None)

    def at(self, time_s: float) -> VideoImage | None:
        """Return the image nearest to a time, or None if there is none; times must not decrease between calls."""
        while self._next is not None and (self._now is None or self._nearer(self._next[0], self._now[0], time_s)):
            self._now, self._next = self._next, next(self._images, None)
        if self._now is None or abs(self._now[0] - time_s) > self._tolerance_s:
            return None
        return self._now[1]

    @staticmethod
    def _nearer(one_s: float, other_s: float, time_s: float) -> bool:
        return abs(one_s - time_s) <= abs(other_s - time_s)


def _tolerance_s(source: VideoSource, frame_times: FrameTimes) -> float:
    rate_hz = None if source.reader is None else source.reader.info.rate_hz
    return 0.51 * max(frame_times.period_s, 1.0 / rate_hz if rate_hz else 0.0)
