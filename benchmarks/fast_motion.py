"""Measure how well methods preserve fast motion: a waving hand at 60 fps, and landings at 100 fps.

``python -m benchmarks.fast_motion [--no-peer]``. Amplitudes are those of the 3 Hz component of the wrist's lateral
motion, velocities are central differences; both are relative to the truth.
"""

import argparse
import os
import warnings
from collections.abc import Callable

import numpy as np

from benchmarks import motions
from benchmarks.trajectory import Path3D, Score, methods
from benchmarks.walking import Walk
from posefuse.skeleton.skeletons import find_skeleton

WAVE_FRAMES = 600
JUMPS = 6
_WINDOW_S = 0.15


def amplitude_ratio(found: Path3D, data: Walk, start_s: float, end_s: float) -> str:
    """Format the ratio of the wrist's 3 Hz amplitude between two times to the truth's, and the wrist's errors."""
    during = (data.times_s >= start_s) & (data.times_s <= end_s)
    wrist = find_skeleton(data.skeleton).index("right_wrist")
    paths = found.points_m[during, wrist], data.points_m[during, wrist]
    across = np.linalg.svd(paths[1] - paths[1].mean(axis=0), full_matrices=False)[2][0]
    ours, true = (wave_amplitude(path @ across, data.times_s[during]) for path in paths)
    error = 1000 * np.linalg.norm(paths[0] - paths[1], axis=1)
    return (
        f"amplitude {100 * ours / true:6.1f} %   wrist median {np.nanmedian(error):5.1f} mm, p99 {p99(error):5.1f} mm"
    )


def wave_amplitude(path_m: np.ndarray, time_s: np.ndarray) -> float:
    """Return the amplitude of the 3 Hz component by least squares."""
    there = np.isfinite(path_m)
    phase = 2 * np.pi * motions.WAVE_HZ * time_s[there]
    basis = np.stack([np.sin(phase), np.cos(phase), np.ones_like(phase), time_s[there]], axis=1)
    found = np.linalg.lstsq(basis, path_m[there], rcond=None)[0]
    return float(np.hypot(found[0], found[1]))


def velocity_ratio(found: Path3D, data: Walk) -> str:
    """Format the ratio of the ankles' largest falling velocity to the truth's: mean and spread over landings."""
    skeleton = find_skeleton(data.skeleton)
    ankles = [skeleton.index(f"{side}_ankle") for side in ("left", "right")]
    ours, true = (np.gradient(points[:, ankles, 2], data.times_s, axis=0) for points in (found.points_m, data.points_m))
    shares, errors = [], []
    around = round(_WINDOW_S * data.rate_hz)
    for jump in range(len(data.points_m) // round(2 * data.rate_hz)):
        first = jump * round(2 * data.rate_hz)
        at = first + int(true[first : first + round(2 * data.rate_hz), 0].argmin())
        span = slice(max(at - around, 0), at + around)
        shares += list(np.nanmin(ours[span], axis=0) / true[span].min(axis=0))
        offset = found.points_m[span][:, ankles] - data.points_m[span][:, ankles]
        errors.append(1000 * np.linalg.norm(offset, axis=-1).ravel())
    error = np.concatenate(errors)
    return (
        f"velocity {100 * np.mean(shares):6.1f} +- {100 * np.std(shares):.1f} %   "
        f"ankle median {np.nanmedian(error):5.1f} mm, p99 {p99(error):5.1f} mm"
    )


def p99(error: np.ndarray) -> float:
    """Return the 99th percentile of the finite values."""
    return float(np.nanpercentile(error, 99))


CASES: dict[str, tuple[Callable[[], Walk], Callable[[Path3D, Walk], str]]] = {
    "waving throughout": (
        lambda: motions.waving(WAVE_FRAMES),
        lambda found, data: amplitude_ratio(found, data, 1.0, 9.0),
    ),
    "waving from 4 to 6 s, otherwise at rest": (
        lambda: motions.waving(WAVE_FRAMES, start_s=4.0, end_s=6.0),
        lambda found, data: amplitude_ratio(found, data, 4.3, 5.7),
    ),
    "landing, feet stopped in 0.04 s": (lambda: motions.landing(JUMPS), velocity_ratio),
    "landing, feet stopped in 0.02 s": (lambda: motions.landing(JUMPS, absorb_s=0.02), velocity_ratio),
}


def main() -> None:
    """Run the benchmark and print its results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--no-peer", action="store_true", help="skip aniposelib, which takes a minute per recording")
    given = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    warnings.simplefilter("ignore")
    for name, (make, measure) in CASES.items():
        data = make()
        print(f"\n{name}, {len(data.points_m)} frames")
        for method, found in methods(data, not given.no_peer):
            print(
                f"{method:32}{measure(found, data)}   all median {Score.of(found, data).median_mm:5.2f} mm", flush=True
            )


if __name__ == "__main__":
    main()
