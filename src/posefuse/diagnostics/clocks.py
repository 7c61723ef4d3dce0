"""Find views with a time offset, a clock drift or dropped frames."""

from dataclasses import dataclass

import numpy as np

from posefuse.diagnostics.coarse_search import CoarseResult
from posefuse.diagnostics.examination import Examination
from posefuse.diagnostics.findings import certainty_of
from posefuse.diagnostics.fine_result import AcceptedFault, FineResult
from posefuse.diagnostics.hypotheses import CLOCK_KINDS, Unknown, solve_unknowns
from posefuse.diagnostics.recording_model import Parameter
from posefuse.diagnostics.start_offsets import medoid
from posefuse.model.findings import Finding, FindingKind

_MIN_DROPPED_FRAMES = 0.5
_SIGNIFICANT_Z = 3.0
_TWO = 2
_REMEDY = "Measure the time offsets with `posefuse.measure_sync`, and correct them with `sync`."


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return a finding for each view whose clock differs significantly from the medoid clock."""
    if examination.coarse is None or examination.fine is None:
        return ()
    fine = examination.fine
    views = [v for v in range(examination.observations.n_views) if fine.final.system.n_checked[v]]
    offset_s = fine.final.model.offset_s
    if not offset_s.any():
        return ()
    if len(views) > _TWO:
        offset_s = offset_s - medoid(offset_s.mean(axis=0)[views])
    findings = []
    for v in views:
        faults = [f for f in fine.accepted if f.hypothesis.kind in CLOCK_KINDS and f.hypothesis.view == v]
        sd_s = float(faults[-1].sds[-1]) if faults else _offset_sd_s(fine, v)
        changes = any(fault.hypothesis.kind != "offset" for fault in faults)
        if changes or abs(offset_s[:, v].mean()) > _SIGNIFICANT_Z * sd_s:
            findings.append(_finding(examination, v, offset_s[:, v], sd_s, faults))
    return tuple(findings)


def _coarse_score(coarse: CoarseResult, view: int) -> float:
    """Return the score of the coarse offsets of a view or of all views."""
    return sum(c.score for c in coarse.corrections if c.kind == "offset" and c.view in (view, -1))


def _offset_sd_s(fine: FineResult, view: int) -> float:
    """Return the standard deviation of the offset of a view without an accepted clock fault."""
    system = fine.final.system
    unknown = Unknown(view, Parameter.OFFSET, np.ones(len(system.time_s)))
    return float(np.sqrt(solve_unknowns(system, [unknown])[1][0, 0] * fine.design_effect))


@dataclass(frozen=True, eq=False)
class _ViewClock:
    """Hold what a finding about one clock needs.

    Attributes:
        examination: of the recording.
        view: index of the view.
        cameras: names of the affected cameras.
        label: subject of the sentence.
        offset: shape (sample,): time offset in frames.
        sd: standard deviation of the offset in frames.
        certainty: of the finding.
        gain: of the finding.
    """

    examination: Examination
    view: int
    cameras: tuple[str, ...]
    label: str
    offset: np.ndarray
    sd: float
    certainty: float
    gain: float


def _finding(
    examination: Examination, view: int, offset_s: np.ndarray, sd_s: float, faults: list[AcceptedFault]
) -> Finding:
    observations = examination.observations
    assert examination.coarse is not None
    names = observations.rig.names
    two = len(names) == _TWO
    offset, sd = offset_s / observations.period_s, sd_s / observations.period_s
    coarse_score = _coarse_score(examination.coarse, view)
    score = coarse_score + sum(fault.evaluation.score for fault in faults)
    if score == 0.0:
        # The corrections of the other views leave this one unsynchronized.
        score = float(offset.mean() / sd) ** 2
    competitors = [c.score for f in faults for c in f.competitors if c.hypothesis.view != view]
    clock = _ViewClock(
        examination,
        view,
        names if two else (names[view],),
        f"View {names[view]!r}" if not two else f"View {names[view]!r} (relative to {names[1 - view]!r})",
        offset,
        sd,
        certainty_of(score if not coarse_score else 100.0, [] if two else competitors),
        0.5 * score,
    )
    # Only whole frames are dropped.
    min_jump_s = _MIN_DROPPED_FRAMES * observations.period_s
    jumps = [f for f in faults if f.hypothesis.since_block is not None and abs(f.values[-1]) > min_jump_s]
    if jumps:
        return _dropped_frames(clock, jumps[0])
    drifts = [fault for fault in faults if fault.hypothesis.kind == "drift"]
    return _drift(clock, drifts) if drifts else _offset(clock)


def _drift(clock: _ViewClock, faults: list[AcceptedFault]) -> Finding:
    ppm, sd = 1e6 * float(sum(f.values[-1] for f in faults)), 1e6 * float(faults[0].sds[-1])
    sentence = (
        f"{clock.label} has a clock drift of {ppm:+.0f} +- {sd:.0f} ppm: its time offset changes from "
        f"{clock.offset[0]:+.1f} to {clock.offset[-1]:+.1f} frames."
    )
    kind = FindingKind.CLOCK_DRIFT
    return Finding(kind, clock.cameras, None, ppm, "ppm", sd, clock.certainty, clock.gain, sentence, _REMEDY)


def _offset(clock: _ViewClock) -> Finding:
    size, sd = float(clock.offset.mean()), clock.sd
    order = "later" if size > 0 else "earlier"
    sentence = (
        f"{clock.label} has a time offset of {size:+.2f} +- {sd:.2f} frames: its frames were captured {order} than "
        "their timestamps indicate."
    )
    kind = FindingKind.TIME_OFFSET
    return Finding(kind, clock.cameras, None, size, "frames", sd, clock.certainty, clock.gain, sentence, _REMEDY)


def _dropped_frames(clock: _ViewClock, fault: AcceptedFault) -> Finding:
    observations, fine, offset = clock.examination.observations, clock.examination.fine, clock.offset
    assert fine is not None
    sample = int(np.argmax(fine.final.system.block_index >= fault.hypothesis.since_block))
    # Convert to the frame numbers of the view itself.
    timestamp_s = observations.frame_time_s[fine.final.model.frames[sample]] - offset[sample] * observations.period_s
    place = int(np.searchsorted(observations.time_s[:, clock.view], timestamp_s))
    frame = int(observations.frame_numbers[min(place, len(observations.frame_numbers) - 1)])
    jump = float(fault.values[-1]) / observations.period_s
    what = "dropped" if jump > 0 else "has"
    extra = "" if jump > 0 else " extra"
    offsets = f"its time offset is {offset[-1]:+.1f} frames from then on"
    if abs(offset[0]) > _MIN_DROPPED_FRAMES:
        offsets = f"its time offset changes from {offset[0]:+.1f} to {offset[-1]:+.1f} frames"
    sentence = (
        f"{clock.label} {what} {abs(jump):.1f} +- {clock.sd:.1f}{extra} frames at about frame {frame}; {offsets}."
    )
    span = (frame, int(observations.frame_numbers[-1]))
    kind, sd = FindingKind.DROPPED_FRAMES, clock.sd
    return Finding(kind, clock.cameras, span, jump, "frames", sd, clock.certainty, clock.gain, sentence, _REMEDY)
