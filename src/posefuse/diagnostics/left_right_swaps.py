"""Does a view take left for right, more often than detectors do?"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from posefuse.diagnostics.findings import Finding, Kind
from posefuse.diagnostics.observations import Evidence
from posefuse.diagnostics.points import TAILS, Points
from posefuse.diagnostics.state import State, look

if TYPE_CHECKING:
    from posefuse.diagnostics.examine import Examination

_CLEAR = 4.0
_SHARE, _TIMES_OTHERS = 0.1, 3.0
_FEWEST_CLEAR = 50


def exchanged(evidence: Evidence, state: State, points: Points) -> tuple[np.ndarray, np.ndarray]:
    """Where views' left is right.

    Returns:
        Shape (view,): shares of what is clear either way; and shape (sample, view, column), bool: what is exchanged.
    """
    views = evidence.n_views
    left = np.flatnonzero(evidence.partner > np.arange(len(evidence.partner)))
    right = evidence.partner[left]
    mask = np.zeros((len(state.frames), views, len(evidence.partner)), dtype=bool)
    if not len(left):
        return np.zeros(views), mask
    sight = look(evidence, state)
    with np.errstate(invalid="ignore", divide="ignore"):
        expected = np.where((points.weight > 0)[..., None], points.inside[..., :2] / points.inside[..., 2:], np.nan)

    def cost(seen: np.ndarray, as_if: np.ndarray) -> np.ndarray:
        off = (sight.at[:, seen] - expected[:, as_if]) / points.sigma[:, seen][..., None]
        return (TAILS + 2.0) * np.log1p(np.square(off).sum(axis=-1) / TAILS)

    for_it = cost(left, left) + cost(right, right) - cost(left, right) - cost(right, left)
    shares = np.zeros(views)
    for v in range(views):
        clear = np.abs(for_it[..., v]) > _CLEAR
        wrong = for_it[..., v] > _CLEAR
        if clear.sum() >= _FEWEST_CLEAR:
            shares[v] = wrong.sum() / clear.sum()
        # Limbs are mixed up in spells, and mostly together: what a frame's pairs say together decides for each.
        together = np.nansum(np.clip(for_it[..., v], -8.0, 8.0), axis=1) > _CLEAR
        decided = np.where(clear, wrong, together[:, None])
        mask[:, v, left] = mask[:, v, right] = decided
    return shares, mask


def undone(evidence: Evidence, frames: np.ndarray, mask: np.ndarray) -> Evidence:
    """The evidence with sides exchanged where a mask of samples says so.

    Args:
        evidence: the recording.
        frames: shape (sample,): of the mask.
        mask: shape (sample, view, column), bool.
    """
    at = np.arange(len(evidence.pixels))
    after = np.clip(np.searchsorted(frames, at), 0, len(frames) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(frames[before] - at) <= np.abs(frames[after] - at), before, after)
    wrong = mask[nearest]
    pixels = np.where(wrong[..., None], evidence.pixels[:, :, evidence.partner], evidence.pixels)
    confidence = np.where(wrong, evidence.confidence[:, :, evidence.partner], evidence.confidence)
    return replace(evidence, pixels=pixels, confidence=confidence)


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Views that exchange left and right far more often than the others, or always."""
    names = examination.evidence.rig.names
    shares = examination.sides.copy()
    if examination.coarse is not None and examination.coarse.agreed:
        shares = np.where(examination.coarse.state.swapped, 1.0 - shares, shares)
    usual = float(np.median(shares))
    return tuple(
        _finding(names[v], float(shares[v]), usual)
        for v in range(len(names))
        if shares[v] > max(_SHARE, _TIMES_OTHERS * usual)
    )


def _finding(name: str, share: float, usual: float) -> Finding:
    if share > 0.9:
        sentence = f"View {name!r} calls left what the other views call right, all the time."
        remedy = "Its images are probably mirrored, or its keypoints are in another order. Exchange left and right."
    else:
        sentence = f"View {name!r} mixes up left and right in {100 * share:.0f} % of the time."
        remedy = (
            "--pairs enumerate (the default) puts sides right frame by frame; --exclude-camera leaves the view out."
        )
    certainty = min(0.99, 1.0 - 0.5 * max(usual, 0.02) / share)
    return Finding(Kind.SIDES, (name,), None, share, "share", np.nan, certainty, 200.0 * share, sentence, remedy)
