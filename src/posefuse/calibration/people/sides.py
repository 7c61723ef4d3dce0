"""Correct left and right in all frames of all views, once the cameras are approximately known."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posefuse.calibration.people.bearings import Bearings
from posefuse.calibration.people.bodies import BodySamples, observe_body
from posefuse.calibration.people.sample_sides import relation_gains
from posefuse.calibration.people.views import ViewTracks
from posefuse.kernels.calibration.two_state_path import two_state_path

_SWITCH_COST = 4.0
_LONGEST_S = 1.0
_PRIOR_COST = 0.1
_SWEEPS = 4


def exchanged_sides(
    views: Sequence[Bearings],
    people: Sequence[Sequence[int]],
    poses: tuple[np.ndarray, np.ndarray],
    clocks: tuple[np.ndarray, np.ndarray],
) -> list[np.ndarray]:
    """Return where each view exchanges left and right: per view, shape (frame, person), bool.

    Epipolar errors between views decide, with few changes over time. Only relations between views are observable: a
    person whose sides most views exchange is taken as correct there.

    Args:
        views: directions of all views.
        people: index of each person in every view, -1 where a view does not observe it.
        poses: rotations, shape (view, 3, 3), and centers, shape (view, 3).
        clocks: offsets and rates, shape (view,): true time is the offset plus the rate times the timestamp.
    """
    out = [np.zeros((len(view.time_s), len(people)), dtype=bool) for view in views]
    if (views[0].mirror == np.arange(len(views[0].mirror))).all():
        return out
    for p, person in enumerate(people):
        observing = [v for v in range(len(views)) if person[v] >= 0]
        if len(observing) < 2:
            continue
        for v, labels in zip(observing, _labels(views, person, observing, poses, clocks), strict=True):
            out[v][:, p] = labels
    return out


def _labels(
    views: Sequence[Bearings],
    person: Sequence[int],
    observing: list[int],
    poses: tuple[np.ndarray, np.ndarray],
    clocks: tuple[np.ndarray, np.ndarray],
) -> list[np.ndarray]:
    """Return where the sides of one person are exchanged, shape (frame,), for each view that observes the person."""
    offset_s, rate = clocks
    chosen = [views[v] for v in observing]
    gains, frames, costs = [], [], []
    for place, v in enumerate(observing):
        true_s = offset_s[v] + rate[v] * views[v].time_s
        times = (true_s[:, None] - offset_s[observing]) / rate[observing]
        observed = observe_body(chosen, [person[u] for u in observing], times)
        samples = BodySamples(true_s, np.zeros(len(true_s), dtype=np.int64), observed, views[v].mirror)
        gains.append(relation_gains(samples, poses[0][observing], poses[1][observing], place))
        frames.append(np.stack([_nearest(u.time_s, times[:, i]) for i, u in enumerate(chosen)], axis=1))
        steps = np.diff(true_s, prepend=true_s[0] - 1.0)
        costs.append(_SWITCH_COST * np.exp(-np.maximum(steps, 0.0) / _LONGEST_S))
    labels = [np.zeros(len(view.time_s), dtype=bool) for view in chosen]
    for _ in range(_SWEEPS):
        before = [each.copy() for each in labels]
        for place in range(len(chosen)):
            same = np.stack([np.where(labels[u][frames[place][:, u]], -1.0, 1.0) for u in range(len(chosen))], axis=1)
            gain = (gains[place] * same).sum(axis=1) - _PRIOR_COST
            two_state_path(gain, costs[place], labels[place])
        if all((a == b).all() for a, b in zip(before, labels, strict=True)):
            break
    if np.mean(np.concatenate(labels)) > 0.5:
        labels = [~each for each in labels]
    return labels


def _nearest(times: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the indices of the nearest times."""
    after = np.clip(np.searchsorted(times, wanted), 1, max(len(times) - 1, 1))
    after = np.minimum(after, len(times) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(np.abs(times[before] - wanted) <= np.abs(times[after] - wanted), before, after)


def exchange_sides(view: ViewTracks, mirror: np.ndarray, exchanged: np.ndarray) -> ViewTracks:
    """Return a view with left and right exchanged.

    Args:
        view: tracks of one view.
        mirror: shape (keypoint,): mirror image of each keypoint.
        exchanged: shape (frame, person), bool.
    """
    if not exchanged.any():
        return view
    return replace(
        view,
        keypoints_px=np.where(exchanged[..., None, None], view.keypoints_px[:, :, mirror], view.keypoints_px),
        confidence=np.where(exchanged[..., None], view.confidence[:, :, mirror], view.confidence),
    )
