"""Cameras that say nothing any more: that deliver no frames, or show nobody where others show people."""

from dataclasses import dataclass

import numpy as np

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
    options = settings.options
    silence.absent_s = np.where(recorded, 0.0, silence.absent_s + dt_s)
    blind = np.where(recorded & (due > 0), silence.blind_s + dt_s, silence.blind_s)
    silence.blind_s = np.where(shown > 0, 0.0, blind)
    # Who was silent without frames is heard by a frame, who showed nobody by a detection.
    quiet_s = np.maximum(silence.absent_s, silence.blind_s)
    heard_s = np.where(quiet_s == 0.0, silence.heard_s + dt_s, silence.heard_s)
    silence.heard_s = np.where(silence.silent & (quiet_s <= options.camera_heard_s), heard_s, 0.0)
    over = silence.silent & (silence.heard_s >= options.camera_heard_s)
    fallen = ~silence.silent & (quiet_s >= options.camera_silent_s)
    silence.silent = (silence.silent | fallen) & ~over
    told = [(int(v), True, _why(silence, int(v))) for v in np.flatnonzero(fallen)]
    return told + [(int(v), False, "it has frames, and shows whom it should") for v in np.flatnonzero(over)]


def _why(silence: Silence, view: int) -> str:
    if silence.absent_s[view] >= silence.blind_s[view]:
        return f"no frame of it for {silence.absent_s[view]:.1f} s"
    return f"it has shown nobody for {silence.blind_s[view]:.1f} s, where others show people whom it should see"
