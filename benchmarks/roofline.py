"""Measure what one core can do, and how far from it the kernels of triangulation and of trajectories are.

``python -m benchmarks.roofline``. Arithmetic is counted by hand from the formulas, for five views and pinhole cameras:
an addition, a multiplication, a comparison or a minimum is one operation, a fused multiply-add is two. Divisions and
square roots are counted separately, because the divider is not pipelined.
"""

import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable

import numba
import numpy as np

from benchmarks.rejection import measured, options_of
from benchmarks.speed import kernel_rate, median_cpu_s
from benchmarks.walking import walk

CHAIN = 32
LENGTH = 64
SETS = {"L1": 16 << 10, "L2": 1 << 20, "beyond L2": 32 << 20}
"""Sizes of arrays in bytes; two of them are read and one is written."""

VIEWS = 5
EVALUATIONS = 2
"""Evaluations of the reprojection error and its derivatives until a block of points has converged, counted."""

POINT_OPERATIONS = VIEWS * (16 + 42 + 32 + 89 * EVALUATIONS) + 65 * (EVALUATIONS + 1) + 35
"""Rows 16, linear start 42, reprojection 32 and each evaluation 89 per view; each 3x3 solve 65, covariance 35."""

POINT_DIVISIONS = VIEWS * (EVALUATIONS + 2) + 3 * (EVALUATIONS + 2)
"""A division per view and evaluation, one and a square root for the reprojection; three per 3x3 solve and inverse."""

POINT_BYTES = VIEWS * (16 + 8 + 1 + 4) + 24 + 48 + 8 + 1
"""Pixel, confidence, status and error per view; position, covariance, mean error and status."""


@numba.njit(fastmath={"contract"})
def fused(values: np.ndarray, rounds: int, a: float, b: float) -> None:
    """Compute chains of fused multiply-adds, independent of each other."""
    for _ in range(rounds):
        for j in range(values.shape[0]):
            x = values[j]
            for _ in range(CHAIN):
                x = x * a + b
            values[j] = x


@numba.njit(error_model="numpy")
def divided(values: np.ndarray, rounds: int, a: float) -> None:
    """Divide."""
    for _ in range(rounds):
        for j in range(values.shape[0]):
            values[j] = a / values[j]


@numba.njit(fastmath={"contract"})
def triad(first: np.ndarray, second: np.ndarray, out: np.ndarray, rounds: int) -> None:
    """Read two arrays and write one."""
    for _ in range(rounds):
        for j in range(out.shape[0]):
            out[j] = first[j] + 0.5 * second[j]


def gflops() -> float:
    """Return billions of operations per second of fused multiply-adds."""
    values, rounds = np.ones(LENGTH), 20_000
    return 2e-9 * LENGTH * CHAIN * rounds / median_cpu_s(lambda: fused(values, rounds, 0.999, 0.001))


def giga_divisions() -> float:
    """Return billions of divisions per second."""
    values, rounds = np.full(LENGTH, 1.5), 200_000
    return 1e-9 * LENGTH * rounds / median_cpu_s(lambda: divided(values, rounds, 2.0))


def bandwidth(size: int) -> float:
    """Return GB/s of reading two arrays and writing one, which have this many bytes together."""
    n = size // 24
    arrays = [np.ones(n) for _ in range(3)]
    rounds = max((1 << 28) // size, 1)
    return 1e-9 * 24 * n * rounds / median_cpu_s(lambda: triad(*arrays, rounds))


def without_vectors() -> tuple[float, float, float]:
    """Return the figures of this program in a process that compiles no vector instructions."""
    with tempfile.TemporaryDirectory() as folder:
        # Kernels of both kinds would be taken for each other in a common cache.
        environment = {**os.environ, "NUMBA_LOOP_VECTORIZE": "0", "NUMBA_SLP_VECTORIZE": "0", "NUMBA_CACHE_DIR": folder}
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.roofline", "--numbers"], env=environment, capture_output=True, check=True
        )
    first, second, third = (float(each) for each in done.stdout.split()[-3:])
    return first, second, third


def solved_ms(frames: int = 600) -> tuple[float, float, float]:
    """Return CPU ms per frame of the priors, of the rounds and of the whole trajectory solve, with given priors."""
    from posefuse.model.options.options import Options
    from posefuse.model.options.trajectory import TrajectoryOptions
    from posefuse.pipeline.reconstruct import triangulate
    from posefuse.trajectory.bones import Bones
    from posefuse.trajectory.observations import MeasuredRange, PersonObservations
    from posefuse.trajectory.path_solver import PathSolver
    from posefuse.trajectory.priors import estimate_priors
    from posefuse.trajectory.smoothness import Smoothness
    from posefuse.trajectory.solve import solve

    data, options = walk(frames, outlier_share=0.05), TrajectoryOptions()
    detections = data.detections
    result = triangulate(data.rig, detections, Options())
    assert result.tracks is not None
    assert result.noise is not None
    part = MeasuredRange(result.rig, detections, result.tracks, result.layers["measured"], result.swaps, result.noise)
    skeleton = detections.skeleton
    priors = estimate_priors([part], skeleton, options)
    observed = PersonObservations.of(part, 0)
    solver = PathSolver(observed, Smoothness.of(options.prior, observed.time_s), Bones.of(skeleton), options)
    person = priors.of(0, part.noise.spread)
    works: tuple[Callable[[], object], ...] = (
        lambda: estimate_priors([part], skeleton, options),
        lambda: solver.smooth(person),
        lambda: solve(part, priors, options),
    )
    first, second, third = (1000.0 * median_cpu_s(work) / frames for work in works)
    return first, second, third


def main() -> None:
    """Print the peaks and the kernels' shares of them."""
    if "--numbers" in sys.argv:
        print(gflops(), giga_divisions(), kernel_rate("pinhole") / 1e6)
        return
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    peak, divisions = gflops(), giga_divisions()
    scalar = without_vectors()
    print(f"fused multiply-adds: {peak:.1f} GFLOP/s with vectors, {scalar[0]:.1f} without")
    print(f"divisions: {divisions:.2f} per ns with vectors, {scalar[1]:.2f} without")
    for name, size in SETS.items():
        print(f"bandwidth, {name} ({size >> 10} kB): {bandwidth(size):.0f} GB/s")
    rate = kernel_rate("pinhole")
    arithmetic, dividing = 1e-9 * POINT_OPERATIONS / peak, 1e-9 * POINT_DIVISIONS / divisions
    print(f"simple: {rate / 1e6:.2f} million points/s with vectors, {scalar[2]:.2f} without")
    print(f"  {POINT_OPERATIONS} operations and {POINT_DIVISIONS} divisions per point: {1e9 / rate:.0f} ns;")
    print(f"  bounds: arithmetic {1e9 * arithmetic:.0f} ns, divider {1e9 * dividing:.0f} ns, {POINT_BYTES} bytes")
    data = walk(7700, outlier_share=0.05)
    given = options_of(noise_scale_px=2.0)
    for name, options in (("noise estimated", options_of()), ("noise given", given)):
        spent = [median_cpu_s(lambda chosen=options: measured(data, chosen)) for _ in range(3)]
        print(f"consensus, 5 % outliers, {name}: {1000 * statistics.median(spent) / 7700:.4f} CPU ms per frame")
    priors, rounds, whole = solved_ms()
    print(
        f"trajectory, 600 frames: priors {priors:.3f}, solve {whole:.3f}, of which rounds {rounds:.3f} CPU ms per frame"
    )


if __name__ == "__main__":
    main()
