"""Compare the differences of calibrations from reference poses with what either of them is known to.

    python -m benchmarks.calibration_bounds FOLDER

FOLDER holds the recordings that the tests read. ``board``: relative poses of ``caliscope_charuco`` against those of its
file, those of both halves of the recording against each other, and those under the assumption that frames of one index
were taken at the same time, which caliscope makes. ``points``: poses of ``pose2sim_videos`` from eight points against
Qualisys', their standard deviations, and how well Qualisys' poses explain the same points in the best position.
"""

import argparse
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from tests.real.test_scene_points import IMAGE_PX, WORLD_M

import posefuse
from posefuse.calibration.boards.calibration import BoardCalibration
from posefuse.model.cameras import CameraRig, rotation_from_vector, vector_from_rotation
from posefuse.model.options.calibration import CalibrateOptions
from posefuse.model.scene_points import ScenePoints
from posefuse.pipeline.calibrate_board import BoardCorners, calibrate_corners, read_corners
from posefuse.progress import Silent

SYNCHRONIZED = CalibrateOptions(time_offsets=False)


def board(folder: Path) -> None:
    """Print differences of relative poses of all pairs of cameras: of rotations, and of positions."""
    place = folder / "caliscope_charuco"
    file = posefuse.read_cameras(place / "camera_array.toml")
    options = CalibrateOptions()
    corners = read_corners(place, place / "charuco.toml", file, None, options, Silent())
    names = corners.detections.view_names
    whole, together = (calibrate_corners(corners, names, each) for each in (options, SYNCHRONIZED))
    halves = [_half(corners, k) for k in range(2)]
    by_half, together_by_half = ([calibrate_corners(h, names, o) for h in halves] for o in (options, SYNCHRONIZED))
    for label, a, b in (
        ("estimate and file", whole.rig, file),
        ("estimate, both halves", by_half[0].rig, by_half[1].rig),
        ("synchronized and file", together.rig, file),
        ("synchronized, both halves", together_by_half[0].rig, together_by_half[1].rig),
    ):
        turns, shares = differences(a, b)
        print(f"{label:28} rotation {_range(turns)} degrees, baseline {_range(100 * shares)} %")
    for label, each in (("estimate", whole), ("synchronized", together)):
        print(f"{label:28} held-out {each.held_out.rms_px:.2f} px, offsets {_offsets_ms(each)} ms")
    print(f"{'sds of the estimate':28} {_sds(whole)}")
    turn, moved = stated_ratio(*by_half)
    print(f"{'halves, in stated sds':28} rotation {turn:.2f}, center {moved:.2f}")


def _half(corners: BoardCorners, k: int) -> BoardCorners:
    """Return the corners in the first or the second half of the frames that show the board."""
    detections = corners.detections
    pixels = detections.dense()[0]
    shown = np.flatnonzero(np.isfinite(pixels.reshape(len(pixels), -1)).any(axis=1))
    middle = int(shown[len(shown) // 2])
    return replace(corners, detections=detections.frames(*((0, middle), (middle, detections.n_frames))[k]))


def differences(a: CameraRig, b: CameraRig) -> tuple[np.ndarray, np.ndarray]:
    """Return how relative poses of all pairs of cameras differ between two calibrations.

    Returns:
        Angles between the rotations in degrees, and distances between the positions of the second camera in the
        coordinates of the first one as shares of the baseline.
    """
    turns, shares = [], []
    for u, v in combinations(a.names, 2):
        relative = [rig[v].rotation @ rig[u].rotation.T for rig in (a, b)]
        place = [rig[u].rotation @ (rig[v].center_m - rig[u].center_m) for rig in (a, b)]
        turns.append(np.degrees(np.linalg.norm(vector_from_rotation(relative[0] @ relative[1].T))))
        shares.append(np.linalg.norm(place[0] - place[1]) / np.linalg.norm(place[1]))
    return np.array(turns), np.array(shares)


def stated_ratio(a: BoardCalibration, b: BoardCalibration) -> tuple[float, float]:
    """Return differences of rotations and centers relative to the first camera, in units of their standard deviation.

    Both are root mean squares over the directions and cameras: 1 if the standard deviations are right.
    """
    squares = []
    for v in range(1, len(a.cameras)):
        one, other = (each.solution.model.rig.cameras[v] for each in (a, b))
        turn = vector_from_rotation(one.rotation @ other.rotation.T)
        covariance = a.covariance[v] + b.covariance[v]
        moved = one.center_m - other.center_m
        squares.append([_square(turn, covariance[:3, :3]), _square(moved, covariance[3:6, 3:6])])
    turned, shifted = np.sqrt(np.mean(squares, axis=0))
    return float(turned), float(shifted)


def _square(difference: np.ndarray, covariance: np.ndarray) -> float:
    return float(difference @ np.linalg.solve(covariance, difference)) / len(difference)


def _range(values: np.ndarray) -> str:
    return f"{values.min():.2f} to {values.max():.2f} (median {np.median(values):.2f})"


def _offsets_ms(result: BoardCalibration) -> str:
    return " ".join(f"{1000 * each.offset_s:.0f}" for each in result.cameras)


def _sds(result: BoardCalibration) -> str:
    return " ".join(f"{each.rotation_sd_deg:.2f} deg {1000 * each.center_sd_m:.1f} mm," for each in result.cameras[1:])


def points(folder: Path) -> None:
    """Print differences from Qualisys' poses, expected errors, and how well these poses explain the points."""
    truth = posefuse.read_cameras(folder / "pose2sim_videos" / "calibration" / "Calib.qca.txt")
    pixels = {name: np.array(places) for name, places in IMAGE_PX.items()}
    scene = ScenePoints(np.array(WORLD_M, dtype=float), pixels, "z")
    result = posefuse.calibrate_scene(scene, intrinsics=truth)
    truth = truth.select(result.rig.names)
    print(f"places are known to {result.sd_px:.1f} px (sd), error {result.error_px:.2f} px")
    for v, (found, reference) in enumerate(zip(result.rig.cameras, truth.cameras, strict=True)):
        turn = np.degrees(np.linalg.norm(vector_from_rotation(found.rotation @ reference.rotation.T)))
        moved = 1000 * np.linalg.norm(found.center_m - reference.center_m)
        variance = np.diag(result.joint_covariance[v, :, v])
        expected = np.degrees(np.sqrt(variance[:3].sum())), 1000 * np.sqrt(variance[3:6].sum())
        print(f"{found.name}: {turn:.2f} degrees, {moved:.0f} mm; expected {expected[0]:.2f}, {expected[1]:.0f}")
    for label, rig in (("Qualisys' poses", truth), ("estimate", result.rig)):
        stated, best = explained(rig, scene)
        print(f"{label}: {stated:.1f} px with the points where they are stated, {best:.1f} px in the best position")


def explained(rig: CameraRig, scene: ScenePoints) -> tuple[float, float]:
    """Return the root mean square error of the points in px where they are stated, and after the best rigid motion."""
    measured = np.stack([scene.pixels[name] for name in rig.names], axis=1)
    seen = np.isfinite(measured)

    def residuals(motion: np.ndarray) -> np.ndarray:
        moved = scene.points_m @ rotation_from_vector(motion[:3]).T + motion[3:]
        return (rig.project(moved) - measured)[seen]

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(2.0 * np.mean(values**2)))

    return rms(residuals(np.zeros(6))), rms(least_squares(residuals, np.zeros(6)).fun)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    board(given.folder)
    points(given.folder)


if __name__ == "__main__":
    main()
