"""What each view's labels of a pair say, tails and the view's own share in the points considered."""

import numpy as np

from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import unpack_covariance
from posefuse.model.tracks import Tracks
from posefuse.triangulation.linearized import inverse_2x2, linear_rows

_TAILS = 3.0
"""Degrees of freedom: detectors' errors measured from 2.7 up."""
_MOST_SHARE = 0.99
"""A view without which nothing holds a point in place has a share of 1: it tells nothing, but may not divide by 0."""


def robust_evidence(
    rig: CameraRig,
    detections: Detections,
    tracks: Tracks,
    noise: NoiseModel,
    pairs: np.ndarray,
    solved: SolvedPairs,
    min_confidence: float = 0.0,
) -> np.ndarray:
    """How much likelier each view's labels are swapped, for the points that the other views make.

    The kernel's own evidence takes each view at its points, which it helped to place where it suits its best
    assignment, and errors for normal. Here residuals are those of leaving the view out, and Student's t.

    Args:
        rig: the cameras.
        detections: in memory.
        tracks: whose detection is whose.
        noise: of the detections.
        pairs: shape (pair, 2): keypoints, left and right.
        solved: both points of each.
        min_confidence: detections below say nothing.

    Returns:
        Shape (person_frame, pair, view): twice the log-likelihood ratio of swapped and as labelled, 0 where a view
        says nothing.
    """
    rows = tracks.rows(detections).reshape(-1, len(rig))
    there = rows >= 0
    if not there.any():
        return np.zeros_like(solved.evidence)
    safe = np.where(there, rows, 0)
    pixels = np.asarray(detections.keypoints_px)[safe][:, :, pairs]
    pixels = np.where(there[:, :, None, None, None], pixels, np.nan)
    trust = np.asarray(detections.confidence)[safe][:, :, pairs]
    trust = np.where(np.isnan(trust), 1.0, trust)
    valid = (trust >= min_confidence) & (trust > 0.0)
    pixels = np.where(valid[..., None], pixels, np.nan)
    scale = np.where(valid, trust, 1.0) ** -noise.exponent * noise.scale_px[:, None, None]
    total = np.zeros((2, len(rows), len(pairs), len(rig)))
    # Both observations of the view as they would see each point; by point: of its own label, of the other's.
    for point in range(2):
        points = solved.points_m[:, :, point].reshape(-1, 3)
        covariance = unpack_covariance(solved.covariance_m2[:, :, point]).reshape(-1, 1, 3, 3)
        seen, shares = [], None
        for label in (point, 1 - point):
            own = np.moveaxis(pixels[:, :, :, label], 1, 2).reshape(len(points), len(rig), 2)
            residuals, jacobians = linear_rows(rig, points, own)
            seen.append((residuals, np.moveaxis(scale[..., label], 1, 2).reshape(len(points), len(rig))))
            found = jacobians @ covariance @ np.swapaxes(jacobians, -1, -2)
            shares = found if shares is None else np.where(np.isnan(shares), found, shares)
        used = solved.used[..., point].reshape(len(points), len(rig))
        total += _both_ways(seen, np.asarray(shares), used, point).reshape(2, *total.shape[1:])
    return (total[1] - total[0]).astype(np.float32)


def _both_ways(
    seen: list[tuple[np.ndarray, np.ndarray]], spread: np.ndarray, used: np.ndarray, point: int
) -> np.ndarray:
    """Shape (2, point, view): twice the log-likelihoods of a point's own label and of the other one's.

    Args:
        seen: residuals (point, view, 2) and standard deviations (point, view), of its own label and of the other's.
        spread: shape (point, view, 2, 2): covariance of where the view sees the point.
        used: shape (point, view): which label's observation the point rests on.
        point: 0 or 1, the label of its own.
    """
    out = np.zeros((2, *used.shape))
    rests = np.where(used == point, 0, np.where(used >= 0, 1, -1))
    shift = np.zeros_like(seen[0][0])
    variance = np.broadcast_to(np.eye(2), spread.shape) * (seen[0][1] ** 2)[..., None, None]
    for which, (residuals, sigma) in enumerate(seen):
        mine = rests == which
        share = spread / (sigma**2)[..., None, None]
        half = 0.5 * (share[..., 0, 0] + share[..., 1, 1])
        apart = np.hypot(0.5 * (share[..., 0, 0] - share[..., 1, 1]), share[..., 0, 1])
        share = share * np.minimum(1.0, _MOST_SHARE / np.maximum(half + apart, 1e-12))[..., None, None]
        gain = inverse_2x2(np.eye(2) - share)
        moved = ((gain - np.eye(2)) @ residuals[..., None])[..., 0]
        shift = np.where(mine[..., None], moved, shift)
        variance = np.where(mine[..., None, None], gain * (sigma**2)[..., None, None], variance)
    variance = np.where((rests < 0)[..., None, None], variance + spread, variance)
    inverse = inverse_2x2(variance)
    for which, (residuals, _) in enumerate(seen):
        off = residuals + shift
        squared = np.einsum("...i,...ij,...j->...", off, inverse, off)
        cost = -(_TAILS + 2.0) * np.log1p(squared / _TAILS)
        # An observation that is not there says the same of both.
        out[which] = np.where(np.isfinite(cost), cost, 0.0)
    return out
