"""Measure the speed of kernels, of start-up, and of triangulation in comparison with aniposelib, on one core.

``python -m benchmarks.speed``. Times are CPU times, medians of several runs.
"""

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.walking import walk
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.pipeline.reconstruct import triangulate
from posefuse.synthetic.options import LensKind

PEERS = Path(__file__).parent / "peers"
RUNS = 7
# The machine's speed changes by the minute, so each run of the other program is between two runs of posefuse.
ROUNDS = 3


def median_cpu_s(work, runs: int = RUNS) -> float:
    """Return the median CPU time of a call in s, after a warm-up call."""
    work()
    times = []
    for _ in range(runs):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return statistics.median(times)


def kernel_rate(lens: LensKind, frames: int = 8000) -> float:
    """Return the points per second of the kernel of ``simple`` with 5 views, including all its outputs."""
    from posefuse.kernels.records import NoiseParameters, Observations, TriangulatedPoints
    from posefuse.kernels.triangulation.all_views import triangulate_views

    data = walk(frames, lens=lens)
    keypoints = np.ascontiguousarray(data.pixels.reshape(-1, 26, 2))
    confidence = np.ascontiguousarray(data.confidence.reshape(-1, 26))
    rows = np.arange(frames * 5).reshape(frames, 5)
    out = TriangulatedPoints.allocate(frames, 26, 5)
    observations, noise = Observations(keypoints, confidence, rows), NoiseParameters(np.full(5, 2.0), 0.0, 0.0)
    spent = median_cpu_s(lambda: triangulate_views(data.rig.packed, observations, noise, 3, out))
    return frames * 26 / spent


def compare_with_aniposelib(frames: int = 8000) -> dict[str, float]:
    """Return CPU ms per frame of aniposelib's ``triangulate``, of ``simple``, and their ratio; and of ``consensus``.

    The data of ``consensus`` has 5 % outliers, and it estimates the noise.
    """
    data = walk(frames)
    detections, outliers = data.detections, walk(frames, outlier_share=0.05).detections
    labels = Options(pairs="labels")
    simple = Options(noise_scale_px=2.0, triangulation=TriangulationOptions(method="simple"))
    with tempfile.TemporaryDirectory() as folder:
        anipose.write(data.rig, Path(folder) / "calibration.toml")
        np.save(Path(folder) / "points.npy", np.moveaxis(data.pixels, 1, 0))
        rounds = []
        for _ in range(ROUNDS):
            before = median_cpu_s(lambda: triangulate(data.rig, detections, simple))
            peer = run_peer("aniposelib", Path(folder))["ms_per_frame"]
            after = median_cpu_s(lambda: triangulate(data.rig, detections, simple))
            rounds.append((peer, 500 * (before + after) / frames))
    return {
        "aniposelib_ms": statistics.median(peer for peer, _ in rounds),
        "simple_ms": statistics.median(ours for _, ours in rounds),
        "ratio": statistics.median(peer / ours for peer, ours in rounds),
        "consensus_ms": 1000 * median_cpu_s(lambda: triangulate(data.rig, outliers, labels)) / frames,
    }


def peer_environment(name: str) -> Path:
    """Return the folder of another program's environment: in $POSEFUSE_PEERS, or beside its ``pyproject.toml``."""
    folder = os.environ.get("POSEFUSE_PEERS")
    return PEERS / name / ".venv" if folder is None else Path(folder) / name


def run_peer(name: str, data: Path, *arguments: str) -> dict[str, float]:
    """Run another program in its locked environment on one core, with arguments such as ``--mode`` and ``--frames``."""
    uv = shutil.which("uv") or str(Path(sys.executable).with_name("uv"))
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "JAX_PLATFORMS": "cpu"}
    environment["UV_PROJECT_ENVIRONMENT"] = str(peer_environment(name))
    environment.pop("VIRTUAL_ENV", None)
    project = PEERS / name
    done = subprocess.run(
        [uv, "run", "--quiet", "--locked", "--project", project, "python", project / "run.py", data, *arguments],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{name} failed:\n{done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def first_call_s(recording: Path, cache: Path) -> float:
    """Return the wall time in s from the start of a new process to its first result, with a Numba cache folder."""
    program = (
        "import posefuse\n"
        f"rig = posefuse.read_cameras({str(recording / 'calibration.toml')!r})\n"
        f"detections = posefuse.read_detections({str(recording / 'keypoints.nc')!r})\n"
        "posefuse.reconstruct(rig, detections, posefuse.Options(solve='frame'))\n"
    )
    start = time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", program],
        check=True,
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        cwd=Path(__file__).parent.parent,
    )
    return time.perf_counter() - start


def main() -> None:
    """Run the benchmark and print its results."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    for lens in ("pinhole", "barrel", "fisheye"):
        print(f"kernel, 5 views, {lens}: {kernel_rate(lens) / 1e6:.2f} million points/s")
    figures = compare_with_aniposelib()
    for name in ("aniposelib_ms", "simple_ms", "consensus_ms"):
        print(f"{name}: {figures[name]:.4f} CPU ms per frame of 26 keypoints, 5 cameras")
    print(f"aniposelib / simple: {figures['ratio']:.1f} (median of {ROUNDS} rounds)")
    with tempfile.TemporaryDirectory() as cache, tempfile.TemporaryDirectory() as folder:
        data = walk(100)
        anipose.write(data.rig, Path(folder) / "calibration.toml")
        native.write(data.detections, Path(folder) / "keypoints.nc")
        cold = first_call_s(Path(folder), Path(cache))
        warm = statistics.median(first_call_s(Path(folder), Path(cache)) for _ in range(3))
    print(f"first result of a new process: {cold:.1f} s with an empty cache, {warm:.1f} s with a warm one")


if __name__ == "__main__":
    main()
