"""Identity metrics: MOTA, IDF1, HOTA, and ghosts.

Sources: Bernardin and Stiefelhagen 2008 (MOTA, MOTP), Ristani et al. 2016 (IDF1), Luiten et al. 2021 (HOTA, with the
matching of its published code). Mean keypoint distances replace box overlap.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from posefuse.evaluation.matching import GATE_M, Matches, match_identities

MOSTLY = 0.8
"""Fraction of frames in which a mostly tracked person is matched; a mostly lost one at most 1 minus this."""

THRESHOLDS = tuple(np.round(np.arange(0.05, 0.96, 0.05), 2).tolist())
"""Similarities over which HOTA is averaged."""


@dataclass(frozen=True)
class ClearScores:
    """CLEAR MOT counts at one gate. NaN where undefined.

    Attributes:
        gate_m: largest distance of a match.
        n_true: person-frames of the truth.
        n_found: person-frames of the result.
        matches: person-frames matched.
        misses: unmatched person-frames of the truth (FN).
        false_people: unmatched person-frames of the result (FP).
        switches: number of changes of a person's match, however long the interruption (IDSW).
        fragments: number of matches after frames in which the person was present and missed.
        mostly_tracked: people matched in at least 80 % of their frames.
        mostly_lost: people matched in at most 20 %.
        mota: 1 - (misses + false people + switches) / n_true; may be negative.
        motp_mm: mean distance of the matches.
        recall: matches / n_true.
        precision: matches / n_found.
        false_share: false people / n_found.
    """

    gate_m: float
    n_true: int
    n_found: int
    matches: int
    misses: int
    false_people: int
    switches: int
    fragments: int
    mostly_tracked: int
    mostly_lost: int
    mota: float
    motp_mm: float
    recall: float
    precision: float
    false_share: float


@dataclass(frozen=True)
class IdentityScores:
    """Person-frames with the correct identity, with one assignment for the whole recording.

    Attributes:
        gate_m: largest distance of a match.
        idtp: person-frames in which a person of the truth matches the assigned counterpart.
        idf1: 2 idtp / (n_true + n_found).
        id_precision: idtp / n_found.
        id_recall: idtp / n_true.
    """

    gate_m: float
    idtp: int
    idf1: float
    id_precision: float
    id_recall: float


@dataclass(frozen=True)
class HotaScores:
    """HOTA, averaged over thresholds of the similarity 1 - distance / reach.

    Attributes:
        reach_m: distance of similarity 0.
        hota: geometric mean of the two values below, averaged.
        det_a: detection accuracy: matches over matches, misses and false people.
        ass_a: association accuracy: over the matches, the fraction of both tracks with the same match.
    """

    reach_m: float
    hota: float
    det_a: float
    ass_a: float


@dataclass(frozen=True)
class GhostLife:
    """A person of the result in frames without a person of the truth nearby.

    Attributes:
        person: name.
        frames: number of frames without a person of the truth within the gate.
        longest: longest sequence of such frames.
        ever_matched: whether the person is matched at other times.
    """

    person: str
    frames: int
    longest: int
    ever_matched: bool


def clear_scores(matches: Matches) -> ClearScores:
    """Return MOTA and its components."""
    n_true, n_found = int(matches.true_here.sum()), int(matches.here.sum())
    n = int(matches.is_matched.sum())
    switches = sum(_changes(of_one[of_one >= 0]) for of_one in matches.person.T)
    shares = tracked_shares(matches)
    wrong = n_true - n + n_found - n + switches
    return ClearScores(
        gate_m=matches.gate_m,
        n_true=n_true,
        n_found=n_found,
        matches=n,
        misses=n_true - n,
        false_people=n_found - n,
        switches=switches,
        fragments=int(fragments(matches).sum()),
        mostly_tracked=int((shares >= MOSTLY - 1e-12).sum()),
        mostly_lost=int((shares <= 1.0 - MOSTLY + 1e-12).sum()),
        mota=1.0 - wrong / n_true if n_true else math.nan,
        motp_mm=1000.0 * float(matches.distance_m[matches.is_matched].mean()) if n else math.nan,
        recall=_ratio(n, n_true),
        precision=_ratio(n, n_found),
        false_share=_ratio(n_found - n, n_found),
    )


def _changes(sequence: np.ndarray) -> int:
    return int((sequence[1:] != sequence[:-1]).sum())


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else math.nan


def tracked_shares(matches: Matches) -> np.ndarray:
    """Shape (truth,): fraction of a person's frames with a match, NaN for a person who is never present."""
    there = matches.true_here.sum(axis=0)
    share = np.full(len(there), np.nan)
    np.divide(matches.is_matched.sum(axis=0), there, out=share, where=there > 0)
    return share


def fragments(matches: Matches) -> np.ndarray:
    """Shape (truth,), int64: number of interruptions, without frames of absence."""
    found = np.zeros(matches.person.shape[1], dtype=np.int64)
    for t, there in enumerate(matches.true_here.T):
        matched = matches.is_matched[there, t]
        begins = matched & ~np.concatenate([[False], matched[:-1]])
        found[t] = max(0, int(begins.sum()) - 1)
    return found


def recall_after_entry(matches: Matches, time_s: np.ndarray, entry_s: float) -> float:
    """Return the fraction of matched person-frames of the truth, without those shortly after an entry.

    Args:
        matches: matches of the recording.
        time_s: shape (frame,).
        entry_s: excluded time after an entry, including its first frame.

    Returns:
        A fraction, NaN if no frame counts.
    """
    counted = matches.true_here & (since_entry_s(matches.true_here, time_s) >= entry_s - 1e-9)
    return _ratio(int((matches.is_matched & counted).sum()), int(counted.sum()))


def since_entry_s(here: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Shape (frame, person): time since the person entered, NaN if absent.

    Args:
        here: shape (frame, person), bool.
        time_s: shape (frame,).
    """
    enters = here & ~np.concatenate([np.zeros_like(here[:1]), here[:-1]])
    # Index of the last entry at or before each frame.
    entry = np.maximum.accumulate(np.where(enters, np.arange(len(here))[:, None], 0), axis=0)
    return np.where(here, time_s[:, None] - time_s[entry], np.nan)


def ghosts(matches: Matches, names: Sequence[str]) -> tuple[GhostLife, ...]:
    """Return people of the result in frames without a person of the truth within the gate, longest first."""
    alone = matches.here & ~matches.in_reach
    ever = np.asarray(matches.person_matched.any(axis=0))
    longest, frames = longest_runs(alone), np.asarray(alone.sum(axis=0))
    lives = [GhostLife(names[int(p)], int(frames[p]), int(longest[p]), bool(ever[p])) for p in np.flatnonzero(longest)]
    return tuple(sorted(lives, key=lambda life: (-life.longest, names.index(life.person))))


def longest_runs(flags: np.ndarray) -> np.ndarray:
    """Shape (column,), int64: longest run of true flags per column of (frame, column)."""
    places = np.arange(1, len(flags) + 1)[:, None]
    last_false = np.maximum.accumulate(np.where(flags, 0, places), axis=0)
    return np.where(flags, places - last_false, 0).max(axis=0, initial=0)


def identity_scores(apart_m: np.ndarray, n_true: int, n_found: int, gate_m: float = GATE_M) -> IdentityScores:
    """Return IDF1 and its components.

    Args:
        apart_m: shape (frame, truth, person), NaN if one of them is absent.
        n_true: person-frames of the truth.
        n_found: person-frames of the result.
        gate_m: largest distance of a match.
    """
    person, together = match_identities(apart_m, gate_m)
    named = np.flatnonzero(person >= 0)
    idtp = int(together[named, person[named]].sum())
    return IdentityScores(
        gate_m=gate_m,
        idtp=idtp,
        idf1=_ratio(2 * idtp, n_true + n_found),
        id_precision=_ratio(idtp, n_found),
        id_recall=_ratio(idtp, n_true),
    )


def hota_scores(apart_m: np.ndarray, here: np.ndarray, true_here: np.ndarray, reach_m: float = GATE_M) -> HotaScores:
    """Return HOTA as in its published code: one matching per frame, weighted by the agreement over the recording.

    Args:
        apart_m: shape (frame, truth, person), NaN if one of them is absent.
        here: shape (frame, person), bool.
        true_here: shape (frame, truth), bool.
        reach_m: distance of similarity 0.
    """
    similar = np.clip(1.0 - np.where(np.isfinite(apart_m), apart_m, np.inf) / reach_m, 0.0, None)
    frames, truths, people = _likely_pairs(similar, _alignment(similar, here, true_here))
    n_true, n_found = true_here.sum(axis=0), here.sum(axis=0)
    if not n_true.sum() + n_found.sum():
        return HotaScores(reach_m, math.nan, math.nan, math.nan)
    rows = np.array(
        [
            _at_threshold(similar[frames, truths, people] >= least - 1e-9, truths, people, n_true, n_found)
            for least in THRESHOLDS
        ]
    )
    det_a, ass_a = rows.T
    return HotaScores(reach_m, float(np.sqrt(det_a * ass_a).mean()), float(det_a.mean()), float(ass_a.mean()))


def _alignment(similar: np.ndarray, here: np.ndarray, true_here: np.ndarray) -> np.ndarray:
    """Shape (truth, person): agreement over the recording, independent of the threshold."""
    union = similar.sum(axis=1, keepdims=True) + similar.sum(axis=2, keepdims=True) - similar
    likely = np.divide(similar, union, out=np.zeros_like(similar), where=union > 0).sum(axis=0)
    whole = true_here.sum(axis=0)[:, None] + here.sum(axis=0)[None] - likely
    return np.divide(likely, whole, out=np.zeros_like(likely), where=whole > 0)


def _likely_pairs(similar: np.ndarray, alignment: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return frames, truth indices and person indices of the matched pairs."""
    found = []
    for f in np.flatnonzero((similar > 0).any(axis=(1, 2))):
        truths, people = linear_sum_assignment(alignment * similar[f], maximize=True)
        found.append(np.stack([np.full(len(truths), f), truths, people]))
    frames, truths, people = np.concatenate(found, axis=1) if found else np.empty((3, 0), dtype=np.int64)
    return frames, truths, people


def _at_threshold(
    close: np.ndarray, truths: np.ndarray, people: np.ndarray, n_true: np.ndarray, n_found: np.ndarray
) -> tuple[float, float]:
    """Return DetA and AssA of the pairs above the threshold."""
    together = np.zeros((len(n_true), len(n_found)))
    np.add.at(together, (truths[close], people[close]), 1.0)
    n = float(close.sum())
    union = n_true[:, None] + n_found[None] - together
    association = np.divide(together, union, out=np.zeros_like(together), where=union > 0)
    return n / (n_true.sum() + n_found.sum() - n), float((together * association).sum() / max(n, 1.0))
