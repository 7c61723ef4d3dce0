"""Descriptions of boards in text and files."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.errors import CalibrationError, FileError
from posefuse.io.board_specs import read_board_spec
from posefuse.model.board import Board


def test_the_documented_example():
    board = read_board_spec("charuco:4x5,square=54mm,marker=0.75,dict=4X4_1000,inverted")
    assert board == Board("charuco", 4, 5, 0.054, 0.75, dictionary="4X4_1000", inverted=True)


@given(
    kind=st.sampled_from(["charuco", "checkerboard", "aruco", "apriltag"]),
    columns=st.integers(2, 7),
    rows=st.integers(2, 7),
    square_mm=st.integers(5, 300),
    inverted=st.booleans(),
)
def test_text_round_trip(kind, columns, rows, square_mm, inverted):
    dictionary = "" if kind in ("checkerboard", "apriltag") else "5X5_100"
    board = Board(kind, columns, rows, square_mm * 1e-3, dictionary=dictionary, inverted=inverted)
    assert read_board_spec(str(board)) == board


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[board]\nkind = 'checkerboard'\ncolumns = 4\nrows = 7\nsquare_m = 0.06\n", Board("checkerboard", 4, 7, 0.06)),
        (
            "columns = 4\nrows = 5\nboard_height = 11.0\nboard_width = 8.5\ndictionary = 'DICT_4X4_1000'\n"
            "units = 'inch'\naruco_scale = 0.75\nsquare_size_override_cm = 5.4\ninverted = true\n",
            Board("charuco", 4, 5, 5.4 / 100, dictionary="4X4_1000", inverted=True),
        ),
        (
            "[calibration]\nboard_type = 'charuco'\nboard_size = [7, 10]\nboard_marker_bits = 4\n"
            "board_marker_dict_number = 50\nboard_marker_length = 18.75\nboard_square_side_length = 25\n",
            Board("charuco", 7, 10, 0.025, 0.75, dictionary="4X4_50", legacy=True),
        ),
        (
            "[calibration.calculate.intrinsics]\nintrinsics_corners_nb = [4, 7]\nintrinsics_square_size = 60\n",
            Board("checkerboard", 7, 4, 0.06),
        ),
        (
            "[charuco]\ncolumns = 4\nrows = 5\nboard_height = 11.0\nboard_width = 8.5\n"
            "dictionary = 'DICT_4X4_50'\nunits = 'inch'\naruco_scale = 0.75\nsquare_size_overide_cm = 5.4\n",
            Board("charuco", 4, 5, 0.054, dictionary="4X4_50"),
        ),
        (
            "[metadata.board]\nsquares_x = 7\nsquares_y = 5\nsquare_length_mm = 58.0\nmarker_length_mm = 46.4\n"
            "aruco_dictionary_enum = 2\n",
            Board("charuco", 7, 5, 0.058, 0.8, dictionary="4X4_250"),
        ),
        (
            "board_x = 8\nboard_y = 11\nsquare_length = 24.0\nmarker_length = 18.75\n"
            "marker_bits = 4\ndict_size = 1000\n",
            Board("charuco", 8, 11, 0.024, 18.75 / 24.0, dictionary="4X4_1000", legacy=True),
        ),
    ],
)
def test_files_of_other_programs(text, expected, tmp_path):
    path = tmp_path / "board.toml"
    path.write_text(text)
    found = read_board_spec(path)
    assert found.points_m == pytest.approx(expected.points_m)
    assert (str(found), found.legacy) == (str(expected), expected.legacy)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("charuko:4x5,square=5mm", "describes no board"),
        ("charuco:45,square=5mm", "needs a size such as 7x5"),
        ("charuco:4x5", "needs the side of a square"),
        ("charuco", "needs its columns and rows"),
        ("charuco:4x5,square=-54mm", "a positive length with its unit"),
        ("charuco:4x5,square=54", "length with its unit"),
        ("charuco:4x5,square=1.2.3mm", "length with its unit"),
        ("charuco:4x5,square=5mm,marker=big", "a share such as 0.75"),
        ("charuco:4x5,square=5mm,colour=red", "no property 'colour'"),
    ],
)
def test_wrong_descriptions_are_explained(text, message):
    with pytest.raises(CalibrationError, match=message):
        read_board_spec(text)


def test_folder_is_no_description(tmp_path):
    with pytest.raises(FileError, match="is a folder. Describe the board as"):
        read_board_spec(tmp_path)


def test_file_without_a_board(tmp_path):
    path = tmp_path / "settings.toml"
    path.write_text("name = 'x'\n")
    with pytest.raises(FileError, match="describes no board"):
        read_board_spec(path)
