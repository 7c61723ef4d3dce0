"""Boards: corners, sizes, and impossible values."""

import numpy as np
import pytest

from posefuse.errors import CalibrationError
from posefuse.model.board import ARUCO_DICTIONARIES, BOARD_KINDS, Board, marker_count


@pytest.mark.parametrize(
    ("kind", "corners", "markers", "size_m"),
    [
        ("charuco", 12, 10, (0.2, 0.25)),
        ("checkerboard", 20, 0, (0.25, 0.3)),
        ("aruco", 80, 20, (0.23, 0.29)),
        ("apriltag", 80, 20, (0.23, 0.29)),
    ],
)
def test_corners_markers_and_size(kind, corners, markers, size_m):
    board = Board(kind, 4, 5, 0.05)
    assert len(board.points_m) == corners == len(board.skeleton)
    assert board.n_markers == markers
    assert board.size_m == pytest.approx(size_m)
    extent = np.ptp(board.points_m[:, :2], axis=0)
    assert np.all(extent <= np.array(board.size_m) + 1e-12)
    assert not board.points_m[:, 2].any()


def test_corners_run_along_the_rows():
    points = Board("charuco", 4, 5, 0.05).points_m
    assert points[0, :2] == pytest.approx([0.05, 0.05])
    assert points[1, :2] == pytest.approx([0.10, 0.05])
    assert points[3, :2] == pytest.approx([0.05, 0.10])
    assert Board("checkerboard", 4, 5, 0.05).points_m[0, :2] == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (("chess", 4, 5, 0.05), "no kind 'chess'"),
        (("charuco", 1, 5, 0.05), "has 2 to 100 columns and rows"),
        (("checkerboard", 99_999, 99_999, 0.05), "has 2 to 100 columns and rows"),
        (("charuco", 4, 5, 54.0), "square of a board must be above 0 and below 10 m, got 54 m."),
        (("charuco", 4, 5, float("nan")), "square of a board"),
        (("charuco", 4, 5, 0.05, 1.5), "marker of a board"),
        (("aruco", 4, 5, 0.05, 0.75, 0.2, "4X4_5"), "No dictionary of markers '4X4_5'"),
        (("aruco", 8, 8, 0.05, 0.75, 0.2, "4X4_50"), "64 markers, but the dictionary 4X4_50 has 50"),
    ],
)
def test_impossible_boards_are_refused(values, message):
    with pytest.raises(CalibrationError, match=message):
        Board(*values)


def test_dictionaries_have_their_opencv_sizes():
    cv2 = pytest.importorskip("cv2")
    for name in (*ARUCO_DICTIONARIES, "APRILTAG_16h5", "APRILTAG_25h9", "APRILTAG_36h10", "APRILTAG_36h11"):
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
        assert marker_count(name) == len(dictionary.bytesList)


def test_every_kind_is_tested():
    assert set(BOARD_KINDS) == {"charuco", "checkerboard", "aruco", "apriltag"}
