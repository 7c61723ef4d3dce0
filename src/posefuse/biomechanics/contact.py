"""Estimate the probability that heel and toes touch the floor or another level, from all frames.

Each foot is a hidden Markov model in continuous time with the states air, heel, whole foot, toes, and sliding foot. A
touching point moves like the ground and is near a level; levels are the heights at which feet rest. The spread of the
velocity of resting points is estimated from the recording, so that nothing depends on the scene or on the frame rate.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from posefuse.biomechanics.floor_levels import Levels, find_levels
from posefuse.biomechanics.foot_paths import FootPaths
from posefuse.kernels.biomechanics.hidden_states import forward_backward

AIR, HEEL_STATE, FLAT, TOES_STATE, SLIDE = range(5)
_RATES_HZ = {
    (AIR, HEEL_STATE): 1.8, (AIR, TOES_STATE): 0.8, (AIR, FLAT): 0.4, (AIR, SLIDE): 0.02,
    (HEEL_STATE, FLAT): 8.0, (HEEL_STATE, AIR): 0.5,
    (FLAT, TOES_STATE): 1.5, (FLAT, AIR): 0.2, (FLAT, HEEL_STATE): 0.1, (FLAT, SLIDE): 0.05,
    (TOES_STATE, AIR): 4.0, (TOES_STATE, FLAT): 2.0,
    (SLIDE, FLAT): 2.0, (SLIDE, AIR): 0.2, (SLIDE, TOES_STATE): 0.2,
}  # fmt: skip
"""Rates at which a foot changes from one state to another, in human locomotion."""

_PRIOR = np.array([0.2, 0.05, 0.6, 0.1, 0.05])
_INDEPENDENT_S = 0.02
"""Time after which errors of velocity are independent."""
_TAILS = 4.0
_VELOCITY_SD_M_S = (0.03, 0.35)
"""Smallest and largest spread of the velocity of a resting point."""
_AIR_SPEED_M_S = np.array([1.5, 1.5, 0.6])
_SLIDE_SPEED_M_S = np.array([0.4, 0.4, 0.0])
_HEIGHT_RANGE_M = 0.4
_N_PASSES = 3
_MEDIAN_CHI = 1.538
"""Median of the length of a vector of three standard normal numbers."""


@dataclass(frozen=True, eq=False)
class ContactModel:
    """What contact looks like in one recording of one person.

    Attributes:
        ground_m_s: shape (2,): horizontal velocity of the ground; zero except on a treadmill.
        levels: levels on which feet rest.
        velocity_sd_m_s: spread of the velocity of a resting point, per axis.
    """

    ground_m_s: np.ndarray
    levels: Levels
    velocity_sd_m_s: float


@dataclass(frozen=True, eq=False)
class Contact:
    """Contact of one person's feet.

    Attributes:
        probability: shape (frame, side, part): probability that the heel or the toes touch a level; NaN where the foot
            has no points.
        sliding: shape (frame, side): probability that the foot touches and slides.
        model: ground, levels and spread.
    """

    probability: np.ndarray
    sliding: np.ndarray
    model: ContactModel


def fit_contact_model(paths: FootPaths) -> ContactModel:
    """Estimate ground, levels and spread in passes of the forward-backward algorithm."""
    velocity = velocities(paths.time_s, paths.feet_m)
    ground = ground_velocity(velocity, paths)
    speed = np.linalg.norm(velocity - np.array([*ground, 0.0]), axis=-1)
    known = speed[np.isfinite(speed)]
    spread = float(np.clip(np.quantile(known, 0.2) if len(known) else 0.1, *_VELOCITY_SD_M_S))
    model = ContactModel(ground, Levels.none(), spread)
    for _ in range(_N_PASSES):
        posterior = _state_probabilities(paths, model)
        resting = _part_probability(posterior) - posterior[..., SLIDE, None]
        on = np.isfinite(speed) & (resting > 0.5)
        if on.any():
            spread = float(np.clip(np.median(speed[on]) / _MEDIAN_CHI, *_VELOCITY_SD_M_S))
        model = ContactModel(ground, find_levels(paths, resting), spread)
    return model


def estimate_contact(paths: FootPaths, model: ContactModel | None = None) -> Contact:
    """Estimate contact by the forward-backward algorithm.

    Args:
        paths: paths of the person.
        model: ground, levels and spread; by default estimated from the paths.
    """
    model = model or fit_contact_model(paths)
    posterior = _state_probabilities(paths, model)
    seen = np.isfinite(paths.feet_m[..., 0])
    probability = np.where(seen.any(axis=2, keepdims=True), _part_probability(posterior), np.nan)
    return Contact(probability, posterior[..., SLIDE], model)


def _state_probabilities(paths: FootPaths, model: ContactModel) -> np.ndarray:
    """Return the probabilities of the states of both feet, shape (frame, side, 5)."""
    transitions, which = _transitions(paths.time_s)
    weight = np.minimum(1.0, np.gradient(paths.time_s) / _INDEPENDENT_S)[:, None] if len(paths.time_s) > 1 else 1.0
    relative = velocities(paths.time_s, paths.feet_m) - np.array([*model.ground_m_s, 0.0])
    spread = model.velocity_sd_m_s
    touching, airborne = _point_likelihoods(paths, relative, spread, model.levels)
    likelihoods = (_state_likelihoods(touching, airborne, relative, spread, side) for side in (0, 1))
    return np.stack([_posterior(weight * each, transitions, which) for each in likelihoods], axis=1)


def velocities(time_s: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Return central differences over two frames, in the shape of the points; NaN at gaps and at both ends.

    Args:
        time_s: shape (frame,).
        points_m: shape (frame, ..., 3).
    """
    velocity = np.full(points_m.shape, np.nan)
    if len(time_s) > 2:
        span = (time_s[2:] - time_s[:-2]).reshape(-1, *[1] * (points_m.ndim - 1))
        velocity[1:-1] = (points_m[2:] - points_m[:-2]) / span
        velocity[1:-1][span.reshape(-1) > 0.25] = np.nan
    return velocity


def ground_velocity(velocity: np.ndarray, paths: FootPaths) -> np.ndarray:
    """Return the horizontal velocity of a treadmill's belt in m/s, shape (2,), or zero.

    It is the most frequent velocity of the feet, if the person stays in place while the feet move at it.

    Args:
        velocity: shape (frame, side, part, 3): velocities of the feet.
        paths: paths of the person.
    """
    flat = velocity[np.isfinite(velocity[..., 0]) & (np.abs(velocity[..., 2]) < 0.5)][:, :2]
    pelvis = velocities(paths.time_s, paths.pelvis_m)[:, :2]
    moved = np.abs(np.nanmedian(pelvis, axis=0)) if np.isfinite(pelvis).any() else np.zeros(2)
    if len(flat) < 10:
        return np.zeros(2)
    sample = flat[:: max(1, len(flat) // 1000)]
    apart = np.square(sample[:, None] - sample[None]).sum(axis=-1)
    center = sample[int(np.exp(-0.5 * apart / 0.2**2).sum(axis=1).argmax())]
    for _ in range(20):
        weight = np.exp(-0.5 * np.square(sample - center).sum(axis=1) / 0.2**2)
        center = (weight[:, None] * sample).sum(axis=0) / weight.sum()
    speed = float(np.linalg.norm(center))
    is_belt = speed > 0.3 and float(np.linalg.norm(moved)) < 0.3 * speed
    return center if is_belt else np.zeros(2)


def _transitions(time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return transition matrices for the distinct frame intervals, and the matrix of each frame."""
    rates = np.zeros((5, 5))
    for (start, end), rate in _RATES_HZ.items():
        rates[start, end] = rate
    rates -= np.diag(rates.sum(axis=1))
    steps = np.round(np.diff(time_s, prepend=time_s[:1]), 3).clip(1e-3, 2.0)
    distinct, which = np.unique(steps, return_inverse=True)
    return np.stack([expm(rates * step) for step in distinct]), which.astype(np.int64)


def _point_likelihoods(
    paths: FootPaths, relative: np.ndarray, spread: float, levels: Levels
) -> tuple[np.ndarray, np.ndarray]:
    """Return the log-likelihoods of velocity and height of resting points, and of points in the air.

    Both have the shape (frame, side, part); a missing point has zero.
    """
    # A point with a larger standard deviation than usual also has a more uncertain velocity.
    sd = np.sqrt(np.square(paths.sd_m).mean(axis=-1))
    usual = max(float(np.nanmedian(sd)), 1e-9) if np.isfinite(sd).any() else 1.0
    scale = spread * np.maximum(1.0, np.where(np.isfinite(sd), sd / usual, 1.0))
    resting = _student(relative, scale[..., None] * np.ones(3))
    airborne = _student(relative, np.hypot(scale[..., None], _AIR_SPEED_M_S))
    height = levels.nearest_height(paths.feet_m)
    if levels.heights_m.size:
        resting = resting + np.nan_to_num(_student(height[..., None], np.full((*height.shape, 1), levels.sd_m)))
        airborne = airborne - np.log(_HEIGHT_RANGE_M)
    missing = ~np.isfinite(relative[..., 0])
    return np.where(missing, 0.0, resting), np.where(missing, 0.0, airborne)


def _state_likelihoods(
    touching: np.ndarray, airborne: np.ndarray, relative: np.ndarray, spread: float, side: int
) -> np.ndarray:
    """Return the log-likelihoods of the states of a foot, shape (frame, 5)."""
    rest, air = touching[:, side], airborne[:, side]
    # A sliding foot moves as a whole, horizontally, and slower than a swinging one.
    mean = relative[:, side].mean(axis=1)
    apart = relative[:, side, 0] - relative[:, side, 1]
    slide = _normal(mean, np.hypot(spread, _SLIDE_SPEED_M_S)) + _student(apart, np.full(3, 1.4 * spread))
    plain = _student(relative[:, side], np.full(3, spread)).sum(axis=1)
    slide = rest.sum(axis=1) - plain + slide
    states = [air.sum(axis=1), rest[:, 0] + air[:, 1], rest.sum(axis=1), air[:, 0] + rest[:, 1], slide]
    missing = ~np.isfinite(mean[:, 0])
    states[SLIDE] = np.where(missing, np.minimum(states[AIR], states[FLAT]), slide)
    return np.stack(states, axis=1)


def _student(residual: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the log-density of a product of Student-t distributions over the last axis, up to a constant."""
    squared = np.square(residual / scale) / _TAILS
    return (-0.5 * (_TAILS + 1.0) * np.log1p(squared) - np.log(scale) - 0.98).sum(axis=-1)


def _normal(residual: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the log-density of independent normal numbers along the last axis."""
    return (-0.5 * np.square(residual / scale) - np.log(scale) - 0.92).sum(axis=-1)


def _posterior(log_likelihoods: np.ndarray, transitions: np.ndarray, which: np.ndarray) -> np.ndarray:
    posterior = np.empty_like(log_likelihoods)
    likelihoods = np.exp(log_likelihoods - log_likelihoods.max(axis=1, keepdims=True, initial=-1e300))
    forward_backward(np.ascontiguousarray(likelihoods), transitions, which, _PRIOR, posterior, np.empty((2, 5)))
    return posterior


def _part_probability(posterior: np.ndarray) -> np.ndarray:
    """Return the probability of contact of heel and toes, shape (frame, side, 2)."""
    flat = posterior[..., FLAT] + posterior[..., SLIDE]
    return np.stack([flat + posterior[..., HEEL_STATE], flat + posterior[..., TOES_STATE]], axis=-1)
