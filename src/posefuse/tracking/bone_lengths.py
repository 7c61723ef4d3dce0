"""Bone lengths of tracked bodies: estimated, fixed once they are stable, and estimated again where they are biased.

Every 0.4 s the views of a frame are compared with the lengths: a body with wide priors of pose and lengths is fitted to
the frame, from the filtered pose. The fits of about 2 s are taken together, tempered for the correlation of the errors.
Lengths that they contradict are estimated again, starting with what the fits show. See docs/methods/tracking.md.
"""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from posefuse.arrays import frozen, kernel_array
from posefuse.kernels.tracking.records import AssignedDetections, State, UpdateResults
from posefuse.kernels.tracking.smoothing import apply_changes
from posefuse.kernels.tracking.update import update_people
from posefuse.kinematics.initial_pose import initial_covariance
from posefuse.model.frames import Frame
from posefuse.model.options.tracker import MotionOptions
from posefuse.skeleton.trees import Tree
from posefuse.tracking.body_states import ProjectedBodies, select_states
from posefuse.tracking.frame_clock import differ_in_time, view_times
from posefuse.tracking.settings import TrackerSettings, correlation_factor, tempering_factor

_WINDOW, _MIN_CHECKS, _MAX_AGE_S = 6, 4, 4.0
"""Number of comparisons that are taken together, the fewest, and the time after which they are dropped."""
_PRIOR_CHECKS = 4.0
"""Number of comparisons for which the expected dispersion counts in its estimate."""
_SCREENING_SHARE = 0.7
"""Share of the limit of a bias from which it is computed."""
_MAX_MISFIT = 0.9
"""Mean log density of residuals relative to that of the noise law beyond which a pose does not fit the views: sides or
people are probably mixed up, and lengths mean nothing."""
_STEPS = 2
"""Number of Gauss-Newton steps of a comparison."""
_PRIOR_FACTOR = 3.0
"""Standard deviation of lengths in a comparison, relative to that between people."""
_BONE_BIAS, _OFFSET_BIAS = (0.01, 0.003), (0.03, 0.01)
"""Standard deviations of systematic differences between postures and views, of bones and of points on a segment, which
bends: as a share of the length, and in meters for an adult."""
_STEADY_S = 1.0
"""Time for which an estimate must stay within its standard deviation to be steady."""
_AFFECTED_SIGMA = 1.0
"""Bias, in standard deviations, from which a length is estimated again along with one that is biased beyond the limit:
a displaced joint changes the bones on both of its sides."""


@dataclass(frozen=True, eq=False)
class LengthComparison:
    """What the views of one frame show about the lengths of one body, without a prior.

    Attributes:
        time_s: Time of the frame, in seconds.
        information: shape (shape, shape).
        pull: shape (shape,): product of the information and the measured lengths minus those of the tree.
        measured_m: shape (shape,): lengths minus those of the tree, from this frame and a wide prior.
        variance_m2: shape (shape,): their variances.
        misfit: Size of the residuals relative to the noise law, whose expectation is 1.
    """

    time_s: float
    information: np.ndarray
    pull: np.ndarray
    measured_m: np.ndarray
    variance_m2: np.ndarray
    misfit: float


@dataclass
class LengthMonitor:
    """Recent comparisons of the lengths of one body with the views, and for how long their estimate has been steady.

    Attributes:
        recent: The last comparisons, oldest first.
        reference_m: shape (shape,): lengths from which the steady time counts; None before that.
        steady_s: Time for which the lengths have stayed close to the reference, in seconds.
        to_reopen: shape (shape,), bool: lengths to estimate again from the next frame on; None for no change.
    """

    recent: list[LengthComparison] = field(default_factory=list)
    reference_m: np.ndarray | None = None
    steady_s: float = 0.0
    to_reopen: np.ndarray | None = None

    def is_stable(
        self, shape_m: np.ndarray, covariance_m2: np.ndarray, observed_s: float, dt_s: float, settings: TrackerSettings
    ) -> bool:
        """Note an estimate of a frame that shows the body, and return whether the lengths are stable.

        They are if the median of their standard deviations is below ``fix_shape_sd_m``, and if no length has moved by
        more than its standard deviation for a second.

        Args:
            shape_m: shape (shape,).
            covariance_m2: shape (shape, shape): of the filter, which assumes a short correlation of errors.
            observed_s: Time for which the lengths have been observed, in seconds.
            dt_s: Time since the last frame, in seconds.
            settings: Settings of the tracker.
        """
        limit_m = settings.options.fix_shape_sd_m
        if limit_m is None:
            return False
        sd_m = np.sqrt(correlation_factor(observed_s, settings.options) * np.diag(covariance_m2))
        if self.reference_m is None or (np.abs(shape_m - self.reference_m) > sd_m).any():
            self.reference_m, self.steady_s = shape_m.copy(), 0.0
        else:
            self.steady_s += dt_s
        return self.steady_s >= _STEADY_S and bool(np.median(sd_m) < limit_m)

    def add(self, shown: LengthComparison) -> None:
        """Add a comparison."""
        fresh = [each for each in self.recent if shown.time_s - each.time_s < _MAX_AGE_S]
        self.recent = [*fresh[1 - _WINDOW :], shown]

    def pooled(self, memory_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Return information and pull of the recent comparisons, tempered for errors with a correlation time."""
        share = self._shares(memory_s)
        return (
            np.tensordot(share, [each.information for each in self.recent], 1),
            np.tensordot(share, [each.pull for each in self.recent], 1),
        )

    def _shares(self, memory_s: float) -> np.ndarray:
        """Return the share of independent information in each of the recent comparisons, shape (comparison,)."""
        times_s = np.array([each.time_s for each in self.recent])
        return 1.0 / tempering_factor(np.diff(times_s, prepend=-np.inf), memory_s)

    def bias_sigma(self, shape_m: np.ndarray, settings: TrackerSettings) -> np.ndarray:
        """Return how much longer the views show lengths, in standard deviations, shape (shape,).

        The standard deviations are those of unbiased lengths. They include systematic differences between postures, and
        grow where the comparisons differ from each other by more than their errors.

        Args:
            shape_m: shape (shape,): lengths.
            settings: Settings of the tracker.
        """
        tree, memory_s = settings.tree, settings.options.smoother_error_memory_s
        information, pull = self.pooled(memory_s)
        posterior = np.linalg.inv(information + _prior_information(tree))
        response = posterior @ information
        noise = np.diag(response @ posterior) * self._dispersion(self._shares(memory_s))
        systematic = response**2 @ _systematic_variance_m2(tree)
        bias_m = posterior @ (pull - information @ (shape_m - tree.shape_m))
        return bias_m / np.sqrt(np.maximum(noise + systematic, np.finfo(float).tiny))

    def _dispersion(self, share: np.ndarray) -> np.ndarray:
        """Return by how much the variance between comparisons exceeds that of their errors, shape (shape,), from 1."""
        measured = np.array([each.measured_m for each in self.recent])
        variance = np.array([each.variance_m2 for each in self.recent])
        squares = ((measured - share @ measured / share.sum()) ** 2 / variance).sum(axis=0)
        return np.maximum((squares + _PRIOR_CHECKS) / (len(share) - 1 + _PRIOR_CHECKS), 1.0)

    def _may_be_biased(self, shape_m: np.ndarray, limit: float, tree: Tree) -> bool:
        """Return whether any length may be biased, which costs much less than to compute the bias.

        The noise of a mean is at least that of as many independent comparisons.
        """
        n = len(self.recent)
        mean_m, variance = (
            sum(getattr(each, name) for each in self.recent) / n for name in ("measured_m", "variance_m2")
        )
        away_m = np.abs(mean_m - (shape_m - tree.shape_m))
        return bool(
            (away_m > _SCREENING_SHARE * limit * np.sqrt(variance / n + 0.5 * _systematic_variance_m2(tree))).any()
        )

    def find_biased(self, shape_m: np.ndarray, settings: TrackerSettings) -> np.ndarray | None:
        """Return which lengths the recent comparisons contradict, shape (shape,), bool; None if they agree.

        If so, the lengths to estimate again are noted.

        Args:
            shape_m: shape (shape,): lengths.
            settings: Settings of the tracker.
        """
        limit, recent = settings.options.reopen_shape_sigma, self.recent
        if limit is None or len(recent) < _MIN_CHECKS or not self._may_be_biased(shape_m, limit, settings.tree):
            return None
        if sum(each.misfit for each in recent) > _MAX_MISFIT * len(recent):
            return None
        sigma = np.abs(self.bias_sigma(shape_m, settings))
        if not (sigma > limit).any():
            return None
        self.to_reopen = sigma > min(limit, _AFFECTED_SIGMA)
        return sigma > limit


@lru_cache(maxsize=16)
def _prior_information(tree: Tree) -> np.ndarray:
    """Return the information of a wide prior of lengths without the proportions of bodies, shape (shape, shape)."""
    return frozen(np.diag(1.0 / (_PRIOR_FACTOR**2 * np.diag(tree.shape_covariance))))


@lru_cache(maxsize=16)
def _wide_covariance(tree: Tree, motion: MotionOptions) -> np.ndarray:
    """Return the covariance of a new body with wide priors, shape (all, all)."""
    return frozen(initial_covariance(tree, np.linalg.inv(_prior_information(tree)), motion))


@lru_cache(maxsize=16)
def _systematic_variance_m2(tree: Tree) -> np.ndarray:
    """Return the variances of differences between lengths in several postures and views, shape (shape,)."""
    share, constant_m = np.tile(np.array(_OFFSET_BIAS)[:, None], tree.n_shape)
    for node in tree.nodes:
        if node.is_bone and node.shape[2] >= 0:
            share[node.shape[2]], constant_m[node.shape[2]] = _BONE_BIAS
    return frozen((share * np.abs(tree.shape_m) + constant_m * tree.scale) ** 2)


@lru_cache(maxsize=16)
def _tilts(tree: Tree) -> np.ndarray:
    """Return which share of the variances of the pose lengthens each length, shape (pose, shape)."""
    first, tilts = 3 + 3 * len(tree.segments), np.zeros((tree.n_pose, tree.n_shape))
    bones = [node for node in tree.nodes if node.is_bone and node.shape[2] >= 0]
    for node in bones:
        tilts[first + 2 * node.mover : first + 2 * node.mover + 2, node.shape[2]] = 0.5
    return frozen(tilts / np.maximum(np.bincount([n.shape[2] for n in bones], minlength=tree.n_shape), 1))


def measure_lengths(
    state: State, frame: Frame, time_s: float, rows: np.ndarray, labels: np.ndarray, settings: TrackerSettings
) -> list[LengthComparison]:
    """Measure the lengths of bodies in one frame, apart from what is known about their lengths and poses.

    Args:
        state: States after the update by the frame; not changed.
        frame: The detections.
        time_s: Time of the frame, in seconds.
        rows: shape (body, view), int64: assigned detections, -1 for none.
        labels: shape (body, view, keypoint), int64: which of a detection's keypoints to use, -1 for none.
        settings: Settings of the tracker.
    """
    tree, n, h = settings.tree, settings.tree.n_pose, settings.tree.n_shape
    bodies = len(state.root)
    keypoints_px = keypoints_at_one_time(state, frame, time_s, rows, settings)
    wide = select_states(state, np.arange(bodies))
    wide.free[:] = 1
    wide.covariance[:] = _wide_covariance(tree, settings.options.motion)
    detections = AssignedDetections(
        np.ascontiguousarray(rows), np.ascontiguousarray(labels), kernel_array(keypoints_px), frame.confidence
    )
    out = UpdateResults(np.empty(labels.shape, dtype=np.int64), np.empty(bodies), np.empty(bodies))
    update_people(settings.cameras, settings.body, settings.law, detections, np.ones(bodies), _STEPS, wide, out)
    block, variances = wide.covariance[:, n : n + h, n : n + h], np.diagonal(wide.covariance, axis1=1, axis2=2)
    # With the variances v of the two tilts of a bone of length L, errors make it longer by L (v1 + v2) / 2.
    change_m = wide.shape - state.shape * (1.0 + variances[:, :n] @ _tilts(tree))
    after = np.linalg.inv(block)
    information = after - _prior_information(tree)
    pull = (after @ change_m[..., None] + information @ (state.shape - tree.shape_m)[..., None])[..., 0]
    measured_m = (block @ pull[..., None])[..., 0]
    misfit = _misfits(wide, keypoints_px, frame.confidence, rows, labels, settings)
    return [
        LengthComparison(time_s, information[i], pull[i], measured_m[i], variances[i, n : n + h], float(misfit[i]))
        for i in range(bodies)
    ]


def _misfits(
    state: State,
    keypoints_px: np.ndarray,
    confidence: np.ndarray,
    rows: np.ndarray,
    labels: np.ndarray,
    settings: TrackerSettings,
) -> np.ndarray:
    """Return the mean of log(1 + r^2 / nu) over the residuals r of each body, relative to its expectation 2 / nu."""
    nu, (bodies, views, keypoints) = settings.law.nu, labels.shape
    projected = ProjectedBodies.of(state, settings.cameras, settings.body)
    shown = (rows[:, :, None] >= 0) & (labels >= 0)
    row, label = np.where(shown, rows[:, :, None], 0), np.where(shown, labels, 0)
    view = np.tile(np.arange(views), bodies)
    noise = settings.variance_px2(confidence[row, label].reshape(-1, keypoints), view).reshape(labels.shape)
    squared = ((keypoints_px[row, label] - projected.pixels) ** 2).sum(axis=-1)
    # The scale of keypoints that the body lacks is undefined.
    floor_px = settings.law.floor_m * np.where(shown, projected.px_per_m, 0.0)
    misfit = np.log1p(squared / (noise + floor_px**2) / nu) * nu / 2.0
    counts = shown & np.isfinite(misfit)
    return np.where(counts, misfit, 0.0).sum(axis=(1, 2)) / np.maximum(counts.sum(axis=(1, 2)), 1)


def keypoints_at_one_time(
    state: State, frame: Frame, time_s: float, rows: np.ndarray, settings: TrackerSettings
) -> np.ndarray:
    """Return the detections moved to the time of the states by the velocities of the bodies, shape (row, keypoint, 2).

    Args:
        state: States after the update by the frame.
        frame: The detections.
        time_s: Time of the states, in seconds.
        rows: shape (body, view), int64: assigned detections, -1 for none.
        settings: Settings of the tracker.
    """
    if not differ_in_time(frame):
        return frame.keypoints_px
    moved_px, bodies, n = frame.keypoints_px.copy(), len(state.root), settings.tree.n_pose
    now = ProjectedBodies.of(state, settings.cameras, settings.body).pixels
    for taken_s, views in view_times(frame, time_s):
        then = select_states(state, np.arange(bodies))
        change = np.zeros((bodies, state.covariance.shape[1]))
        change[:, :n] = (taken_s - time_s) * state.velocity
        apply_changes(change, then)
        shift_px = ProjectedBodies.of(then, settings.cameras, settings.body).pixels - now
        p, v = np.nonzero((rows >= 0) & views)
        shift = shift_px[p, v]
        moved_px[rows[p, v]] -= np.where(np.isfinite(shift), shift, 0.0)
    return moved_px


def reopen_shape(
    state: State, body: int, covariance_m2: np.ndarray, monitor: LengthMonitor, settings: TrackerSettings
) -> None:
    """Estimate the fixed lengths of a body again, in place, from what the recent comparisons show.

    Args:
        state: Updated in place.
        body: Index of the body.
        covariance_m2: shape (shape, shape): covariance of the lengths when they were fixed. The variances of the biased
            ones grow by those between people.
        monitor: Recent comparisons, and the biased lengths.
        settings: Settings of the tracker.
    """
    tree, n, h = settings.tree, settings.tree.n_pose, settings.tree.n_shape
    information, pull = monitor.pooled(settings.options.smoother_error_memory_s)
    affected = np.zeros(h, dtype=bool) if monitor.to_reopen is None else monitor.to_reopen
    prior = covariance_m2 + np.diag(np.where(affected, np.diag(tree.shape_covariance), 0.0))
    posterior = np.linalg.inv(np.linalg.inv(prior) + information)
    before_m = state.shape[body].copy()
    state.shape[body] = before_m + posterior @ (pull - information @ (before_m - tree.shape_m))
    state.covariance[body, n : n + h, n : n + h] = 0.5 * (posterior + posterior.T)
    state.free[body] = 1
