"""How somebody has held themselves lately is told to the state of whom one view alone shows.

One view shows how far away somebody is by how large they look. A bone that errors make shorter turns towards the view
or away from it, one that they make longer cannot, so that bodies of which no more is known come nearer and nearer. But
how upright a trunk is, and how far each bone leans from it, is about what it was while several views showed it,
wherever the body has turned since.
"""

import numpy as np

from posefuse.kernels.tracking.posture_statistics import update_lean_statistics
from posefuse.kernels.tracking.records import State
from posefuse.tracking.body_states import chosen, put
from posefuse.tracking.records import Lately
from posefuse.tracking.settings import Settings, tempering
from posefuse.tracking.tempering import see_of_pose

_MEMORY_S = 2.0
_ENOUGH_S = 0.6
_SD = 0.1
"""By how much more than they did lately people lean, as a cosine, or in radians of the trunk."""
_LASTS_S = 0.25
"""For how long they keep on leaning as they do: so much less a frame counts."""


def note_posture(state: State, lately: Lately, views: np.ndarray, dt_s: float) -> None:
    """Take into account how those hold themselves whom several views show.

    Args:
        state: theirs.
        lately: in and out.
        views: shape (track,), int64: how many show each.
        dt_s: since the last frame.
    """
    if state.turns.shape[1]:
        update_lean_statistics(
            state.turns, state.bones, views > 1, dt_s, _MEMORY_S, lately.looked_s, lately.leans,
            lately.leans_variance, lately.upright,
        )  # fmt: skip


def keep_posture(state: State, lately: Lately, alone: np.ndarray, dt_s: float, settings: Settings) -> None:
    """Tell the states of those whom one view alone shows, in place, that they hold themselves as they did.

    Those stay as they are of whom not enough is known, and all bodies without a trunk, which have nothing to lean from.

    Args:
        state: everybody's.
        lately: what is known of them.
        alone: shape (track,), bool: whom one view alone shows.
        dt_s: since the last frame.
        settings: of the tracker.
    """
    if not state.turns.shape[1] or dt_s <= 0.0:
        return
    calm = float(tempering(np.array([dt_s]), _LASTS_S)[0])
    for p in np.flatnonzero(alone & (lately.looked_s >= _ENOUGH_S)).tolist():
        one = chosen(state, [p])
        rows, off, variance = _leaning(one, lately, p)
        told = rows.T / (calm * variance)
        see_of_pose(one, told @ rows, told @ off, settings)
        put(state, p, one)


def _leaning(one: State, lately: Lately, p: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How leans go with the pose, shape (lean, pose), how far they are off, and their variances, shape (lean,).

    The first two are of the trunk in the world, the others of all else and the trunk.
    """
    segments, n = one.turns.shape[1], one.velocity.shape[1]
    frames = np.concatenate([one.turns[0], one.bones[0]])
    trunk, up = frames[0], frames[0][:, 2]
    rows = np.zeros((len(frames) + 1, n))
    rows[0, 3] = rows[1, 4] = 1.0
    long = float(np.linalg.norm(lately.upright[p]))
    was = trunk.T @ lately.upright[p] / max(long, 1e-9)
    first = np.append(3 + 3 * np.arange(segments), 3 + 3 * segments + 2 * np.arange(len(frames) - segments))
    # Turning about its first axis moves a third axis against the second, about the second along the first.
    for i in range(1, len(frames)):
        axes, c = frames[i], first[i]
        rows[i + 1, c : c + 2] = -axes[:, 1] @ up, axes[:, 0] @ up
        rows[i + 1, 3:5] = -trunk[:, 1] @ axes[:, 2], trunk[:, 0] @ axes[:, 2]
    off = np.concatenate([[-was[1], was[0]], lately.leans[p, 1:] - frames[1:, :, 2] @ up])
    varied = np.concatenate([np.full(2, max(0.5 * (1.0 - long**2), 0.0)), lately.leans_variance[p, 1:]])
    return rows, off, varied + _SD**2
