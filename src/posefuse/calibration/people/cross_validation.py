"""Test a rig by prediction: cameras from one half of a recording must predict the other half, at its own times.

Under the null hypothesis, the views are unrelated, or people show too little: a rig that fits errors and chance
predicts held-out observations no better than those of one view at wrong times (a permutation test of cross-validated
predictions, M. Stone, "Cross-validatory choice and assessment of statistical predictions", Journal of the Royal
Statistical Society B 36, 1974).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posefuse.calibration.people.assemble import Assembly, free_parameters, readjust
from posefuse.calibration.people.bearings import Bearings
from posefuse.calibration.people.bodies import BodySamples, Bones
from posefuse.calibration.people.body_bundle import BodyState, adjust_bodies, initial_state
from posefuse.calibration.people.likelihood import SIGNIFICANT, advantage, body_costs
from posefuse.calibration.people.sample_sides import with_corrected_sides
from posefuse.errors import CalibrationError, choices
from posefuse.kernels.calibration.body_bundle import VIEW_COLUMNS

_WRONG_TIMES = ((0.25, False), (0.5, False), (0.75, False), (0.0, True), (0.25, True), (0.5, True), (0.75, True))
"""By which share of a half a view is later, circularly, and whether its time runs backward."""
_MOST_VIEWS, _TWO = 3, 2
_MIN_SAMPLES = 12
_ROUNDS, _STEPS = 2, 6


def check_prediction(views: Sequence[Bearings], bones: Bones, focal_known: np.ndarray, assembly: Assembly) -> None:
    """Check that two or three views predict each other in held-out times.

    More views test each other: those that agree with no others are left out before.

    Args:
        views: directions of all views.
        bones: bones of the skeleton.
        focal_known: shape (view,), bool, of all views.
        assembly: of some views.

    Raises:
        CalibrationError: if a view is predicted no better than at wrong times.
    """
    if len(assembly.views) > _MOST_VIEWS or len(assembly.samples.time_s) < _MIN_SAMPLES:
        return
    if prediction_advantage(assembly, bones, focal_known[list(assembly.views)]) < SIGNIFICANT:
        raise CalibrationError(
            f"The people do not determine the cameras {choices(views[v].name for v in assembly.views)}: a calibration "
            "by one half of the recording predicts the other half hardly better than at wrong times. Film for longer "
            "a person who walks through the images of all cameras, turns around and raises an arm, or add a camera."
        )


def prediction_advantage(assembly: Assembly, bones: Bones, focal_known: np.ndarray) -> float:
    """Return by how many standard deviations held-out observations are more probable at their own times.

    It is that of the view and the wrong times for which it is smallest.

    Args:
        assembly: of at least two views.
        bones: bones of the skeleton.
        focal_known: shape (view,), bool, of the views of the assembly.
    """
    samples = assembly.samples
    free = free_parameters(focal_known, False)
    is_later = samples.time_s > np.median(samples.time_s)
    # Of two views, a shift of one is a shift of the other.
    shifts = [
        (v, *wrong) for v in range(1 if samples.n_views == _TWO else 0, samples.n_views) for wrong in _WRONG_TIMES
    ]
    time_s, own, others = [], [], [[] for _ in shifts]
    for half in (is_later, ~is_later):
        held_out = samples.select(~half)
        state = _refitted(assembly, samples.select(half), bones, free)
        time_s.append(held_out.time_s)
        own.append(_held_out_costs(held_out, bones, state))
        for costs, shift in zip(others, shifts, strict=True):
            costs.append(_held_out_costs(at_wrong_times(held_out, *shift), bones, state))
    joined, times = np.concatenate(own), np.concatenate(time_s)
    return min(advantage(joined, np.concatenate(costs), times) for costs in others)


def at_wrong_times(samples: BodySamples, view: int, share: float, runs_backward: bool) -> BodySamples:
    """Return the samples with the observations of a view, of each person, in another order of time.

    Args:
        samples: observations, of each person ordered by time.
        view: place of the view.
        share: by which share of the samples the view is later, circularly.
        runs_backward: whether its time runs backward.
    """
    observed = samples.observed.copy()
    seen = np.isfinite(observed[:, view, :, 0]).any(axis=1)
    for person in np.unique(samples.person):
        places = np.flatnonzero(seen & (samples.person == person))
        taken = np.roll(places[::-1] if runs_backward else places, round(share * len(places)))
        observed[places, view] = samples.observed[taken, view]
    return replace(samples, observed=observed)


def _refitted(assembly: Assembly, samples: BodySamples, bones: Bones, free: np.ndarray) -> BodyState:
    """Return the state of the cameras that fit some samples."""
    for _ in range(_ROUNDS):
        assembly = readjust(assembly, samples, bones, free)
    return assembly.state


def _held_out_costs(samples: BodySamples, bones: Bones, cameras: BodyState) -> np.ndarray:
    """Return the costs of the best bodies under given cameras, shape (sample, keypoint)."""
    labeled, _ = with_corrected_sides(samples, cameras.rotations, cameras.centers)
    state = initial_state(labeled, bones, cameras.rotations, cameras.centers, cameras.log_focal)
    held = np.zeros((samples.n_views, VIEW_COLUMNS), dtype=bool)
    return body_costs(labeled, bones, adjust_bodies(labeled, bones, state, held, _ROUNDS, _STEPS))
