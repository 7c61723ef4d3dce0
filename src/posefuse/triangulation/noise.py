"""How noisy the detections are, from how far they lie from the points they agree on."""

from dataclasses import replace

import numpy as np
from scipy.special import gammaincinv

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus
from posefuse.model.tracks import Tracks

SAMPLE_FRAMES = 300
"""So many frames, spread evenly over the recording, tell the scale to a few per cent."""

_PIECE_FRAMES = 30
_VIEWS = 3
_FEWEST_POINTS = 30
_ASSUMED_PX_AT_1000 = 4.5
_FINEST_PX = 1e-3


def sample(n_frames: int) -> list[tuple[int, int]]:
    """Ranges of frames that represent a recording: all of a short one, evenly spread pieces of a long one."""
    if n_frames <= SAMPLE_FRAMES:
        return [(0, n_frames)]
    starts = np.linspace(0, n_frames - _PIECE_FRAMES, SAMPLE_FRAMES // _PIECE_FRAMES).astype(int)
    return [(int(start), int(start) + _PIECE_FRAMES) for start in starts]


def three_views(tracks: Tracks, view_names: tuple[str, ...], seed: int) -> Tracks:
    """The same people with at most three detections left in each frame, chosen at random (by name, not by order).

    Where every point has many views, nearly every point has a wrong one among them, and then no median over points
    helps. Of three views most are still right.
    """
    detection = np.array(tracks.detection[:])
    keys = np.empty(detection.shape)
    keys[..., np.argsort(view_names)] = np.random.default_rng(seed).random(detection.shape)
    keys[detection < 0] = 2.0
    detection[keys.argsort(axis=-1).argsort(axis=-1) >= _VIEWS] = -1
    return replace(tracks, detection=detection)


def relative_noise(rig: CameraRig, options: TriangulationOptions) -> NoiseModel:
    """The noise up to its scale, to triangulate the sample with: 1 px for a detection of confidence 1."""
    return NoiseModel(np.ones(len(rig)), options.confidence_exponent, "relative")


def squared_scales(layer: Layer, detections: Detections, rows: np.ndarray, exponent: float) -> np.ndarray:
    """One estimate of the squared scale from each point that has views to spare.

    With n views a point's weighted squared residuals sum to the squared scale times a chi-square variable of
    2 n - 3 degrees of freedom; dividing by its median gives numbers whose median is the squared scale, and a median
    does not mind the outliers.

    Args:
        layer: triangulated with :func:`relative_noise`.
        detections: of the same frames.
        rows: shape (frame, person, view): rows of the detections.
        exponent: of the confidence.

    Returns:
        Shape (point,), px^2.
    """
    used = np.asarray(layer.view_status) == ViewStatus.USED
    residual = np.where(used, np.asarray(layer.view_error_px, dtype=np.float64), 0.0)
    if exponent > 0:
        trust = np.moveaxis(np.asarray(detections.confidence)[np.maximum(rows, 0)], -1, -2)
        residual *= np.where(used & np.isfinite(trust), trust, 1.0) ** exponent
    n = used.sum(axis=-1)
    spare = n >= 2
    total = (residual**2).sum(axis=-1)[spare]
    freedom = np.maximum(2 * np.arange(used.shape[-1] + 1) - 3, 1)
    medians = 2.0 * gammaincinv(freedom / 2.0, 0.5)
    estimates = total / medians[n[spare]]
    return estimates[np.isfinite(estimates)]


def scale_from(estimates: np.ndarray, rig: CameraRig, exponent: float) -> NoiseModel:
    """The noise of a recording from the estimates of its sample, or the usual one where they are too few."""
    if len(estimates) < _FEWEST_POINTS:
        widths = np.array([camera.size_px[0] for camera in rig.cameras])
        return NoiseModel(_ASSUMED_PX_AT_1000 * widths / 1000.0, exponent, "assumed")
    scale = max(float(np.sqrt(np.median(estimates))), _FINEST_PX)
    return NoiseModel(np.full(len(rig), scale), exponent, "estimated")
