"""``posefuse evaluate``."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from posefuse.cli.console import count, note, percent, say, table, warn
from posefuse.cli.evaluate_angles import evaluate_angles
from posefuse.cli.types import Overwrite, PointsUnit
from posefuse.errors import OptionsError, choices
from posefuse.evaluation.accuracy import Accuracy
from posefuse.evaluation.head_points import HeadRule
from posefuse.evaluation.other_world import OtherWorld, is_scaled
from posefuse.model.options.options import LayerName
from posefuse.model.tracks import TrackState

if TYPE_CHECKING:
    from posefuse.evaluation.people import PeopleScores, ScoringOptions
    from posefuse.evaluation.self_consistency import PersonConsistency, SelfConsistency

StateName = Literal["tentative", "active", "lost"]

UNDEFINED = "-"
"""Text for a number that is not defined."""

_OF_IDENTITIES = {
    "mota", "switches", "fragments", "mostly_tracked", "mostly_lost", "identity", "hota", "recall_after_entry",
    "entry_s", "people", "ghosts", "jitter", "bone_variation", "bone_variation_of", "undefined",
}  # fmt: skip
"""Numbers of :class:`PeopleScores` that follow people over time."""


@dataclass(frozen=True)
class NumbersFile:
    """Flags of the file of numbers."""

    json_file: Annotated[
        Path | None,
        Parameter(name="--json", help="File for the numbers; by default evaluation.json in the result."),
    ] = None
    overwrite: Overwrite = False


@dataclass(frozen=True)
class ScoringFlags:
    """Flags of the scores of several people."""

    head_rule: Annotated[HeadRule, Parameter(help="Keypoints that represent the head in PCP, for several people.")] = (
        "none"
    )
    entry_s: Annotated[
        float, Parameter(help="Time after each entry that the second recall excludes, in s, for several people.")
    ] = 0.4
    gate_m: Annotated[
        tuple[float, ...],
        Parameter(
            help="Maximum mean keypoint distances of a match, in m, for several people; by default 0.5 and 0.25 for "
            "bodies of 1.75 m, and in proportion."
        ),
    ] = ()

    def options(self) -> "ScoringOptions":
        """Return the options of the scores."""
        from posefuse.evaluation.people import ScoringOptions

        return ScoringOptions(self.gate_m or None, entry_s=self.entry_s, head_rule=self.head_rule)


def evaluate(
    result: Annotated[
        Path, Parameter(help="Folder of a result or of a run, reconstruction.nc, or a file of 3D points.")
    ],
    truth: Annotated[
        tuple[Path, ...],
        Parameter(
            help="Ground truth: a truth.nc, a result, or 3D points in any format that posefuse reads, as one file or "
            "one per person; or joint angles (.mot, .sto); without it, the self-consistency of the result."
        ),
    ] = (),
    *,
    length_unit: PointsUnit = None,
    layer: Annotated[LayerName | None, Parameter(help="Layer to evaluate; by default the best one available.")] = None,
    scoring: Annotated[ScoringFlags, Parameter(name="*")] = ScoringFlags(),
    states: Annotated[
        tuple[StateName, ...],
        Parameter(help="Track states to evaluate; by default all frames with points."),
    ] = (),
    max_time_shift_s: Annotated[
        float, Parameter(help="Largest time shift to search between joint angles and a reference, in s.")
    ] = 0.0,
    numbers: Annotated[NumbersFile, Parameter(name="*")] = NumbersFile(),
) -> None:
    """Compare a result with ground truth and write the numbers as JSON.

    Without ground truth, the command evaluates the self-consistency of the result and of its covariances. Joint angles
    are compared with those of the result's .mot files: error, bias, limits of agreement, and a Bland-Altman figure.

    Several people are matched in every frame, and by name over the whole recording.
    """
    from posefuse.evaluation.self_consistency import SelfConsistency, self_consistency
    from posefuse.io.files import must_exist, replacing
    from posefuse.io.motion_tables import is_motion_table
    from posefuse.io.outputs import check_new_files
    from posefuse.io.results.comparable import read_comparable
    from posefuse.pipeline.evaluate_files import evaluate_files

    angles = any(is_motion_table(file) for file in truth)
    refuse_arguments_without_effect(
        angles, length_unit=length_unit, layer=layer, states=states, scoring=scoring, max_time_shift_s=max_time_shift_s
    )
    if angles:
        evaluate_angles(result, truth, max_time_shift_s, numbers.json_file, overwrite=numbers.overwrite)
        return
    opened = read_comparable(must_exist(result, "result"), length_unit)
    path, reconstruction = opened.path, opened.content
    for file in truth:
        must_exist(file, "ground truth")
    target = numbers.json_file or path.parent / "evaluation.json"
    check_new_files([target], overwrite=numbers.overwrite, target="--json")
    reconstruction = replace(reconstruction, options=replace(reconstruction.options, layer=layer))
    if opened.was_aligned:
        note("The result is aligned; it is compared in the calibration's coordinate system.")
    if states:
        from posefuse.evaluation.paired_results import only_in_states

        reconstruction = only_in_states(reconstruction, [TrackState[name.upper()] for name in states])
    if truth:
        scores = evaluate_files(reconstruction, truth, scoring.options(), length_unit=length_unit)
    else:
        scores = self_consistency(reconstruction)
    values = plain(asdict(scores))
    if not reconstruction.has_identities:
        values = without_identities(values)
    with replacing(target) as temporary:
        temporary.write_text(json.dumps(values, indent=2, allow_nan=False) + "\n", "utf-8")
    if isinstance(scores, SelfConsistency):
        show_self_consistency(scores)
    elif isinstance(scores, Accuracy):
        show(scores)
    else:
        show_people(scores, reconstruction.has_identities)
    note(f"Wrote {target}")


def refuse_arguments_without_effect(
    angles: bool,
    *,
    length_unit: str | None,
    layer: str | None,
    states: Sequence[str],
    scoring: ScoringFlags,
    max_time_shift_s: float,
) -> None:
    """Raise :class:`OptionsError` if the command has arguments that this kind of comparison does not use."""
    if angles:
        default = ScoringFlags()
        given = {
            "--length-unit": length_unit is not None,
            "--layer": layer is not None,
            "--states": bool(states),
            "--head-rule": scoring.head_rule != default.head_rule,
            "--entry-s": scoring.entry_s != default.entry_s,
            "--gate-m": scoring.gate_m != default.gate_m,
        }
        reason = "joint angles (.mot, .sto) are compared with the .mot files of the result, which have one layer"
    else:
        given = {"--max-time-shift-s": max_time_shift_s != 0.0}
        reason = "only joint angles (.mot, .sto) are searched for a time shift"
    unused = [flag for flag, is_given in given.items() if is_given]
    if unused:
        raise OptionsError(f"{choices(unused)}: no effect here; {reason}. Leave the argument out.")


def without_identities(value: object) -> object:
    """Return the numbers of :class:`PeopleScores` that are defined for unrelated frames."""
    if isinstance(value, Mapping):
        return {name: without_identities(inner) for name, inner in value.items() if name not in _OF_IDENTITIES}
    return [without_identities(inner) for inner in value] if isinstance(value, list) else value


def plain(value: object) -> object:
    """Return a value that JSON can hold; NaN becomes null."""
    if isinstance(value, Mapping):
        return {str(name): plain(inner) for name, inner in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def show(accuracy: Accuracy) -> None:
    """Print the accuracy of one person."""
    rows = [
        ["compared points", str(accuracy.n_points)],
        ["mean error (MPJPE)", f"{accuracy.mpjpe_mm:.2f} mm"],
        ["median", f"{accuracy.median_mm:.2f} mm"],
        ["90 %", f"{accuracy.p90_mm:.2f} mm"],
        ["95 %", f"{accuracy.p95_mm:.2f} mm"],
        ["99 %", f"{accuracy.p99_mm:.2f} mm"],
        ["beyond 5 cm", percent(accuracy.share_beyond_50_mm)],
        ["missing", percent(accuracy.missing_share)],
    ]
    if accuracy.reprojection_median_px is not None:
        rows.append(["median reprojection error", f"{accuracy.reprojection_median_px:.2f} px"])
    if accuracy.bone_variation is not None:
        rows.append(["bone length variation", percent(accuracy.bone_variation)])
    if accuracy.covered_68 is not None and accuracy.covered_95 is not None:
        rows.append(["inside 68 / 95 % region", f"{percent(accuracy.covered_68)} / {percent(accuracy.covered_95)}"])
    say(
        f"layer {accuracy.layer} against the ground truth, by {accuracy.matched_by}: "
        f"{count(accuracy.n_frames, 'frame')}, {count(accuracy.n_keypoints, 'keypoint')}"
    )
    table(None, ["", ""], rows)
    if accuracy.other_world is not None:
        warn(_other_world(accuracy.other_world))


def _other_world(world: OtherWorld) -> str:
    """Return what to do about a result in another world than the truth."""
    if is_scaled(world):
        return (
            f"The result and the truth have different units of length: scaled by {world.scale:.4g}, rotated and "
            f"shifted, the mean error is {world.mean_mm:.1f} mm. State the unit with --length-unit, or calibrate with "
            "the true size."
        )
    change = (
        "a rotation and a shift" if world.scale == 1.0 else f"a rotation, a shift and a scaling by {world.scale:.4g}"
    )
    return (
        f"The result and the truth are in different worlds: after {change}, the mean error is {world.mean_mm:.1f} mm. "
        "posefuse calibrate --origin-points places cameras in the world of known points."
    )


def show_self_consistency(account: "SelfConsistency") -> None:
    """Print the self-consistency of a result."""
    note(f"layer {account.layer}, self-consistency without ground truth: {count(account.n_frames, 'frame')}")
    variation, reprojection = account.bone_variation, account.reprojection_median_px
    rows = [
        ["median reprojection error", _number(math.nan if reprojection is None else reprojection, "px")],
        ["bone length variation", _share(math.nan if variation is None else variation)],
        ["median acceleration", _number(account.acceleration_m_s2, "m/s²")],
    ]
    if account.innovations is not None:
        values = account.innovations
        rows += [
            ["NIS per degree of freedom, mean", _number(values.mean, "")],
            ["NIS per degree of freedom, median", _number(values.median, "")],
        ]
    table(None, ["", ""], rows)
    heads = ["person", "frames", "missing", "bone variation", "NIS, median"]
    table(None, heads, [_consistency_row(person) for person in account.people])
    if account.innovations is not None:
        note("NIS: normalized innovation squared of the detections; 1 if the covariances are consistent.")


def _consistency_row(person: "PersonConsistency") -> list[str]:
    return [
        person.name,
        str(person.n_frames),
        _share(person.missing_share),
        _share(math.nan if person.bone_variation is None else person.bone_variation),
        _number(math.nan if person.innovations is None else person.innovations.median, ""),
    ]


def show_people(scores: "PeopleScores", identities: bool = True) -> None:
    """Print the scores of several people; in unrelated frames, those that need no identities."""
    note(
        f"layer {scores.layer} against the truth, by {scores.matched_by}: {count(scores.n_frames, 'frame')}, "
        f"{count(scores.n_keypoints, 'keypoint')}, {scores.n_people} people for {scores.n_true_people}"
    )
    heads = ["matched within", *(f"{each.gate_m:g} m" for each in scores.clear)]
    if not identities:
        table(None, heads, _detection_rows(scores))
        table(None, ["", ""], [*_position_rows(scores), *_quality_rows(scores)[2:]])
        note("Frames are unrelated (`people='stills'`), so scores of identities and motion are undefined.")
        return
    table(None, heads, _clear_rows(scores))
    table(None, ["", ""], [*_identity_rows(scores), *_position_rows(scores), *_quality_rows(scores)])
    table(None, ["in the truth", "in the result", "frames", "tracked", "same name", "MPJPE"], _person_rows(scores))
    for reason in dict.fromkeys(scores.undefined.values()):
        note(f"{UNDEFINED} {reason}")


def _clear_rows(scores: "PeopleScores") -> list[list[str]]:
    return [
        ["MOTA", *(_share(each.mota) for each in scores.clear)],
        *_detection_rows(scores),
        ["identity switches", *(str(each.switches) for each in scores.clear)],
        ["fragments", *(str(each.fragments) for each in scores.clear)],
        ["mostly tracked / lost", *(f"{each.mostly_tracked} / {each.mostly_lost}" for each in scores.clear)],
    ]


def _detection_rows(scores: "PeopleScores") -> list[list[str]]:
    return [
        ["MOTP", *(_number(each.motp_mm, "mm") for each in scores.clear)],
        ["recall", *(_share(each.recall) for each in scores.clear)],
        ["missed", *(f"{each.misses} of {each.n_true}" for each in scores.clear)],
        ["false people", *(f"{each.false_people} of {each.n_found}" for each in scores.clear)],
    ]


def _identity_rows(scores: "PeopleScores") -> list[list[str]]:
    longest = scores.ghosts[0].longest if scores.ghosts else 0
    hota = scores.hota
    return [
        ["IDF1", _share(scores.identity.idf1)],
        ["HOTA (detection, association)", f"{_share(hota.hota)} ({_share(hota.det_a)}, {_share(hota.ass_a)})"],
        [f"recall from {scores.entry_s:g} s after entries", _share(scores.recall_after_entry)],
        ["false tracks, longest", f"{len(scores.ghosts)}, {count(longest, 'frame')}"],
    ]


def _position_rows(scores: "PeopleScores") -> list[list[str]]:
    parts = scores.parts
    return [
        ["mean error (MPJPE)", _number(scores.mpjpe_mm, "mm")],
        ["median", _number(scores.median_mm, "mm")],
        [f"keypoints within {' / '.join(scores.pck)} m", " / ".join(_share(share) for share in scores.pck.values())],
        [f"PCP (head rule {parts.head_rule})", _share(parts.average)],
        ["PCP of the first three", _share(parts.average_first_three)],
    ]


def _quality_rows(scores: "PeopleScores") -> list[list[str]]:
    jitter, nees = scores.jitter, scores.nees
    accelerations = f"{_number(jitter.result_m_s2, 'm/s²')} ({_number(jitter.truth_m_s2, 'm/s²')})"
    return [
        ["median acceleration (of the truth)", accelerations],
        ["bone length variation", _share(scores.bone_variation)],
        ["NEES, 3 if consistent", _number(nees.mean, "")],
        ["inside 68 / 95 % region", f"{_share(nees.covered_68)} / {_share(nees.covered_95)}"],
    ]


def _person_rows(scores: "PeopleScores") -> list[list[str]]:
    return [
        [
            person.name,
            person.counterpart or UNDEFINED,
            str(person.n_frames),
            _share(person.tracked_share),
            _share(person.named_share),
            _number(person.mpjpe_mm, "mm"),
        ]
        for person in scores.people
    ]


def _share(share: float) -> str:
    return UNDEFINED if math.isnan(share) else percent(share)


def _number(value: float, unit: str) -> str:
    return UNDEFINED if math.isnan(value) else f"{value:.2f} {unit}".strip()
