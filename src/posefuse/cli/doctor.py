"""``posefuse doctor``."""

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from posefuse.cli.console import count, labeled, note, say, warn

if TYPE_CHECKING:
    from posefuse.diagnostics.installation import Installation

EXTRA_OF_COMMAND: Mapping[str, tuple[str, ...]] = {
    "run": ("calibrate", "video"),
    "detect": ("video",),
    "calibrate": ("calibrate",),
    "overlay": ("video",),
    "people": ("video",),
    "view": ("view",),
    "opensim": ("opensim",),
    "batch --scheduler": ("cluster",),
    "batch s3://, gs://": ("cloud",),
    "stream --input nats://": ("live",),
}
"""Extras that commands need, or may need: videos, boards, clusters, object stores and message brokers."""


def doctor(
    *,
    as_json: Annotated[bool, Parameter(name="--json", negative="", help="Print JSON.")] = False,
) -> None:
    """Check the installation: versions, extras, machine, compiled kernels, detectors, and what commands lack.

    Include its output in reports of problems. The exit code is 1 if the core does not work.
    """
    from posefuse.diagnostics.installation import examine_installation

    found = examine_installation()
    problem = _core_problem()
    if as_json:
        say(json.dumps({**asdict(found), "lacking": lacking(found), "problem": problem}, indent=2))
    else:
        _print(found)
        note("The core works." if not problem else f"The core does not work: {problem}")
    if problem:
        sys.exit(1)


def lacking(found: "Installation") -> dict[str, tuple[str, ...]]:
    """Return the extras that are not installed, by the command that needs them."""
    absent = {extra.name for extra in found.extras if extra.missing}
    needed = {command: tuple(e for e in extras if e in absent) for command, extras in EXTRA_OF_COMMAND.items()}
    return {command: extras for command, extras in needed.items() if extras}


def _core_problem() -> str:
    """Return why points cannot be triangulated; empty if they can."""
    import numpy as np

    import posefuse
    from posefuse.skeleton.skeletons import find_skeleton
    from posefuse.synthetic.rigs import build_rig

    try:
        rig = build_rig("ring", 3)
        skeleton = find_skeleton("coco_17")
        points = np.random.default_rng(0).normal((0.0, 0.0, 1.0), 0.3, (1, len(skeleton), 3))
        pixels = np.stack([camera.project(points)[0] for camera in rig.cameras], axis=1)
        people = posefuse.Detections.from_dense(skeleton, rig.names, pixels)
        found = posefuse.triangulate(rig, people).layers["measured"].points_m
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    error_m = float(np.abs(np.asarray(found)[:, 0] - points).max())
    return "" if error_m < 1e-6 else f"Points without noise are triangulated {error_m} m from the truth."


def _print(found: "Installation") -> None:
    versions = dict(found.versions)
    labeled("posefuse", f"{versions.pop('posefuse')}, Python {versions.pop('python')}")
    labeled("packages", ", ".join(f"{name} {version}" for name, version in versions.items()))
    labeled("system", found.system)
    memory = "" if found.memory_gb is None else f", {found.memory_gb:.0f} GB of memory"
    gpu = "NVIDIA GPU for detectors" if found.gpu else "no NVIDIA GPU (only detectors use one)"
    labeled("machine", f"{count(found.cores, 'core')}{memory}, {gpu}")
    labeled("kernels", _stored_kernels(found))
    is_complete = found.prebuilt_mb > 0 and not found.prebuilt_unused
    if found.prebuilt_mb and found.prebuilt_unused:
        labeled("", f"{found.prebuilt_mb:.0f} MB in the package are not used: {found.prebuilt_unused}")
    elif is_complete:
        labeled("", f"{found.prebuilt_mb:.0f} MB in the package")
    if not found.is_cache_writable:
        others = "other kernels" if found.cache or is_complete else "kernels"
        where = f"{found.cache} is read-only" if found.cache else "No folder for kernels is writable"
        warn(f"{where}, so every process compiles {others} again. Set NUMBA_CACHE_DIR to a writable folder.")
    labeled("extras", ", ".join(extra.name for extra in found.extras if not extra.missing) or "none")
    for extra in found.extras:
        if extra.missing:
            labeled("", f"without {extra.name} ({', '.join(extra.missing)}): {extra.command}")
    for i, detector in enumerate(found.detectors):
        how = f": {detector.command}" if detector.command else ""
        labeled("" if i else "detectors", f"{detector.name} {detector.state}{how}")
    for i, (command, extras) in enumerate(lacking(found).items()):
        labeled("" if i else "lacking", f"posefuse {command}: {', '.join(extras)}")


def _stored_kernels(found: "Installation") -> str:
    if not found.cache:
        return "not stored"
    return f"{found.cache_mb:.0f} MB compiled in {found.cache}" if found.cache_mb else f"none compiled in {found.cache}"
