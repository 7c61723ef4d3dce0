"""The steps of :mod:`benchmarks.same_numbers`, and the inputs that the base makes once.

A step is written like a command line. ``{data}`` is ``../shared/data``, ``{inputs}`` holds the inputs from the base,
``{out}`` is a new folder for the case. Flags are those of the base; the script translates them for the current tree.
"""

import shlex
from dataclasses import dataclass
from typing import Literal

Kind = Literal["command", "library", "inputs"]


@dataclass(frozen=True)
class Step:
    """One process.

    Attributes:
        words: the command line, with placeholders.
        kind: a posefuse command, a call of the library, or a function that makes inputs.
        printed: whether printed numbers are compared.
        reads, writes: files for standard input and output.
    """

    words: tuple[str, ...]
    kind: Kind = "command"
    printed: bool = False
    reads: str = ""
    writes: str = ""


@dataclass(frozen=True)
class Case:
    """Steps that share a folder.

    Attributes:
        name: name of the case or input.
        steps: steps, run in order.
        needs: required folder of ``../shared/data``; empty if none.
        timeout_s: time limit of each step.
        note: comment for the report.
    """

    name: str
    steps: tuple[Step, ...]
    needs: str = ""
    timeout_s: float = 420.0
    note: str = ""


def run(line: str, printed: bool = False, reads: str = "", writes: str = "") -> Step:
    """Return a step that runs a posefuse command."""
    return Step(tuple(shlex.split(line)), "command", printed, reads, writes)


def printed(line: str) -> Step:
    """Return a step that runs a posefuse command and compares printed numbers."""
    return run(line, printed=True)


def library(line: str) -> Step:
    """Return a step that calls the library."""
    return Step(tuple(shlex.split(line)), "library")


def made(name: str, needs: str = "") -> Case:
    """Return an input that a function makes."""
    return Case(name, (Step((name, "{data}", "{out}"), "inputs"),), needs)


def simulated(name: str, command: str) -> Case:
    """Return an input that a posefuse command simulates."""
    return Case(name, (run(f"{command} --output {{out}}"),))


SIMULATIONS = {
    "one": "simulate --duration-s 20 --lens barrel --detector.swap-share 0.02 --seed 1",
    "late": "simulate --duration-s 12 --layout corners --detector.max-offset-s 0.05 --seed 2",
    "creature": "simulate --skeleton fly_38 --size-m 0.3 --cameras 6 --duration-s 6 --lens fisheye --seed 3",
    "people": "simulate-people --people 4 --duration-s 20 --seed 4",
    "people_ids": "simulate-people --scenario hug --duration-s 16 --faults.track-ids --seed 5",
    "body_133": "simulate-people --skeleton coco_wholebody_133 --people 2 --duration-s 10 --seed 6",
}
INPUTS = (
    *(simulated(name, command) for name, command in SIMULATIONS.items()),
    made("edits"),
    made("mice"),
    made("faults"),
    made("wand"),
    made("frames"),
    made("panoptic_one", "panoptic_motion"),
    made("panoptic_three", "panoptic_three_people"),
    made("outdoor", "mouse_outdoor_12cam"),
)
"""Inputs in order; ``frames`` reads ``people``."""
FAULTS = (
    "healthy", "turned_late", "moved_dropped", "bumped_drift", "focal_confidence", "lens_sides", "rotated_repeated",
    "resized", "order", "copied", "another_rig",
)  # fmt: skip
"""Recordings with faults, made by ``same_numbers_inputs.py``."""
