"""Check that numbers do not change: run a base commit and this checkout on the same recordings, and compare all files.

``python -m benchmarks.same_numbers --base COMMIT [--cache FOLDER] [--only NAME ...]``, from the root of a checkout.
Real recordings are those of ``../shared/data``; the base simulates the others once. Every case runs in separate
processes, one at a time, first with the base, then with this checkout. Numbers are compared bit by bit in all files
except pictures and pages. Texts may change; they are counted as renamed labels. ``--cache`` keeps the base's files, so
that the next run needs this checkout only. The exit code is 1 if there is a difference that ``EXPECTED`` does not
allow.
"""

import argparse
import contextlib
import math
import re
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path

from benchmarks.same_numbers_cases import CASES, UNREAD
from benchmarks.same_numbers_compare import Difference, Renamed, Verdict, compare
from benchmarks.same_numbers_files import NOT_COMPARED
from benchmarks.same_numbers_runs import (
    DATA,
    ROOT,
    Tree,
    check_import,
    checkout,
    commit_of,
    is_clean,
    kept,
    last_words,
    run_case,
)
from benchmarks.same_numbers_steps import INPUTS, Case
from posefuse.model.options.aliases import REMOVED as REMOVED_OPTIONS
from posefuse.model.options.aliases import RENAMED as RENAMED_OPTIONS


@dataclass(frozen=True)
class Expected:
    """An allowed difference.

    Attributes:
        case, file, column: patterns, ``*`` for any.
        tolerance: the largest absolute difference, in the column's unit; infinity also allows what is missing or new.
        reason: reason for the difference.
    """

    case: str
    file: str
    column: str
    tolerance: float
    reason: str


FLAGS: dict[str, str] = {
    **{f"--{old}".replace("_", "-"): f"--{new}".replace("_", "-") for old, new in RENAMED_OPTIONS.items()},
    # Units are part of the names of options; all cases give these in meters and as fractions of the focal length.
    "--triangulation.weighted-subsets.target-unit": "",
    "--triangulation.weighted-subsets.target-unit normalised": "",
    "--triangulation.weighted-subsets.target-reprojection-error": "--triangulation.weighted-subsets.target-normalized",
    "--triangulation.ransac.threshold-unit": "",
    "--triangulation.ransac.threshold-unit m": "",
    "--triangulation.ransac.threshold": "--triangulation.ransac.threshold-m",
    "init": "init --all",
}
"""Names of flags, ``flag value`` pairs, commands and options of the library in the base, and the current ones.

For example ``{"--tracker.preset": "--tracker.strategy", "--tracker.preset specification": "scores"}``; for a
``flag value`` pair, the right side is the value alone.
"""
RENAMED: tuple[Renamed, ...] = (
    *(
        Renamed("*", rf"@options(_toml)?:{re.escape(old)}(\[\])?", rf"@resolved_options:{new}\2")
        for old, new in RENAMED_OPTIONS.items()
    ),
    Renamed("*", r"@options(_toml)?:(.*)", r"@resolved_options:\2"),
    *(Renamed("*.toml", rf"{re.escape(old)}(\[\])?", rf"{new}\1") for old, new in RENAMED_OPTIONS.items()),
    Renamed("*", r"@rig_metres_per_unit", r"@rig_meters_per_unit"),
    Renamed("*/posefuse.json", r"source\.modelled", r"source.modeled"),
    Renamed("*/batch.json", "", "fingerprint.json"),
    Renamed("*/batch.json", r"(numbers|statistics)\.(.*)", r"remembered.statistics.\2"),
)
"""Renamed files, columns and variables; the first matching rule applies.

For example ``Renamed("*.nc", r"(.*)_view_error", r"\\1_view_residual")``.
"""
EXPECTED: tuple[Expected, ...] = (
    *(Expected("*", "*", f"@options*:{name}", math.inf, "the option had no effect") for name in REMOVED_OPTIONS),
    Expected("*", "*", "new @options*", math.inf, "the requested options are stored besides the resolved ones"),
    Expected("*", "*", "new @resolved_options:*", math.inf, "constants of the tracker became options"),
    Expected("batch", "options.toml", "new tracker.*", math.inf, "constants of the tracker became options"),
    Expected("batch", "options.toml", "new association.rpt.*", math.inf, "constants of a method became options"),
    *(Expected("batch", "options.toml", name, math.inf, "the option had no effect") for name in REMOVED_OPTIONS),
    Expected("batch", "options.toml", "start_s", 1.0, "a commented example, not a default"),
    Expected("batch", "options.toml", "end_s", 11.0, "a commented example, not a default"),
    Expected("batch", "options.toml", "align.height_m", 0.8, "a commented example, not a default"),
    Expected("caliscope_webcams", "step_6.txt", "numbers", math.inf, "a note names time 0"),
    Expected("faults", "step_6.txt", "numbers", math.inf, "'rotated by 180 degrees' instead of 'upside down'"),
    Expected("simulated_late", "step_3.txt", "numbers", 1.25, "an early view has a negative offset instead of a word"),
    Expected("pose2sim_align", "opensim/*", "*", 1e-12, "one sample of points determines scale and world"),
    Expected("*", "*", "new @findings*", math.inf, "findings are stored in the result"),
)
"""Allowed differences."""
MOST_LINES, MOST_COLUMNS = 30, 3
"""Largest number of printed lines per case, and of columns per line."""


@dataclass
class Outcome:
    """Outcome of a case: the reason for skipping it, or the verdicts on its files."""

    case: Case
    skipped: str = ""
    base: dict = field(default_factory=dict)
    current: dict = field(default_factory=dict)
    verdicts: list[Verdict] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    allowed: int = 0


def allowed_by(case: str, file: str, difference: Difference) -> Expected | None:
    """Return the first entry of ``EXPECTED`` that allows a difference."""
    for each in EXPECTED:
        names = ((case, each.case), (file, each.file), (difference.column, each.column))
        if all(fnmatch(name, pattern) for name, pattern in names) and difference.absolute <= each.tolerance:
            return each
    return None


def current_name(file: str) -> str:
    """Return the name of a file in the current tree."""
    for rule in RENAMED:
        if not rule.base and fnmatch(file, rule.file):
            return str(Path(file).with_name(rule.current))
    return file


def files_of(folder: Path) -> set[str]:
    """Return the paths of all compared files in a case."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.suffix not in NOT_COMPARED)
    return {path.relative_to(folder).as_posix() for path in files}


def judge(outcome: Outcome, base: Path, current: Path, parse: bool) -> None:
    """Compare all files of a case, and print one line for each difference."""
    name, ours, theirs = outcome.case.name, files_of(base), files_of(current)
    for number, (one, other) in enumerate(zip(outcome.base["steps"], outcome.current["steps"], strict=True)):
        if one["exit"] != other["exit"]:
            why = f"{one['exit']} became {other['exit']}: {last_words(current, number)}"
            _fail(outcome, f"step {number}", Difference("exit code", why))
    for file in sorted(ours):
        now = current_name(file)
        if now not in theirs:
            _fail(outcome, file, Difference("file", "is missing"))
            continue
        try:
            verdict = compare(base / file, current / now, file, RENAMED, parse)
        except (ValueError, OSError, KeyError) as error:
            _fail(outcome, file, Difference("file", f"cannot be read: {error}"))
            continue
        outcome.verdicts.append(verdict)
        wrong = [found for found in verdict.differences if not allowed_by(name, file, found)]
        outcome.allowed += len(verdict.differences) - len(wrong)
        if wrong:
            _fail(outcome, file, *sorted(wrong, key=lambda found: found.rank, reverse=True))
    for file in sorted(theirs - {current_name(each) for each in ours}):
        _fail(outcome, file, Difference("file", "is new"))
    same = len(outcome.verdicts) - sum(bool(v.differences) for v in outcome.verdicts)
    bits = sum(v.identical for v in outcome.verdicts)
    if len(outcome.failures) > MOST_LINES:
        print(f"differs  {name}: and {len(outcome.failures) - MOST_LINES} more files")
    print(f"equal    {name}: {same} of {len(ours)} files, {bits} of them byte by byte", flush=True)


def _fail(outcome: Outcome, file: str, *found: Difference) -> None:
    """Print one line for a file that differs, with its worst columns."""
    if all(allowed_by(outcome.case.name, file, each) for each in found):
        outcome.allowed += len(found)
        return
    outcome.failures.append(file)
    if len(outcome.failures) > MOST_LINES:
        return
    columns = "; ".join(map(str, found[:MOST_COLUMNS]))
    more = f"; and {len(found) - MOST_COLUMNS} more columns" if len(found) > MOST_COLUMNS else ""
    print(f"differs  {outcome.case.name}: {file}: {columns}{more}", flush=True)


def absent(case: Case) -> str:
    """Return the reason why a case cannot be run, or an empty string."""
    if case.needs and not (DATA / case.needs).is_dir():
        return f"no ../shared/data/{case.needs}"
    return ""


def needed_inputs(cases: Sequence[Case]) -> list[Case]:
    """Return the inputs of cases, and the inputs of these."""
    words = " ".join(word for case in cases for step in case.steps for word in step.words)
    names = set(re.findall(r"\{inputs\}/(\w+)", words))
    names |= {"people"} if "frames" in names else set()
    return [each for each in INPUTS if each.name in names and not absent(each)]


def make_base(cases: Sequence[Case], commit: str, cache: Path, given: Path | None) -> None:
    """Run the base for inputs and cases that the cache lacks."""
    inputs, outputs = cache / "inputs", cache / "outputs"
    todo = [(each, inputs) for each in needed_inputs(cases) if kept(each, inputs / each.name) is None]
    todo += [(case, outputs) for case in cases if kept(case, outputs / case.name) is None]
    if not todo:
        return
    with contextlib.nullcontext(given) if given else checkout(commit) as root:
        tree = Tree(root, cache / "kernels")
        check_import(tree)
        for case, place in todo:
            done = run_case(case, tree, inputs, place / case.name)
            print(f"base     {case.name}: {_spent(done):.0f} s, exit {_exits(done)}", flush=True)
            if place == inputs and any(step["exit"] != 0 for step in done["steps"]):
                sys.exit(f"The base could not make the input {case.name}: see {place / case.name}.logs")


def _spent(record: dict) -> float:
    return sum(step["cpu_s"] for step in record.get("steps", ()))


def _exits(record: dict) -> str:
    return " ".join(dict.fromkeys(str(step["exit"]) for step in record["steps"]))


def run_current(cases: Sequence[Case], cache: Path, room: Path, parse: bool) -> list[Outcome]:
    """Run this checkout case by case, and compare the files."""
    tree = Tree(ROOT, cache / "kernels", FLAGS)
    check_import(tree)
    outcomes = []
    for case in cases:
        base, current = cache / "outputs" / case.name, room / case.name
        outcome = Outcome(case, base=kept(case, base) or {})
        outcome.current = run_case(case, tree, cache / "inputs", current)
        judge(outcome, base, current, parse)
        outcomes.append(outcome)
    return outcomes


def report(outcomes: Sequence[Outcome], commit: str) -> int:
    """Print the final table; return 1 if there is a difference that is not allowed."""
    print(f"\nBase {commit[:12]}. CPU seconds include compiling kernels that were not cached.")
    print("| case | files | numbers read | differ | allowed | renamed labels | base exit | base s | current s |")
    print("|---|---|---|---|---|---|---|---|---|")
    for each in outcomes:
        if each.skipped:
            print(f"| {each.case.name} | skipped: {each.skipped} |")
            continue
        labels, read = sum(v.labels.total() for v in each.verdicts), sum(v.numbers for v in each.verdicts)
        print(
            f"| {each.case.name} | {len(each.verdicts)} | {read} | {len(each.failures)} | {each.allowed} | {labels} | "
            f"{_exits(each.base)} | {_spent(each.base):.0f} | {_spent(each.current):.0f} |"
        )
    for each in outcomes:
        if each.case.note:
            print(f"{each.case.name}: {each.case.note}")
    for name, reason in UNREAD.items():
        print(f"{name}: not read: {reason}.")
    failed = [each.case.name for each in outcomes if each.failures]
    print(f"Differs: {', '.join(failed)}." if failed else "All numbers are the same, or differ as expected.")
    return int(bool(failed))


def print_labels(outcomes: Sequence[Outcome], most: int = 5) -> None:
    """Print the most frequent changes of texts by file."""
    for each in outcomes:
        for verdict in each.verdicts:
            for (old, new), count in verdict.labels.most_common(most):
                print(f"label    {each.case.name}: {verdict.file}: {count} x {old[:80]!r} -> {new[:80]!r}")


def main() -> int:
    """Run both trees, compare the files, and print a report."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--base", required=True, help="commit to compare with")
    parser.add_argument("--base-tree", type=Path, help="a clean checkout of the base commit; temporary by default")
    parser.add_argument("--cache", type=Path, help="folder that keeps the files of the base")
    parser.add_argument("--keep", type=Path, help="folder that keeps the files of this checkout")
    parser.add_argument("--only", nargs="+", default=["*"], help="patterns of case names")
    parser.add_argument("--base-only", action="store_true", help="fill the cache without comparing")
    parser.add_argument("--parse", action="store_true", help="read files even if their bytes are equal")
    parser.add_argument("--labels", action="store_true", help="print the texts that changed")
    given = parser.parse_args()
    commit = commit_of(ROOT, given.base)
    if given.base_tree and not is_clean(given.base_tree, commit):
        parser.error(f"--base-tree is not at {given.base}, or has changes.")
    chosen = [case for case in CASES if any(fnmatch(case.name, pattern) for pattern in given.only)]
    ready = [case for case in chosen if not absent(case)]
    with tempfile.TemporaryDirectory(prefix="posefuse-same-") as room:
        cache = (given.cache or Path(room) / "cache").resolve() / commit[:12]
        make_base(ready, commit, cache, given.base_tree and given.base_tree.resolve())
        if given.base_only:
            return 0
        outcomes = run_current(ready, cache, (given.keep or Path(room) / "current").resolve(), given.parse)
    if given.labels:
        print_labels(outcomes)
    return report([*outcomes, *(Outcome(case, absent(case)) for case in chosen if case not in ready)], commit)


if __name__ == "__main__":
    sys.exit(main())
