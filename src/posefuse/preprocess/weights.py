"""Detections that say themselves how noisy each is, put so that every method weighs them by it.

Methods take the noise of a detection as ``scale / confidence^exponent``. Where files give standard deviations, the
confidence becomes ``reference / sigma`` and the exponent 1, which is the same number. The scale is still found from the
recording: what an ensemble of networks disagrees by, or a smoother believes, is right up to a factor.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from posefuse.arrays import ArraySource, in_memory, ranges
from posefuse.model.detections import Detections

_WIDEST = 5.0
"""What is noisier than the middle by more than this may count as by this much: with a 25th of its weight."""

_LEAST = 0.05
_SAMPLED_ROWS = 20_000


def weighed(detections: Detections, usual_px: float, min_confidence: float) -> Detections | None:
    """Weigh detections by their own standard deviations, or None where they have none.

    Args:
        detections: may be in files; then they stay there.
        usual_px: the standard deviation that methods take a detection of confidence 1 to have where nothing tells; so
            they take the detections' own.
        min_confidence: detections of less confidence get the weight 0; all others get at least this weight, so that no
            method takes a noisy detection for one that the detector did not believe in.

    Returns:
        The same detections, their ``confidence`` being the weights.
    """
    middle = None if detections.sigma_px is None else _median(detections.sigma_px)
    if detections.sigma_px is None or middle is None:
        return None
    reference_px = max(usual_px, _WIDEST * max(min_confidence, _LEAST) * middle)
    source = _Weights(detections, reference_px, middle, min_confidence)
    weights = source[:] if in_memory(detections.keypoints_px) else source
    return replace(detections, confidence=weights, sigma_px=None)


def _median(sigma_px: ArraySource) -> float | None:
    """The median of pieces that are spread evenly over the rows, or None where nothing is known."""
    rows = sigma_px.shape[0]
    pieces = list(ranges(rows, 500))
    step = max(len(pieces) * 500 // _SAMPLED_ROWS, 1)
    values = np.concatenate([np.asarray(sigma_px[a:b]).ravel() for a, b in pieces[::step]] or [np.empty(0)])
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


class _Weights:
    """The weights of rows, made as they are read."""

    def __init__(self, detections: Detections, reference_px: float, middle_px: float, min_confidence: float) -> None:
        assert detections.sigma_px is not None
        self._confidence, self._sigma_px = detections.confidence, detections.sigma_px
        self._reference_px, self._middle_px = reference_px, middle_px
        self._min_confidence, self._least = min_confidence, max(min_confidence, _LEAST)
        self.shape = tuple(detections.confidence.shape)
        self.dtype = np.dtype(np.float64)

    def __getitem__(self, key: Any) -> np.ndarray:
        sigma = np.asarray(self._sigma_px[key])
        # Of what nothing is known is as good as most.
        weights = self._reference_px / np.where(np.isfinite(sigma), sigma, self._middle_px)
        trust = np.asarray(self._confidence[key])
        return np.where(trust < self._min_confidence, 0.0, np.maximum(weights, self._least))
