"""Is a view out of step with the others: late, drifting, or short of frames from some moment on?"""

from typing import TYPE_CHECKING

import numpy as np

from posefuse.diagnostics.findings import Finding, Kind, certainty_of
from posefuse.diagnostics.gross_faults import Coarse
from posefuse.diagnostics.hypotheses import CLOCKS, Unknown, solve
from posefuse.diagnostics.search import Fine, Found
from posefuse.diagnostics.start_offsets import amid
from posefuse.diagnostics.state import Column

if TYPE_CHECKING:
    from posefuse.diagnostics.examine import Examination

_WHOLE = 0.5
_CERTAIN = 3.0
_TWO = 2


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Views that took their frames at other times than they say: than the one amid them all."""
    if examination.coarse is None or examination.fine is None:
        return ()
    fine = examination.fine
    views = [v for v in range(examination.evidence.n_views) if fine.last.system.seen[v]]
    late_s = fine.last.state.late_s
    if not late_s.any():
        return ()
    if len(views) > _TWO:
        late_s = late_s - amid(late_s.mean(axis=0)[views])
    found = []
    for v in views:
        items = [item for item in fine.found if item.hypothesis.kind in CLOCKS and item.hypothesis.view == v]
        sd_s = float(items[-1].sds[-1]) if items else _sd_s(fine, v)
        changes = any(item.hypothesis.kind != "late" for item in items)
        if changes or abs(late_s[:, v].mean()) > _CERTAIN * sd_s:
            found.append(_finding(examination, v, late_s[:, v], sd_s, items))
    return tuple(found)


def _coarse_gain(coarse: Coarse, view: int) -> float:
    """What was gained by guessing that a view, or all of them, are late."""
    late = [guess for guess in coarse.guesses if guess.kind == "late" and guess.view in (view, -1)]
    return sum(400.0 * (guess.before - guess.after) for guess in late)


def _sd_s(fine: Fine, view: int) -> float:
    """How well an offset is known to which nothing had to be added."""
    system = fine.last.system
    unknown = Unknown(view, Column.LATE, np.ones(len(system.time_s)))
    return float(np.sqrt(solve(system, [unknown])[1][0, 0] * fine.effect))


def _finding(examination: "Examination", view: int, late_s: np.ndarray, sd_s: float, items: list[Found]) -> Finding:
    evidence = examination.evidence
    assert examination.coarse is not None
    two = len(evidence.rig) == _TWO
    cameras = evidence.rig.names if two else (evidence.rig.names[view],)
    late, sd = late_s / evidence.period_s, sd_s / evidence.period_s
    coarse_gain = _coarse_gain(examination.coarse, view)
    score = coarse_gain + sum(item.verdict.score for item in items)
    if score == 0.0:
        # The others were moved, but it is this one that is not with them.
        score = float(late.mean() / sd) ** 2
    rivals = [r.score for item in items for r in item.rivals if r.hypothesis.view != view]
    certainty = certainty_of(score if not coarse_gain else 100.0, [] if two else rivals)
    name = f"View {cameras[0]!r}" if not two else f"View {cameras[view]!r} (beside {cameras[1 - view]!r})"
    # Frames are dropped whole.
    steps = [i for i in items if i.hypothesis.since is not None and abs(i.values[-1]) > _WHOLE * evidence.period_s]
    remedy = "posefuse sync measures the offsets of all views; reconstruct --sync FILE uses them."
    if steps:
        return _dropped(examination, cameras, name, steps[0], late, sd, certainty, 0.5 * score, remedy)
    drifts = [item for item in items if item.hypothesis.kind == "drift"]
    if drifts:
        ppm, spread = 1e6 * float(sum(i.values[-1] for i in drifts)), 1e6 * float(drifts[0].sds[-1])
        sentence = (
            f"{name} drifts: from {late[0]:+.1f} frames at the start to {late[-1]:+.1f} at the end, {ppm:+.0f} +- "
            f"{spread:.0f} ppm."
        )
        return Finding(Kind.DRIFT, cameras, None, ppm, "ppm", spread, certainty, 0.5 * score, sentence, remedy)
    size = float(late.mean())
    sentence = f"{name} is {abs(size):.2f} +- {sd:.2f} frames {'late' if size > 0 else 'early'}."
    return Finding(Kind.LATE, cameras, None, size, "frames", sd, certainty, 0.5 * score, sentence, remedy)


def _dropped(
    examination: "Examination",
    cameras: tuple[str, ...],
    name: str,
    step: Found,
    late: np.ndarray,
    sd: float,
    certainty: float,
    gain: float,
    remedy: str,
) -> Finding:
    evidence, fine = examination.evidence, examination.fine
    assert fine is not None
    sample = int(np.argmax(fine.last.system.block_of >= step.hypothesis.since))
    # Frames as the view counts them.
    said_s = evidence.frame_time_s[fine.last.state.frames[sample]] - late[sample] * evidence.period_s
    place = int(np.searchsorted(evidence.time_s[:, step.hypothesis.view], said_s))
    at = int(evidence.frame_numbers[min(place, len(evidence.frame_numbers) - 1)])
    jump = float(step.values[-1]) / evidence.period_s
    what = "lacks" if jump > 0 else "has too many"
    before = f"{late[0]:+.1f} before and " if abs(late[0]) > _WHOLE else ""
    sentence = (
        f"{name} {what} {abs(jump):.1f} +- {sd:.1f} frames from about frame {at} on: out of step by {before}"
        f"{late[-1]:+.1f}{' after' if before else ''}."
    )
    span = (at, int(evidence.frame_numbers[-1]))
    return Finding(Kind.DROPPED, cameras, span, jump, "frames", sd, certainty, gain, sentence, remedy)
