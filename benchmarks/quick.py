"""Fast motion that a smoother must not take away: a waving hand at 60 fps, and landings at 100 fps.

``python -m benchmarks.quick [--no-peer]``. Amplitudes are those of the 3 Hz part of the wrist's way across the body,
velocities those by central differences, both as shares of the truth's.
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


def kept_amplitude(found: Path3D, data: Walk, start_s: float, end_s: float) -> str:
    """The wrist's 3 Hz amplitude between two times, over the truth's."""
    during = (data.times_s >= start_s) & (data.times_s <= end_s)
    wrist = find_skeleton(data.skeleton).index("right_wrist")
    paths = found.points_m[during, wrist], data.points_m[during, wrist]
    across = np.linalg.svd(paths[1] - paths[1].mean(axis=0), full_matrices=False)[2][0]
    ours, true = (amplitude(path @ across, data.times_s[during]) for path in paths)
    error = 1000 * np.linalg.norm(paths[0] - paths[1], axis=1)
    return (
        f"amplitude {100 * ours / true:6.1f} %   wrist median {np.nanmedian(error):5.1f} mm, p99 {p99(error):5.1f} mm"
    )


def amplitude(way_m: np.ndarray, time_s: np.ndarray) -> float:
    """Of the 3 Hz part, by least squares."""
    there = np.isfinite(way_m)
    phase = 2 * np.pi * motions.WAVE_HZ * time_s[there]
    basis = np.stack([np.sin(phase), np.cos(phase), np.ones_like(phase), time_s[there]], axis=1)
    found = np.linalg.lstsq(basis, way_m[there], rcond=None)[0]
    return float(np.hypot(found[0], found[1]))


def kept_velocity(found: Path3D, data: Walk) -> str:
    """The ankles' fastest fall of every landing, over the truth's: mean, and spread from landing to landing."""
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
    """Its 99 % percentile, of what is there."""
    return float(np.nanpercentile(error, 99))


CASES: dict[str, tuple[Callable[[], Walk], Callable[[Path3D, Walk], str]]] = {
    "waving throughout": (
        lambda: motions.waving(WAVE_FRAMES),
        lambda found, data: kept_amplitude(found, data, 1.0, 9.0),
    ),
    "waving from 4 to 6 s, else at rest": (
        lambda: motions.waving(WAVE_FRAMES, start_s=4.0, end_s=6.0),
        lambda found, data: kept_amplitude(found, data, 4.3, 5.7),
    ),
    "landing, feet stopped in 0.04 s": (lambda: motions.landing(JUMPS), kept_velocity),
    "landing, feet stopped in 0.02 s": (lambda: motions.landing(JUMPS, absorb_s=0.02), kept_velocity),
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--no-peer", action="store_true", help="without aniposelib, which takes a minute a recording")
    given = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    warnings.simplefilter("ignore")
    for name, (make, kept) in CASES.items():
        data = make()
        print(f"\n{name}, {len(data.points_m)} frames")
        for method, found in methods(data, not given.no_peer):
            print(f"{method:32}{kept(found, data)}   all median {Score.of(found, data).median_mm:5.2f} mm", flush=True)


if __name__ == "__main__":
    main()
