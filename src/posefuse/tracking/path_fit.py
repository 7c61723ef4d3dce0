"""Poses of one body in consecutive frames, fitted to all detections at once.

The filter weights each detection by what is known when it arrives. Here all poses are fitted together: Gauss-Newton
steps on the detections, whose weights follow from the fitted poses and whose errors are correlated in time, on joint
limits and on the motion, for a known shape. See docs/methods/smoothing.md.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.path_errors import Innovations, weigh_errors, weigh_lasting_errors
from posefuse.kernels.tracking.path_solve import PathFactor, factor_path, invert_path, solve_path
from posefuse.kernels.tracking.path_terms import (
    LinearObservations,
    PathScratch,
    PathSystem,
    add_limits,
    add_motion,
    add_observations,
    align_bones,
    linearize_path,
    move_poses,
    pose_differences,
)
from posefuse.kernels.tracking.records import State
from posefuse.tracking.settings import MIN_MEMORY_S, TrackerSettings

_STEPS = (1.0, 2.0, 2.0, 1.0)
"""Lengths of the Gauss-Newton steps. Weights that follow the poses let single steps reach about half of a change, so
the middle ones are doubled; four reach what six without doubled ones do."""

_MAX_STEP = 0.5
"""Largest change of a number of the pose in one step, in meters or radians."""

_SHORT_MEMORY = 0.4
"""Correlation time of errors for the poses over that of the smoother: a part of the errors is hardly correlated."""

_LASTING_MEMORY = 0.8
"""Correlation time of weighted errors over that of the errors, since the weights vary."""


@dataclass(frozen=True, eq=False)
class PathDetections:
    """Detections of one body in consecutive frames.

    Attributes:
        time_s: shape (frame,), ascending, in seconds.
        keypoints_px: shape (frame, view, node keypoint, 2), NaN where there is none; sides are corrected.
        variance_px2: shape (frame, view, node keypoint): variance of the noise per axis.
    """

    time_s: np.ndarray
    keypoints_px: np.ndarray
    variance_px2: np.ndarray

    @classmethod
    def of(
        cls, time_s: np.ndarray, keypoints_px: np.ndarray, confidence: np.ndarray, settings: TrackerSettings
    ) -> "PathDetections":
        """Return the detections with the variance that the noise model gives them; unlikely ones are left out."""
        frames, views, keypoints = confidence.shape
        view = np.tile(np.arange(views), frames)
        values = confidence.reshape(-1, keypoints).astype(np.float64)
        variance = settings.variance_px2(values, view).reshape(confidence.shape)
        pixels = keypoints_px.astype(np.float64, order="C")
        pixels[confidence < settings.law.min_confidence] = np.nan
        return cls(time_s, pixels, variance)


@dataclass(frozen=True, eq=False)
class PathMotion:
    """Motion of a body: every number of the pose has a velocity that decays and white accelerations.

    Attributes:
        decay_s: shape (pose,): time constant of the decay.
        power: shape (pose,): spectral density of the accelerations.
    """

    decay_s: np.ndarray
    power: np.ndarray

    def rows(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of each deviation by three poses, and its inverse variance.

        The deviation is the velocity of the second interval minus what the decay leaves of that of the first.

        Args:
            time_s: shape (frame,).

        Returns:
            Shapes (row, 3, pose) and (row, pose).
        """
        dt_s = np.diff(time_s)[:, None]
        after, before = dt_s[1:], dt_s[:-1]
        decay = np.exp(-0.5 * (after + before) / self.decay_s)
        first, last = decay / before, np.broadcast_to(1.0 / after, decay.shape)
        variance = 0.5 * self.power * self.decay_s * (1.0 - np.square(decay))
        return np.stack([first, -first - last, last], axis=1), 1.0 / variance


@dataclass(frozen=True, eq=False)
class MotionEvidence:
    """What fitted poses show of the motion and of the errors.

    Attributes:
        squares: shape (pose,): sum of the squared deviations, each in units of its variance.
        determined: shape (pose,): number of deviations that the detections determine.
        errors: shape (3,): sums over the detections of their weights, of the squared weighted errors per axis, and of
            the derivatives of the weighted errors by the errors.
    """

    squares: np.ndarray
    determined: np.ndarray
    errors: np.ndarray

    def __add__(self, other: "MotionEvidence") -> "MotionEvidence":
        """Return what both show."""
        return MotionEvidence(
            self.squares + other.squares, self.determined + other.determined, self.errors + other.errors
        )


class PathFit:
    """Fit of the poses of one body.

    Args:
        state: State with one entry per frame, where the fit begins; it is not changed. Its shape is known.
        detections: Detections of the same frames, at least three.
        settings: Settings of the tracker.
    """

    def __init__(self, state: State, detections: PathDetections, settings: TrackerSettings) -> None:
        self.state = State(*(each.copy() for each in state))
        self.detections = detections
        self.settings = settings
        columns, nodes = _offset_columns(settings), len(settings.body.parents)
        self._scratch = PathScratch(
            columns, np.empty((nodes, 3)), np.empty((nodes, 3, 3)), np.empty((nodes, 3, 3)), np.empty((nodes, 3)),
            np.empty((3, columns.shape[1])),
        )  # fmt: skip
        self._linear: LinearObservations | None = None
        self._factor: PathFactor | None = None

    def release(self) -> None:
        """Release the memory of the equations; the poses remain."""
        self._linear = self._factor = None

    @property
    def linear(self) -> LinearObservations:
        """The linearized detections."""
        if self._linear is None:
            seen, offsets = self.detections.variance_px2.shape, self._scratch.columns.shape
            self._linear = LinearObservations(
                np.zeros((*seen, 2)), np.zeros((*seen, 2, 3)), np.zeros(seen), np.ones(seen), np.ones(seen),
                np.zeros((seen[0], offsets[0], 3, offsets[1])),
            )  # fmt: skip
        return self._linear

    @property
    def factor(self) -> PathFactor:
        """The factored equations."""
        if self._factor is None:
            n, frames = self.settings.tree.n_pose, len(self.detections.time_s)
            self._factor = PathFactor(*(np.empty((frames, n, n)) for _ in range(3)))
        return self._factor

    def fit(self, motion: PathMotion) -> bool:
        """Fit the poses; return whether all equations could be solved."""
        for length in _STEPS:
            self.linearize()
            system = self.equations(motion, self.settings.tree.n_pose)
            if not self.factorize(system) or not self.move(length * self.solve(system.gradient[:, :, None])[:, :, 0]):
                return False
        self.linearize()
        return True

    def linearize(self) -> None:
        """Linearize and weight the detections at the poses."""
        s, d = self.settings, self.detections
        align_bones(self.state.bones)
        linearize_path(
            s.cameras, s.node_body, s.law, self.state, d.keypoints_px, d.variance_px2, self._scratch, self.linear
        )

    def equations(self, motion: PathMotion, columns: int, inflation: float | None = None) -> PathSystem:
        """Return the normal equations at the poses.

        Args:
            motion: Motion of the body.
            columns: Number of the columns: those of the pose, or also those of the shape.
            inflation: For uncertainties: variance of the errors over that of the weighted ones; these errors last as
                long as those of the detector. None for estimates.
        """
        s, frames, n = self.settings, len(self.detections.time_s), self.settings.tree.n_pose
        system = PathSystem(
            np.zeros((frames, columns, columns)), np.zeros((frames, columns, columns)), np.zeros((frames, n)),
            np.zeros((frames, columns)),
        )  # fmt: skip
        share = _SHORT_MEMORY if inflation is None else _LASTING_MEMORY
        memory_s = max(share * s.options.smoother_error_memory_s, MIN_MEMORY_S)
        correlation = np.exp(-np.diff(self.detections.time_s, prepend=-np.inf) / memory_s)
        innovations = Innovations(*(np.empty(self.linear.precision.shape) for _ in range(2)))
        if inflation is None:
            weigh_errors(self.linear, correlation, innovations)
        else:
            weigh_lasting_errors(self.linear, correlation, inflation, innovations)
        add_observations(s.node_body, self.linear, innovations, self._scratch, system)
        self.add_priors(motion, system)
        return system

    def add_priors(self, motion: PathMotion, system: PathSystem) -> None:
        """Add joint limits, the motion, and the spread of new bodies to the equations."""
        s, n = self.settings, self.settings.tree.n_pose
        add_limits(s.body, s.options.limit_sigma**-2.0, self.state, system)
        coefficients, information = motion.rows(self.detections.time_s)
        add_motion(coefficients, information, self._deviations(coefficients), system)
        # Without any detection, a number of the pose is as uncertain as that of a new body.
        system.diagonal[:, np.arange(n), np.arange(n)] += 1.0 / s.most

    def factorize(self, system: PathSystem) -> bool:
        """Factor the equations of the poses, which are overwritten; return whether that was possible."""
        scratch = np.empty(2 * self.settings.tree.n_pose)
        return factor_path(system, self.factor, scratch) == len(self.detections.time_s)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return the solutions of the factored equations, shape (frame, pose, number)."""
        solution = np.ascontiguousarray(right).copy()
        solve_path(self.factor, solution, np.empty(solution.shape[1:]))
        return solution

    def move(self, change: np.ndarray) -> bool:
        """Move the poses, shape (frame, pose), by a limited step; return whether the change is finite."""
        largest = float(np.abs(change).max())
        if not np.isfinite(largest):
            return False
        move_poses(change * min(1.0, _MAX_STEP / max(largest, _MAX_STEP)), self.state)
        return True

    def covariances(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the inverse of the factored equations within the band, shape (frame, pose, pose) each.

        The blocks are those of each frame, of the next frame with it, and of the second frame with it.
        """
        blocks = tuple(np.empty_like(self.factor.inverse) for _ in range(3))
        invert_path(self.factor, *blocks)
        return blocks

    def motion_evidence(self, motion: PathMotion) -> MotionEvidence:
        """Return what the poses show of the motion, by the equations that were factored last."""
        coefficients, information = motion.rows(self.detections.time_s)
        own, one, two = (np.diagonal(each, axis1=1, axis2=2) for each in self.covariances())
        a, b, c = coefficients.transpose(1, 0, 2)
        variance = (
            a * a * own[:-2] + b * b * own[1:-1] + c * c * own[2:]
            + 2.0 * (a * b * one[:-2] + b * c * one[1:-1] + a * c * two[:-2])
        )  # fmt: skip
        determined = np.clip(1.0 - information * variance, 0.0, 1.0)
        squares = information * np.square(self._deviations(coefficients))
        return MotionEvidence(squares.sum(axis=0), determined.sum(axis=0), self._error_sums())

    def velocities(self) -> np.ndarray:
        """Return the mean velocity of the intervals before and after each frame, shape (frame, pose)."""
        time_s = self.detections.time_s
        change = np.empty((len(time_s) - 1, self.settings.tree.n_pose))
        pose_differences(self.state, change)
        velocity = change / np.diff(time_s)[:, None]
        return 0.5 * (np.concatenate([velocity[:1], velocity]) + np.concatenate([velocity, velocity[-1:]]))

    def _error_sums(self) -> np.ndarray:
        """Return ``errors`` of :class:`MotionEvidence`."""
        linear, nu = self.linear, self.settings.law.nu
        weight, squared = np.square(linear.weight), linear.squared
        errors = (weight, 0.5 * np.square(weight) * squared, weight * nu / (nu + squared))
        return np.array([each[linear.precision > 0.0].sum() for each in errors])

    def _deviations(self, coefficients: np.ndarray) -> np.ndarray:
        """Return the deviations from the motion, shape (row, pose)."""
        change = np.empty((len(self.detections.time_s) - 1, self.settings.tree.n_pose))
        pose_differences(self.state, change)
        return coefficients[:, 2] * change[1:] - coefficients[:, 0] * change[:-1]


@dataclass(frozen=True, eq=False)
class LengthEquations:
    """Normal equations of the bone lengths of a body.

    Attributes:
        curvature: shape (shape, shape): of the negative log likelihood.
        gradient: shape (shape,): of the log likelihood.
    """

    curvature: np.ndarray
    gradient: np.ndarray

    def __add__(self, other: "LengthEquations") -> "LengthEquations":
        """Return the equations of both."""
        return LengthEquations(self.curvature + other.curvature, self.gradient + other.gradient)


@dataclass(frozen=True, eq=False)
class ReducedPath:
    """Equations of a path without its poses, by their Schur complement.

    Attributes:
        lengths: Equations of the lengths.
        pose: shape (frame, pose): change of the poses if the lengths do not change.
        by_length: shape (frame, pose, shape): what a change of each length takes from it.
    """

    lengths: LengthEquations
    pose: np.ndarray
    by_length: np.ndarray

    def covariance(self, poses: np.ndarray, lengths_m2: np.ndarray) -> np.ndarray:
        """Return the joint covariances of poses and lengths, shape (frame, pose + shape, pose + shape).

        Args:
            poses: shape (frame, pose, pose): covariances for known lengths.
            lengths_m2: shape (frame, shape, shape): covariances of the lengths.
        """
        n = poses.shape[1]
        mixed = -self.by_length @ lengths_m2
        joint = np.empty((len(poses), n + lengths_m2.shape[1], n + lengths_m2.shape[1]))
        joint[:, :n, :n] = poses - mixed @ self.by_length.transpose(0, 2, 1)
        joint[:, :n, n:] = mixed
        joint[:, n:, :n] = mixed.transpose(0, 2, 1)
        joint[:, n:, n:] = lengths_m2
        return joint


def _offset_columns(settings: TrackerSettings) -> np.ndarray:
    """Return the ``columns`` of :class:`PathScratch`."""
    body, n_pose, n_segments = settings.node_body, settings.tree.n_pose, len(settings.tree.segments)
    columns = np.full((len(body.parents), 6), -1)
    for node, (parent, carrier, lengths) in enumerate(zip(body.parents, body.carriers, body.shape_of, strict=True)):
        if parent < 0:
            own = [0, 1, 2]
        elif body.is_bone[node]:
            own = [3 + 3 * n_segments + 2 * carrier + i for i in range(2)]
        else:
            own = [3 + 3 * carrier + i for i in range(3)]
        own = [*own, *(n_pose + lengths[lengths >= 0])]
        columns[node, : len(own)] = own
    return columns


def reduce_to_lengths(fit: PathFit, motion: PathMotion, inflation: float | None = None) -> ReducedPath | None:
    """Return the equations of a linearized fit without its poses; None if they could not be solved.

    With ``inflation`` they are those of uncertainties, as in :meth:`PathFit.equations`.
    """
    n, h = fit.settings.tree.n_pose, fit.settings.tree.n_shape
    system = fit.equations(motion, n + h, inflation)
    own, following = system.diagonal, system.next
    pose = system._replace(
        diagonal=own[:, :n, :n].copy(), next=following[:, :n, :n].copy(), gradient=system.gradient[:, :n].copy()
    )  # fmt: skip
    if not fit.factorize(pose):
        return None
    mixed = own[:, n:, :n].transpose(0, 2, 1) + following[:, :n, n:]
    mixed[:-1] += following[1:, n:, :n].transpose(0, 2, 1)
    solution = fit.solve(np.concatenate([pose.gradient[:, :, None], mixed], axis=2))
    lower, link = np.tril(own[:, n:, n:].sum(axis=0)), following[:, n:, n:].sum(axis=0)
    reduced = np.einsum("fpi,fpj->ij", mixed, solution)
    curvature = lower + np.tril(lower, -1).T + link + link.T - reduced[:, 1:]
    gradient = system.gradient[:, n:].sum(axis=0) - reduced[:, 0]
    lengths = LengthEquations(0.5 * (curvature + curvature.T), gradient)
    return ReducedPath(lengths, solution[:, :, 0], solution[:, :, 1:])
