"""Estimate the lens of each camera from images in which it alone sees a board."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.calibration.boards.intrinsics import LENSES, Intrinsics, estimate_intrinsics
from posefuse.calibration.boards.observations import corner_observations
from posefuse.errors import CalibrationError
from posefuse.io.board_specs import read_board_spec
from posefuse.io.calibration import anipose
from posefuse.io.files import replacing
from posefuse.io.open_recording import digest_path
from posefuse.model.board import Board
from posefuse.model.cameras import CameraRig, LensModel
from posefuse.pipeline.calibrate_board import as_detections
from posefuse.pipeline.detect_board import detect_board
from posefuse.pipeline.run.plan import RunPlan
from posefuse.progress import Progress


@dataclass(frozen=True, eq=False)
class Lenses:
    """The lenses that a run estimated from images of a board.

    Attributes:
        rig: the cameras; their poses mean nothing.
        n_images: number of images of each camera that show the board.
        left_out: cameras whose lens could not be estimated, with the reason.
    """

    rig: CameraRig
    n_images: tuple[int, ...]
    left_out: Mapping[str, str]


def board_of(plan: RunPlan) -> Board:
    """Return the board of a run."""
    assert plan.choices.board is not None
    text = plan.choices.board
    return read_board_spec(plan.path(text) if text.endswith(".toml") else text)


def board_digest(plan: RunPlan) -> str:
    """Return the description of the board, independent of the file that contains it."""
    return str(board_of(plan))


def lens_inputs(plan: RunPlan) -> dict[str, Any]:
    """Return what the lenses depend on, as JSON values."""
    return {
        "board": board_digest(plan),
        "images": [[view.name, *(digest_path(file) for file in view.files)] for view in plan.lens_views],
        "lens": plan.choices.by_board.lens,
    }


def calibrate_lenses(plan: RunPlan, output: Path, progress: Progress) -> Lenses:
    """Estimate the lenses, and write them as cameras without poses.

    Raises:
        CalibrationError: if no image shows the board, or no lens follows from the images.
    """
    board, options = board_of(plan), plan.choices.by_board
    found = detect_board(plan.lens_views, board, every=options.every, jobs=options.jobs, progress=progress)
    corners = corner_observations(as_detections(found, board), board)
    models = LENSES if options.lens is None else (LensModel(options.lens),)
    made: dict[str, Intrinsics] = {}
    left_out: dict[str, str] = {}
    for v, view in enumerate(found):
        try:
            made[view.name] = estimate_intrinsics(view.name, view.size_px, board, corners.of_view(v), models)
        except CalibrationError as error:
            left_out[view.name] = str(error)
    if not made:
        raise CalibrationError("\n".join(left_out.values()))
    cameras = tuple(replace(each.camera, camera_from_world=np.eye(4)) for each in made.values())
    rig = CameraRig(cameras, notes=("Lenses by a board; the poses of these cameras mean nothing.",))
    with replacing(output) as temporary:
        anipose.write(rig, temporary)
    return Lenses(rig, tuple(each.n_images for each in made.values()), left_out)
