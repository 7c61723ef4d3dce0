"""Weight detections by standard deviations that their files give.

Methods take the noise of a detection as ``scale / confidence^exponent``. Where files give standard deviations, the
confidence is replaced by ``reference / sigma`` and the exponent by 1, which is the same number. The scale is still
estimated from the recording: the spread of an ensemble of networks, or the variance of a smoother, is correct only up
to a factor.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from posefuse.arrays import ArraySource, in_memory, ranges
from posefuse.lazy_array import LazyArray
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options

_MAX_RATIO = 5.0
"""Upper limit of a standard deviation, as a multiple of the median; the detection then has a 25th of its weight."""

_MIN_CONFIDENCE = 0.05
_SAMPLED_ROWS = 20_000


class WeightedDetections(NamedTuple):
    """Detections weighted by their own standard deviations.

    Attributes:
        options: options with the confidence exponent that belongs to the weights.
        detections: detections whose ``confidence`` holds the weights.
        notes: notes for the result.
    """

    options: Options
    detections: Detections
    notes: tuple[str, ...]


def weight_by_sigma(detections: Detections, options: Options, default_px: float | None) -> WeightedDetections:
    """Weight detections by the standard deviations that they come with, unless the options fix the noise.

    Args:
        detections: detections with ``sigma_px``.
        options: options of the reconstruction.
        default_px: noise of a detection of confidence 1 if the recording does not determine it; None if the options set
            the noise.
    """
    unweighted = replace(detections, sigma_px=None)
    if default_px is None:
        note = "The options set the noise; the standard deviations of the detections in the files are not used."
        return WeightedDetections(options, unweighted, (note,))
    found = weighted(detections, default_px, options.triangulation.min_confidence)
    if found is None:
        return WeightedDetections(options, unweighted, ())
    note = (
        "Detections are weighted by their standard deviations in the files; a common scale is estimated from the "
        "recording. `noise_scale_px` weights all detections equally."
    )
    triangulation = replace(options.triangulation, confidence_exponent=1.0)
    return WeightedDetections(replace(options, triangulation=triangulation), found, (note,))


def weighted(detections: Detections, default_px: float, min_confidence: float) -> Detections | None:
    """Return detections whose ``confidence`` holds weights from their standard deviations, or None without any.

    Args:
        detections: detections; arrays in files stay there.
        default_px: noise of a detection of confidence 1 where a recording does not show it. The weights keep the
            detections' own standard deviations in that case.
        min_confidence: detections of less confidence get the weight 0; all others get at least this weight, so that no
            method mistakes a noisy detection for one that the detector rejected.
    """
    middle = None if detections.sigma_px is None else _median(detections.sigma_px)
    if detections.sigma_px is None or middle is None:
        return None
    reference_px = max(default_px, _MAX_RATIO * max(min_confidence, _MIN_CONFIDENCE) * middle)
    source = _Weights(detections, reference_px, middle, min_confidence)
    weights = source[:] if in_memory(detections.keypoints_px) else source
    return replace(detections, confidence=weights, sigma_px=None)


def _median(sigma_px: ArraySource) -> float | None:
    """Return the median over pieces evenly spread over the rows, or None if no value is known."""
    rows = sigma_px.shape[0]
    pieces = list(ranges(rows, 500))
    step = max(len(pieces) * 500 // _SAMPLED_ROWS, 1)
    values = np.concatenate([np.asarray(sigma_px[a:b]).ravel() for a, b in pieces[::step]] or [np.empty(0)])
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


class _Weights(LazyArray):
    """The weights of rows, computed when they are read."""

    def __init__(self, detections: Detections, reference_px: float, median_px: float, min_confidence: float) -> None:
        assert detections.sigma_px is not None
        super().__init__(detections.confidence.shape, np.float64)
        self._confidence, self._sigma_px = detections.confidence, detections.sigma_px
        self._reference_px, self._median_px = reference_px, median_px
        self._min_confidence, self._min_weight = min_confidence, max(min_confidence, _MIN_CONFIDENCE)

    def read_rows(self, start: int, stop: int) -> np.ndarray:
        """Compute the weights of rows."""
        sigma = np.asarray(self._sigma_px[start:stop])
        # A detection of unknown standard deviation gets the median.
        weights = self._reference_px / np.where(np.isfinite(sigma), sigma, self._median_px)
        confidence = np.asarray(self._confidence[start:stop])
        return np.where(confidence < self._min_confidence, 0.0, np.maximum(weights, self._min_weight))
