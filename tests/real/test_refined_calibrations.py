"""Refinement of wrong real calibrations by a board and by a moving subject, and its limits."""

import h5py
import numpy as np
import pytest

import posefuse
from posefuse.calibration.selection import held_out_frames
from posefuse.errors import CalibrationError
from posefuse.io.boards import find_board, read_board
from posefuse.model.options.options import Options
from posefuse.model.options.refinement import RefineOptions
from posefuse.pipeline.refine_calibration import refine_calibration
from posefuse.skeleton.skeletons import Skeleton

ONE = Options(people="one")


def test_copied_camera_is_located_by_board_corners(shared_data):
    """The camera's lens was copied as well: a focal length of 965 px that is 751."""
    folder = shared_data("sleap_mouse")
    rig = posefuse.read_cameras(folder / "calibration.toml")
    board = read_board(find_board(folder), rig.names)
    result = refine_calibration(rig, board, ONE, RefineOptions(relocate=("side",), rigid=True))
    assert result["side"].role == "located"
    assert result["side"].before_px > 50
    assert result["side"].after_px < 1.0
    good = posefuse.read_cameras(folder / "calibration_0b26179_good.toml")
    assert np.linalg.norm(result.rig["side"].center_m - good["side"].center_m) < 0.003
    assert result.rig["side"].matrix[0, 0] == pytest.approx(good["side"].matrix[0, 0], rel=0.01)
    kept_back, _ = board.dense()
    points = posefuse.triangulate(good, board, ONE).layers["measured"].points_m[held_out_frames(board.n_frames), 0]
    error = np.linalg.norm(
        result.rig["side"].project(points)[0] - kept_back[held_out_frames(board.n_frames), 2], axis=-1
    )
    assert np.nanmedian(error) < 1.0


@pytest.mark.long
def test_mouse_alone_does_not_determine_a_camera_or_lenses(shared_data):
    folder = shared_data("sleap_mouse")
    views, nodes = [], []
    rig = posefuse.read_cameras(folder / "calibration.toml")
    for name in rig.names:
        with h5py.File(next((folder / name).glob("*.analysis.h5"))) as file:
            views.append(np.asarray(file["tracks"])[0].transpose(2, 1, 0))
            nodes = [node.decode() for node in file["node_names"][:]]
    mouse = posefuse.Detections.from_dense(Skeleton("mouse", tuple(nodes)), rig.names, np.stack(views, axis=1))
    with pytest.raises(CalibrationError, match="do not determine focal length .* images of back, mid, top they cover"):
        refine_calibration(rig, mouse, ONE, RefineOptions("focal", relocate=("side",)))
    held = RefineOptions(fix=("back", "mid", "top"), relocate=("side",))
    with pytest.raises(
        CalibrationError, match=r"would be, for 'side': rotation [2-4](\.\d)? degrees, position"
    ) as caught:
        refine_calibration(rig, mouse, ONE, held)
    assert "focal" not in str(caught.value)


@pytest.mark.long
def test_twelve_cameras_are_refined_from_an_initial_calibration(shared_data):
    folder = shared_data("mouse_outdoor_12cam")
    rig = posefuse.read_cameras(folder / "calibration_right_4_10_2026_adjusted.toml")
    pixels = np.load(folder / "points_right_4_10_2026_sub.npz")["p2d"].transpose(1, 0, 2)[:, :, None]
    points = posefuse.Detections.from_dense(Skeleton("point", ("point",)), rig.names, pixels)
    result = refine_calibration(rig, points, ONE)
    assert result.left_out == ("18",)
    assert result.after_px <= 0.75
