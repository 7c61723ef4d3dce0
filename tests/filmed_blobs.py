"""Videos of bright bars that move, and a detector of bars, for tests of the detection in videos."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
from scipy.ndimage import find_objects, label

from posefuse.io.videos.library import import_pyav
from posefuse.skeleton.skeletons import Skeleton

BAR = Skeleton("bar", ("left_end", "middle", "right_end"), (("left_end", "middle"), ("middle", "right_end")),
               pairs=(("left_end", "right_end"),))  # fmt: skip
SIZE_PX = (96, 64)
TICKS_HZ = 90_000


def bar_place(number: int, person: int = 0) -> tuple[int, int]:
    """Return left column and top row of a bar in an image; both are even, so that encoding keeps the edges."""
    return 8 + 2 * (number % 30), 8 + 20 * person


def bars_image(number: int, people: int = 1, size_px: tuple[int, int] = SIZE_PX) -> np.ndarray:
    """Return an image with bars of 16 x 6 px."""
    rgb = np.full((size_px[1], size_px[0], 3), 20, dtype=np.uint8)
    for person in range(people):
        left, top = bar_place(number, person)
        rgb[top : top + 6, left : left + 16] = 230
    return rgb


def film(
    path: Path,
    times_s: Sequence[float] | int = 40,
    *,
    people: int = 1,
    codec: str = "libx264",
    pixels: str = "yuv420p",
    size_px: tuple[int, int] = SIZE_PX,
    gop: int = 12,
) -> Path:
    """Write a video of moving bars.

    Args:
        path: the file; its ending selects the container.
        times_s: times of the images; a number stands for that many images at 25 Hz.
        people: number of bars.
        codec: encoder.
        pixels: pixel format.
        size_px: width and height.
        gop: interval of the images at which decoding can start.
    """
    av = import_pyav()
    ticks_hz = 25 if isinstance(times_s, int) else TICKS_HZ
    times = np.arange(times_s) / 25.0 if isinstance(times_s, int) else np.asarray(times_s)
    options = {"g": str(gop), "bf": "2", "crf": "10"} if codec == "libx264" else {"g": str(gop)}
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = *size_px, pixels
        stream.time_base = stream.codec_context.time_base = Fraction(1, ticks_hz)
        for number, time_s in enumerate(times):
            rgb = bars_image(number, people, size_px)
            frame = av.VideoFrame.from_ndarray(rgb, format="rgb24").reformat(format=pixels)
            frame.pts, frame.time_base = round(time_s * ticks_hz), Fraction(1, ticks_hz)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def find_bars(image: np.ndarray) -> np.ndarray:
    """Return ends and middle of each bar, shape (person, 3, 3), with a confidence that falls from top to bottom."""
    labels, _ = label(image[..., 1] > 120)
    rows = []
    for rank, (down, right) in enumerate(find_objects(labels)):
        y, left, last = (down.start + down.stop - 1) / 2, right.start, right.stop - 1
        trust = 0.9 - 0.1 * rank
        rows.append([[left, y, trust], [(left + last) / 2, y, trust], [last, y, trust]])
    return np.array(rows, dtype=float).reshape(-1, 3, 3)


def lefts_of(keypoints_px: np.ndarray) -> list[int]:
    """Return the column of the left end of each detection."""
    return [round(float(x)) for x in np.asarray(keypoints_px)[:, 0, 0]]
