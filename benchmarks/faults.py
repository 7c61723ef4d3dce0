"""Benchmark of the recording check: it must find simulated faults, and report nothing in recordings without faults.

``python -m benchmarks.faults`` simulates each fault alone, pairs of faults in different cameras, and recordings without
faults. Rig, person, motion, skeleton and frame rate depend on the seed; detector errors are as measured (correlated,
heavy-tailed, 1 % outliers). Cases come in rounds of all kinds, and each adds a line to ``--log``: an interrupted run is
balanced, and the same command resumes it. ``--timing`` measures offsets and drifts instead.
"""

import argparse
import json
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from benchmarks.fault_scenes import FAULTS, Fault, Planted, healthy, plant
from posefuse.errors import DetectionsError
from posefuse.model.findings import Finding, FindingKind
from posefuse.model.options.options import Options
from posefuse.pipeline.diagnose import inspect_health, measure_sync

NAMED_AS: dict[Fault, tuple[FindingKind, ...]] = {
    "turned": (FindingKind.CAMERA_POSE,),
    "moved across": (FindingKind.CAMERA_POSE,),
    "moved along": (FindingKind.CAMERA_POSE,),
    "bumped": (FindingKind.CAMERA_POSE,),
    "moved across later": (FindingKind.CAMERA_POSE,),
    "moved along later": (FindingKind.CAMERA_POSE,),
    "focal": (FindingKind.FOCAL_LENGTH,),
    "lens": (FindingKind.LENS_DISTORTION,),
    "rotated image": (FindingKind.IMAGE_TRANSFORM,),
    "resized image": (FindingKind.IMAGE_TRANSFORM,),
    "order": (FindingKind.CAMERA_ORDER,),
    "copied pose": (FindingKind.COPIED_POSE,),
    "late": (FindingKind.TIME_OFFSET,),
    "drift": (FindingKind.CLOCK_DRIFT, FindingKind.FRAME_RATE),
    "dropped": (FindingKind.DROPPED_FRAMES,),
    "repeated": (FindingKind.REPEATED_FRAMES,),
    "sides": (FindingKind.LEFT_RIGHT_SWAP,),
    "confidence": (FindingKind.CONFIDENCE,),
    "another rig": (FindingKind.WRONG_CALIBRATION,),
}
ALONE: tuple[Fault, ...] = ("another rig",)
"""Faults that hide all others."""


def views_of(fault: Fault, first: int) -> tuple[int, ...]:
    """Return the views of a fault: the copy and its original, two exchanged ones, all, or one."""
    if fault in ("order", "copied pose"):
        return (first, first + 1)
    return () if fault == "another rig" else (first,)


def is_named(planted: Planted, findings: Sequence[Finding]) -> bool:
    """Return whether a finding names a simulated fault and its camera."""
    wanted = planted.cameras[:1] if planted.fault == "copied pose" else planted.cameras
    return any(f.kind in NAMED_AS[planted.fault] and set(f.cameras) == set(wanted) for f in findings)


def others(planted: Sequence[Planted], findings: Sequence[Finding]) -> list[Finding]:
    """Return findings about cameras or faults that were not simulated."""
    return [f for f in findings if not any(is_named(p, [f]) for p in planted)]


def check(faults: Sequence[Fault], seed: int) -> tuple[list[Planted], tuple[Finding, ...], float]:
    """Simulate a recording with faults and return the findings and the CPU time in s."""
    scene, planted = healthy(seed), []
    for number, fault in enumerate(faults):
        scene, one = plant(scene, fault, views_of(fault, 2 * number))
        planted.append(one)
    rig, detections = scene.watch()
    began = time.process_time()
    findings = inspect_health(rig, detections, Options())
    return planted, findings, time.process_time() - began


def cases(first: int, seeds: int, healthy: int, pairs: int) -> Iterator[tuple[tuple[Fault, ...], int]]:
    """Yield faults and seeds in rounds.

    Each fault alone, and equal shares of pairs and of recordings without faults.
    """
    beside: list[Fault] = [fault for fault in FAULTS if fault not in ALONE]
    every = list(combinations(beside, 2))
    # Neighbors in the list are similar; a step without a common divisor with its length visits all in mixed order.
    step = next(k for k in range(int(0.62 * len(every)), len(every)) if np.gcd(k, len(every)) == 1)
    rounds = max(seeds, 1)
    for number in range(rounds):
        if seeds:
            yield from (((fault,), first + number) for fault in FAULTS)
        yield from (((), first + k) for k in range(number * healthy // rounds, (number + 1) * healthy // rounds))
        total = pairs * len(every)
        # Every pair has a different rig; otherwise an unobservable fault of one rig would count in all pairs.
        for k in range(number * total // rounds, (number + 1) * total // rounds):
            yield every[k * step % len(every)], first + 500 + k


def record(faults: Sequence[Fault], seed: int) -> dict:
    """Outcome of one case."""
    planted, findings, seconds = check(faults, seed)
    return {
        "faults": list(faults),
        "seed": seed,
        "named": [is_named(one, findings) for one in planted],
        "others": [f"{f.kind} {' '.join(f.cameras)}" for f in others(planted, findings)],
        "seconds": round(seconds, 2),
    }


def summary(records: Iterable[dict]) -> None:
    """Print the numbers of identified faults: alone, in pairs, and per fault in pairs."""
    tallies: dict[str, list[tuple[bool, int]]] = defaultdict(list)
    for one in records:
        faults, named, more = one["faults"], one["named"], len(one["others"])
        if not faults:
            tallies["healthy: no findings"].append((more == 0, more))
        elif len(faults) == 1:
            tallies[faults[0]].append((named[0], more))
        else:
            tallies["pairs: both named"].append((all(named), more))
            for fault, hit in zip(faults, named, strict=True):
                tallies[f"in pairs: {fault}"].append((hit, 0))
    for name, rows in sorted(tallies.items(), key=lambda item: ":" in item[0]):
        print(f"{name:28} {sum(hit for hit, _ in rows):4} of {len(rows):4}, other findings {sum(n for _, n in rows)}")


def timing(seeds: range) -> None:
    """Print errors of offsets and drifts of one walking person at 25 Hz, with cameras started separately."""
    for duration_s, ppm in ((60.0, 300.0), (180.0, 100.0)):
        errors, found, drifts, refused = [], 0, [], 0
        for seed in seeds:
            rng = np.random.default_rng([seed, 4])
            scene = healthy(seed, rate_hz=25.0, duration_s=duration_s, activities=("walk",))
            offsets = rng.uniform(-3.0, 3.0, len(scene.rig))
            for v in range(1, len(scene.rig)):
                scene, _ = plant(scene, "late", [v], offsets[v])
            scene, _ = plant(scene, "drift", [1], ppm)
            try:
                views, _ = measure_sync(*scene.watch(), reference=scene.rig.names[0])
            except DetectionsError:
                refused += 1
                continue
            errors += [25.0 * v.offset_s[0] - offsets[i] for i, v in enumerate(views) if i > 1]
            drifts.append(views[1].drift_ppm[0])
            found += bool(views[1].drift_ppm[0])
        print(
            f"{duration_s:.0f} s: offset error {np.sqrt(np.mean(np.square(errors))):.3f} frames (at most "
            f"{np.abs(errors).max():.3f}); drift of {ppm:.0f} ppm found {found} of {len(seeds)}, measured "
            f"{np.mean(drifts):.0f} +- {np.std(drifts):.0f}; {refused} refused",
            flush=True,
        )


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50, help="of each fault alone")
    parser.add_argument("--first", type=int, default=1000, help="seed")
    parser.add_argument("--healthy", type=int, default=300)
    parser.add_argument("--pairs", type=int, default=3, help="seeds of each pair")
    parser.add_argument(
        "--log", type=Path, default=Path("faults.jsonl"), help="log with one line per case; read if it exists"
    )
    parser.add_argument("--timing", action="store_true")
    arguments = parser.parse_args()
    if arguments.timing:
        timing(range(arguments.first, arguments.first + arguments.seeds))
        return
    done = [json.loads(line) for line in arguments.log.read_text().splitlines()] if arguments.log.exists() else []
    known = {(tuple(one["faults"]), one["seed"]) for one in done}
    with arguments.log.open("a") as log:
        for faults, seed in cases(arguments.first, arguments.seeds, arguments.healthy, arguments.pairs):
            if (faults, seed) not in known:
                done.append(record(faults, seed))
                log.write(json.dumps(done[-1]) + "\n")
                log.flush()
    summary(done)


if __name__ == "__main__":
    main()
