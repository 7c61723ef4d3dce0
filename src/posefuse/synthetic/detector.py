"""A simulated detector: project the truth and add the errors of real detectors.

The noise ``measured`` was estimated on OpenPose detections by leaving one view out: with confidence c the standard
deviation is 4.5 px / c per axis at 1000 px image width, the tails are Student's t with 2.7 degrees of freedom, and the
correlation of a view's errors between frames is 0.85 at 25 fps (0.85^(25 dt) for frames dt seconds apart). The noise
``rtmpose`` has half of this scale and the same tails and correlation: an assumption on current detectors such as
RTMPose, not a measurement. The noise ``gaussian`` is for benchmarks: white noise with constant
standard deviation and uninformative confidences.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv, ndtr

from posefuse.errors import OptionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton
from posefuse.synthetic.options import DetectorOptions

_SCALE_PX_AT_1000 = {"measured": 4.5, "rtmpose": 2.25}
_TAILS = 2.7
_CORRELATION_AT_25_HZ = 0.85
_SWAP_DWELL_S = {"chain": 0.4, "body": 1.0}


@dataclass(frozen=True)
class Hidden:
    """Occluded keypoints and their detection errors.

    Attributes:
        mask: shape (frame, column, keypoint), bool.
        miss_share: fraction that is missed, in intervals.
        confidence: factor on the confidence of the others; errors grow by its inverse.
        error: additional factor on their errors.
    """

    mask: np.ndarray
    miss_share: float
    confidence: float
    error: float


def clock_offsets(rig: CameraRig, options: DetectorOptions, rng: np.random.Generator) -> np.ndarray:
    """Return the time offset of each view's clock, shape (view,), in seconds."""
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
    """Simulate the detections of one person.

    Args:
        rig: cameras.
        points_m: shape (frame, view, keypoint, 3): keypoints at the capture time of each view.
        skeleton: skeleton of the keypoints.
        rate_hz: frame rate.
        options: detector errors.
        rng: random generator.
    """
    pixels = np.empty((*points_m.shape[:3], 2))
    for v, camera in enumerate(rig.cameras):
        pixels[:, v] = camera.project(points_m[:, v])[0]
    sizes = np.array([camera.size_px for camera in rig.cameras])
    pixels, confidence = add_errors(pixels, sizes, skeleton, rate_hz, options, rng)
    return Detections.from_dense(skeleton, rig.names, pixels, confidence, rate_hz=rate_hz)


def add_errors(
    exact_px: np.ndarray,
    sizes_px: np.ndarray,
    skeleton: Skeleton,
    rate_hz: float,
    options: DetectorOptions,
    rng: np.random.Generator,
    hidden: Hidden | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Add detector errors to exact projections; each column (a person in a view) has independent errors.

    Args:
        exact_px: shape (frame, column, keypoint, 2), NaN if not visible.
        sizes_px: shape (column, 2): width and height of the image.
        skeleton: skeleton of the keypoints.
        rate_hz: frame rate.
        options: detector errors.
        rng: random generator.
        hidden: occluded keypoints.

    Returns:
        Pixels of the same shape, and confidence, shape (frame, column, keypoint); NaN if not detected.
    """
    shape = exact_px.shape[:3]
    pixels = exact_px.copy()
    if options.noise == "gaussian":
        confidence = rng.uniform(0.35, 0.9, shape)
        sigma = np.full(shape, options.sigma_px)
        unit = rng.standard_normal(pixels.shape)
    else:
        confidence = _confidences(shape, rate_hz, rng)
        sigma = _SCALE_PX_AT_1000[options.noise] * sizes_px[:, :1] / 1000.0 / confidence
        unit = _correlated_t_noise(shape, rate_hz, rng)
    if hidden is not None:
        confidence = np.where(hidden.mask, hidden.confidence * confidence, confidence)
        sigma = np.where(hidden.mask, hidden.error / hidden.confidence * sigma, sigma)
    pixels += sigma[..., None] * unit
    _swap_limbs(pixels, confidence, skeleton, rate_hz, options, rng)
    displaced = rng.random(shape) < options.outlier_share
    direction = rng.uniform(0, 2 * np.pi, shape)
    distance = rng.uniform(*options.outlier_px, shape) * displaced
    pixels += distance[..., None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    missed = on_intervals(shape, options.miss_share, 0.2, rate_hz, rng)
    if hidden is not None:
        missed |= hidden.mask & on_intervals(shape, hidden.miss_share, 0.2, rate_hz, rng)
    outside = ((pixels < -0.5) | (pixels > sizes_px[None, :, None] - 0.5)).any(axis=-1)
    pixels[missed | outside] = np.nan
    confidence[~np.isfinite(pixels).all(axis=-1)] = np.nan
    return pixels, confidence


def correlated_noise(shape: tuple[int, ...], rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Return standard normal numbers with the measured correlation along the first axis (frames)."""
    rho = _CORRELATION_AT_25_HZ ** (25.0 / rate_hz)
    white = rng.standard_normal(shape)
    out = np.empty(shape)
    if shape[0]:
        out[0] = white[0]
    for t in range(1, shape[0]):
        out[t] = rho * out[t - 1] + np.sqrt(1.0 - rho * rho) * white[t]
    return out


def _correlated_t_noise(shape: tuple[int, ...], rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Return Student-t errors of unit scale, shape (*shape, 2), with correlated directions and magnitudes."""
    normal = correlated_noise((*shape, 2), rate_hz, rng)
    chi_square = 2.0 * gammaincinv(_TAILS / 2.0, ndtr(correlated_noise(shape, rate_hz, rng)))
    return normal / np.sqrt(chi_square / _TAILS)[..., None]


def _confidences(shape: tuple[int, ...], rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Return correlated confidences, mostly between 0.5 and 0.95, occasionally low."""
    level = rng.normal(1.4, 0.4, shape[1:]) + correlated_noise(shape, rate_hz, rng)
    return 0.15 + 0.82 / (1.0 + np.exp(-level))


def on_intervals(
    shape: tuple[int, ...],
    share: float | np.ndarray,
    dwell_s: float,
    rate_hz: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return two-state Markov chains along the first axis, on for ``share`` of the time in intervals of ``dwell_s``.

    ``share`` may be an array that broadcasts against ``shape[1:]``.
    """
    on = np.zeros(shape, dtype=bool)
    share = np.asarray(share, dtype=np.float64)
    if (share <= 0).all() or not shape[0]:
        return on
    with np.errstate(divide="ignore", invalid="ignore"):
        # A chain that is on most of the time cannot have short intervals only: they become longer.
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
    for pairs in _swap_groups(skeleton, options):
        if options.swap_law == "pair":
            swapped = rng.random(pixels.shape[:2]) < share
        else:
            swapped = on_intervals(pixels.shape[:2], share, _SWAP_DWELL_S[options.swap_law], rate_hz, rng)
        for left, right in pairs:
            both = [skeleton.index(left), skeleton.index(right)]
            for values in (pixels, confidence):
                values[:, :, both] = np.where(
                    swapped.reshape(*swapped.shape, *[1] * (values.ndim - 2)),
                    values[:, :, both[::-1]],
                    values[:, :, both],
                )


def _swap_groups(skeleton: Skeleton, options: DetectorOptions) -> tuple[tuple[tuple[str, str], ...], ...]:
    if options.swap_law == "chain":
        return tuple(skeleton.chains.values())
    return (skeleton.pairs,) if options.swap_law == "body" else tuple((pair,) for pair in skeleton.pairs)


def _swap_shares(n_views: int, options: DetectorOptions) -> float | np.ndarray:
    if not options.swap_shares:
        return options.swap_share
    if len(options.swap_shares) != n_views:
        raise OptionsError(f"swap_shares needs one fraction per view ({n_views}), got {len(options.swap_shares)}.")
    return np.array(options.swap_shares)
