"""Report views with a time offset, a clock drift, a wrong frame rate or dropped frames, and free-running cameras."""

import numpy as np

from posefuse.calibration.joint.evidence import CLOCK_KINDS, Choice
from posefuse.diagnostics.examination import Examination
from posefuse.diagnostics.findings import certainty_of
from posefuse.diagnostics.fine_result import AcceptedFault
from posefuse.diagnostics.time_offsets import time_views
from posefuse.diagnostics.verdict import Verdict, rival_text
from posefuse.model.findings import Finding, FindingKind

_MIN_DROPPED_FRAMES = 0.5
_TWO = 2
_REMEDY = "Measure the time offsets with `posefuse.measure_sync`, and correct them with `sync`."


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return a finding for each view with dropped frames or a wrong clock, and one for all other offsets to correct."""
    verdict = examination.verdict
    if verdict is None:
        return ()
    findings = []
    for view in range(examination.observations.n_views):
        dropped = _dropped(examination, view)
        choices = verdict.of(view, CLOCK_KINDS)
        if dropped is not None:
            findings.append(_dropped_frames(examination, verdict, view, dropped))
        elif choices or verdict.rate_error[view]:
            findings.append(_clock(examination, verdict, view, choices))
    if verdict.is_free_running:
        findings += _unsynchronized(examination, verdict, {name for finding in findings for name in finding.cameras})
    return tuple(findings)


def _dropped(examination: Examination, view: int) -> AcceptedFault | None:
    """Return the accepted fault of dropped frames of a view, or None; only whole frames are dropped."""
    assert examination.fine is not None
    min_jump_s = _MIN_DROPPED_FRAMES * examination.observations.period_s
    faults = [f for f in examination.fine.accepted if f.hypothesis.view == view and f.hypothesis.kind == "dropped"]
    return next((fault for fault in faults if abs(fault.values[-1]) > min_jump_s), None)


def _offset_frames(examination: Examination, verdict: Verdict, view: int) -> np.ndarray:
    """Return the time offset of a view at the samples, shape (sample,), in frames."""
    assert examination.fine is not None
    time_s = examination.observations.frame_time_s[examination.fine.final.model.frames]
    offset_s, drift = (float(value) for value in verdict.change[view, 6:8])
    return verdict.offsets_s(view, time_s, offset_s, drift) / examination.observations.period_s


def _cameras(examination: Examination, view: int) -> tuple[tuple[str, ...], str]:
    """Return the names of the affected cameras and the subject of the sentence."""
    names = examination.observations.rig.names
    if len(names) == _TWO:
        return names, f"View {names[view]!r} (relative to {names[1 - view]!r})"
    return (names[view],), f"View {names[view]!r}"


def _clock(examination: Examination, verdict: Verdict, view: int, choices: tuple[Choice, ...]) -> Finding:
    period_s = examination.observations.period_s
    cameras, label = _cameras(examination, view)
    offset, sd = _offset_frames(examination, verdict, view), verdict.sd[view, 6] / period_s
    kinds = {choice.explanation.kind: choice for choice in choices}
    gain = sum(choice.gain for choice in choices)
    assert examination.coarse is not None
    gain += 0.5 * sum(c.score for c in examination.coarse.corrections if (c.kind, c.view) == ("rate", view))
    rivals = [2.0 * choice.gain for choice in choices for _ in choice.rivals]
    certainty = certainty_of(max(100.0 if not rivals else 0.0, 2.0 * gain), rivals)
    if "rate" in kinds or verdict.rate_error[view]:
        error = 1.0 + verdict.rate_error[view]
        error = float(error * (1.0 + (kinds["rate"].explanation.rate_error if "rate" in kinds else 0.0)) - 1.0)
        rate = 1.0 / period_s
        size, unit, sd, kind = 1e6 * error, "ppm", float(1e6 * verdict.estimate.sd[view, 7]), FindingKind.FRAME_RATE
        sentence = f"{label} has a wrong frame rate: about {rate / (1.0 + error):.4g} instead of {rate:.4g} Hz."
    elif "drift" in kinds:
        size, unit, kind = float(1e6 * verdict.change[view, 7]), "ppm", FindingKind.CLOCK_DRIFT
        sd = float(1e6 * verdict.sd[view, 7])
        sentence = (
            f"{label} has a clock drift of {size:+.0f} +- {sd:.0f} ppm: its time offset changes from "
            f"{offset[0]:+.1f} to {offset[-1]:+.1f} frames."
        )
    else:
        size, unit, kind = float(offset.mean()), "frames", FindingKind.TIME_OFFSET
        order = "later" if size > 0 else "earlier"
        sentence = (
            f"{label} has a time offset of {size:+.2f} +- {sd:.2f} frames: its frames were captured {order} than "
            "their timestamps indicate."
        )
    sentence += "".join(dict.fromkeys(rival_text(verdict, choice) for choice in choices))
    return Finding(kind, cameras, None, size, unit, float(sd), certainty, gain, sentence, _REMEDY)


def _unsynchronized(examination: Examination, verdict: Verdict, named: set[str]) -> list[Finding]:
    """Return a finding with all time offsets of free-running cameras that `sync` corrects, or none."""
    period_s = examination.observations.period_s
    late = [t for t in time_views(examination) or () if t.is_corrected and t.camera not in named]
    if not late:
        return []
    frames = [timing.offset_s[0] / period_s for timing in late]
    sizes = ", ".join(
        f"{timing.camera!r} {size:+.2f} +- {timing.offset_sd_s / period_s:.2f}"
        for timing, size in zip(late, frames, strict=True)
    )
    sentence = f"The cameras have no common trigger. Time offsets of the views, in frames: {sizes}."
    largest = max(range(len(late)), key=lambda k: abs(frames[k]))
    return [
        Finding(
            FindingKind.UNSYNCHRONIZED, tuple(timing.camera for timing in late), None, frames[largest], "frames",
            late[largest].offset_sd_s / period_s, certainty_of(2.0 * verdict.free_running + 10.0, []),
            verdict.free_running, sentence, _REMEDY,
        )
    ]  # fmt: skip


def _dropped_frames(examination: Examination, verdict: Verdict, view: int, fault: AcceptedFault) -> Finding:
    observations, fine = examination.observations, examination.fine
    assert fine is not None
    cameras, label = _cameras(examination, view)
    offset = _offset_frames(examination, verdict, view)
    sample = int(np.argmax(fine.final.system.block_index >= fault.hypothesis.since_block))
    # Convert to the frame numbers of the view itself.
    timestamp_s = observations.frame_time_s[fine.final.model.frames[sample]] - offset[sample] * observations.period_s
    place = int(np.searchsorted(observations.time_s[:, view], timestamp_s))
    frame = int(observations.frame_numbers[min(place, len(observations.frame_numbers) - 1)])
    jump, sd = (float(value) / observations.period_s for value in (fault.values[-1], fault.sds[-1]))
    what, extra = ("dropped", "") if jump > 0 else ("has", " extra")
    offsets = f"its time offset is {offset[-1]:+.1f} frames from then on"
    if abs(offset[0]) > _MIN_DROPPED_FRAMES:
        offsets = f"its time offset changes from {offset[0]:+.1f} to {offset[-1]:+.1f} frames"
    sentence = f"{label} {what} {abs(jump):.1f} +- {sd:.1f}{extra} frames at about frame {frame}; {offsets}."
    span = (frame, int(observations.frame_numbers[-1]))
    score = fault.evaluation.score
    certainty, kind = certainty_of(score, []), FindingKind.DROPPED_FRAMES
    return Finding(kind, cameras, span, jump, "frames", sd, certainty, 0.5 * score, sentence, _REMEDY)
