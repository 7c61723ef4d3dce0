"""Videos hold the images that are written."""

import numpy as np

from posefuse.io.videos.writer import write_video
from tests.videos import images_of

SIZE_PX, RATE_HZ, IMAGES = (320, 240), 30.0, 24


def pictures():
    """Return images of a bright bar that moves over gray stripes."""
    stripes = np.arange(SIZE_PX[0] * SIZE_PX[1]).reshape(SIZE_PX[1], SIZE_PX[0], 1) // 40 % 60
    for i in range(IMAGES):
        image = np.repeat(stripes, 3, axis=2).astype(np.uint8)
        image[:, 8 * i : 8 * i + 40] = 220
        yield image


def test_images_are_read_as_written(tmp_path):
    with write_video(tmp_path / "video.mp4", SIZE_PX, RATE_HZ) as video:
        for i, image in enumerate(pictures()):
            video.add(image, i / RATE_HZ)
    found = images_of(tmp_path / "video.mp4")
    assert len(found) == IMAGES
    for image, expected in zip(found, pictures(), strict=True):
        assert np.abs(image.astype(float) - expected).mean() < 6.0
