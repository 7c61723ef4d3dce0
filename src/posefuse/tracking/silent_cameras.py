"""Cameras that say nothing any more: that deliver no frames, or show nobody where others show people."""

from dataclasses import dataclass

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.tracking.frame_statistics import update_silence
from posefuse.tracking.settings import Settings


@dataclass
class Silence:
    """For how long each view has said nothing.

    Attributes:
        absent_s: shape (view,): since its last frame.
        blind_s: shape (view,): for how long it has shown nobody at all while it should have.
        heard_s: shape (view,): for how long it has been heard, while it is silent.
        silent: shape (view,), bool.
    """

    absent_s: np.ndarray
    blind_s: np.ndarray
    heard_s: np.ndarray
    silent: np.ndarray

    @classmethod
    def over(cls, n_views: int) -> "Silence":
        """Nothing known of any view."""
        return cls(np.zeros(n_views), np.zeros(n_views), np.zeros(n_views), np.zeros(n_views, dtype=bool))


def listen(
    silence: Silence,
    recorded: np.ndarray,
    shown: np.ndarray,
    due: np.ndarray,
    dt_s: float,
    settings: Settings,
) -> list[tuple[int, bool, str]]:
    """Take a frame into account.

    Args:
        silence: in and out.
        recorded: shape (view,), bool: whether the view has this frame.
        shown: shape (view,): how many detections it has.
        due: shape (view,): how many people it should show, whom two others do.
        dt_s: since the last frame.
        settings: of the tracker.

    Returns:
        Views that are silent from now on (True) or heard again (False), and why.
    """
    o, change = settings.options, np.empty(len(recorded), dtype=np.int64)
    if not update_silence(
        frozen(recorded, np.bool_), shown, due, dt_s, o.camera_silent_s, o.camera_heard_s, silence.absent_s,
        silence.blind_s, silence.heard_s, silence.silent, change,
    ):  # fmt: skip
        return []
    told = [(int(v), True, _why(silence, int(v))) for v in np.flatnonzero(change > 0)]
    return told + [(int(v), False, "it has frames, and shows whom it should") for v in np.flatnonzero(change < 0)]


def _why(silence: Silence, view: int) -> str:
    if silence.absent_s[view] >= silence.blind_s[view]:
        return f"no usable frame of it for {silence.absent_s[view]:.1f} s"
    return f"it has shown nobody for {silence.blind_s[view]:.1f} s, where others show people whom it should see"
