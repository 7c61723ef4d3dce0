"""A simulated detector: projects the truth and spoils it as real detectors do.

The ``measured`` law was found on OpenPose detections by leaving one view out: with confidence c the standard deviation
is 4.5 px / c per axis at 1000 px image width, the tails are Student's t with 2.7 degrees of freedom, and errors last:
the correlation of one view's error from frame to frame is 0.85 at 25 fps (so 0.85^(25 dt) over dt). The ``gaussian``
law is for benchmarks: white noise of one size, confidences that say nothing.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv, ndtr

from posefuse.errors import OptionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton
from posefuse.synthetic.options import DetectorOptions

_SCALE_PX_AT_1000 = 4.5
_TAILS = 2.7
_CORRELATION_AT_25_HZ = 0.85
_SWAP_DWELL_S = {"chain": 0.4, "body": 1.0}


@dataclass(frozen=True)
class Hidden:
    """Keypoints behind something, and what the detector makes of them.

    Attributes:
        mask: shape (frame, column, keypoint), bool.
        miss_share: share of them that it misses, in spells.
        confidence: what its confidence in the others is multiplied by; their errors grow by as much.
        error: what their errors are multiplied by on top of that.
    """

    mask: np.ndarray
    miss_share: float
    confidence: float
    error: float


def clock_offsets(rig: CameraRig, options: DetectorOptions, rng: np.random.Generator) -> np.ndarray:
    """Shape (view,): how much later than it says each view took its frames, s."""
    return (
        rng.uniform(-options.max_offset_s, options.max_offset_s, len(rig))
        if options.max_offset_s
        else np.zeros(len(rig))
    )


def detect(
    rig: CameraRig,
    points_m: np.ndarray,
    skeleton: Skeleton,
    rate_hz: float,
    options: DetectorOptions,
    rng: np.random.Generator,
) -> Detections:
    """What the detector sees of one person.

    Args:
        rig: the cameras.
        points_m: shape (frame, view, keypoint, 3): where the keypoints were when each view took each frame.
        skeleton: of the keypoints.
        rate_hz: frames per second.
        options: how it errs.
        rng: where its errors come from.
    """
    pixels = np.empty((*points_m.shape[:3], 2))
    for v, camera in enumerate(rig.cameras):
        pixels[:, v] = camera.project(points_m[:, v])[0]
    sizes = np.array([camera.size_px for camera in rig.cameras])
    pixels, confidence = spoil(pixels, sizes, skeleton, rate_hz, options, rng)
    return Detections.from_dense(skeleton, rig.names, pixels, confidence, rate_hz=rate_hz)


def spoil(
    exact_px: np.ndarray,
    sizes_px: np.ndarray,
    skeleton: Skeleton,
    rate_hz: float,
    options: DetectorOptions,
    rng: np.random.Generator,
    hidden: Hidden | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """What the detector makes of exact projections, each column a person in a view with errors of its own.

    Args:
        exact_px: shape (frame, column, keypoint, 2), NaN where there is nothing to see.
        sizes_px: shape (column, 2): width and height of the image.
        skeleton: of the keypoints.
        rate_hz: frames per second.
        options: how it errs.
        rng: where its errors come from.
        hidden: what is hidden by something else, and what the detector makes of that.

    Returns:
        Pixels, of the same shape, and confidence, shape (frame, column, keypoint); NaN where nothing is detected.
    """
    shape = exact_px.shape[:3]
    pixels = exact_px.copy()
    if options.noise == "gaussian":
        confidence = rng.uniform(0.35, 0.9, shape)
        sigma = np.full(shape, options.sigma_px)
        unit = rng.standard_normal(pixels.shape)
    else:
        confidence = _confidences(shape, rate_hz, rng)
        sigma = _SCALE_PX_AT_1000 * sizes_px[:, :1] / 1000.0 / confidence
        unit = _lasting_t_noise(shape, rate_hz, rng)
    if hidden is not None:
        confidence = np.where(hidden.mask, hidden.confidence * confidence, confidence)
        sigma = np.where(hidden.mask, hidden.error / hidden.confidence * sigma, sigma)
    pixels += sigma[..., None] * unit
    _swap_limbs(pixels, confidence, skeleton, rate_hz, options, rng)
    thrown = rng.random(shape) < options.outlier_share
    direction = rng.uniform(0, 2 * np.pi, shape)
    distance = rng.uniform(*options.outlier_px, shape) * thrown
    pixels += distance[..., None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    missed = spells(shape, options.miss_share, 0.2, rate_hz, rng)
    if hidden is not None:
        missed |= hidden.mask & spells(shape, hidden.miss_share, 0.2, rate_hz, rng)
    outside = ((pixels < -0.5) | (pixels > sizes_px[None, :, None] - 0.5)).any(axis=-1)
    pixels[missed | outside] = np.nan
    confidence[~np.isfinite(pixels).all(axis=-1)] = np.nan
    return pixels, confidence


def lasting(shape: tuple[int, ...], rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Standard normal numbers, correlated along the first axis (frames) as measured."""
    rho = _CORRELATION_AT_25_HZ ** (25.0 / rate_hz)
    white = rng.standard_normal(shape)
    out = np.empty(shape)
    if shape[0]:
        out[0] = white[0]
    for t in range(1, shape[0]):
        out[t] = rho * out[t - 1] + np.sqrt(1.0 - rho * rho) * white[t]
    return out


def _lasting_t_noise(shape: tuple[int, ...], rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Shape (*shape, 2): Student-t errors of unit scale whose direction and size both last."""
    normal = lasting((*shape, 2), rate_hz, rng)
    chi_square = 2.0 * gammaincinv(_TAILS / 2.0, ndtr(lasting(shape, rate_hz, rng)))
    return normal / np.sqrt(chi_square / _TAILS)[..., None]


def _confidences(shape: tuple[int, ...], rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Confidences that last as errors do: mostly between 0.5 and 0.95, now and then low."""
    level = rng.normal(1.4, 0.4, shape[1:]) + lasting(shape, rate_hz, rng)
    return 0.15 + 0.82 / (1.0 + np.exp(-level))


def spells(
    shape: tuple[int, ...],
    share: float | np.ndarray,
    dwell_s: float,
    rate_hz: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Two-state chains along the first axis that are on for ``share`` of the time, ``dwell_s`` at a stretch.

    A share may be an array that broadcasts against ``shape[1:]``.
    """
    on = np.zeros(shape, dtype=bool)
    share = np.asarray(share, dtype=np.float64)
    if (share <= 0).all() or not shape[0]:
        return on
    with np.errstate(divide="ignore", invalid="ignore"):
        # No chain is on for most of the time at short stretches only: then the stretches are longer.
        leave = np.minimum(min(1.0, 1.0 / (dwell_s * rate_hz)), (1.0 - share) / share)
        enter = np.where(share < 1.0, leave * share / (1.0 - share), 1.0)
    draws = rng.random(shape)
    on[0] = draws[0] < share
    for t in range(1, shape[0]):
        on[t] = np.where(on[t - 1], draws[t] >= leave, draws[t] < enter)
    return on


def _swap_limbs(
    pixels: np.ndarray,
    confidence: np.ndarray,
    skeleton: Skeleton,
    rate_hz: float,
    options: DetectorOptions,
    rng: np.random.Generator,
) -> None:
    share = _swap_shares(pixels.shape[1], options)
    for pairs in _swapped_together(skeleton, options):
        if options.swap_law == "pair":
            swapped = rng.random(pixels.shape[:2]) < share
        else:
            swapped = spells(pixels.shape[:2], share, _SWAP_DWELL_S[options.swap_law], rate_hz, rng)
        for left, right in pairs:
            both = [skeleton.index(left), skeleton.index(right)]
            for values in (pixels, confidence):
                values[:, :, both] = np.where(
                    swapped.reshape(*swapped.shape, *[1] * (values.ndim - 2)),
                    values[:, :, both[::-1]],
                    values[:, :, both],
                )


def _swapped_together(skeleton: Skeleton, options: DetectorOptions) -> tuple[tuple[tuple[str, str], ...], ...]:
    if options.swap_law == "chain":
        return tuple(skeleton.chains.values())
    return (skeleton.pairs,) if options.swap_law == "body" else tuple((pair,) for pair in skeleton.pairs)


def _swap_shares(n_views: int, options: DetectorOptions) -> float | np.ndarray:
    if not options.swap_shares:
        return options.swap_share
    if len(options.swap_shares) != n_views:
        raise OptionsError(f"swap_shares needs one share for each of {n_views} views, got {len(options.swap_shares)}.")
    return np.array(options.swap_shares)
