"""Measure how often the 95 % intervals of the joint estimate of poses and clocks contain the truth.

A person balances, stands, walks or jumps in front of four or five cameras for 1.5 to 60 s. Clocks are correct; every
camera is rotated by 0 to 2 degrees. Detection errors have the measured law: Student-t tails, a correlation of 0.85
between frames at 25 fps and of 0.4 after a second, a standard deviation that depends on the confidence, and outliers.

    python -m benchmarks.clock_coverage --trials 64 --log clock_coverage.jsonl
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from scipy.signal import lfilter
from scipy.special import gammaincinv, ndtr

from benchmarks.fault_scenes import placed
from posefuse.calibration.joint.estimate import JointEstimate, estimate
from posefuse.calibration.joint.parameters import JointParameters, difference
from posefuse.calibration.joint.recording import JointRecording
from posefuse.model.cameras import CameraRig, rotation_from_vector
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import HumanMotion
from posefuse.synthetic.options import Activity
from posefuse.synthetic.rigs import build_rig

Person = Literal["balances", "stands", "walks", "jumps"]
PEOPLE: tuple[Person, ...] = get_args(Person)
DURATIONS_S = (1.5, 5.0, 15.0, 60.0)
PARAMETERS = ("rotation", "center", "offset", "drift")
_ACTIVITY: dict[Person, Activity] = {"balances": "stand", "stands": "stand", "walks": "walk", "jumps": "jump"}
_MAX_ROTATION_DEG, _RATE_HZ = 2.0, 25.0
_SCALE_PX, _TAILS = 4.5 * 1.92, 2.7
_SLOW, _FAST_S, _SLOW_S = 0.45, 0.13, 8.0
_OUTLIERS = 0.01
_USUAL_CONFIDENCE, _STILL = 0.79, 1e-6


@dataclass(frozen=True)
class Trial:
    """Result of one trial, in the order of :data:`PARAMETERS`.

    Attributes:
        errors: estimates minus truth, in units of the standard deviation; of parameters that are not determined, empty.
        sds: median standard deviation in degrees, cm, ms and ppm.
    """

    errors: tuple[tuple[float, ...], ...]
    sds: tuple[float, ...]


def run(person: Person, duration_s: float, seed: int) -> Trial:
    """Simulate and estimate one recording."""
    recording, truth = simulate(person, duration_s, np.random.default_rng([seed, 77]))
    joint = estimate(recording)
    assert joint is not None
    return compare(joint, truth)


def compare(joint: JointEstimate, truth: np.ndarray) -> Trial:
    """Compare an estimate with the truth, shape (view, parameter)."""
    error = (joint.projection @ (joint.change - truth).ravel()).reshape(truth.shape) / joint.sd
    known = joint.determined
    parts = (slice(0, 3), slice(3, 6), slice(6, 7), slice(7, 8))
    errors = tuple(tuple(np.round(error[:, p][known[:, p]], 3).tolist()) for p in parts)
    units = (180.0 / np.pi, 1e2, 1e3, 1e6)
    return Trial(errors, tuple(float(u * np.median(joint.sd[:, p])) for u, p in zip(units, parts, strict=True)))


def simulate(person: Person, duration_s: float, rng: np.random.Generator) -> tuple[JointRecording, np.ndarray]:
    """Return a recording and the true change of every view from its calibration."""
    rig, time_s, points = scene(person, duration_s, rng)
    n = len(rig)
    pixels, sigma = detect(rig.project(points), rng)
    focal = np.array([camera.matrix[0, 0] for camera in rig.cameras])
    middle = np.array([camera.matrix[:2, 2] for camera in rig.cameras])
    turns = [_rotation(rng) for _ in range(n)]
    true, centers = np.stack([camera.rotation for camera in rig.cameras]), np.stack([c.center_m for c in rig.cameras])
    given = np.stack([rotation_from_vector(turn) for turn in turns]) @ true
    recording = JointRecording(
        rig.names,
        (pixels - middle[None, :, None]) / focal[None, :, None, None],
        sigma / focal[None, :, None],
        np.repeat(time_s[:, None], n, axis=1),
        np.zeros(len(time_s), dtype=int),
        1.0 / _RATE_HZ,
        given,
        centers,
    )
    still = np.zeros(n)
    return recording, difference(
        JointParameters(given, centers, still, still), JointParameters(true, centers, still, still)
    )


def scene(person: Person, duration_s: float, rng: np.random.Generator) -> tuple[CameraRig, np.ndarray, np.ndarray]:
    """Return cameras, times, and exact keypoints, shape (frame, keypoint, 3)."""
    rig = build_rig("ring", int(rng.integers(4, 6)), radius_m=5.0)
    rig = replace(rig, cameras=tuple(placed(camera, rng) for camera in rig.cameras))
    skeleton, figure = find_skeleton("halpe_26"), human(float(rng.uniform(1.55, 1.9)))
    time_s = np.arange(round(duration_s * _RATE_HZ)) / _RATE_HZ
    motion = HumanMotion.random((_ACTIVITY[person],), rng)
    points = motion.positions(figure, time_s + 0.5)[:, figure.columns(skeleton)]
    if person == "balances":
        points = points + _sway(time_s, rng)[:, None] * points[:, :, 2:] / figure_height(points)
    return rig, time_s, points


def bounds(person: Person, duration_s: float, seed: int) -> tuple[float, float]:
    """Return the Cramer-Rao bounds of a view's time offset in ms and its drift in ppm; infinite without movement.

    They are those of an oracle that knows all movements, all poses and the other clocks, so no estimator is better.
    """
    rig, time_s, points = scene(person, duration_s, np.random.default_rng([seed, 77]))
    pixels = rig.project(points)[:, 0].reshape(len(time_s), -1)
    slope = np.asarray(np.gradient(pixels, time_s, axis=0)) * _USUAL_CONFIDENCE / _SCALE_PX
    lag_s = np.abs(time_s[:, None] - time_s)
    correlation = (1.0 - _SLOW) * np.exp(-lag_s / _FAST_S) + _SLOW * np.exp(-lag_s / _SLOW_S)
    late = np.stack([slope, slope * (time_s - time_s.mean())[:, None]])
    solved = np.linalg.solve(correlation, np.concatenate(late, axis=1))
    halves = np.stack(np.split(solved, 2, axis=1))
    information = np.einsum("atc,btc->ab", late, halves) * (_TAILS + 2.0) / (_TAILS + 4.0)
    if np.abs(slope).max() < _STILL:
        return np.inf, np.inf
    sd = np.sqrt(np.diag(np.linalg.inv(information)))
    return float(1e3 * sd[0]), float(1e6 * sd[1])


def print_bounds() -> None:
    """Print one row per person and duration."""
    print("| person | s | offset, ms | drift, ppm |\n|---|---|---|---|")
    for person in PEOPLE:
        for duration_s in DURATIONS_S:
            offset, drift = np.median([bounds(person, duration_s, seed) for seed in range(5)], axis=0)
            print(f"| {person} | {duration_s:g} | {offset:.2g} | {drift:.2g} |", flush=True)


def figure_height(points_m: np.ndarray) -> float:
    """Return the height of the highest keypoint."""
    return float(points_m[..., 2].max())


def _sway(time_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the horizontal sway of the head of a balancing person, shape (frame, 3), in meters."""
    out = np.zeros((len(time_s), 3))
    for axis in range(2):
        for _ in range(3):
            out[:, axis] += 0.03 * np.sin(2 * np.pi * rng.uniform(0.2, 0.8) * time_s + rng.uniform(0, 2 * np.pi))
    return out


def _rotation(rng: np.random.Generator) -> np.ndarray:
    """Return a rotation vector of 0 to 2 degrees in a random direction."""
    axis = rng.standard_normal(3)
    return axis * np.radians(rng.uniform(0.0, _MAX_ROTATION_DEG)) / np.linalg.norm(axis)


def detect(exact_px: np.ndarray, rng: np.random.Generator, rate_hz: float = _RATE_HZ) -> tuple[np.ndarray, np.ndarray]:
    """Return detected pixels, shape (frame, view, keypoint, 2), and their expected noise."""
    shape = exact_px.shape[:3]
    level = rng.normal(1.4, 0.4, shape[1:]) + _decaying(shape, 0.25, rng, rate_hz)
    sigma = _SCALE_PX / (0.15 + 0.82 / (1.0 + np.exp(-level)))
    chi_square = 2.0 * gammaincinv(_TAILS / 2.0, ndtr(correlated_errors(shape, rng, rate_hz=rate_hz)))
    errors = correlated_errors((*shape, 2), rng, rate_hz=rate_hz)
    pixels = exact_px + (sigma / np.sqrt(chi_square / _TAILS))[..., None] * errors
    angle = rng.uniform(0.0, 2 * np.pi, shape)
    thrown = (rng.random(shape) < _OUTLIERS) * rng.uniform(30.0, 300.0, shape)
    return pixels + thrown[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1), sigma


def correlated_errors(
    shape: tuple[int, ...], rng: np.random.Generator, slow_share: float = _SLOW, rate_hz: float = _RATE_HZ
) -> np.ndarray:
    """Return normal numbers with a fast and a slow part, correlated along the first axis."""
    fast, slow = _decaying(shape, _FAST_S, rng, rate_hz), _decaying(shape, _SLOW_S, rng, rate_hz)
    return np.sqrt(1.0 - slow_share) * fast + np.sqrt(slow_share) * slow


def _decaying(
    shape: tuple[int, ...], reach_s: float, rng: np.random.Generator, rate_hz: float = _RATE_HZ
) -> np.ndarray:
    """Return normal numbers whose correlation decays exponentially along the first axis."""
    rho = np.exp(-1.0 / (rate_hz * reach_s))
    white = rng.standard_normal(shape)
    white[1:] *= np.sqrt(1.0 - rho * rho)
    return np.asarray(lfilter([1.0], [1.0, -rho], white, axis=0))


def coverage(errors: Sequence[Sequence[float]]) -> float:
    """Return the share of errors within 1.96 standard deviations, NaN without any."""
    every = np.concatenate([np.asarray(each, dtype=float) for each in errors]) if errors else np.zeros(0)
    return float((np.abs(every) <= 1.96).mean()) if len(every) else float("nan")


def summary(log: list[dict]) -> None:
    """Print one row per person and duration, and the total."""
    print("| person | s | trials | " + " | ".join(f"{p} % (sd)" for p in PARAMETERS) + " |")
    print("|---|---|---|" + "---|" * len(PARAMETERS))
    for person in (*PEOPLE, "all"):
        for duration_s in (*DURATIONS_S, None) if person == "all" else DURATIONS_S:
            rows = [r for r in log if person in (r["person"], "all") and duration_s in (r["duration_s"], None)]
            if not rows or (person == "all" and duration_s is not None):
                continue
            cells = []
            for k in range(len(PARAMETERS)):
                known = [r["errors"][k] for r in rows if r["errors"][k]]
                sd = np.median([r["sds"][k] for r in rows])
                cells.append(f"{100 * coverage(known):.1f} ({sd:.2g})" if len(known) else f"not determined ({sd:.2g})")
            print(f"| {person} | {duration_s or ''} | {len(rows)} | {' | '.join(cells)} |")


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=64, help="of each person and duration")
    parser.add_argument("--first", type=int, default=0, help="seed of the first trial")
    parser.add_argument("--log", type=Path, default=Path("clock_coverage.jsonl"), help="log; read if it exists")
    parser.add_argument("--summary", action="store_true", help="print the table of the log only")
    parser.add_argument("--bounds", action="store_true", help="print the bounds of clocks only")
    arguments = parser.parse_args()
    if arguments.bounds:
        print_bounds()
        return
    log = [json.loads(line) for line in arguments.log.read_text().splitlines()] if arguments.log.exists() else []
    done = {(r["person"], r["duration_s"], r["seed"]) for r in log}
    cases: list[tuple[Person, float, int]] = [
        (person, duration_s, seed)
        for seed in range(arguments.first, arguments.first + arguments.trials)
        for duration_s in DURATIONS_S
        for person in PEOPLE
        if (person, duration_s, seed) not in done and not arguments.summary
    ]
    with arguments.log.open("a") as file:
        for person, duration_s, seed in cases:
            trial = run(person, duration_s, seed)
            row = {"person": person, "duration_s": duration_s, "seed": seed, "errors": trial.errors, "sds": trial.sds}
            log.append(json.loads(json.dumps(row)))
            file.write(json.dumps(row) + "\n")
            file.flush()
    summary(log)


if __name__ == "__main__":
    main()
