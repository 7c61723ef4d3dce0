"""Cameras that no longer stand where the calibration has them: what they show fits nobody whom the others see."""

from dataclasses import dataclass

import numpy as np

from posefuse.tracking.settings import Settings

_TIME_S = 2.0
_ENOUGH_S = 1.0
_FEW, _MANY = 0.15, 0.5
_SHOWN = 0.5


@dataclass
class Watch:
    """How well each view has fitted lately.

    Attributes:
        expected_s: shape (view,): for how long people were to be seen, those the other views agree on.
        matched_s: shape (view,): for how long they were.
        shown_s: shape (view,): for how long there was somebody that nobody is.
        refused: shape (view,), bool.
    """

    expected_s: np.ndarray
    matched_s: np.ndarray
    shown_s: np.ndarray
    refused: np.ndarray

    @classmethod
    def over(cls, n_views: int) -> "Watch":
        """Nothing known of any view."""
        return cls(np.zeros(n_views), np.zeros(n_views), np.zeros(n_views), np.zeros(n_views, dtype=bool))


def look_at(
    watch: Watch,
    supported: np.ndarray,
    expected: np.ndarray,
    free: np.ndarray,
    dt_s: float,
    settings: Settings,
) -> list[tuple[int, bool, str]]:
    """Take a frame into account.

    Args:
        watch: in and out.
        supported: shape (active person, view), bool.
        expected: shape (active person, view), bool.
        free: shape (view,): how many detections are nobody's.
        dt_s: since the last frame.
        settings: of the tracker.

    Returns:
        Views that are refused from now on (True) or trusted again (False), and why.
    """
    fade = np.exp(-dt_s / _TIME_S)
    others = supported.sum(axis=1, keepdims=True) - supported
    sure = expected & (others >= 2)
    missed = sure & ~supported
    watch.expected_s = watch.expected_s * fade + dt_s * sure.sum(axis=0)
    watch.matched_s = watch.matched_s * fade + dt_s * (sure & supported).sum(axis=0)
    watch.shown_s = watch.shown_s * fade + dt_s * np.minimum(free, missed.sum(axis=0))
    told = watch.expected_s > _ENOUGH_S
    share = watch.matched_s / np.maximum(watch.expected_s, 1e-9)
    shown = watch.shown_s / np.maximum(watch.expected_s, 1e-9)
    now = np.where(watch.refused, ~(told & (share > _MANY)), told & (share < _FEW) & (shown > _SHOWN))
    changed = np.flatnonzero(now != watch.refused)
    watch.refused = np.asarray(now, dtype=bool)
    return [
        (
            int(v),
            bool(now[v]),
            f"it shows {share[v]:.0%} of the people whom others see, and others where nobody is"
            if now[v]
            else f"it shows {share[v]:.0%} of the people whom others see",
        )
        for v in changed
    ]
