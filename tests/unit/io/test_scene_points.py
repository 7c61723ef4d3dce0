"""Files of points of known position."""

import numpy as np
import pytest

from posefuse.errors import CalibrationError, FileError
from posefuse.io.scene_points import read_scene_points

TOML = """
world_m = [[0, 0, 0], [1, 0, 0], [0, 1, 0.5]]
[image_px]
left = [[10, 20], [], [30.5, 40]]
"right 2" = [[1, 2], [3, 4], [5, 6]]
"""


def written(folder, text, name="points.toml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_toml(tmp_path):
    scene = read_scene_points(written(tmp_path, TOML))
    assert scene.points_m.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0.5]]
    assert list(scene.pixels) == ["left", "right 2"]
    assert scene.pixels["left"][2].tolist() == [30.5, 40.0]
    assert np.isnan(scene.pixels["left"][1]).all()
    assert scene.up_axis == "z"


def test_csv_is_the_same(tmp_path):
    rows = "camera,x_m,y_m,z_m,u_px,v_px\nleft,0,0,0,10,20\nleft,0,1,0.5,30.5,40\nb,1,0,0,3,4\n"
    scene = read_scene_points(written(tmp_path, rows, "points.csv"))
    assert scene.points_m.tolist() == [[0, 0, 0], [0, 1, 0.5], [1, 0, 0]]
    assert scene.pixels["left"][:2].tolist() == [[10, 20], [30.5, 40]]
    assert np.isnan(scene.pixels["b"][:2]).all()


def test_positions_of_pose2sim(tmp_path):
    written(tmp_path, "[calibration.calculate.extrinsics.scene]\nobject_coords_3d = [[0,0,0],[1,2,3]]\n", "Config.toml")
    scene = read_scene_points(written(tmp_path, 'world_m = "Config.toml"\n[image_px]\na = [[1, 2], [3, 4]]\n'))
    assert scene.points_m.tolist() == [[0, 0, 0], [1, 2, 3]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("world_m = [[0, 0, 0]]", "no scene points"),
        (TOML.replace(", [5, 6]]", "]"), "'right 2' has 2 places"),
        (TOML.replace("[1, 0, 0]", "[1, 0]"), "world_m must be a list with 3 numbers"),
        (TOML.replace("[1, 0, 0]", "[1, 0, nan]"), "finite"),
        (TOML.replace("world_m", "up = 'q'\nworld_m"), "not an axis"),
        ("world_m = 'Other.toml'\n[image_px]\na = []", "Other.toml"),
        ("world_m = []\n[image_px]\n", "no places in the images"),
    ],
)
def test_broken_files_are_named(text, message, tmp_path):
    path = written(tmp_path, text)
    with pytest.raises((FileError, CalibrationError), match=message):
        read_scene_points(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("camera,x_m\na,1\n", "no column y_m"),
        ("camera,x_m,y_m,z_m,u_px,v_px\n", "no rows"),
        ("camera,x_m,y_m,z_m,u_px,v_px\na,0,0,0,1,2\na,0,0,0,1,3\n", "twice"),
        ("camera,x_m,y_m,z_m,u_px,v_px\na,0,0,zero,1,2\n", "points.csv"),
    ],
)
def test_broken_tables_are_named(text, message, tmp_path):
    with pytest.raises((FileError, CalibrationError), match=message):
        read_scene_points(written(tmp_path, text, "points.csv"))
