"""Calibrate beside caliscope in one run, which has an environment of its own (``benchmarks/peers``).

    python -m benchmarks.calibration_peers FOLDER [--keypoints FOLDER] [--only board people]

FOLDER holds the recordings that the tests read. ``board``: CPU time of detection and solve on the videos of a board,
errors, and distances on the board. ``people``: relative rotations and centers of calibrations from the same keypoints.
"""

import argparse
import json
import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import posefuse
from benchmarks.calibration_recordings import CalibrationCase, recording
from benchmarks.calibration_scores import CalibrationScore, score_calibration
from benchmarks.people_calibration import KEYPOINTS, VIDEOS, calibrate, table_row
from benchmarks.speed import run_peer
from posefuse.io.board_images import find_images
from posefuse.io.board_specs import read_board_spec
from posefuse.model.cameras import Camera, LensModel
from posefuse.model.options.calibration import CalibrateOptions
from posefuse.pipeline.detect_board import detect_board

PEOPLE = ("balancing", VIDEOS, "webcams")
ROUNDS = 3


def board(folder: Path) -> dict[str, float]:
    """Return figures of both programs on ``caliscope_charuco``; the ratio is that of CPU times of neighboring runs."""
    place = folder / "caliscope_charuco"
    lenses = posefuse.read_cameras(place / "camera_array.toml")
    spec, options = place / "charuco.toml", CalibrateOptions(jobs=1)
    calibration = posefuse.calibrate(place, spec, intrinsics=lenses, options=options)  # Loads compiled functions.
    rounds = []
    for _ in range(ROUNDS):
        peer = run_peer("caliscope", place, "--mode", "board")
        with empty_cache():
            begun = time.process_time()
            calibration = posefuse.calibrate(place, spec, intrinsics=lenses, options=options)
            rounds.append((peer, time.process_time() - begun))
    with empty_cache():
        begun = time.process_time()
        detect_board(find_images(place), read_board_spec(spec), jobs=1)
        detection_s = time.process_time() - begun
    last = rounds[-1][0]
    theirs = [peer["detect_s"] + peer["full_s"] for peer, _ in rounds]
    return last | {
        "caliscope_s": statistics.median(theirs),
        "posefuse_s": statistics.median(ours for _, ours in rounds),
        "posefuse_detect_s": detection_s,
        "ratio": statistics.median(ours / peer for peer, (_, ours) in zip(theirs, rounds, strict=True)),
        "rmse_px": calibration.error_px,
        "corners": calibration.n_corners,
        "distance_error": calibration.distances.error,
        "distance_spread": calibration.distances.spread,
    }


@contextmanager
def empty_cache() -> Iterator[None]:
    """Use an empty cache, so that corners are detected again."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("POSEFUSE_CACHE", folder)
        yield


def caliscope_people(case: CalibrationCase) -> tuple[CalibrationScore, float]:
    """Return the score of caliscope on a recording of one person, and its CPU time."""
    pixels, _ = case.detections.dense()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        np.save(folder / "points.npy", np.moveaxis(pixels, 1, 0))
        (folder / "lenses.json").write_text(json.dumps([_lens(camera) for camera in case.rig.cameras]), "utf-8")
        spent = run_peer("caliscope", folder, "--mode", "people")["cpu_s"]
        poses = json.loads((folder / "caliscope.json").read_text("utf-8"))
    cameras = []
    for v, pose in poses.items():
        c = case.rig.cameras[int(v)]
        cameras.append(
            Camera.from_opencv(
                c.name, c.size_px, c.matrix, c.distortion, np.array(pose["rotation"]), pose["translation"]
            )
        )
    return score_calibration(cameras, case.rig), spent


def _lens(camera: Camera) -> dict:
    """Return a lens as caliscope has it: five coefficients."""
    if camera.lens not in (LensModel.PINHOLE, LensModel.BROWN):
        raise ValueError(f"caliscope's cameras have five coefficients; {camera.name!r} is {camera.lens}.")
    distortion = [*camera.distortion, *[0.0] * 5][:5]
    return {"size": list(camera.size_px), "matrix": camera.matrix.tolist(), "distortions": distortion}


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--keypoints", type=Path, default=os.environ.get(KEYPOINTS))
    parser.add_argument("--only", nargs="*", default=["board", "people"], choices=["board", "people"])
    given = parser.parse_args()
    if "board" in given.only:
        for name, value in board(given.folder).items():
            print(f"{name:24} {value:.5g}")
    if "people" not in given.only:
        return
    for name in PEOPLE:
        if name == VIDEOS and given.keypoints is None:
            continue
        case = recording(name, given.folder, given.keypoints)
        theirs, spent = caliscope_people(case)
        print(table_row(name, "caliscope", str(theirs.cameras), theirs, spent), flush=True)
        found = calibrate(case)
        ours = found.score(case)
        print(table_row(name, "posefuse", str(ours.cameras), ours, found.cpu_s), flush=True)


if __name__ == "__main__":
    main()
