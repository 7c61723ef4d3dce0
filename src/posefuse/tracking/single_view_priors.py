"""Priors on posture and height for people whom a single view shows.

A single view measures the distance of a person by the apparent size, which correlated errors change by a tenth and
more. A bone that errors shorten turns toward the view or away from it; one that they lengthen cannot turn, so
bodies without further constraints drift closer. Two quantities stay about what they were while several views showed the
person: the inclination of the trunk with the angle between each bone and the trunk, and the height of the body's lowest
point, because floors are level. The height needs a calibration with a known up axis.
"""

import numpy as np

from posefuse.kernels.tracking.posture_statistics import lowest_point, update_height_statistics, update_lean_statistics
from posefuse.kernels.tracking.records import LeanStatistics, State
from posefuse.tracking.body_states import ProjectedBodies, select_states, set_state
from posefuse.tracking.records import RecentHistory
from posefuse.tracking.settings import TrackerSettings, tempering_factor
from posefuse.tracking.tempering import update_pose


def observe_posture(
    state: State, recent: RecentHistory, n_views: np.ndarray, dt_s: float, settings: TrackerSettings
) -> None:
    """Update the posture statistics of people whom several views show.

    Args:
        state: Updated states.
        recent: Updated in place.
        n_views: shape (track,), int64: number of views that support each track.
        dt_s: Time since the last frame, in seconds.
        settings: Settings of the tracker.
    """
    if state.turns.shape[1]:
        statistics = LeanStatistics(recent.posture_observed_s, recent.leans, recent.leans_variance, recent.trunk_axis)
        memory_s = settings.options.single_view.history_s
        update_lean_statistics(state.turns, state.bones, n_views > 1, dt_s, memory_s, statistics)


def observe_height(
    projected: ProjectedBodies, recent: RecentHistory, n_views: np.ndarray, dt_s: float, settings: TrackerSettings
) -> None:
    """Update the statistics of the lowest point's height of people whom several views show.

    Args:
        projected: Predicted bodies.
        recent: Updated in place.
        n_views: shape (track,), int64: number of views that support each track.
        dt_s: Time since the last frame, in seconds.
        settings: Settings of the tracker.
    """
    if settings.up is not None:
        update_height_statistics(
            projected.points_m, settings.up, n_views > 1, dt_s, settings.options.single_view.history_s,
            recent.height_observed_s, recent.lowest_m, recent.lowest_variance_m2,
        )  # fmt: skip


def apply_posture_prior(
    state: State, recent: RecentHistory, single_view: np.ndarray, dt_s: float, settings: TrackerSettings
) -> None:
    """Update the states of people whom a single view shows by their recent posture, in place.

    People with too short a history, and bodies without a trunk, stay as they are.

    Args:
        state: States of all tracks.
        recent: Recent histories.
        single_view: shape (track,), bool: tracks that a single view shows.
        dt_s: Time since the last frame, in seconds.
        settings: Settings of the tracker.
    """
    if not single_view.any():
        return
    options = settings.options.single_view
    applies = single_view & (recent.posture_observed_s >= options.min_history_s)
    if not state.turns.shape[1] or dt_s <= 0.0 or not applies.any():
        return
    temper = float(tempering_factor(np.array([dt_s]), options.correlation_s)[0])
    for p in np.flatnonzero(applies).tolist():
        body = select_states(state, [p])
        rows, residual, variance = _lean_rows(body, recent, p, options.lean_sd)
        weighted = rows.T / (temper * variance)
        update_pose(body, weighted @ rows, weighted @ residual, settings)
        set_state(state, p, body)


def apply_height_prior(
    state: State, recent: RecentHistory, single_view: np.ndarray, dt_s: float, settings: TrackerSettings
) -> None:
    """Update the states of people whom a single view shows by the recent height of their lowest point, in place.

    People with too short a history stay as they are, and all do if the up axis is unknown.

    Args:
        state: States of all tracks.
        recent: Recent histories.
        single_view: shape (track,), bool: tracks that a single view shows.
        dt_s: Time since the last frame, in seconds.
        settings: Settings of the tracker.
    """
    if not single_view.any():
        return
    options = settings.options.single_view
    applies = single_view & (recent.height_observed_s >= options.min_history_s)
    if settings.up is None or dt_s <= 0.0 or not applies.any():
        return
    temper = float(tempering_factor(np.array([dt_s]), options.correlation_s)[0])
    row = np.empty(settings.tree.n_pose)
    for p in np.flatnonzero(applies).tolist():
        body = select_states(state, [p])
        residual = recent.lowest_m[p] - lowest_point(settings.body, body, settings.up, row)
        weighted = row / (temper * (recent.lowest_variance_m2[p] + options.height_sd_m**2))
        update_pose(body, np.outer(weighted, row), weighted * residual, settings)
        set_state(state, p, body)


def _lean_rows(body: State, recent: RecentHistory, p: int, lean_sd: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the Jacobian of the inclinations, shape (inclination, pose), their residuals and their variances.

    The first two are those of the trunk in the world, the others those of all segments and bones to the trunk.
    """
    segments, n = body.turns.shape[1], body.velocity.shape[1]
    frames = np.concatenate([body.turns[0], body.bones[0]])
    trunk, up = frames[0], frames[0][:, 2]
    rows = np.zeros((len(frames) + 1, n))
    rows[0, 3] = rows[1, 4] = 1.0
    length = float(np.linalg.norm(recent.trunk_axis[p]))
    mean = trunk.T @ recent.trunk_axis[p] / max(length, 1e-9)
    first = np.append(3 + 3 * np.arange(segments), 3 + 3 * segments + 2 * np.arange(len(frames) - segments))
    # A turn about a mover's first axis moves its third axis against the second; one about the second, along the first.
    for i in range(1, len(frames)):
        axes, c = frames[i], first[i]
        rows[i + 1, c : c + 2] = -axes[:, 1] @ up, axes[:, 0] @ up
        rows[i + 1, 3:5] = -trunk[:, 1] @ axes[:, 2], trunk[:, 0] @ axes[:, 2]
    residual = np.concatenate([[-mean[1], mean[0]], recent.leans[p, 1:] - frames[1:, :, 2] @ up])
    variance = np.concatenate([np.full(2, max(0.5 * (1.0 - length**2), 0.0)), recent.leans_variance[p, 1:]])
    return rows, residual, variance + lean_sd**2
