"""Writing of videos: H.264 in MP4, which every player supports.

The encoder has one thread, because with two the bytes depend on the load of the machine, and the file contains neither
a date nor a program name.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import replacing
from posefuse.io.videos.library import import_pyav

_TICKS_HZ = 90_000
_BT709 = 1
_ENCODER = {"crf": "20", "preset": "veryfast", "threads": "1"}


@dataclass
class VideoWriter:
    """A video being written.

    Attributes:
        n_written: number of images written so far.
    """

    container: Any
    stream: Any
    n_written: int = 0
    last_tick: int = -1

    def add(self, rgb: np.ndarray, time_s: float) -> None:
        """Append an image.

        Args:
            rgb: shape (height, width, 3), uint8, of the video's size.
            time_s: time since the start of the video, later than that of the previous image.
        """
        av = import_pyav()
        # H.264 subsamples color by two, so the last row or column of an odd size is repeated.
        height, width = rgb.shape[:2]
        if height % 2 or width % 2:
            rgb = np.pad(rgb, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
        image = av.VideoFrame.from_ndarray(np.ascontiguousarray(rgb), format="rgb24")
        frame = image.reformat(format="yuv420p", dst_colorspace=_BT709)
        tick = max(round(time_s * _TICKS_HZ), self.last_tick + 1)
        frame.pts, frame.time_base = tick, Fraction(1, _TICKS_HZ)
        self.container.mux(self.stream.encode(frame))
        self.n_written += 1
        self.last_tick = tick


def add_h264_stream(container: Any, size_px: tuple[int, int], rate_hz: float, options: Mapping[str, str]) -> Any:
    """Return a new stream of H.264 that gives the same bytes for the same images.

    Args:
        container: the file being written.
        size_px: width and height of the images; odd sides are one longer.
        rate_hz: nominal frame rate.
        options: options of the encoder.

    Raises:
        FileError: if the encoder is not available.
    """
    av = import_pyav()
    if "libx264" not in av.codecs_available:
        raise FileError("The installed PyAV has no encoder libx264. Run: pip install --force-reinstall av")
    stream = container.add_stream("libx264", rate=Fraction(rate_hz).limit_denominator(1001), options=dict(options))
    stream.width, stream.height = (side + side % 2 for side in size_px)
    stream.pix_fmt = "yuv420p"
    stream.time_base = Fraction(1, _TICKS_HZ)
    stream.codec_context.time_base = Fraction(1, _TICKS_HZ)
    stream.codec_context.colorspace = _BT709
    stream.codec_context.flags |= int(av.codec.context.Flags.bitexact)
    return stream


@contextmanager
def write_video(path: Path, size_px: tuple[int, int], rate_hz: float) -> Iterator[VideoWriter]:
    """Write a video; the file appears at ``path`` only if no error occurs.

    Args:
        path: the MP4 file.
        size_px: width and height of the images.
        rate_hz: nominal frame rate.

    Raises:
        FileError: if the file cannot be written, there is no image, or the encoder is not available.
    """
    av = import_pyav()
    with replacing(path) as temporary:
        options = {"fflags": "+bitexact", "movflags": "+faststart"}
        with av.open(str(temporary), "w", format="mp4", options=options) as container:
            stream = add_h264_stream(container, size_px, rate_hz, _ENCODER)
            writer = VideoWriter(container, stream)
            yield writer
            container.mux(stream.encode(None))
        if not writer.n_written:
            raise FileError(f"{path} was not written: there are no images.")
