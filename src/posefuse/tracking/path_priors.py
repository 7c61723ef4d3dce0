"""Priors of fitted paths, estimated from a recording: motion, bone lengths of each person, and level of the errors.

Accelerations are white with the spectral density that maximizes the marginal likelihood for linear measurements: the
squared deviations from the motion over the number of deviations that the detections determine (MacKay, "Bayesian
interpolation", 1992). Bone lengths are fitted together with the poses. The variance of a robust estimate is that of the
weighted errors over the square of the mean derivative of the weighted errors (Huber, "Robust statistics", 1981); both
follow from the fitted errors.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from posefuse.checkpoint import Spool
from posefuse.kernels.tracking.records import State
from posefuse.parallel import Jobs
from posefuse.tracking.backward_pass import smooth_in_place
from posefuse.tracking.history import History
from posefuse.tracking.path_fit import (
    LengthEquations,
    MotionEvidence,
    PathDetections,
    PathFit,
    PathMotion,
    reduce_to_lengths,
)
from posefuse.tracking.refiltering import refilter_run
from posefuse.tracking.runs import Run
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.smoothed_bodies import SmoothedBodies

_SPANS, _SPAN_FRAMES, _MIN_FRAMES = 4, 128, 8
"""Number and length of the ranges of frames of each person that priors are estimated from."""

_MAX_PEOPLE = 12
"""Number of people, those with the longest tracks, who show how all of them move."""

_ROUNDS = 7
"""Each round is one step of all poses and lengths, and one estimate of the motion."""

_INITIAL_SHARE = 0.05
"""Typical density of accelerations over that of the filter, which must follow the fastest motion without delay."""

_MIN_POWER = 1e-9
"""Least typical density, for options that let a number of the pose not accelerate at all."""

_PRIOR_DEVIATIONS = 10.0
"""Weight of the typical density, as a number of deviations."""

_MAX_LENGTH_CHANGE = 1.0
"""Largest change of a length from that of the filter, in standard deviations of its prior. Fitted together with the
poses, short bones grow by the errors of their ends, and those that no view tells from a turn move without a limit."""

_MAX_SQUARED_ERROR = 1.5
"""Largest median squared error of fitted poses over that of the smoothed ones. Where errors are small and independent,
deviations of the body from its model outweigh them, and fitted poses are worse."""

_LASTING_SHARE = 0.2
"""Typical lasting offset between a joint of the body and the keypoint over the one that the noise model assumes."""

_SLIDING_SHARE = 0.5
"""The same for the offsets of keypoints that slide with the skin, by which they exceed those of humans."""


@dataclass(frozen=True, eq=False)
class BodyLengths:
    """Bone lengths of a track in a range of frames.

    Attributes:
        start: Index of the first frame in the history.
        shape_m: shape (shape,).
        covariance_m2: shape (shape, shape).
    """

    start: int
    shape_m: np.ndarray
    covariance_m2: np.ndarray


@dataclass(frozen=True, eq=False)
class PathPriors:
    """Priors of fitted paths.

    Attributes:
        motion: Motion of all bodies.
        inflation: Variance of robust estimates over that of weighted ones.
        bodies: Lengths by number of the track, in order of time.
    """

    motion: PathMotion
    inflation: float
    bodies: dict[int, list[BodyLengths]]


def estimate_priors(history: History, settings: TrackerSettings, uncertain: bool = True) -> PathPriors | None:
    """Estimate the priors from some frames of a history; None if it holds too few detected keypoints.

    Args:
        history: History of a tracker.
        settings: Settings of the tracker.
        uncertain: Whether the covariances of the lengths are needed; they are NaN otherwise.
    """
    samples = _samples(history)
    longest = sorted(samples, key=lambda each: (each.start - each.stop, each.number))[:_MAX_PEOPLE]
    bodies = {sample: _BodyFit.of(sample, history, settings) for sample in longest}
    if not any(body.fits for body in bodies.values()):
        return None
    typical = np.maximum(_INITIAL_SHARE * settings.power, _MIN_POWER)
    motion, alike = PathMotion(settings.decay_s, typical), _alike_numbers(settings)
    evidence = None
    for _ in range(_ROUNDS):
        prior = _PRIOR_DEVIATIONS * np.ones(len(typical))
        evidence = MotionEvidence(prior * typical / motion.power, prior, np.full(3, 1e-9))
        for body in bodies.values():
            for each in body.step(motion):
                evidence += each
        squares, determined = (np.bincount(alike, each)[alike] for each in (evidence.squares, evidence.determined))
        motion = PathMotion(settings.decay_s, motion.power * squares / determined)
    assert evidence is not None
    weights, squares, slopes = evidence.errors
    inflation = float(weights * squares / slopes**2)
    lengths: dict[int, list[BodyLengths]] = {}
    for sample in samples:
        body = bodies.get(sample)
        if body is None:
            body = _BodyFit.of(sample, history, settings)
            for _ in range(_ROUNDS):
                body.step(motion)
        if body.explains_detections():
            unknown = np.full((len(body.shape_m), len(body.shape_m)), np.nan)
            covariance_m2 = body.covariance_m2(motion, inflation) if uncertain else unknown
            found = BodyLengths(sample.start, body.shape_m, covariance_m2)
            lengths.setdefault(sample.number, []).append(found)
    return PathPriors(motion, inflation, lengths)


def _alike_numbers(settings: TrackerSettings) -> np.ndarray:
    """Return for each number of the pose the first one with the same spectral density, shape (pose,), int64.

    The axes of the world across the vertical, and those of a bone across its direction, are arbitrary: with densities
    of their own, a turned world would change the poses.
    """
    tree, up = settings.tree, settings.up
    alike, first_tilt = np.arange(tree.n_pose), 3 + 3 * len(tree.segments)
    vertical = np.zeros(3, dtype=bool) if up is None else np.abs(up) > 0.5
    alike[:3][~vertical] = np.flatnonzero(~vertical)[0]
    alike[first_tilt + 1 :: 2] = alike[first_tilt::2]
    return alike


def begin_priors(history: History, jobs: Jobs) -> Callable[[], PathPriors | None] | None:
    """Begin to estimate the priors of a whole history in another process.

    Returns:
        A function that waits for the priors; None where they are not needed, or better estimated in this process: with
        one job, and for a short recording, whose history no other process can read.
    """
    spool = None if jobs.number == 1 else history.shared_spool
    if spool is None or history.settings.options.smoother != "full":
        return None
    return cache(jobs.begin(_estimate_elsewhere, (history, spool)))


def _estimate_elsewhere(given: tuple[History, Spool]) -> PathPriors | None:
    history, spool = given
    history.attach_spool(spool)
    return estimate_priors(history, history.settings)


@dataclass(frozen=True)
class _Sample:
    """Some ranges of frames of one epoch of a track: its first frame and end, and the ranges, evenly spread over it."""

    number: int
    start: int
    stop: int
    ranges: tuple[tuple[int, int], ...]


def _samples(history: History) -> list[_Sample]:
    """Return a sample of each epoch of each track."""
    samples = []
    for number, epochs in sorted(history.epochs.items()):
        for epoch in epochs:
            count = min(_SPANS, -(-(epoch.stop - epoch.start) // _SPAN_FRAMES))
            last = max(epoch.stop - _SPAN_FRAMES, epoch.start)
            stop, ranges = epoch.start, []
            for start in np.linspace(epoch.start, last, count).astype(int).tolist():
                first, stop = max(start, stop), min(start + _SPAN_FRAMES, epoch.stop)
                ranges.append((first, stop))
            samples.append(_Sample(number, epoch.start, epoch.stop, tuple(ranges)))
    return samples


class _BodyFit:
    """Poses of one person in some ranges of frames, and the common bone lengths."""

    def __init__(self, fits: list[PathFit], shape_m: np.ndarray, settings: TrackerSettings) -> None:
        self.fits = fits
        self.shape_m = shape_m
        self._settings = settings
        self._start_m = shape_m
        self._start_error = self._squared_error()

    @classmethod
    def of(cls, sample: _Sample, history: History, settings: TrackerSettings) -> "_BodyFit":
        """Begin with the smoothed states of the filter and its last lengths; short ranges are left out."""
        fits, shape_m = [], settings.tree.shape_m
        for span in sample.ranges:
            for run in history.runs(*span, sample.number):
                if len(run) < _MIN_FRAMES or not np.isfinite(run.confidence).any():
                    continue
                state = State(*(each.copy() for each in refilter_run(run, None, settings).state))
                smooth_in_place(state, run.time_s, settings, means_only=True)
                shape_m = run.state.shape[-1]
                detections = PathDetections.of(run.time_s, run.keypoints_px, run.confidence, settings)
                fits.append(PathFit(_without_covariance(state), detections, settings))
        for fit in fits:
            fit.state.shape[:] = shape_m
        return cls(fits, shape_m.copy(), settings)

    def step(self, motion: PathMotion) -> list[MotionEvidence]:
        """Take one step of all poses and lengths; return the evidence of each range about the motion."""
        tree = self._settings.tree
        prior = np.linalg.pinv(tree.shape_covariance, hermitian=True)
        equations = LengthEquations(prior, prior @ (tree.shape_m - self.shape_m))
        evidence, solved = [], []
        for fit in self.fits:
            fit.linearize()
            reduced = reduce_to_lengths(fit, motion)
            if reduced is None:
                continue
            evidence.append(fit.motion_evidence(motion))
            equations = equations + reduced.lengths
            solved.append((fit, reduced))
            fit.release()
        shape_m = self.shape_m + np.linalg.pinv(equations.curvature, hermitian=True) @ equations.gradient
        most_m = _MAX_LENGTH_CHANGE * np.sqrt(np.diag(tree.shape_covariance))
        change_m = np.clip(shape_m, self._start_m - most_m, self._start_m + most_m) - self.shape_m
        self.shape_m = self.shape_m + change_m
        self.fits = [fit for fit, reduced in solved if fit.move(reduced.pose - reduced.by_length @ change_m)]
        for fit in self.fits:
            fit.state.shape[:] = self.shape_m
        return evidence

    def covariance_m2(self, motion: PathMotion, inflation: float) -> np.ndarray:
        """Return the covariance of the lengths, shape (shape, shape)."""
        information = np.linalg.pinv(self._settings.tree.shape_covariance, hermitian=True)
        for fit in self.fits:
            fit.linearize()
            reduced = reduce_to_lengths(fit, motion, inflation)
            if reduced is not None:
                information = information + reduced.lengths.curvature
            fit.release()
        return np.linalg.pinv(information, hermitian=True)

    def explains_detections(self) -> bool:
        """Return whether there are fits, whose errors are not much larger than those of the smoothed poses."""
        return bool(self.fits) and self._squared_error() <= _MAX_SQUARED_ERROR * self._start_error

    def _squared_error(self) -> float:
        """Return the median squared error of all detected keypoints, in variances; NaN without any."""
        errors = []
        for fit in self.fits:
            fit.linearize()
            errors.append(fit.linear.squared[fit.linear.precision > 0.0])
            fit.release()
        return float(np.median(np.concatenate(errors))) if errors else np.nan


def fit_path(
    begin: State, run: Run, priors: PathPriors, settings: TrackerSettings, uncertain: bool = True
) -> State | None:
    """Fit the poses of one person to all detections of a run.

    Args:
        begin: States of the run, filtered or smoothed, where the fit begins.
        run: Consecutive frames of one track.
        priors: Priors of the recording.
        settings: Settings of the tracker.
        uncertain: Whether the covariances are needed; they are empty otherwise.

    Returns:
        State with one entry per frame, and covariances without velocities; None if the run is too short, shows nothing
            or could not be fitted, or if fitted poses of the track explain the detections worse than the smoothed ones.
    """
    lengths = priors.bodies.get(run.number)
    if len(run) < _MIN_FRAMES or not lengths or not np.isfinite(run.confidence).any():
        return None
    epoch = np.searchsorted([each.start for each in lengths], run.places, side="right") - 1
    epoch = np.maximum(epoch, 0)
    state = begin._replace(shape=np.stack([each.shape_m for each in lengths])[epoch])
    detections = PathDetections.of(run.time_s, run.keypoints_px, run.confidence, settings)
    fit = PathFit(_without_covariance(state), detections, settings)
    if not fit.fit(priors.motion):
        return None
    if not uncertain:
        return fit.state
    reduced = reduce_to_lengths(fit, priors.motion, priors.inflation)
    if reduced is None:
        return None
    lengths_m2 = np.stack([each.covariance_m2 for each in lengths])[epoch]
    covariance = reduced.covariance(fit.covariances()[0], lengths_m2)
    free = np.ones(len(run), dtype=np.int64)
    return fit.state._replace(velocity=fit.velocities(), covariance=covariance, free=free)


def with_lasting_offsets(body: SmoothedBodies, settings: TrackerSettings) -> SmoothedBodies:
    """Return a fitted body with the uncertainty of the offsets between joints and keypoints, which no frame reduces."""
    floor_m = settings.law.floor_m
    human_m = floor_m / max(settings.tree.offset_factor, 1.0)
    offset_m2 = (_LASTING_SHARE * human_m) ** 2 + _SLIDING_SHARE**2 * (floor_m**2 - human_m**2)
    return replace(body, covariance_m2=body.covariance_m2 + offset_m2 * np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0]))


def _without_covariance(state: State) -> State:
    """Return a state whose covariance takes no memory."""
    return state._replace(covariance=state.covariance[:, :0, :0])
