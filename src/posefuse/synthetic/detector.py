"""A simulated detector: projects the truth and spoils it as real detectors do.

The ``measured`` law was found on OpenPose detections by leaving one view out: with confidence c the standard deviation
is 4.5 px / c per axis at 1000 px image width, the tails are Student's t with 2.7 degrees of freedom, and errors last:
the correlation of one view's error from frame to frame is 0.85 at 25 fps (so 0.85^(25 dt) over dt). The ``gaussian``
law is for benchmarks: white noise of one size, confidences that say nothing.
"""

import numpy as np
from scipy.special import gammaincinv, ndtr

from posefuse.errors import OptionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.skeletons import Skeleton
from posefuse.synthetic.options import DetectorOptions

_SCALE_PX_AT_1000 = 4.5
_TAILS = 2.7
_CORRELATION_AT_25_HZ = 0.85
_SWAP_DWELL_S = {"chain": 0.4, "body": 1.0}


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
    shape = points_m.shape[:3]
    pixels = np.empty((*shape, 2))
    for v, camera in enumerate(rig.cameras):
        pixels[:, v] = camera.project(points_m[:, v])[0]
    if options.noise == "gaussian":
        confidence = rng.uniform(0.35, 0.9, shape)
        pixels += options.sigma_px * rng.standard_normal(pixels.shape)
    else:
        confidence = _confidences(shape, rate_hz, rng)
        widths = np.array([camera.size_px[0] for camera in rig.cameras])
        sigma = _SCALE_PX_AT_1000 * widths[:, None] / 1000.0 / confidence
        pixels += sigma[..., None] * _lasting_t_noise(shape, rate_hz, rng)
    _swap_limbs(pixels, confidence, skeleton, rate_hz, options, rng)
    thrown = rng.random(shape) < options.outlier_share
    direction = rng.uniform(0, 2 * np.pi, shape)
    distance = rng.uniform(*options.outlier_px, shape) * thrown
    pixels += distance[..., None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    missed = _spells(shape, options.miss_share, 0.2, rate_hz, rng)
    sizes = np.array([camera.size_px for camera in rig.cameras])
    outside = ((pixels < -0.5) | (pixels > sizes[None, :, None] - 0.5)).any(axis=-1)
    pixels[missed | outside] = np.nan
    confidence[~np.isfinite(pixels).all(axis=-1)] = np.nan
    return Detections.from_dense(skeleton, rig.names, pixels, confidence, rate_hz=rate_hz)


def _lasting(shape: tuple[int, ...], rate_hz: float, rng: np.random.Generator) -> np.ndarray:
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
    normal = _lasting((*shape, 2), rate_hz, rng)
    chi_square = 2.0 * gammaincinv(_TAILS / 2.0, ndtr(_lasting(shape, rate_hz, rng)))
    return normal / np.sqrt(chi_square / _TAILS)[..., None]


def _confidences(shape: tuple[int, ...], rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Confidences that last as errors do: mostly between 0.5 and 0.95, now and then low."""
    level = rng.normal(1.4, 0.4, shape[1:]) + _lasting(shape, rate_hz, rng)
    return 0.15 + 0.82 / (1.0 + np.exp(-level))


def _spells(
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
            swapped = _spells(pixels.shape[:2], share, _SWAP_DWELL_S[options.swap_law], rate_hz, rng)
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
