"""Are planted faults named, and are healthy recordings left in peace?

``python -m benchmarks.faults`` plants each fault alone, with ``--pairs`` also in pairs of different cameras, and looks
at as many healthy recordings. Every seed is another rig, person, walk, skeleton and frame rate, seen by a detector that
errs as measured (errors that last, heavy tails, 1 % of outliers). ``--timing`` measures offsets and drifts instead.
"""

import argparse
import time
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from posefuse.diagnosis import inspect_health, measure_sync
from posefuse.health.findings import Finding, Kind
from posefuse.model.options import Options
from posefuse.synthetic.faults import FAULTS, Fault, Planted, healthy, plant

NAMED_AS: dict[Fault, tuple[Kind, ...]] = {
    "turned": (Kind.POSE,),
    "moved across": (Kind.POSE,),
    "moved along": (Kind.POSE,),
    "bumped": (Kind.POSE,),
    "focal": (Kind.FOCAL,),
    "lens": (Kind.LENS,),
    "rotated image": (Kind.IMAGE,),
    "resized image": (Kind.IMAGE,),
    "order": (Kind.ORDER,),
    "copied pose": (Kind.COPY,),
    "late": (Kind.LATE,),
    "drift": (Kind.DRIFT,),
    "dropped": (Kind.DROPPED,),
    "repeated": (Kind.REPEATED,),
    "sides": (Kind.SIDES,),
    "confidence": (Kind.CONFIDENCE,),
    "another rig": (Kind.RIG,),
}
ALONE: tuple[Fault, ...] = ("another rig", "order")
"""Faults that are not planted beside another."""


def views_of(fault: Fault, first: int) -> tuple[int, ...]:
    """Which views have a fault: the copy and its original, two that change places, all, or one."""
    if fault in ("order", "copied pose"):
        return (first, first + 1)
    return () if fault == "another rig" else (first,)


def is_named(planted: Planted, findings: Sequence[Finding]) -> bool:
    """Whether a finding names a planted fault and its camera."""
    wanted = planted.cameras[:1] if planted.fault == "copied pose" else planted.cameras
    return any(f.kind in NAMED_AS[planted.fault] and set(f.cameras) == set(wanted) for f in findings)


def others(planted: Sequence[Planted], findings: Sequence[Finding]) -> list[Finding]:
    """Findings about cameras or things that nobody planted."""
    return [f for f in findings if not any(is_named(p, [f]) for p in planted)]


def check(faults: Sequence[Fault], seed: int) -> tuple[list[Planted], tuple[Finding, ...], float]:
    """A recording with faults, what is found, and how long that takes, s of processor time."""
    scene, planted = healthy(seed), []
    for number, fault in enumerate(faults):
        scene, one = plant(scene, fault, views_of(fault, 2 * number))
        planted.append(one)
    rig, detections = scene.watch()
    began = time.process_time()
    findings = inspect_health(rig, detections, Options())
    return planted, findings, time.process_time() - began


def cases(pairs: int) -> Iterator[tuple[Fault, ...]]:
    """Every fault alone, then some pairs, evenly chosen."""
    alone: list[tuple[Fault, ...]] = [(fault,) for fault in FAULTS]
    yield from alone
    beside: list[Fault] = [fault for fault in FAULTS if fault not in ALONE]
    every = list(combinations(beside, 2))
    for i in np.linspace(0, len(every) - 1, min(pairs, len(every))) if pairs else ():
        first, second = every[int(i)]
        yield first, second


def timing(seeds: range) -> None:
    """Print errors of offsets and drifts of one walking person at 25 frames a second."""
    for duration_s, ppm in ((60.0, 300.0), (180.0, 100.0)):
        errors, found, drifts = [], 0, []
        for seed in seeds:
            rng = np.random.default_rng([seed, 4])
            scene = healthy(seed, rate_hz=25.0, duration_s=duration_s, activities=("walk",))
            offsets = rng.uniform(-3.0, 3.0, len(scene.rig))
            for v in range(1, len(scene.rig)):
                scene, _ = plant(scene, "late", [v], offsets[v])
            scene, _ = plant(scene, "drift", [1], ppm)
            views, _ = measure_sync(*scene.watch(), reference=scene.rig.names[0])
            errors += [25.0 * v.late_s[0] - offsets[i] for i, v in enumerate(views) if i > 1]
            drifts.append(views[1].drift_ppm[0])
            found += bool(views[1].drift_ppm[0])
        print(
            f"{duration_s:.0f} s: offsets err by {np.sqrt(np.mean(np.square(errors))):.3f} frames (at most "
            f"{np.abs(errors).max():.3f}); drift of {ppm:.0f} ppm found {found} of {len(seeds)}, measured "
            f"{np.mean(drifts):.0f} +- {np.std(drifts):.0f}",
            flush=True,
        )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--healthy", type=int, default=300)
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--timing", action="store_true")
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    if arguments.timing:
        timing(seeds)
        return
    for faults in cases(arguments.pairs):
        named, extra, spent = 0, 0, []
        for seed in seeds:
            planted, findings, seconds = check(faults, seed)
            hit = all(is_named(one, findings) for one in planted)
            named, extra = named + hit, extra + len(others(planted, findings))
            spent.append(seconds)
            if not hit:
                print(f"    seed {seed}: {[str(f.kind) + ' ' + ' '.join(f.cameras) for f in findings]}", flush=True)
        said = " + ".join(faults)
        print(f"{said:32} named {named} of {len(seeds)}, others {extra}, {np.median(spent):.1f} s", flush=True)
    false = 0
    for seed in range(arguments.first, arguments.first + arguments.healthy):
        _, findings, _ = check((), seed)
        false += bool(findings)
        if findings:
            print(f"    healthy, seed {seed}: {[str(f) for f in findings]}", flush=True)
    print(f"healthy: {false} false alarms in {arguments.healthy}")


if __name__ == "__main__":
    main()
