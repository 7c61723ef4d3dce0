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
    found = np.array([corners for _, corners in search.corners_of((0.4 * k, g) for k, g in enumerate(video(spec)))])
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
    for _ in search.corners_of((0.4 * k, image) for k, image in enumerate(video(SPECS[0]))):
        pass
    assert sum(size == (720, 1000) for size in sizes) <= 5
    assert sum(size != (720, 1000) for size in sizes) >= 4


@pytest.mark.parametrize("rate_hz", [6.0, 30.0, 240.0])
@pytest.mark.parametrize("spec", SPECS[:2])
def test_few_images_are_examined_while_no_board_is_shown(spec, rate_hz, monkeypatch):
    """The board is found in the images before the one that shows it first, too."""
    board = picture(read_board_spec(spec), margin_px=30, px_per_m=1200.0)
    empty = np.full_like(board, 140)
    n = round(3.0 * rate_hz)
    first, last = round(1.25 * rate_hz), round(2.1 * rate_hz)
    searched = []
    one = BoardSearch.corners_px
    monkeypatch.setattr(BoardSearch, "corners_px", lambda self, gray: (searched.append(gray), one(self, gray))[1])
    images = [board if first <= k < last else empty for k in range(n)]
    pairs = list(
        BoardSearch(BoardDetector(read_board_spec(spec))).corners_of((k / rate_hz, g) for k, g in enumerate(images))
    )
    assert all(gray is image for (gray, _), image in zip(pairs, images, strict=True))
    shown = np.array([np.isfinite(corners).any() for _, corners in pairs])
    assert np.flatnonzero(shown).tolist() == list(range(first, last))
    n_empty = sum(gray is empty for gray in searched)
    after_board = min(0.35 * rate_hz, 12)
    assert n_empty <= 3 + after_board + max((n - last + first) / 13, 2.2 / 0.35 * (2 if rate_hz < 10 else 1))


@pytest.mark.parametrize("rate_hz", [15.0, 30.0, 120.0])
def test_boards_that_are_missed_in_some_images_are_found_in_all_others(rate_hz, monkeypatch):
    """A board that is blurred or far away is found in a part of the images."""
    found = np.zeros((4, 2))
    monkeypatch.setattr(BoardSearch, "corners_px", lambda self, gray: found if gray.any() else np.full((4, 2), np.nan))
    shown = np.random.default_rng(0).random(400) < 0.7
    images = [np.full((2, 2), each, dtype=np.uint8) for each in shown]
    pairs = BoardSearch(BoardDetector(read_board_spec(SPECS[0]))).corners_of(
        (k / rate_hz, image) for k, image in enumerate(images)
    )
    np.testing.assert_array_equal([np.isfinite(corners).all() for _, corners in pairs], shown)
