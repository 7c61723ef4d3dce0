"""The verdict on a result: its level, the sentence that explains it, and what to do next."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from posefuse.diagnostics.view_agreement import DISAGREEMENT
from posefuse.diagnostics.view_shifts import SHIFTED_VIEWS
from posefuse.model.findings import Finding, certain_faults, verdict_sentences
from posefuse.model.reconstruction import Reconstruction
from posefuse.report.summary import Summary

_PREFIX = "Health: "
"""Prefix of findings among the notes of results of version 0.1."""

_FEWEST_CAMERAS, _UNEVEN = 3, 2.0
"""Number of cameras, and ratio of errors, from which a camera is named that fits worse than the others."""

VerdictLevel = Literal["good", "check", "poor"]


@dataclass(frozen=True)
class ResultVerdict:
    """The verdict on a result.

    Attributes:
        level: good, check (usable, look at the finding) or poor (do not use).
        sentence: the reason.
        remedy: what to do next; empty if nothing is to be done.
    """

    level: VerdictLevel
    sentence: str
    remedy: str


def judge_result(result: Reconstruction, summary: Summary) -> ResultVerdict:
    """Return the verdict of the recording check on a result.

    It is poor exactly if ``posefuse inspect --deep`` exits with the code of certain faults, or if there are no points.
    """
    missing = sum(n for code, n in summary.status_counts.items() if not code.has_point)
    if missing >= summary.n_points:
        return ResultVerdict("poor", "No point has coordinates.", "The highlights state why.")
    certain = certain_faults(result.findings)
    if certain:
        return _of_finding("poor", certain[0], len(result.findings))
    if result.findings:
        return _of_finding("check", result.findings[0], len(result.findings))
    if earlier := findings_of(result):
        return ResultVerdict("check", earlier[0], "")
    if len(result.rig) == 1:
        reason = "The recording was not checked: one camera has no other one to be compared with."
        return ResultVerdict("check", reason, "Watch the video with the skeleton on it.")
    if result.options.health == "off" or not result.has_identities:
        reason = "The recording was not checked for wrong poses and clocks of cameras."
        return ResultVerdict("check", reason, "Run `posefuse inspect --deep` on the folder of the recording.")
    if disagreement := _note(result, DISAGREEMENT):
        symptom, _, causes = disagreement.partition(". ")
        return ResultVerdict("check", f"{symptom}.", causes)
    (sentence,) = verdict_sentences(())
    uneven, remedy = _worst_camera(result.rig.names, [error.median for error in summary.error_px_by_view])
    shifts = _note(result, SHIFTED_VIEWS)
    if shifts and not uneven:
        shifted, _, remedy = shifts.partition(". ")
        uneven = f" But {shifted[0].lower()}{shifted[1:]}."
    return ResultVerdict("good", f"{sentence[0].upper()}{sentence[1:]}.{uneven}", remedy)


def _note(result: Reconstruction, beginning: str) -> str:
    """Return the note that begins with some words; empty if there is none."""
    return next((note for note in result.provenance.notes if note.startswith(beginning)), "")


def _worst_camera(names: Sequence[str], errors_px: Sequence[float]) -> tuple[str, str]:
    """Return a sentence on a camera whose errors are far larger than those of the others, and what to do; else empty.

    A wrong pose that is within the noise of the detector is no finding, but may be improved.
    """
    known = np.array(errors_px)
    if len(known) < _FEWEST_CAMERAS or not np.isfinite(known).all():
        return "", ""
    worst = int(known.argmax())
    usual = float(np.median(np.delete(known, worst)))
    if known[worst] < _UNEVEN * usual:
        return "", ""
    return (
        f" But {names[worst]} fits worst: median {known[worst]:.1f} px, the others {usual:.1f} px.",
        f"Compare the skeleton with the video of {names[worst]}; `posefuse.refine_calibration` tests other poses.",
    )


def findings_of(result: Reconstruction) -> list[str]:
    """Return the findings of the recording check as sentences; results of version 0.1 hold them as notes."""
    notes = [note.removeprefix(_PREFIX) for note in result.provenance.notes if note.startswith(_PREFIX)]
    return [*map(str, result.findings), *notes]


def _of_finding(level: VerdictLevel, finding: Finding, count: int) -> ResultVerdict:
    more = f" {count - 1} more finding{'s' if count > 2 else ''} below." if count > 1 else ""
    return ResultVerdict(level, f"{finding.sentence} ({100 * finding.certainty:.0f} % certain){more}", finding.remedy)
