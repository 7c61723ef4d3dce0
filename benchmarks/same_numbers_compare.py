"""Compare two files number by number, for :mod:`benchmarks.same_numbers`."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

from benchmarks.same_numbers_files import Content, read

_DIAGONAL = (0, 3, 5)
"""Diagonal entries of a covariance stored as xx, xy, xz, yy, yz, zz."""
_TIMES = re.compile(r"(^|[._])(cpu|wall|elapsed|took|seconds|ms_per_frame)(_s|_ms)?$")
"""Names of numbers that differ between runs."""


@dataclass(frozen=True)
class Renamed:
    """A file, column or variable with another name in the current tree.

    Attributes:
        file: pattern of the file's path in the base's case.
        base: regular expression of the whole name; empty if the file itself is renamed.
        current: the current name, with groups of the expression; for a file, its current name.
    """

    file: str
    base: str
    current: str


@dataclass(frozen=True)
class Difference:
    """A variable or column that differs.

    Attributes:
        column: its name in the base; for one that only the current tree has, ``new`` and its name.
        what: description.
        absolute, relative: the largest differences; infinite if they cannot be compared.
        share: the largest ratio of the difference to the standard deviation; NaN without one.
        count, size: number of values that differ, and of all values.
    """

    column: str
    what: str
    absolute: float = np.inf
    relative: float = np.inf
    share: float = np.nan
    count: int = 0
    size: int = 0

    @property
    def rank(self) -> tuple[float, float]:
        """Sort key: first what cannot be compared, then the largest ratio to the standard deviation."""
        lacking = np.isinf(self.absolute)
        return (np.inf if lacking else np.nan_to_num(self.share, nan=0.0), self.absolute)

    def __str__(self) -> str:
        if not np.isfinite(self.absolute):
            return f"{self.column}: {self.what}"
        share = "" if np.isnan(self.share) else f", {self.share:.2g} of its standard deviation"
        return (
            f"{self.column}: {self.count} of {self.size} differ, by {self.absolute:.3g} at most "
            f"({self.relative:.2g} relative{share}){self.what}"
        )


@dataclass
class Verdict:
    """Result of comparing a file.

    Attributes:
        file: its path in the case.
        numbers: number of compared values; 0 if the bytes are equal and the file was not read.
        differences: differences of numbers.
        labels: pairs of texts that differ, with counts.
        identical: whether the bytes are equal.
    """

    file: str
    numbers: int = 0
    differences: list[Difference] = field(default_factory=list)
    labels: Counter[tuple[str, str]] = field(default_factory=Counter)
    identical: bool = False


def compare(base: Path, current: Path, file: str, renamed: Sequence[Renamed], parse: bool = False) -> Verdict:
    """Compare two files.

    Args:
        base: path of the base's file.
        current: path of the current tree's file.
        file: path of the base's file in its case.
        renamed: rules for names.
        parse: read the files even if their bytes are equal.
    """
    verdict = Verdict(file, identical=base.read_bytes() == current.read_bytes())
    if verdict.identical and not parse:
        return verdict
    ours, theirs = read(base), read(current)
    rules = [rule for rule in renamed if rule.base and fnmatch(file, rule.file)]
    names = {name: _new_name(name, rules) for name in (*ours.numbers, *ours.labels)}
    _compare_numbers(ours, theirs, names, verdict)
    _compare_labels(ours, theirs, names, verdict)
    _compare_inner(ours, theirs, rules, verdict)
    return verdict


def _new_name(name: str, rules: Sequence[Renamed]) -> str:
    for rule in rules:
        if re.fullmatch(rule.base, name):
            return re.sub(rule.base, rule.current, name)
    return name


def _compare_numbers(ours: Content, theirs: Content, names: dict[str, str], verdict: Verdict) -> None:
    for name, values in ours.numbers.items():
        other = theirs.numbers.get(names[name])
        if _TIMES.search(name):
            continue
        verdict.numbers += values.size
        if other is None:
            alike = [n for n, v in theirs.numbers.items() if n not in ours.numbers and difference(n, values, v) is None]
            verdict.differences.append(Difference(name, f"is missing{f'; {alike[0]} is the same' if alike else ''}"))
        elif found := difference(name, values, other, standard_deviation(name, ours.numbers)):
            verdict.differences.append(found)
    for name in theirs.numbers.keys() - {names[each] for each in ours.numbers}:
        verdict.differences.append(Difference(f"new {name}", "is new"))


def difference(name: str, ours: np.ndarray, theirs: np.ndarray, sd: np.ndarray | None = None) -> Difference | None:
    """Return the difference of two arrays; None if dtype, shape and all bits are equal. All NaN are equal."""
    if ours.shape != theirs.shape:
        if ours.ndim == theirs.ndim == 1:
            return _multiset(name, ours, theirs)
        return Difference(name, f"shape {ours.shape} became {theirs.shape}")
    if ours.dtype != theirs.dtype:
        return Difference(name, f"dtype {ours.dtype} became {theirs.dtype}")
    if ours.tobytes() == theirs.tobytes():
        return None
    a, b = ours.astype(np.float64), theirs.astype(np.float64)
    other = ~((a == b) & (np.signbit(a) == np.signbit(b)) | (np.isnan(a) & np.isnan(b)))
    if not other.any():
        return None
    with np.errstate(all="ignore"):
        off = np.abs(a - b)
        missing = np.isnan(off) & other
        off = np.where(other, np.where(np.isnan(off), 0.0, off), 0.0)
        relative = np.nan_to_num(off / np.maximum(np.abs(a), np.abs(b)), nan=0.0)
        share = np.nan
        if sd is not None and sd.shape == off.shape and (known := (off > 0) & (sd > 0)).any():
            share = float((off / sd)[known].max())
    place = np.unravel_index(int(off.argmax()), off.shape)
    words = f" at {tuple(map(int, place))}" + (f"; {int(missing.sum())} missing in one only" if missing.any() else "")
    worst = np.inf if missing.any() else float(off.max())
    found = Difference(name, words, float(off.max()), float(relative.max()), share, int(other.sum()), off.size)
    return found if np.isfinite(worst) else Difference(name, str(found).partition(": ")[2])


def _multiset(name: str, ours: np.ndarray, theirs: np.ndarray) -> Difference:
    a, b = Counter(ours.tolist()), Counter(theirs.tolist())
    lost, added = (a - b).total(), (b - a).total()
    return Difference(
        name, f"{ours.size} values became {theirs.size}: {lost} are not found again, {added} are new", size=ours.size
    )


def standard_deviation(name: str, numbers: dict[str, np.ndarray]) -> np.ndarray | None:
    """Return the standard deviation of a variable that the file stores; None without one."""
    for old, new in (("position", "covariance"), ("keypoints_m", "covariance_m2"), ("points_m", "covariance_m2")):
        beside = numbers.get(name.replace(old, new)) if old in name else None
        if beside is not None and beside.shape[-1:] == (6,):
            return np.sqrt(beside[..., _DIAGONAL])
        if beside is not None and beside.shape == (2 * numbers[name].size,):
            return np.sqrt(beside.reshape(-1, 6)[:, _DIAGONAL].ravel())
    head, _, tail = name.rpartition(".")
    for other in (f"{name}_sd", f"{head}.sd_{tail}" if head else f"sd_{tail}", re.sub("^median", "sd", name)):
        if other != name and other in numbers:
            return numbers[other]
    return None


def _compare_labels(ours: Content, theirs: Content, names: dict[str, str], verdict: Verdict) -> None:
    """Count every changed text; texts may change."""
    for name, texts in ours.labels.items():
        others = theirs.labels.get(names[name])
        if others is None:
            verdict.labels[name, "(missing)"] += 1
        elif len(texts) == len(others):
            verdict.labels.update((a, b) for a, b in zip(texts, others, strict=True) if a != b)
        else:
            verdict.labels[f"{name}: {len(texts)} texts", f"{len(others)} texts"] += 1
    for name in theirs.labels.keys() - {names[each] for each in ours.labels}:
        verdict.labels["(missing)", name] += 1


def _compare_inner(ours: Content, theirs: Content, rules: Sequence[Renamed], verdict: Verdict) -> None:
    """Compare the numbers of documents inside attributes, such as options; renamed keys follow the rules."""
    names = {name: _new_name(name, rules) for name in ours.inner}
    for name, values in ours.inner.items():
        other = theirs.inner.get(names[name])
        verdict.numbers += values.size
        if other is None:
            verdict.differences.append(Difference(name, "is missing"))
        elif found := difference(name, values, other):
            verdict.differences.append(found)
    verdict.differences += [Difference(f"new {name}", "is new") for name in theirs.inner.keys() - names.values()]
