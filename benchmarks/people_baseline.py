"""Hold the accuracy of calibrations from people: compare it with ``people_baseline.json``.

    python -m benchmarks.people_baseline [FOLDER] [--write]

FOLDER holds the recordings that the tests read; without it, only simulated recordings are measured. ``--write`` stores
the figures of the recordings that were measured.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from benchmarks.calibration_recordings import CalibrationCase, recording
from benchmarks.people_calibration import calibrate
from benchmarks.simulated_rigs import RigOptions, simulate_rig

BASELINE = Path(__file__).with_name("people_baseline.json")
REAL = (
    ("balancing", True),
    ("balancing", False),
    ("panoptic", True),
    ("panoptic", False),
    ("two_people", True),
    ("mvor", True),
)
"""Recordings in the folder, and whether focal lengths are known."""
FIGURES = {"rotation_deg": 0.05, "center_m": 0.005, "focal": 0.003, "offset_frames": 0.05}
"""Figures and the loss that is tolerated in addition to a share of each."""
TOLERATED = 1.15
SIMULATED: dict[str, tuple[RigOptions, bool]] = {
    "ring, walking": (RigOptions(cameras=4, seed=1), True),
    "ring, walking, unknown focal lengths": (RigOptions(cameras=4, seed=2), False),
    "corners, several, 25 and 30 Hz, apart": (
        RigOptions("corners", 5, "several", rates_hz=(25.0, 30.0), max_offset_s=2.0, seed=3), True,
    ),
    "aisle, walking, barrel": (RigOptions("aisle", 6, lens="barrel", seed=4), True),
    "two cameras, walking 10 s": (RigOptions(cameras=2, duration_s=10.0, seed=5), True),
}  # fmt: skip
"""Simulated recordings by name, and whether focal lengths are known."""


def simulated() -> Iterator[tuple[str, CalibrationCase, bool]]:
    """Yield the simulated recordings: name, recording, and whether focal lengths are known."""
    for name, (options, focal_known) in SIMULATED.items():
        yield name, simulate_rig(options), focal_known


def real(folder: Path) -> Iterator[tuple[str, CalibrationCase, bool]]:
    """Yield the recordings in a folder."""
    for name, focal_known in REAL:
        yield f"{name}{'' if focal_known else ', unknown focal lengths'}", recording(name, folder), focal_known


def measure(case: CalibrationCase, *, focal_known: bool) -> dict[str, float]:
    """Return the figures of a recording, without those that are not defined."""
    score = calibrate(case, focal_known=focal_known).score(case)
    figures = {name: float(getattr(score, name)) for name in FIGURES}
    return {name: round(value, 5) for name, value in figures.items() if np.isfinite(value)}


def shortfalls(
    measured: dict[str, dict[str, float]],
    baseline: dict[str, dict[str, float]],
    tolerated: Mapping[str, float] = MappingProxyType(FIGURES),
) -> list[str]:
    """Return one sentence for every figure that is worse than the baseline.

    Args:
        measured: figures by recording and name.
        baseline: committed figures.
        tolerated: loss of each figure that is tolerated in addition to a share of it.
    """
    out = []
    for name, figures in measured.items():
        for figure, value in figures.items():
            most = TOLERATED * baseline[name][figure] + tolerated[figure]
            if not value <= most:
                out.append(f"{name}: {figure} is {value:.4g}, at most {most:.4g} is tolerated.")
    return out


def main() -> int:
    """Measure, compare or write; return 1 if a figure is worse."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    baseline = json.loads(BASELINE.read_text("utf-8")) if BASELINE.exists() else {}
    measured = {}
    for name, case, focal_known in [*simulated(), *(real(given.folder) if given.folder else ())]:
        measured[name] = measure(case, focal_known=focal_known)
        print(name, measured[name], flush=True)
    if given.write:
        BASELINE.write_text(json.dumps(baseline | measured, indent=2) + "\n", "utf-8")
        return 0
    worse = shortfalls(measured, baseline)
    print("\n".join(worse) or "No figure is worse than the baseline.")
    return int(bool(worse))


if __name__ == "__main__":
    sys.exit(main())
