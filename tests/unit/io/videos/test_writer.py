"""Videos have the same bytes whatever else the machine does."""

import multiprocessing
import time

import numpy as np

from posefuse.io.videos.writer import write_video
from tests.videos import images_of

SIZE_PX, RATE_HZ, IMAGES, REPEATS, LOAD = (320, 240), 30.0, 24, 12, 3


def occupy(stop):
    while not stop.is_set():
        pass


def pictures():
    """Return images of a bright bar that moves over gray stripes."""
    stripes = np.arange(SIZE_PX[0] * SIZE_PX[1]).reshape(SIZE_PX[1], SIZE_PX[0], 1) // 40 % 60
    for i in range(IMAGES):
        image = np.repeat(stripes, 3, axis=2).astype(np.uint8)
        image[:, 8 * i : 8 * i + 40] = 220
        yield image


def write(path, waits_s=np.zeros(IMAGES)):
    """Write a video, with a pause before each image, and return its bytes."""
    with write_video(path, SIZE_PX, RATE_HZ) as video:
        for i, image in enumerate(pictures()):
            time.sleep(waits_s[i])
            video.add(image, i / RATE_HZ)
    return path.read_bytes()


def test_bytes_do_not_depend_on_the_load(tmp_path, rng):
    first = write(tmp_path / "first.mp4")
    stop = multiprocessing.get_context("spawn").Event()
    load = [multiprocessing.get_context("spawn").Process(target=occupy, args=(stop,)) for _ in range(LOAD)]
    for each in load:
        each.start()
    try:
        time.sleep(1.0)
        waits_s = rng.uniform(0.0, 0.01, (REPEATS, IMAGES))
        assert {write(tmp_path / f"{i}.mp4", each) for i, each in enumerate(waits_s)} == {first}
    finally:
        stop.set()
        for each in load:
            each.join()


def test_images_are_read_as_written(tmp_path):
    write(tmp_path / "video.mp4")
    found = images_of(tmp_path / "video.mp4")
    assert len(found) == IMAGES
    for image, expected in zip(found, pictures(), strict=True):
        assert np.abs(image.astype(float) - expected).mean() < 6.0
