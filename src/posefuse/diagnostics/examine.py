"""The health check: look at the detections, search for what is wrong, and say so in findings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.diagnostics import gross_faults, search
from posefuse.diagnostics.findings import Finding, ranked
from posefuse.diagnostics.gross_faults import Coarse
from posefuse.diagnostics.left_right_swaps import exchanged, undone
from posefuse.diagnostics.observations import Evidence
from posefuse.diagnostics.points import Points, solve_points
from posefuse.diagnostics.search import Fine
from posefuse.diagnostics.state import State, look, sample_frames

_COARSE_EVERY_S, _COARSE_MOST, _COARSE_COLUMNS = 0.1, 100, 13
_MUCH = 0.05
_LEAST_SAMPLES = 8
_BLOCK_S, _FEWEST_BLOCKS = 1.0, 12
_PLACES, _FEWEST_PLACED = ("pose", "turn", "across"), 3


@dataclass(frozen=True)
class Effort:
    """How closely to look.

    Attributes:
        every_s: samples are no nearer in time.
        most: samples at most.
        reach_s: how late views may be.
    """

    every_s: float = 0.12
    most: int = 600
    reach_s: float = 2.0


DEEP = Effort()
SHORT = Effort(0.25, 150, 1.0)


@dataclass(frozen=True, eq=False)
class Examination:
    """All that was learnt of a recording.

    Attributes:
        evidence: its detections, sides exchanged where a view often mixes them up.
        seen: the same as they are.
        coarse: what is badly wrong, or None where there is too little to look at.
        fine: what is a little wrong, or None where the views do not agree enough to tell.
        sides: shape (view,): share of the time that each view takes left for right.
        points: with all that granted, or None.
    """

    evidence: Evidence
    seen: Evidence
    coarse: Coarse | None
    fine: Fine | None
    sides: np.ndarray
    points: Points | None


def examine(
    evidence: Evidence, effort: Effort = DEEP, free: Sequence[str] = ("pose", "lens", "late"), doubt: float = 1.0
) -> Examination:
    """Search for what is wrong with a recording.

    Args:
        evidence: of the recording.
        effort: how closely to look.
        free: what may be a little wrong.
        doubt: how many times the threshold what is no clock has to gain, for those who ask for clocks only.
    """
    nothing = Examination(evidence, evidence, None, None, np.zeros(evidence.n_views), None)
    frames = _samples(evidence, effort.every_s, effort.most)
    if evidence.n_views < 2 or len(frames) < _LEAST_SAMPLES or not len(evidence.keypoint):
        return nothing
    few = evidence.columns(_spread(len(evidence.keypoint), evidence.partner))
    rough = gross_faults.search(few, _samples(evidence, _COARSE_EVERY_S, _COARSE_MOST), effort.reach_s)
    state = rough.state.at(frames)
    shares, mended = np.zeros(evidence.n_views), evidence
    if not rough.agreed:
        return Examination(evidence, evidence, rough, None, shares, None)
    shares, _ = exchanged(evidence, rough.state, solve_points(evidence, rough.state, look(evidence, rough.state)))
    if (shares > _MUCH).any():
        shares, mended = _without_exchanges(evidence, state)
    fine = search.search(mended, state, free, _block_s(evidence), doubt)
    if _nobody_stands(rough, fine, evidence.n_views):
        return Examination(evidence, evidence, replace(rough, agreed=False), None, shares, None)
    return Examination(mended, evidence, rough, fine, shares, fine.last.points)


def _nobody_stands(rough: Coarse, fine: Fine, views: int) -> bool:
    """Whether all cameras but one had to be placed anew: what fits then is not the calibration that was given."""
    placed = {guess.view for guess in rough.guesses if guess.kind == "pose"}
    placed |= {found.hypothesis.view for found in fine.found if found.hypothesis.kind in _PLACES}
    return len(placed) >= max(views - 1, _FEWEST_PLACED)


def findings_of(examination: Examination) -> tuple[Finding, ...]:
    """What is wrong, the worst first."""
    from posefuse.diagnostics.registry import FINDERS

    return ranked([finding for find in FINDERS for finding in find(examination)])


def _samples(evidence: Evidence, every_s: float, most: int) -> np.ndarray:
    """Frames to look at, those with two views that show something."""
    frames = sample_frames(len(evidence.pixels), evidence.runs, evidence.period_s, every_s, most)
    shown = np.isfinite(evidence.pixels[frames][..., 0]).any(axis=-1).sum(axis=1)
    return frames[shown >= 2]


def _spread(columns: int, partner: np.ndarray) -> np.ndarray:
    """Columns for the coarse search: not all, and partners together."""
    if columns <= _COARSE_COLUMNS:
        return np.arange(columns)
    picked: list[int] = []
    for column in np.linspace(0, columns - 1, _COARSE_COLUMNS).astype(int):
        picked += [int(column), int(partner[column])]
    return np.array(sorted(set(picked)))


def _without_exchanges(evidence: Evidence, state: State) -> tuple[np.ndarray, Evidence]:
    """Shares of exchanged sides by view, and the evidence with those of bad views put right."""
    points = solve_points(evidence, state, look(evidence, state))
    shares, mask = exchanged(evidence, state, points)
    mended = undone(evidence, state.frames, mask & (shares > _MUCH)[None, :, None])
    return shares, mended


def _block_s(evidence: Evidence) -> float:
    lasts = evidence.period_s * len(evidence.pixels)
    return min(_BLOCK_S, max(lasts / _FEWEST_BLOCKS, 2.0 * evidence.period_s))
