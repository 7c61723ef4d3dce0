"""Corners are found where they were drawn."""

import numpy as np
import pytest

from posefuse.detection.boards.detector import BoardDetector
from posefuse.io.board_specs import read_board_spec
from tests.boards import picture

BOARDS = (
    "charuco:7x5,square=30mm",
    "charuco:4x6,square=40mm,legacy",
    "charuco:4x5,square=54mm,dict=4X4_1000,inverted",
    "checkerboard:4x7,square=60mm",
    "aruco:4x3,square=40mm,dict=5X5_100",
    "apriltag:3x2,square=50mm",
)
MARGIN_PX, PX_PER_M = 60, 4000.0


@pytest.mark.parametrize("spec", BOARDS)
def test_corners_are_where_they_were_drawn(spec):
    board = read_board_spec(spec)
    found = BoardDetector(board, thorough=True).corners_px(picture(board))
    edge = board.square_m if board.kind == "checkerboard" else 0.0
    expected = (board.points_m[:, :2] + edge) * PX_PER_M + MARGIN_PX - 0.5
    assert np.isfinite(found).all()
    assert np.abs(found - expected).max() < 0.3


@pytest.mark.parametrize("spec", BOARDS)
def test_an_empty_image_has_no_corners(spec):
    board = read_board_spec(spec)
    assert np.isnan(BoardDetector(board).corners_px(np.full((300, 400), 127, dtype=np.uint8))).all()


def test_hidden_corners_are_missing():
    board = read_board_spec(BOARDS[0])
    image = picture(board)
    image[:, : image.shape[1] // 3] = 127
    found = np.isfinite(BoardDetector(board).corners_px(image)).all(axis=1)
    assert 0.4 < found.mean() < 0.9


def test_only_the_markers_of_the_board_are_searched(monkeypatch):
    """OpenCV compares every square shape with every marker of the dictionary, of which a board has few."""
    from posefuse.detection.boards import detector

    counts = []
    whole = detector.dictionary_of
    monkeypatch.setattr(detector, "dictionary_of", lambda name, n=None: (counts.append(n), whole(name, n))[1])
    for spec in BOARDS:
        board = read_board_spec(spec)
        if board.kind != "checkerboard":
            BoardDetector(board).corners_px(picture(board))
            assert counts.pop() == board.n_markers
    assert len(whole("4X4_1000", 10).bytesList) == 10
    assert (whole("4X4_1000", 10).bytesList == whole("4X4_1000").bytesList[:10]).all()


def test_detectors_can_be_sent_to_other_processes():
    import pickle

    detector = BoardDetector(read_board_spec(BOARDS[0]), thorough=True)
    detector.corners_px(np.zeros((100, 100), dtype=np.uint8))
    assert pickle.loads(pickle.dumps(detector)) == detector
