"""Scores of several people against ground truth: detection, identity, position errors and consistency.

:func:`posefuse.evaluation.paired_results.people_points` pairs a result and its truth on common frames and keypoints;
:func:`score_people` scores the pair. Plain arrays are accepted too.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import ResultError, choices
from posefuse.evaluation.consistency import Consistency, consistency, normalized_squares
from posefuse.evaluation.head_points import JOINTS, HeadRule, joints_14
from posefuse.evaluation.identity import (
    ClearScores,
    GhostLife,
    HotaScores,
    IdentityScores,
    clear_scores,
    ghosts,
    hota_scores,
    identity_scores,
    recall_after_entry,
    tracked_shares,
)
from posefuse.evaluation.matching import (
    GATE_M,
    Matches,
    followed,
    is_here,
    match_identities,
    matches_of,
    mean_distances_m,
)
from posefuse.evaluation.motion import Jitter, bone_spreads, jitter
from posefuse.evaluation.paired_results import KeypointSet, PeoplePoints
from posefuse.evaluation.pcp import PartScores, part_scores, pck

_GATES_M, _PCK_M = (GATE_M, 0.25), (0.05, 0.1, 0.15)


@checked
@dataclass(frozen=True)
class ScoringOptions:
    """Options of the scores.

    Attributes:
        gates_m: largest distances of a match; the first one is used for everything except the counts of the others.
            Default: 0.5 and 0.25 m, scaled with the body size.
        entry_s: time after each entry that one of the recall figures excludes.
        pck_m: distances at which keypoints are correct; default: 5, 10 and 15 cm, scaled with the body size.
        head_rule: head rule of PCP.
    """

    gates_m: tuple[float, ...] | None = None
    entry_s: float = 0.4
    pck_m: tuple[float, ...] | None = None
    head_rule: HeadRule = "none"

    def __post_init__(self) -> None:
        if self.gates_m is not None and (not self.gates_m or min(self.gates_m) <= 0):
            raise ResultError(f"gates_m: expected one or more distances above 0 m, got {self.gates_m}.")
        if not self.entry_s >= 0:
            raise ResultError(f"entry_s: expected 0 s or more, got {self.entry_s}.")

    def distances_m(self, scale: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return gates and PCK distances for bodies of a given scale; defaults are rounded to two digits."""
        gates, pck = (tuple(float(f"{scale * each:.2g}") for each in default) for default in (_GATES_M, _PCK_M))
        return self.gates_m or gates, self.pck_m or pck


@dataclass(frozen=True)
class PersonScores:
    """Scores of one person of the truth.

    Attributes:
        name: name in the truth.
        counterpart: assigned person of the result over the whole recording, None without one.
        n_frames: number of frames with the person.
        tracked_share: fraction of frames with any match.
        named_share: fraction of frames matched with the counterpart.
        mpjpe_mm: mean distance of the keypoints to those of the matches, NaN without.
    """

    name: str
    counterpart: str | None
    n_frames: int
    tracked_share: float
    named_share: float
    mpjpe_mm: float


@dataclass(frozen=True)
class PeopleScores:
    """All scores of a result with several people. Undefined numbers are NaN; ``undefined`` gives the reason.

    Attributes:
        layer: compared layer.
        matched_by: how frames were matched.
        n_frames: number of compared frames.
        n_keypoints: number of compared keypoints.
        n_people: number of people in the result.
        n_true_people: number of people in the truth.
        clear: MOTA and its counts, per gate.
        identity: IDF1 at the first gate.
        hota: HOTA with the first gate as its reach.
        recall_after_entry: recall at the first gate without the time ``entry_s`` after each entry.
        entry_s: excluded time after an entry.
        people: one record per person of the truth.
        ghosts: people of the result without a person of the truth nearby, longest first.
        mpjpe_mm: mean distance over the keypoints of all matches at the first gate.
        median_mm: median distance over the same keypoints.
        mpjpe_mm_of: keypoint to its mean distance.
        pck: distance in m to the fraction of correct keypoints.
        parts: PCP.
        jitter: accelerations.
        bone_variation: median variation over bones.
        bone_variation_of: bone, as ``a-b``, to its variation.
        nees: NEES of the positions of matched keypoints.
        nees_of: keypoint to its mean NEES.
        undefined: name of a number to the reason why it is NaN.
    """

    layer: str
    matched_by: str
    n_frames: int
    n_keypoints: int
    n_people: int
    n_true_people: int
    clear: tuple[ClearScores, ...]
    identity: IdentityScores
    hota: HotaScores
    recall_after_entry: float
    entry_s: float
    people: tuple[PersonScores, ...]
    ghosts: tuple[GhostLife, ...]
    mpjpe_mm: float
    median_mm: float
    mpjpe_mm_of: Mapping[str, float]
    pck: Mapping[str, float]
    parts: PartScores
    jitter: Jitter
    bone_variation: float
    bone_variation_of: Mapping[str, float]
    nees: Consistency
    nees_of: Mapping[str, float]
    undefined: Mapping[str, str] = field(default_factory=dict)


@checked
def score_people(data: PeoplePoints, options: ScoringOptions = ScoringOptions()) -> PeopleScores:
    """Return all scores of several people.

    Raises:
        ResultError: if the truth contains no person.
    """
    truth_here, here = is_here(data.truth_m), is_here(data.points_m)
    if not truth_here.any():
        raise ResultError(
            "The truth contains no person in these frames. Check that result and truth are from the same recording."
        )
    apart = mean_distances_m(data.points_m, data.truth_m)
    gates_m, pck_m = options.distances_m(data.scale)
    gates = [matches_of(apart, here, truth_here, gate) for gate in gates_m]
    first, gate = gates[0], gates_m[0]
    ours = followed(data.points_m, first.person)
    errors_mm = 1000.0 * np.linalg.norm(ours - data.truth_m, axis=-1)
    squares = _squares(data, first, ours - data.truth_m)
    keypoints = data.skeleton.keypoints
    spreads = bone_spreads(data.points_m, data.skeleton.edge_indices)
    shares = pck(ours, data.truth_m, pck_m)
    clear = tuple(clear_scores(each) for each in gates)
    scores = PeopleScores(
        layer=data.layer,
        matched_by=data.matched_by,
        n_frames=len(data.points_m),
        n_keypoints=len(keypoints),
        n_people=len(data.person_ids),
        n_true_people=len(data.truth_ids),
        clear=clear,
        identity=identity_scores(apart, clear[0].n_true, clear[0].n_found, gate),
        hota=hota_scores(apart, here, truth_here, gate),
        recall_after_entry=_late_recall(data, first, options.entry_s),
        entry_s=options.entry_s,
        people=_each_person(data, first, apart, errors_mm),
        ghosts=ghosts(first, data.person_ids),
        mpjpe_mm=_mean(errors_mm),
        median_mm=_median(errors_mm),
        mpjpe_mm_of={name: _mean(errors_mm[..., k]) for k, name in enumerate(keypoints)},
        pck={f"{limit:g}": share for limit, share in zip(pck_m, shares, strict=True)},
        parts=_parts(data, options.head_rule),
        jitter=_jitter(data, first, ours),
        bone_variation=_median(spreads),
        bone_variation_of={
            f"{a}-{b}": float(spread) for (a, b), spread in zip(data.skeleton.edges, spreads, strict=True)
        },
        nees=consistency(squares, 3),
        nees_of={name: _mean(squares[..., k]) for k, name in enumerate(keypoints)},
    )
    return _with_reasons(scores, data)


def matched_errors_mm(data: PeoplePoints, gate_m: float = GATE_M) -> np.ndarray:
    """Shape (frame, truth, keypoint): errors of the keypoints of matched people, NaN without a match."""
    apart = mean_distances_m(data.points_m, data.truth_m)
    matches = matches_of(apart, is_here(data.points_m), is_here(data.truth_m), gate_m)
    return 1000.0 * np.linalg.norm(followed(data.points_m, matches.person) - data.truth_m, axis=-1)


def _squares(data: PeoplePoints, matches: Matches, offsets_m: np.ndarray) -> np.ndarray:
    if data.covariance_m2 is None:
        return np.full(offsets_m.shape[:-1], np.nan)
    return normalized_squares(offsets_m, followed(data.covariance_m2, matches.person))


def _late_recall(data: PeoplePoints, matches: Matches, entry_s: float) -> float:
    return math.nan if data.time_s is None else recall_after_entry(matches, data.time_s, entry_s)


def _parts(data: PeoplePoints, rule: HeadRule) -> PartScores:
    ours, true = (joints_14(each.points_m, each.skeleton, rule, data.up_axis) for each in _whole(data))
    return part_scores(ours, true, rule)


def _whole(data: PeoplePoints) -> tuple[KeypointSet, KeypointSet]:
    return data.whole or (KeypointSet(data.skeleton, data.points_m), KeypointSet(data.skeleton, data.truth_m))


def _jitter(data: PeoplePoints, matches: Matches, ours: np.ndarray) -> Jitter:
    if data.time_s is None:
        return Jitter(math.nan, math.nan, math.nan, 0)
    return jitter(ours, data.truth_m, matches.person, data.time_s)


def _each_person(
    data: PeoplePoints, matches: Matches, apart: np.ndarray, errors_mm: np.ndarray
) -> tuple[PersonScores, ...]:
    counterpart, _ = match_identities(apart, matches.gate_m)
    shares = tracked_shares(matches)
    found = []
    for t, name in enumerate(data.truth_ids):
        n, other = int(matches.true_here[:, t].sum()), int(counterpart[t])
        named = (matches.person[:, t] == other).sum() if other >= 0 else 0
        found.append(
            PersonScores(
                name=name,
                counterpart=data.person_ids[other] if other >= 0 else None,
                n_frames=n,
                tracked_share=float(shares[t]),
                named_share=float(named / n) if n else math.nan,
                mpjpe_mm=_mean(errors_mm[:, t]),
            )
        )
    return tuple(found)


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else math.nan


def _with_reasons(scores: PeopleScores, data: PeoplePoints) -> PeopleScores:
    """Return the scores with a reason for every NaN."""
    reasons = {path: _reason(path, scores, data) for path in _undefined(asdict(scores), "")}
    return replace(scores, undefined=reasons)


def _undefined(value: object, path: str) -> Iterator[str]:
    """Yield the paths of NaN in nested records, such as ``clear.0.motp_mm``."""
    if isinstance(value, Mapping):
        items = value.items()
    elif isinstance(value, (tuple, list)):
        items = enumerate(value)
    else:
        if isinstance(value, float) and math.isnan(value):
            yield path
        return
    for name, inner in items:
        yield from _undefined(inner, f"{path}.{name}" if path else str(name))


def _reason(path: str, scores: PeopleScores, data: PeoplePoints) -> str:
    """Return the reason why a number is undefined."""
    top, last = path.split(".")[0], path.split(".")[-1]
    no_match = f"no person is matched within {scores.clear[0].gate_m:g} m"
    if top == "parts":
        return _why_no_part(path, scores, data)
    if top in ("nees", "nees_of"):
        return "the layer carries no covariance" if data.covariance_m2 is None else "no matched point has a covariance"
    if top in ("jitter", "recall_after_entry") and data.time_s is None:
        return "the frames have no times"
    if top == "recall_after_entry":
        return f"no person stays for {scores.entry_s:g} s"
    if top == "jitter":
        still = last == "ratio" and scores.jitter.n
        return "the truth does not move" if still else "no point is matched in three consecutive frames"
    if top in ("bone_variation", "bone_variation_of"):
        return "no bone is seen twice" if scores.bone_variation_of else "the compared keypoints have no bones"
    if last in ("precision", "id_precision", "false_share"):
        return "the result contains no person in these frames"
    if top == "people":
        there = scores.people[int(path.split(".")[1])].n_frames
        return no_match if there else "the truth does not have this person in these frames"
    return no_match


def _why_no_part(path: str, scores: PeopleScores, data: PeoplePoints) -> str:
    if scores.parts.head_rule == "none" and path.split(".")[-1] in ("8", "9"):
        return "head rule none: head and torso are undefined"
    lacking = [name for name in JOINTS[:12] if name not in _whole(data)[1].skeleton.keypoints]
    if lacking:
        return f"the truth's skeleton has no {choices(lacking)}"
    return "the truth does not have the part in these frames"
