"""Measure how often the 95 % regions of calibrations by a board contain the truth.

Each trial simulates a rig of 2 to 8 cameras in a ring or a corner that films a board, and calibrates it, with lenses
known or not. Corners have white noise; with imperfections, their errors in one image are correlated, the board is bent
by up to 0.5 mm, or its squares are stretched by 0.1 %. Regions are those of each camera relative to the first one:
ellipsoids for rotation and center, intervals for focal length and time offset.

    OPENBLAS_NUM_THREADS=1 python -m benchmarks.board_coverage --trials 40 --log board_coverage.jsonl
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from benchmarks.people_coverage import coverage, level
from posefuse.calibration.boards.calibration import BoardCalibration, calibrate_board
from posefuse.errors import PosefuseError
from posefuse.model.board import Board
from posefuse.model.cameras import Camera, CameraRig, LensModel, rotation_from_vector, vector_from_rotation
from posefuse.model.detections import Detections
from posefuse.synthetic.rigs import look_at

Layout = Literal["ring", "corner"]
Imperfection = Literal["white", "blur", "bent", "stretched", "all"]
SIZE_PX: tuple[int, int] = (1280, 720)
PARAMETERS = {"rotation": slice(0, 3), "center": slice(3, 6), "focal": slice(6, 7), "offset": slice(18, 19)}
BOARDS = {"charuco": Board("charuco", 6, 5, 0.1), "checkerboard": Board("checkerboard", 6, 4, 0.1)}
"""Boards that the cameras, 3 m away, see as large as a sheet of A4 from 1 m."""
RATE_HZ = 10.0
BLUR_PX = 0.15
BLUR_CORRELATION = 0.8
BENT_M = 5e-4
STRETCHED = 1e-3
MAX_TILT = 0.35
_MIN_CORNERS = 6


@dataclass(frozen=True)
class BoardOptions:
    """Options of a simulated calibration.

    Attributes:
        layout: arrangement of the cameras.
        cameras: number of cameras.
        board: kind of the board.
        n_frames: number of frames.
        lenses_known: whether lenses are given.
        max_offset_s: largest time offset of a camera.
        noise_px: standard deviation of the white noise of a coordinate.
        imperfection: further errors.
        seed: random seed.
    """

    layout: Layout
    cameras: int
    board: str
    n_frames: int
    lenses_known: bool
    max_offset_s: float
    noise_px: float
    imperfection: Imperfection
    seed: int


def random_options(seed: int, imperfection: Imperfection) -> BoardOptions:
    """Return the options of a trial: every property is sampled independently."""
    rng = np.random.default_rng([seed, 41])
    return BoardOptions(
        layout=get_args(Layout)[int(rng.integers(2))],
        cameras=int(rng.integers(2, 9)),
        board=("charuco", "checkerboard")[int(rng.integers(2))],
        n_frames=round(float(np.exp(rng.uniform(np.log(15), np.log(200))))),
        lenses_known=bool(rng.integers(2)),
        max_offset_s=float(rng.choice([0.0, 0.04])),
        noise_px=float(rng.uniform(0.1, 0.4)),
        imperfection=imperfection,
        seed=seed,
    )


@dataclass(frozen=True, eq=False)
class BoardCase:
    """A simulated calibration.

    Attributes:
        rig: true cameras.
        board: the board as it was meant to be.
        detections: its corners.
        offset_s: shape (view,): true time offsets.
    """

    rig: CameraRig
    board: Board
    detections: Detections
    offset_s: np.ndarray


def simulate_board(options: BoardOptions) -> BoardCase:
    """Simulate the corners of a board that is carried about between the cameras."""
    rng = np.random.default_rng([options.seed, 42])
    board = BOARDS[options.board]
    rig = _rig(options, rng)
    offset_s = rng.uniform(-1.0, 1.0, len(rig)) * options.max_offset_s
    offset_s -= offset_s[0]
    poses = _carried(options, rng)
    errors = _Errors.of(options, rng)
    shape_m = errors.shape_of(board)
    times = np.arange(options.n_frames) / RATE_HZ
    pixels = np.full((options.n_frames, len(rig), len(shape_m), 2), np.nan)
    for v, camera in enumerate(rig.cameras):
        rotations, origins = poses(times + offset_s[v])
        places = shape_m @ rotations.transpose(0, 2, 1) + origins[:, None]
        exact = camera.project(places)[0]
        seen = exact + rng.normal(0.0, options.noise_px, exact.shape) + errors.blur(board, options.n_frames)
        inside = ((exact > 0) & (exact < np.array(camera.size_px) - 1)).all(axis=-1) & (
            rng.random(exact.shape[:2]) > 0.05
        )
        facing = np.einsum("tij,tj->ti", rotations, np.broadcast_to([0.0, 0.0, 1.0], (len(times), 3)))
        sight = places.mean(axis=1) - camera.center_m
        tilt = np.einsum("ti,ti->t", facing, sight) / np.linalg.norm(sight, axis=1)
        inside &= (tilt > MAX_TILT)[:, None]
        if options.board == "checkerboard":
            inside &= inside.sum(axis=1, keepdims=True) >= 0.9 * len(shape_m)
        inside &= inside.sum(axis=1, keepdims=True) >= _MIN_CORNERS
        pixels[:, v] = np.where(inside[..., None], seen, np.nan)
    detections = Detections.from_dense(board.skeleton, rig.names, pixels, rate_hz=RATE_HZ)
    return BoardCase(rig, board, detections, offset_s)


def _rig(options: BoardOptions, rng: np.random.Generator) -> CameraRig:
    """Return cameras with random lenses at random places of the layout."""
    n = options.cameras
    wide = 2.0 * np.pi * (n - 1) / n if options.layout == "ring" else 0.5 * np.pi
    cameras = []
    for v in range(n):
        angle = wide * (v / max(n - 1, 1) - 0.5) + rng.uniform(-0.1, 0.1)
        radius = rng.uniform(2.5, 3.5)
        place = np.array([radius * np.sin(angle), -radius * np.cos(angle), rng.uniform(-0.3, 0.8)])
        focal, share = rng.uniform(700.0, 1100.0), rng.uniform(0.2, 1.0)
        center = np.array(SIZE_PX) / 2.0 + rng.normal(0.0, 8.0, 2)
        matrix = np.array([[focal, 0.0, center[0]], [0.0, focal * (1.0 + rng.normal(0, 1e-3)), center[1]], [0, 0, 1.0]])
        distortion = tuple(share * np.array([-0.2, 0.05, 1e-3, -5e-4, 0.01]))
        pose = look_at(place, rng.normal(0.0, 0.1, 3))
        cameras.append(Camera(f"cam_{v}", SIZE_PX, matrix, pose, LensModel.BROWN, distortion))
    return CameraRig(tuple(cameras))


def _carried(options: BoardOptions, rng: np.random.Generator) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return the pose of the board at any time: it faces all directions of the cameras in turn."""
    frequency, phase = rng.uniform(0.6, 1.6, 6), rng.uniform(0.0, 2.0 * np.pi, 6)
    facing = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    middle = BOARDS[options.board].points_m.mean(axis=0)
    duration_s = options.n_frames / RATE_HZ

    def poses(time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        swing = np.sin(frequency * time_s[:, None] + phase)
        yaw = 2.0 * np.pi * time_s / max(duration_s, 4.0) if options.layout == "ring" else 0.9 * swing[:, 2]
        turns = np.stack([0.5 * swing[:, 0], 0.6 * swing[:, 1], np.zeros(len(yaw))], axis=1)
        upright = np.stack([np.zeros(len(yaw)), np.zeros(len(yaw)), yaw], axis=1)
        rotations = np.array(
            [rotation_from_vector(u) @ rotation_from_vector(t) @ facing for u, t in zip(upright, turns, strict=True)]
        )
        centers = swing[:, 3:] * np.array([0.7, 0.7, 0.5])
        return rotations, centers - rotations @ middle

    return poses


@dataclass(frozen=True, eq=False)
class _Errors:
    """Errors of real boards and images."""

    bend_m: np.ndarray
    stretch: np.ndarray
    blur_px: float
    rng: np.random.Generator

    @classmethod
    def of(cls, options: BoardOptions, rng: np.random.Generator) -> "_Errors":
        """Return the errors of a trial."""
        kind = options.imperfection
        bend_m, stretch = rng.uniform(-1.0, 1.0, 3) * BENT_M, rng.uniform(-1.0, 1.0, 2) * STRETCHED
        is_bent, is_stretched = kind in ("bent", "all"), kind in ("stretched", "all")
        blur_px = BLUR_PX if kind in ("blur", "all") else 0.0
        return cls(bend_m * is_bent, stretch * is_stretched, blur_px, rng)

    def shape_of(self, board: Board) -> np.ndarray:
        """Return the corners of the printed board, shape (corner, 3)."""
        out = board.points_m.copy()
        x, y = _unit(board).T
        out[:, 2] += self.bend_m @ np.array([x**2, y**2, x * y])
        out[:, :2] *= 1.0 + self.stretch - self.stretch.mean()
        return out

    def blur(self, board: Board, n_frames: int) -> np.ndarray:
        """Return errors that the corners of an image share, shape (frame, corner, 2): affine, slowly varying."""
        terms = np.concatenate([np.ones((len(board.points_m), 1)), _unit(board)], axis=1)
        state, out = self.rng.normal(0.0, 1.0, (3, 2)), []
        for _ in range(n_frames):
            out.append(terms @ state)
            fresh = self.rng.normal(0.0, np.sqrt(1.0 - BLUR_CORRELATION**2), (3, 2))
            state = BLUR_CORRELATION * state + fresh
        return self.blur_px * np.array(out)


def _unit(board: Board) -> np.ndarray:
    """Return the corners relative to the middle of the board, -1 to 1, shape (corner, 2)."""
    away = board.points_m[:, :2] - board.points_m[:, :2].mean(axis=0)
    return away / np.abs(away).max(axis=0)


def run(options: BoardOptions) -> dict:
    """Simulate and calibrate; return levels of the regions on whose edges the truth lies, and standard deviations."""
    case = simulate_board(options)
    given = (
        {c.name: replace(c, camera_from_world=np.eye(4)) for c in case.rig.cameras} if options.lenses_known else None
    )
    start = time.process_time()
    sizes: dict[str, tuple[int, int]] = dict.fromkeys(case.rig.names, SIZE_PX)
    found = calibrate_board(case.detections, case.board, sizes, intrinsics=given)
    cpu_s = time.process_time() - start
    return scores(case, found) | {"cpu_s": cpu_s, "lens": [str(c.lens) for c in found.rig.cameras]}


def scores(case: BoardCase, found: BoardCalibration) -> dict:
    """Return the levels of the true parameters, and errors in units of the standard deviations, by parameter."""
    error = errors(case, found)
    covariance = found.joint_covariance
    levels: dict[str, list[float]] = {}
    ratios: dict[str, list[float]] = {}
    sds: dict[str, float] = {}
    for name, part in PARAMETERS.items():
        blocks = [(v, covariance[v, part, v, part]) for v in range(len(error)) if covariance[v, part, v, part].any()]
        if not blocks:
            continue
        levels[name] = [level(error[v, part], block) for v, block in blocks]
        ratios[name] = [
            float(error[v, part] @ np.linalg.pinv(block) @ error[v, part] / len(block)) for v, block in blocks
        ]
        sds[name] = float(np.median([np.sqrt(np.max(np.linalg.eigvalsh(block))) for _, block in blocks]))
    return {"levels": levels, "nees": ratios, "sds": sds}


def errors(case: BoardCase, found: BoardCalibration) -> np.ndarray:
    """Return true minus estimated parameters in the world of the first camera, shape (view, 19)."""
    world = found.solution.model.rig
    to_world = np.linalg.inv(case.rig.cameras[0].camera_from_world) @ world.cameras[0].camera_from_world
    out = np.zeros((len(world), 19))
    for v, (camera, true) in enumerate(zip(world.cameras, case.rig.cameras, strict=True)):
        moved = replace(true, camera_from_world=true.camera_from_world @ to_world)
        out[v, :3] = vector_from_rotation(moved.rotation @ camera.rotation.T)
        out[v, 3:6] = moved.center_m - camera.center_m
        out[v, 6:8] = np.diag(true.matrix)[:2] - np.diag(camera.matrix)[:2]
        out[v, 18] = case.offset_s[v] - found.cameras[v].offset_s
    return out


def groups_of(options: dict) -> set[str]:
    """Return the groups of the summary that a trial is in."""
    n, frames = options["cameras"], options["n_frames"]
    return {
        options["imperfection"],
        options["layout"],
        options["board"],
        "2" if n == 2 else "3-5" if n <= 5 else "6-8",
        "lenses known" if options["lenses_known"] else "lenses estimated",
        "to 40 frames" if frames <= 40 else "41 to 200 frames",
        "synchronized" if options["max_offset_s"] == 0.0 else "offsets",
    }


def summary(log: list[dict]) -> None:
    """Print coverage, and mean squared errors in units of the variance, of all trials and of each group."""
    print("| trials | n | failed | " + " | ".join(f"{name} % (NEES)" for name in PARAMETERS) + " | CPU s |")
    print("|---" * (4 + len(PARAMETERS)) + "|")
    names = sorted(set().union(*(groups_of(row["options"]) for row in log)))
    for group in ("total", *names):
        rows = [row for row in log if group == "total" or group in groups_of(row["options"])]
        good = [row for row in rows if "error" not in row]
        cells = []
        for name in PARAMETERS:
            known = [row["levels"][name] for row in good if name in row["levels"]]
            nees = np.concatenate([row["nees"][name] for row in good if name in row["nees"]] or [[np.nan]])
            cells.append(f"{100 * coverage(known):.1f} ({np.mean(nees):.1f})")
        cpu = np.median([row["cpu_s"] for row in good] or [np.nan])
        print(f"| {group} | {len(rows)} | {len(rows) - len(good)} | {' | '.join(cells)} | {cpu:.1f} |")


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=40, help="of each imperfection")
    parser.add_argument("--first", type=int, default=0, help="seed of the first trial")
    parser.add_argument("--only", choices=get_args(Imperfection), action="append", help="imperfections; default all")
    parser.add_argument("--log", type=Path, default=Path("board_coverage.jsonl"), help="log; read if it exists")
    given = parser.parse_args()
    log = [json.loads(line) for line in given.log.read_text().splitlines()] if given.log.exists() else []
    done = {(row["options"]["seed"], row["options"]["imperfection"]) for row in log}
    for imperfection in given.only or get_args(Imperfection):
        for seed in range(given.first, given.first + given.trials):
            if (seed, imperfection) in done:
                continue
            options = random_options(seed, imperfection)
            entry: dict = {"options": asdict(options)}
            try:
                entry |= run(options)
            except PosefuseError as error:
                entry |= {"error": str(error)}
            log.append(entry)
            with given.log.open("a") as file:
                file.write(json.dumps(entry) + "\n")
    summary(log)


if __name__ == "__main__":
    main()
