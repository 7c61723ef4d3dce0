"""Decoding of ranges of images by number."""

import numpy as np
import pytest

from posefuse.errors import FileError
from posefuse.io.videos.decoder import VideoDecoder
from posefuse.io.videos.frame_index import read_frame_index
from tests.filmed_blobs import bar_place, film, find_bars

CONTAINERS = [
    ("a.mp4", "libx264", "yuv420p"),
    ("a.mkv", "libx264", "yuv420p"),
    ("a.ts", "libx264", "yuv420p"),
    ("a.avi", "libx264", "yuv420p"),
    ("b.avi", "mpeg4", "yuv420p"),
    ("a.mpg", "mpeg2video", "yuv420p"),
    ("a.webm", "libvpx-vp9", "yuv420p"),
    ("ten_bit.mp4", "libx264", "yuv420p10le"),
    ("still.mov", "mjpeg", "yuvj420p"),
]


def numbers_shown(images: list[np.ndarray]) -> list[int]:
    """Return the number of each image modulo 30, read from the place of its bar."""
    return [round((find_bars(image)[0, 0, 0] - bar_place(0)[0]) / 2) for image in images]


@pytest.mark.parametrize(("name", "codec", "pixels"), CONTAINERS)
def test_a_range_has_the_images_of_its_numbers(tmp_path, name, codec, pixels):
    """From any place, a range has the same pixels as in the whole video."""
    index = read_frame_index(film(tmp_path / name, 50, codec=codec, pixels=pixels))
    whole = list(VideoDecoder(index).images(0, 50))
    assert [number for number, _ in whole] == list(range(50))
    assert numbers_shown([image for _, image in whole]) == [number % 30 for number in range(50)]
    kept = VideoDecoder(index)
    for start, stop in ((31, 42), (5, 9), (9, 20), (30, 50), (11, 13), (12, 14), (0, 1), (49, 50), (3, 3)):
        for decoder in (kept, VideoDecoder(index, threads=2)):
            part = list(decoder.images(start, stop))
            assert [number for number, _ in part] == list(range(start, stop))
            assert all(np.array_equal(image, whole[number][1]) for number, image in part)
    kept.close()


def test_only_wanted_images_are_converted(tmp_path):
    decoder = VideoDecoder(read_frame_index(film(tmp_path / "a.mp4", 30)))
    part = list(decoder.images(4, 20, lambda number: number % 5 == 0))
    assert [number for number, _ in part] == [5, 10, 15]
    assert numbers_shown([image for _, image in part]) == [5, 10, 15]


def test_images_after_a_damaged_part_keep_their_numbers(tmp_path):
    path = film(tmp_path / "a.avi", 40, codec="mjpeg", pixels="yuvj420p")
    content = bytearray(path.read_bytes())
    starts = [at for at in range(len(content)) if content[at : at + 3] == b"\xff\xd8\xff"]
    content[starts[9] : starts[10] - 8] = bytes(starts[10] - 8 - starts[9])
    path.write_bytes(content)
    found = list(VideoDecoder(read_frame_index(path)).images(0, 40))
    numbers = [number for number, _ in found]
    assert numbers[:9] == list(range(9))
    assert numbers[-20:] == list(range(20, 40))
    shown = numbers_shown([image for number, image in found if number != 9])
    assert shown == [number % 30 for number in numbers if number != 9]


def test_a_change_of_size_is_one_sentence(tmp_path):
    one, other = film(tmp_path / "a.ts", 10), film(tmp_path / "b.ts", 10, size_px=(128, 96))
    both = tmp_path / "c.ts"
    both.write_bytes(one.read_bytes() + other.read_bytes())
    index = read_frame_index(both)
    with pytest.raises(FileError, match=r"changes its image size at image \d+, from 96 x 64 to 128 x 96 px"):
        list(VideoDecoder(index).images(0, index.n_images))
