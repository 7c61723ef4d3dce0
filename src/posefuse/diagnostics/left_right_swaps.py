"""Find views that swap left and right more often than detectors usually do."""

from dataclasses import replace

import numpy as np

from posefuse.diagnostics.examination import Examination
from posefuse.diagnostics.normalized_views import normalize_views
from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.recording_model import RecordingModel
from posefuse.diagnostics.sample_points import STUDENT_T_DOF, SamplePoints
from posefuse.model.findings import Finding, FindingKind

_DECISIVE = 4.0
_MIN_SHARE, _MIN_RATIO = 0.1, 3.0
_MIN_DECISIVE_SAMPLES = 50


def detect_swaps(
    observations: TrackedObservations, model: RecordingModel, points: SamplePoints
) -> tuple[np.ndarray, np.ndarray]:
    """Detect swapped left/right labels.

    Returns:
        Shape (view,): share of swaps among the decisive samples; and shape (sample, view, column), bool: swapped
        observations.
    """
    views = observations.n_views
    left = np.flatnonzero(observations.mirror_column > np.arange(len(observations.mirror_column)))
    right = observations.mirror_column[left]
    mask = np.zeros((len(model.frames), views, len(observations.mirror_column)), dtype=bool)
    if not len(left):
        return np.zeros(views), mask
    normalized = normalize_views(observations, model)
    with np.errstate(invalid="ignore", divide="ignore"):
        expected = np.where(
            (points.weight > 0)[..., None], points.camera_xyz[..., :2] / points.camera_xyz[..., 2:], np.nan
        )

    def cost(observed: np.ndarray, projected: np.ndarray) -> np.ndarray:
        error = (normalized.xy[:, observed] - expected[:, projected]) / points.sigma[:, observed][..., None]
        return (STUDENT_T_DOF + 2.0) * np.log1p(np.square(error).sum(axis=-1) / STUDENT_T_DOF)

    log_odds = cost(left, left) + cost(right, right) - cost(left, right) - cost(right, left)
    shares = np.zeros(views)
    for v in range(views):
        decisive = np.abs(log_odds[..., v]) > _DECISIVE
        swapped = log_odds[..., v] > _DECISIVE
        if decisive.sum() >= _MIN_DECISIVE_SAMPLES:
            shares[v] = swapped.sum() / decisive.sum()
        # Swaps persist and mostly affect several pairs: the sum over a frame's pairs decides where one pair does not.
        frame_swapped = np.nansum(np.clip(log_odds[..., v], -8.0, 8.0), axis=1) > _DECISIVE
        decided = np.where(decisive, swapped, frame_swapped[:, None])
        mask[:, v, left] = mask[:, v, right] = decided
    return shares, mask


def undo_swaps(observations: TrackedObservations, frames: np.ndarray, mask: np.ndarray) -> TrackedObservations:
    """Return the observations with left and right exchanged where a mask of samples is true.

    Args:
        observations: of the recording.
        frames: shape (sample,): sampled frames of the mask; other frames take the value of the nearest sample.
        mask: shape (sample, view, column), bool.
    """
    every = np.arange(len(observations.pixels))
    after = np.clip(np.searchsorted(frames, every), 0, len(frames) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(frames[before] - every) <= np.abs(frames[after] - every), before, after)
    swapped = mask[nearest]
    mirror = observations.mirror_column
    pixels = np.where(swapped[..., None], observations.pixels[:, :, mirror], observations.pixels)
    confidence = np.where(swapped, observations.confidence[:, :, mirror], observations.confidence)
    return replace(observations, pixels=pixels, confidence=confidence)


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return a finding for each view that swaps left and right always, or far more often than the others."""
    names = examination.observations.rig.names
    shares = examination.swap_shares.copy()
    if examination.coarse is not None and examination.coarse.views_agree:
        shares = np.where(examination.coarse.model.swapped, 1.0 - shares, shares)
    typical = float(np.median(shares))
    return tuple(
        _finding(names[v], float(shares[v]), typical)
        for v in range(len(names))
        if shares[v] > max(_MIN_SHARE, _MIN_RATIO * typical)
    )


def _finding(name: str, share: float, typical: float) -> Finding:
    if share > 0.9:
        sentence = f"View {name!r} always labels left and right opposite to the other views."
        remedy = "Its images are probably mirrored, or its keypoints are in another order. Exchange left and right."
    else:
        sentence = f"View {name!r} swaps left and right {100 * share:.0f} % of the time."
        remedy = (
            "`pairs='enumerate'` (the default) corrects swaps frame by frame; `exclude_camera` excludes the camera."
        )
    certainty = min(0.99, 1.0 - 0.5 * max(typical, 0.02) / share)
    kind, gain = FindingKind.LEFT_RIGHT_SWAP, 200.0 * share
    return Finding(kind, (name,), None, share, "share", np.nan, certainty, gain, sentence, remedy)
