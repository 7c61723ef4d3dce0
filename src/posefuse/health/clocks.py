"""Is a view out of step with the others: late, drifting, or short of frames from some moment on?"""

from typing import TYPE_CHECKING

import numpy as np

from posefuse.health.coarse import Guess
from posefuse.health.findings import Finding, Kind, certainty_of
from posefuse.health.hypotheses import CLOCKS, Unknown, solve
from posefuse.health.search import Fine, Found
from posefuse.health.state import Column

if TYPE_CHECKING:
    from posefuse.health.examine import Examination

_WHOLE = 0.5


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Views that took their frames at other times than they say."""
    if examination.coarse is None or examination.fine is None:
        return ()
    coarse = {
        view: 400.0 * (guess.before - guess.after)
        for guess in examination.coarse.guesses
        if guess.kind == "late"
        for view in _late_by(examination, guess)
    }
    items = [item for item in examination.fine.found if item.hypothesis.kind in CLOCKS]
    views = sorted({item.hypothesis.view for item in items} | set(coarse))
    return tuple(
        _finding(examination, v, [item for item in items if item.hypothesis.view == v], coarse.get(v, 0.0))
        for v in views
    )


def _late_by(examination: "Examination", guess: Guess) -> list[int]:
    """The views that a guess says are late: of all together those that are not with the one amid them."""
    if guess.view >= 0:
        return [guess.view]
    return np.flatnonzero(np.abs(guess.state.late_s[0]) > _WHOLE * examination.evidence.period_s).tolist()


def _sd_s(fine: Fine, view: int) -> float:
    """How well an offset is known to which nothing had to be added."""
    system = fine.last.system
    unknown = Unknown(view, Column.LATE, np.ones(len(system.time_s)))
    return float(np.sqrt(solve(system, [unknown])[1][0, 0] * fine.effect))


def _finding(examination: "Examination", view: int, items: list[Found], coarse_gain: float) -> Finding:
    evidence, fine = examination.evidence, examination.fine
    assert fine is not None
    two = len(evidence.rig) == 2
    cameras = evidence.rig.names if two else (evidence.rig.names[view],)
    late = fine.last.state.late_s[:, view] / evidence.period_s
    score = coarse_gain + sum(item.verdict.score for item in items)
    rivals = [r.score for item in items for r in item.rivals if r.hypothesis.view != view]
    certainty = certainty_of(score if not coarse_gain else 100.0, [] if two else rivals)
    name = f"View {cameras[0]!r}" if not two else f"View {cameras[view]!r} (beside {cameras[1 - view]!r})"
    # Frames are dropped whole.
    steps = [i for i in items if i.hypothesis.since is not None and abs(i.values[-1]) > _WHOLE * evidence.period_s]
    sd = (float(items[-1].sds[0]) if items else _sd_s(fine, view)) / evidence.period_s
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
    at = int(evidence.frame_numbers[fine.last.state.frames[sample]])
    jump = float(step.values[-1]) / evidence.period_s
    what = "lacks" if jump > 0 else "has too many"
    sentence = (
        f"{name} {what} {abs(jump):.1f} +- {sd:.1f} frames from about frame {at} on: out of step by {late[-1]:+.1f}."
    )
    span = (at, int(evidence.frame_numbers[-1]))
    return Finding(Kind.DROPPED, cameras, span, jump, "frames", sd, certainty, gain, sentence, remedy)
