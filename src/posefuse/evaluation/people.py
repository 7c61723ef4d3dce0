"""Many people against known positions: who was found, under which name, how far off, how sure.

:func:`posefuse.evaluation.together.people_points` puts a result and its truth on the same frames and keypoints;
:func:`score_people` takes it from there, and takes plain arrays as well.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from posefuse.errors import ResultError, choices
from posefuse.evaluation.consistency import Consistency, consistency, normalised_squares
from posefuse.evaluation.heads import JOINTS, HeadRule, joints_14
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
from posefuse.evaluation.parts import PartScores, part_scores, pck
from posefuse.evaluation.together import Bodies, PeoplePoints

_GATES_M, _PCK_M = (GATE_M, 0.25), (0.05, 0.1, 0.15)


@dataclass(frozen=True)
class ScoringOptions:
    """What is asked of the scores.

    Attributes:
        gates_m: the farthest a match may be; the first is used for everything but the counts of the others. By default
            0.5 and 0.25 m, in proportion for bodies of another size than an adult human's.
        entry_s: recall is also counted without this time after each entry of a person.
        pck_m: distances at which keypoints are correct; by default 5, 10 and 15 cm, in proportion likewise.
        head_rule: of PCP.
    """

    gates_m: tuple[float, ...] | None = None
    entry_s: float = 0.4
    pck_m: tuple[float, ...] | None = None
    head_rule: HeadRule = "none"

    def __post_init__(self) -> None:
        if self.gates_m is not None and (not self.gates_m or min(self.gates_m) <= 0):
            raise ResultError(f"gates_m: expected one distance or more, each above 0 m, got {self.gates_m}.")
        if not self.entry_s >= 0:
            raise ResultError(f"entry_s: expected 0 s or more, got {self.entry_s}.")

    def distances_m(self, scale: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Gates, and distances of PCK, for bodies so large next to an adult human; two digits of those not given."""
        gates, pck = (tuple(float(f"{scale * each:.2g}") for each in usual) for usual in (_GATES_M, _PCK_M))
        return self.gates_m or gates, self.pck_m or pck


@dataclass(frozen=True)
class PersonScores:
    """One person of the truth.

    Attributes:
        name: in the truth.
        counterpart: the person of the result it is over the whole recording, None for nobody.
        n_frames: in which the truth has it.
        tracked_share: of them, matched to anybody.
        named_share: of them, matched to the counterpart.
        mpjpe_mm: mean distance of its keypoints to those of its matches, NaN without.
    """

    name: str
    counterpart: str | None
    n_frames: int
    tracked_share: float
    named_share: float
    mpjpe_mm: float


@dataclass(frozen=True)
class PeopleScores:
    """Everything about a result with many people. Numbers that cannot be had are NaN; ``undefined`` says why.

    Attributes:
        layer: what was compared.
        matched_by: how frames were put together.
        n_frames: compared.
        n_keypoints: compared.
        n_people: of the result.
        n_true_people: of the truth.
        clear: MOTA and its counts, for each gate.
        identity: IDF1 at the first gate.
        hota: with the first gate as its reach.
        recall_after_entry: at the first gate, without the time ``entry_s`` after each entry.
        entry_s: that time.
        people: each person of the truth.
        ghosts: people of the result where nobody is, longest life first.
        mpjpe_mm: mean distance over the keypoints of all matches at the first gate.
        median_mm: likewise the median.
        mpjpe_mm_of: keypoint to its mean distance.
        pck: distance in m to the share of correct keypoints.
        parts: PCP.
        jitter: accelerations.
        bone_variation: median over bones.
        bone_variation_of: bone, as ``a-b``, to how much it changes length.
        nees: of the positions of matched keypoints.
        nees_of: keypoint to its mean.
        undefined: the name of a number to why it is NaN.
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


def score_people(data: PeoplePoints, options: ScoringOptions = ScoringOptions()) -> PeopleScores:
    """All scores of many people.

    Raises:
        ResultError: if the truth has nobody.
    """
    truth_here, here = is_here(data.truth_m), is_here(data.points_m)
    if not truth_here.any():
        raise ResultError("The truth has nobody in these frames; are result and truth of the same recording?")
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
    """Shape (frame, truth, keypoint): how far keypoints of matched people are off, NaN where nobody is matched."""
    apart = mean_distances_m(data.points_m, data.truth_m)
    matches = matches_of(apart, is_here(data.points_m), is_here(data.truth_m), gate_m)
    return 1000.0 * np.linalg.norm(followed(data.points_m, matches.person) - data.truth_m, axis=-1)


def _squares(data: PeoplePoints, matches: Matches, offsets_m: np.ndarray) -> np.ndarray:
    if data.covariance_m2 is None:
        return np.full(offsets_m.shape[:-1], np.nan)
    return normalised_squares(offsets_m, followed(data.covariance_m2, matches.person))


def _late_recall(data: PeoplePoints, matches: Matches, entry_s: float) -> float:
    return math.nan if data.time_s is None else recall_after_entry(matches, data.time_s, entry_s)


def _parts(data: PeoplePoints, rule: HeadRule) -> PartScores:
    ours, true = (joints_14(each.points_m, each.skeleton, rule, data.up_axis) for each in _whole(data))
    return part_scores(ours, true, rule)


def _whole(data: PeoplePoints) -> tuple[Bodies, Bodies]:
    return data.whole or (Bodies(data.skeleton, data.points_m), Bodies(data.skeleton, data.truth_m))


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
    """The same scores, every NaN with its reason."""
    reasons = {path: _reason(path, scores, data) for path in _undefined(asdict(scores), "")}
    return replace(scores, undefined=reasons)


def _undefined(value: object, path: str) -> Iterator[str]:
    """Where NaN stands in nested records, as ``clear.0.motp_mm``."""
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
    """Why a number is not there."""
    top, last = path.split(".")[0], path.split(".")[-1]
    nobody = f"nobody is matched within {scores.clear[0].gate_m:g} m"
    if top == "parts":
        return _why_no_part(path, scores, data)
    if top in ("nees", "nees_of"):
        return "the layer carries no covariance" if data.covariance_m2 is None else "no matched point has a covariance"
    if top in ("jitter", "recall_after_entry") and data.time_s is None:
        return "the frames have no times"
    if top == "recall_after_entry":
        return f"nobody stays for {scores.entry_s:g} s"
    if top == "jitter":
        still = last == "ratio" and scores.jitter.n
        return "the truth stands still" if still else "no point is matched in three frames in a row"
    if top in ("bone_variation", "bone_variation_of"):
        return "no bone is seen twice" if scores.bone_variation_of else "the compared keypoints have no bones"
    if last in ("precision", "id_precision", "false_share"):
        return "the result has nobody in these frames"
    if top == "people":
        there = scores.people[int(path.split(".")[1])].n_frames
        return nobody if there else "the truth does not have this person in these frames"
    return nobody


def _why_no_part(path: str, scores: PeopleScores, data: PeoplePoints) -> str:
    if scores.parts.head_rule == "none" and path.split(".")[-1] in ("8", "9"):
        return "head rule none: there is no head, and no torso that ends at it"
    lacking = [name for name in JOINTS[:12] if name not in _whole(data)[1].skeleton.keypoints]
    if lacking:
        return f"the truth's skeleton has no {choices(lacking)}"
    return "the truth does not have the part in these frames"
