"""The search in a video finds the corners that are found in every image by itself."""

import numpy as np
import pytest

from posefuse.detection.boards.detector import BoardDetector
from posefuse.detection.boards.search import BoardSearch
from posefuse.io.board_specs import read_board_spec
from tests.boards import picture

SPECS = ("charuco:5x4,square=30mm", "aruco:4x3,square=40mm,dict=5X5_100", "checkerboard:4x5,square=40mm")


def video(spec: str) -> list[np.ndarray]:
    """A board that enters, moves fast and slowly, jumps, and leaves."""
    small = picture(read_board_spec(spec), margin_px=30, px_per_m=1200.0)
    height, width = small.shape
    places = [None, None, (10, 20), (30, 60), (60, 160), (70, 190), None, (300, 500), (310, 480), None]
    images = []
    for place in places:
        image = np.full((720, 1000), 140, dtype=np.uint8)
        if place is not None:
            image[place[0] : place[0] + height, place[1] : place[1] + width] = small
        images.append(image)
    return images


@pytest.mark.parametrize("spec", SPECS)
def test_same_corners_as_in_every_image(spec):
    detector = BoardDetector(read_board_spec(spec))
    search = BoardSearch(detector)
    found = np.array([search.corners_px(image) for image in video(spec)])
    expected = np.array([detector.corners_px(image) for image in video(spec)])
    assert np.isfinite(expected[:, :, 0]).any(axis=1).sum() == 6
    np.testing.assert_allclose(found, expected, atol=0.05)


def test_images_without_markers_are_not_searched_in_full(monkeypatch):
    detector = BoardDetector(read_board_spec(SPECS[0]))
    sizes = []
    whole = BoardDetector.corners_px
    monkeypatch.setattr(
        BoardDetector, "corners_px", lambda self, gray: (sizes.append(gray.shape), whole(self, gray))[1]
    )
    search = BoardSearch(detector)
    for image in video(SPECS[0]):
        search.corners_px(image)
    assert sum(size == (720, 1000) for size in sizes) <= 5
    assert sum(size != (720, 1000) for size in sizes) >= 4
