"""DeepLabCut files: one file per camera."""

import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError

PARTS = ("nose", "ear_L", "ear_R", "tail")


def write_deeplabcut(file, values):
    """Write values of shape (frame, part, 3)."""
    rows = [
        ["scorer"] + ["net"] * 3 * len(PARTS),
        ["bodyparts"] + [part for part in PARTS for _ in range(3)],
        ["coords"] + ["x", "y", "likelihood"] * len(PARTS),
        *[[n, *["" if np.isnan(v) else repr(float(v)) for v in row.ravel()]] for n, row in enumerate(values)],
    ]
    file.write_text("\n".join(",".join(map(str, row)) for row in rows) + "\n")


@pytest.fixture
def values(rng):
    values = rng.uniform(1, 500, (7, 4, 3))
    values[..., 2] = rng.uniform(0.1, 1.0, (7, 4))
    values[2, 1] = np.nan
    return values


def test_deeplabcut_survives_a_round_trip(tmp_path, values):
    for name, shift in (("A", 0.0), ("B", 5.0), ("C", 9.0)):
        write_deeplabcut(tmp_path / f"trial_1_Cam-{name}_resnet.csv", values + np.array([shift, 0.0, 0.0]))
    detections = posefuse.read_detections(tmp_path)
    assert detections.view_names == ("Cam-A", "Cam-B", "Cam-C")
    assert detections.skeleton.keypoints == PARTS
    assert detections.skeleton.pairs == (("ear_L", "ear_R"),)
    assert detections.n_frames == 7
    pixels = np.asarray(detections.keypoints_px).reshape(7, 3, 4, 2)
    np.testing.assert_array_equal(pixels[:, 1], values[..., :2] + np.array([5.0, 0.0]))
    np.testing.assert_array_equal(np.asarray(detections.confidence).reshape(7, 3, 4)[:, 2], values[..., 2])


def test_truncated_deeplabcut_file_is_reported_with_its_line(tmp_path, values):
    file = tmp_path / "cam.csv"
    write_deeplabcut(file, values)
    text = file.read_text()
    file.write_text(text[: len(text) - 40])
    with pytest.raises(FileError, match=r"line 10: .*truncated"):
        posefuse.read_detections(file)


def test_file_of_one_camera_without_frames_is_an_error(tmp_path, values):
    for name in ("A", "B"):
        write_deeplabcut(tmp_path / f"trial_{name}_net.csv", values)
    for kept in ("", "scorer,net,net\nbodyparts,nose,nose\n"):
        (tmp_path / "trial_B_net.csv").write_text(kept)
        with pytest.raises(FileError, match=r"trial_B_net.csv contains no frames"):
            posefuse.read_detections(tmp_path)
