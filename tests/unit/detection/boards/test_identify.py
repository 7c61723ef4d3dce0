"""Identification of unknown boards."""

import cv2
import numpy as np
import pytest

from posefuse.detection.boards.identify import IdentifiedBoard, identify_board, merged
from posefuse.io.board_specs import read_board_spec
from tests.boards import picture

SPECS = (
    "charuco:6x5,square=60mm,marker=0.75,dict=4X4_50",
    "charuco:7x6,square=60mm,marker=0.6,dict=5X5_50,legacy",
    "charuco:5x7,square=60mm,marker=0.8,dict=4X4_50,inverted",
    "aruco:5x4,square=70mm,gap=0.3,dict=6X6_50",
    "apriltag:6x5,square=60mm,gap=0.3,dict=APRILTAG_36h11",
    "checkerboard:7x5,square=60mm",
)


@pytest.mark.parametrize("spec", SPECS)
def test_kind_size_and_markers_are_seen(spec):
    found = identify_board([picture(read_board_spec(spec), 1000.0)])
    assert found is not None
    assert found.spec("60mm") == spec.replace("70mm", "60mm")
    assert found.agrees_with(read_board_spec(spec))


def test_the_dictionary_is_the_smallest_one_that_has_the_markers():
    found = identify_board([picture(read_board_spec("charuco:12x9,square=40mm,dict=4X4_1000"), 1000.0)])
    assert found is not None
    assert found.dictionary == "4X4_100"


def test_patterns_of_the_room_are_not_markers_of_the_board():
    """One of them would change the number of rows, or hide the board, if it were."""
    spec = SPECS[0]
    marker = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_100), 93, 24)
    shown = np.pad(picture(read_board_spec(spec), 1000.0), 60, constant_values=200)
    disturbed = shown.copy()
    disturbed[9:45, 9:45] = 255
    disturbed[15:39, 15:39] = marker
    partly = disturbed.copy()
    partly[60:220] = 200
    for images in ([disturbed], [shown, shown, shown, partly]):
        found = identify_board(images)
        assert found is not None
        assert found.spec("60mm") == spec
        assert found.n_images == len(images)


def test_images_without_a_board():
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (360, 480), dtype=np.uint8)
    tiles = np.kron(np.indices((4, 4)).sum(axis=0) % 2, np.full((60, 60), 255)).astype(np.uint8)
    assert identify_board([noise, np.zeros((360, 480), np.uint8), np.pad(tiles, 40, constant_values=255)]) is None
    assert merged([]) is None


def test_a_partly_hidden_board_is_completed_by_other_images():
    board = read_board_spec("charuco:6x7,square=60mm")
    whole = picture(board, 1000.0)
    top = whole.copy()
    top[260:] = 128
    part, full = identify_board([top]), identify_board([whole])
    assert part is not None
    assert full is not None
    assert (part.columns, full.rows) == (6, 7)
    assert part.rows < 7
    assert part.agrees_with(board)
    together = merged([part, full])
    assert together is not None
    assert (together.rows, together.n_images) == (7, 2)
    assert not IdentifiedBoard("charuco", 5, 7).agrees_with(board)
    assert not IdentifiedBoard("checkerboard", 6, 7).agrees_with(board)
