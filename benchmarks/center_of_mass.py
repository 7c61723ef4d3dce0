"""Centers of mass of simulated people: errors of positions and velocities, and shares of the 95 % intervals.

``python -m benchmarks.center_of_mass`` reconstructs walks, runs, squats and jumps from five cameras with the errors
measured on OpenPose, or others (``--noise``, ``--rate-hz``). The truth uses the same segment masses, so that their
error does not count. ``--first`` sets the first seed.
"""

import argparse
import sys
from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np

from posefuse.biomechanics.center_of_mass import center_of_mass
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import LAYERS
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.synthetic.figures import human
from posefuse.synthetic.gait_motions import GaitMotion
from posefuse.synthetic.gait_plans import WalkPlan, stand, walk
from posefuse.synthetic.gait_scenes import GaitSceneOptions, simulate_gait
from posefuse.synthetic.options import DetectorOptions
from posefuse.synthetic.scenes import truth_of

KINDS = ("walk", "run", "squat", "jump")
_STEP_S = 1e-3


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of one recording and layer, and the standard deviations that the result states.

    Attributes:
        position_m: shape (frame, 3).
        position_sd_m: shape (frame, 3).
        velocity_m_s: shape (frame, 3).
        velocity_sd_m_s: shape (frame, 3).
    """

    position_m: np.ndarray
    position_sd_m: np.ndarray
    velocity_m_s: np.ndarray
    velocity_sd_m_s: np.ndarray


def motion_of(seed: int) -> tuple[GaitMotion, float]:
    """Return a motion and its duration in s; the kind is that of ``KINDS`` by the seed."""
    rng = np.random.default_rng(seed + 1000)
    kind = KINDS[seed % len(KINDS)]
    if kind == "walk":
        start = (-2.0, float(rng.uniform(-0.5, 0.5)))
        plan = WalkPlan(float(rng.uniform(0.8, 1.6)), float(rng.uniform(0.95, 1.2)), strides=3, start_m=start)
        return walk(replace(plan, heading=float(rng.uniform(-0.3, 0.3)))), plan.duration_s
    if kind == "run":
        plan = WalkPlan(float(rng.uniform(2.4, 3.0)), 0.72, 0.36, 5, treadmill=True)
        return walk(replace(plan, heading=float(rng.uniform(-3.0, 3.0)))), 4.0
    if kind == "squat":
        return stand(5.0, drops=((0.8, 2.0, float(rng.uniform(0.25, 0.4))), (3.0, 1.5, 0.3))), 5.0
    return stand(5.0, flights=((1.5, float(rng.uniform(0.35, 0.5))), (3.5, 0.4))), 5.0


def errors_of(seed: int, options: GaitSceneOptions) -> dict[str, Errors]:
    """Reconstruct a recording and return the errors of each layer."""
    motion, duration_s = motion_of(seed)
    scene = simulate_gait(motion, duration_s, options)
    result = reconstruct(scene.rig, scene.detections, Options(bodies="fit"))
    figure = human(options.stature_m)
    columns, time_s = figure.columns(result.skeleton), np.asarray(result.time_s)

    def true_position(at_s: np.ndarray) -> np.ndarray:
        points = motion.positions(figure, at_s)[:, columns]
        return center_of_mass(truth_of(scene.rig, result.skeleton, points, options.rate_hz)).xyz_m[:, 0]

    position = true_position(time_s)
    velocity = (true_position(time_s + _STEP_S) - true_position(time_s - _STEP_S)) / (2.0 * _STEP_S)
    found = {}
    for layer in result.layers:
        each = center_of_mass(replace(result, options=replace(result.options, layer=layer)))
        found[layer] = Errors(
            each.xyz_m[:, 0] - position, each.sd_m[:, 0], each.velocity_m_s[:, 0] - velocity, each.velocity_sd_m_s[:, 0]
        )
    return found


def row_of(runs: list[Errors]) -> tuple[float, float, float, float]:
    """Return the RMS error and the share within the 95 % interval, of positions (m) and of velocities (m/s)."""
    numbers = []
    for name in ("position", "velocity"):
        unit = "m" if name == "position" else "m_s"
        errors = np.concatenate([getattr(run, f"{name}_{unit}") for run in runs])
        sds = np.concatenate([getattr(run, f"{name}_sd_{unit}") for run in runs])
        known = np.isfinite(errors) & np.isfinite(sds)
        inside = np.abs(errors[known]) <= 1.959964 * sds[known]
        numbers += [float(np.sqrt(np.mean(errors[known] ** 2))), float(inside.mean())]
    return numbers[0], numbers[1], numbers[2], numbers[3]


def main() -> None:
    """Print a table of layers and motions."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=400)
    parser.add_argument("--count", type=int, default=16)
    parser.add_argument("--noise", default="measured", choices=("measured", "rtmpose", "gaussian"))
    parser.add_argument("--rate-hz", type=float, default=60.0)
    flags = parser.parse_args()
    runs: dict[tuple[str, str], list[Errors]] = defaultdict(list)
    for seed in range(flags.first, flags.first + flags.count):
        options = GaitSceneOptions(
            1.6 + 0.05 * (seed % 7), rate_hz=flags.rate_hz, seed=seed, detector=DetectorOptions(flags.noise)
        )
        for layer, errors in errors_of(seed, options).items():
            runs[layer, KINDS[seed % len(KINDS)]].append(errors)
            runs[layer, "all"].append(errors)
        print(".", end="", file=sys.stderr, flush=True)
    print("\n| layer | motion | position, RMS | in 95 % interval | velocity, RMS | in 95 % interval |")
    print("|---|---|---|---|---|---|")
    for layer in LAYERS:
        for kind in ("all", *KINDS):
            if runs[layer, kind]:
                position, inside, velocity, velocity_inside = row_of(runs[layer, kind])
                print(
                    f"| `{layer}` | {kind} | {1000 * position:.1f} mm | {100 * inside:.1f} % | {velocity:.3f} m/s | "
                    f"{100 * velocity_inside:.1f} % |"
                )


if __name__ == "__main__":
    main()
