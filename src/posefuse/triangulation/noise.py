"""How noisy the detections are, from how far they lie from the points they agree on."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import gammaincinv

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus
from posefuse.model.tracks import Tracks

MOST_ROUNDS = 16

_SAMPLE_FRAMES = 300
"""So many frames, spread evenly over the recording, tell the scale to a few per cent."""

_FEW_FRAMES = 60
_PIECE_FRAMES = 30
_FEWEST_POINTS = 30
_ASSUMED_PX_AT_1000 = 4.5
_FINEST_PX_AT_1000 = 0.1
_EXPLAINED = 1.1
_STRIDE = 2.5
_FINEST_PX = 1e-3


def sample(n_frames: int, *, few: bool = False) -> list[tuple[int, int]]:
    """Ranges of frames that represent a recording: all of a short one, evenly spread pieces of a long one."""
    most = _FEW_FRAMES if few else _SAMPLE_FRAMES
    if n_frames <= most:
        return [(0, n_frames)]
    starts = np.linspace(0, n_frames - _PIECE_FRAMES, most // _PIECE_FRAMES).astype(int)
    return [(int(start), int(start) + _PIECE_FRAMES) for start in starts]


def assumed(rig: CameraRig, exponent: float) -> NoiseModel:
    """What detectors usually do, where a recording tells too little."""
    return NoiseModel(_ASSUMED_PX_AT_1000 * _widths(rig), exponent, "assumed")


def finest(rig: CameraRig, exponent: float) -> NoiseModel:
    """Where the search for the noise of a recording begins: below any detector's."""
    return NoiseModel(_FINEST_PX_AT_1000 * _widths(rig), exponent, "assumed")


def _widths(rig: CameraRig) -> np.ndarray:
    return np.array([camera.size_px[0] for camera in rig.cameras]) / 1000.0


def coarser(noise: NoiseModel, found: NoiseModel | None) -> NoiseModel | None:
    """The next noise to try, or None if the views that agree err no more than was tried.

    What views agree on depends on the noise, and the noise on what views agree on. Too small a noise leaves only the
    best views in agreement, and they err more than it: coming from below, the first noise that explains itself is
    that of the right detections, however many and however near the wrong ones are. From above it need not be.

    Args:
        noise: tried.
        found: what :func:`estimate` made of it.
    """
    if found is None:
        return replace(noise, scale_px=2.0 * noise.scale_px)
    ratio = float(np.median(found.scale_px) / np.median(noise.scale_px))
    if ratio <= _EXPLAINED:
        return None
    return replace(noise, scale_px=min(ratio, _STRIDE) * noise.scale_px)


def estimate(
    rig: CameraRig,
    pieces: Sequence[Detections],
    tracks: Sequence[Tracks],
    layers: Sequence[Layer],
    before: NoiseModel,
) -> NoiseModel | None:
    """The noise of the views that agree, or None where too few do.

    Args:
        rig: the cameras.
        pieces: of the recording.
        tracks: whose detection is whose, in each piece.
        layers: the pieces as the method ``consensus`` triangulates them with the noise ``before``.
        before: the noise so far.
    """
    squares = [
        squared_scales(layer, piece, people.rows(piece), before.exponent)
        for layer, piece, people in zip(layers, pieces, tracks, strict=True)
    ]
    found = np.concatenate(squares)
    if len(found) < _FEWEST_POINTS:
        return None
    scale = max(float(np.sqrt(np.median(found))), _FINEST_PX)
    return NoiseModel(np.full(len(rig), scale), before.exponent, "estimated")


def squared_scales(layer: Layer, detections: Detections, rows: np.ndarray, exponent: float) -> np.ndarray:
    """One estimate of the squared scale from each point whose views check each other.

    With n views a point's weighted squared residuals sum to the squared scale times a chi-square variable of
    2 n - 3 degrees of freedom; dividing by its median gives numbers whose median is the squared scale. Two views that
    are left of more were chosen because they agree, and say nothing.

    Args:
        layer: triangulated, wrong views rejected.
        detections: of the same frames.
        rows: shape (frame, person, view): rows of the detections.
        exponent: of the confidence.

    Returns:
        Shape (point,), px^2.
    """
    status = np.asarray(layer.view_status)
    used = status == ViewStatus.USED
    residual = np.where(used, np.asarray(layer.view_error_px, dtype=np.float64), 0.0)
    if exponent > 0:
        trust = np.moveaxis(np.asarray(detections.confidence)[np.maximum(rows, 0)], -1, -2)
        residual *= np.where(used & np.isfinite(trust), trust, 1.0) ** exponent
    n = used.sum(axis=-1)
    telling = (n > 2) | ((n == 2) & ~(status == ViewStatus.OUTLIER).any(axis=-1))
    total = (residual**2).sum(axis=-1)[telling]
    freedom = np.maximum(2 * np.arange(used.shape[-1] + 1) - 3, 1)
    medians = 2.0 * gammaincinv(freedom / 2.0, 0.5)
    estimates = total / medians[n[telling]]
    return estimates[np.isfinite(estimates)]
