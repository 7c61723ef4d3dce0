"""On what height somebody has stood lately is told to the state of whom one view alone shows.

One view shows how far away somebody is by how large they look, which lasting errors change by a tenth and more. But
floors are level: the lowest point of a body, whichever foot that is and however it walks, turns or bends, is about as
high as it was while several views showed it, and a camera that looks down on a floor has one place for each pixel.
Only where the calibration says which way is up.
"""

import numpy as np

from posefuse.kernels.tracking.posture_statistics import lowest_point, update_height_statistics
from posefuse.kernels.tracking.records import State
from posefuse.model.cameras import up_vector
from posefuse.tracking.body_states import Sight, chosen, put
from posefuse.tracking.records import Lately
from posefuse.tracking.settings import Settings, tempering
from posefuse.tracking.tempering import see_of_pose

_MEMORY_S = 2.0
_ENOUGH_S = 0.6
_SD_M = 0.03
"""By how much more than they did lately people's lowest points go up and down, of a human."""
_LASTS_S = 0.25
"""For how long they keep on being higher or lower: so much less a frame counts."""


def note_floor(sight: Sight, lately: Lately, views: np.ndarray, dt_s: float, settings: Settings) -> None:
    """Take into account on what height those stand whom several views show.

    Args:
        sight: where everybody is.
        lately: in and out.
        views: shape (track,), int64: how many show each.
        dt_s: since the last frame.
        settings: of the tracker.
    """
    if settings.rig.up_axis is not None:
        up = np.array(up_vector(settings.rig.up_axis))
        update_height_statistics(
            sight.points_m, up, views > 1, dt_s, _MEMORY_S, lately.stood_s, lately.floor_m, lately.floor_variance
        )


def keep_floor(state: State, lately: Lately, alone: np.ndarray, dt_s: float, settings: Settings) -> None:
    """Tell the states of those whom one view alone shows, in place, that they stand as high as they did.

    Those stay as they are of whom not enough is known, and all where nobody knows which way is up.

    Args:
        state: everybody's.
        lately: what is known of them.
        alone: shape (track,), bool: whom one view alone shows.
        dt_s: since the last frame.
        settings: of the tracker.
    """
    if settings.rig.up_axis is None or dt_s <= 0.0:
        return
    up = np.array(up_vector(settings.rig.up_axis))
    calm = float(tempering(np.array([dt_s]), _LASTS_S)[0])
    row = np.empty(settings.tree.n_pose)
    for p in np.flatnonzero(alone & (lately.stood_s >= _ENOUGH_S)).tolist():
        one = chosen(state, [p])
        off = lately.floor_m[p] - lowest_point(settings.body, one, up, row)
        told = row / (calm * (lately.floor_variance[p] + (_SD_M * settings.tree.scale) ** 2))
        see_of_pose(one, np.outer(told, row), told * off, settings)
        put(state, p, one)
