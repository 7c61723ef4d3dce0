"""Whether somebody who appears is somebody who was lost: by where they can have gone, and by their bones."""

import math

import numpy as np

from posefuse.kernels.tracking.records import State
from posefuse.kinematics.segment_lengths import measured_lengths
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.tracking.records import Track
from posefuse.tracking.settings import Settings

_REACH_M = 0.7
_ROOM_M = 4.0
_TRUNK_M = 0.3
"""By how much one look at a trunk differs from the next where little of it is seen."""
_DEFINITION_SD = 0.03
"""By how much of its length a bone differs from one look at a body to the next."""
_DEFINITION_M = 0.01
_SPOILT = 0.1
"""How often so short a look at somebody tells nothing of their bones, having shown two people as one for example."""
_CLEAR = 1.0


def who_returns(
    tracks: list[Track],
    state: State,
    found: State,
    torso_m: np.ndarray,
    since_s: float,
    time_s: float,
    settings: Settings,
) -> tuple[int, str, str] | None:
    """The lost person that a new one is, if that is likelier than that they are new, or nobody new can be.

    Who is not lost yet, but has not been seen for half the time that the new one was, may be them too.

    Args:
        tracks: of people known.
        state: theirs.
        found: of the new one.
        torso_m: shape (3,): where the new one is.
        since_s: when the new one was first seen.
        time_s: now.
        settings: of the tracker.

    Returns:
        Their place, why, and, where another is nearly as likely, what makes that uncertain ("" where nothing does).
    """
    closed = all_are_known(tracks, settings)
    odds = {}
    for p, track in enumerate(tracks):
        if track.state == TrackState.LOST or time_s - track.seen_s > 0.5 * (time_s - since_s):
            near = _nearness(track, torso_m, time_s, settings, closed)
            if near > -math.inf:
                alike = same_body(settings, track, state, p, found, settings.options.births.min_age_s)
                odds[p] = near + float(np.logaddexp(alike + math.log(1.0 - _SPOILT), math.log(_SPOILT)))
    if not odds:
        return None
    best = max(odds, key=lambda p: odds[p])
    if odds[best] < settings.options.reacquire_log_odds and not closed:
        return None
    others = [p for p in odds if p != best and odds[best] - odds[p] < _CLEAR]
    uncertain = f"{tracks[others[0]].name} is as likely" if others else ""
    return best, f"log odds {odds[best]:.1f} that it is them after {time_s - tracks[best].seen_s:.1f} s", uncertain


def all_are_known(tracks: list[Track], settings: Settings) -> bool:
    """Whether everybody there is has been seen, so that nobody is new."""
    population = settings.options.population
    return population is not None and sum(track.sure for track in tracks) >= population


def _nearness(track: Track, torso_m: np.ndarray, time_s: float, settings: Settings, closed: bool) -> float:
    """Log odds of somebody being so near to where they were lost, against anywhere in a room.

    Either they went about as people mostly do, which leaves them somewhere near, or fast, anywhere within reach; one is
    as likely as the other. -inf for who is beyond reach, but where nobody is new.
    """
    motion, scale, gone_s = settings.options.motion, settings.tree.scale, time_s - track.seen_s
    room = _ROOM_M * scale
    away = float(np.linalg.norm(torso_m - track.lost_at_m))
    reach = _REACH_M * scale + motion.top_speed_m_s * gone_s
    # As far as velocities that fade lead: Ornstein and Uhlenbeck.
    fades = motion.root_decay_s * (1.0 - math.exp(-gone_s / motion.root_decay_s))
    wandered = motion.root_acceleration * motion.root_decay_s**2 * (gone_s - fades)
    sd = math.sqrt(wandered + (_TRUNK_M * scale) ** 2)
    near = 3.0 * math.log(room / (math.sqrt(2.0 * math.pi) * sd)) - 0.5 * (away / sd) ** 2
    if away > reach:
        return near if closed else -math.inf
    return float(np.logaddexp(near, 3.0 * math.log(max(room / min(reach, room), 1.0))) - math.log(2.0))


def same_body(settings: Settings, track: Track, state: State, p: int, found: State, looked_s: float) -> float:
    """How much likelier (log) what was measured of a body is if it is that person's than if it is anybody's.

    Args:
        settings: of the tracker.
        track: the person's.
        state: theirs, for lengths that are still sought.
        p: their place in it.
        found: of one person, fitted from scratch.
        looked_s: for how long that one was looked at.
    """
    tree, options = settings.tree, settings.options
    n, h = tree.n_pose, tree.n_shape
    known = track.trusted or (state.shape[p], state.covariance[p, n : n + h, n : n + h])
    # Either look measured lengths by a definition of its own.
    floor = 0.5 * np.diag((_DEFINITION_SD * np.abs(tree.shape_m) + _DEFINITION_M * tree.scale) ** 2)
    theirs, error = measured_lengths(tree, *known)
    error = _lasting(track.sought_s, options) * error + floor
    new, new_error = measured_lengths(tree, found.shape[0], found.covariance[0, n : n + h, n : n + h])
    new_error = _lasting(looked_s, options) * new_error + floor
    gain = np.linalg.solve(tree.shape_covariance + error, tree.shape_covariance).T
    left = tree.shape_covariance - gain @ tree.shape_covariance
    return _log_normal(new - gain @ theirs, left + new_error) - _log_normal(new, tree.shape_covariance + new_error)


def _lasting(looked_s: float, options: TrackerOptions) -> float:
    """By how much more lengths vary (variance) than the filter says, which looks back less far than errors last.

    Of errors whose correlation fades over m, a look of T is worth 1 + T / 2m independent ones. The filter believes in
    ``error_memory_s``; ``smoother_error_memory_s`` is true.
    """
    believed, true = (1.0 + 0.5 * looked_s / m for m in (options.error_memory_s, options.smoother_error_memory_s))
    return max(believed / true, 1.0)


def _log_normal(off: np.ndarray, covariance: np.ndarray) -> float:
    sign, log_determinant = np.linalg.slogdet(covariance)
    if sign <= 0:
        return -math.inf
    return float(-0.5 * (log_determinant + off @ np.linalg.solve(covariance, off)))
