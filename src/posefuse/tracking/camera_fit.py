"""Cameras that no longer stand where the calibration has them: what they show fits nobody whom the others see."""

from dataclasses import dataclass

import numpy as np

from posefuse.kernels.tracking.frame_statistics import accumulate_view_support

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
        due: shape (view,), int64: how many people, whom two others show, it was to show in the last frame.
    """

    expected_s: np.ndarray
    matched_s: np.ndarray
    shown_s: np.ndarray
    refused: np.ndarray
    due: np.ndarray

    @classmethod
    def over(cls, n_views: int) -> "Watch":
        """Nothing known of any view."""
        expected_s, matched_s, shown_s = np.zeros((3, n_views))
        refused, due = np.zeros(n_views, dtype=bool), np.zeros(n_views, dtype=np.int64)
        return cls(expected_s, matched_s, shown_s, refused, due)


def look_at(
    watch: Watch,
    supported: np.ndarray,
    expected: np.ndarray,
    free: np.ndarray,
    dt_s: float,
) -> list[tuple[int, bool, str]]:
    """Take a frame into account.

    Args:
        watch: in and out.
        supported: shape (active person, view), bool.
        expected: shape (active person, view), bool.
        free: shape (view,), int64: how many detections are nobody's.
        dt_s: since the last frame.

    Returns:
        Views that are refused from now on (True) or trusted again (False), and why.
    """
    fade = float(np.exp(-dt_s / _TIME_S))
    accumulate_view_support(
        supported, expected, free, fade, dt_s, watch.expected_s, watch.matched_s, watch.shown_s, watch.due
    )
    changes = []
    times = zip(watch.expected_s.tolist(), watch.matched_s.tolist(), watch.shown_s.tolist(), strict=True)
    for v, (expected_s, matched_s, shown_s) in enumerate(times):
        share, shown = matched_s / max(expected_s, 1e-9), shown_s / max(expected_s, 1e-9)
        told = expected_s > _ENOUGH_S
        if watch.refused[v] and told and share > _MANY:
            watch.refused[v] = False
            changes.append((v, False, f"it shows {share:.0%} of the people whom others see"))
        elif not watch.refused[v] and told and share < _FEW and shown > _SHOWN:
            watch.refused[v] = True
            why = f"it shows {share:.0%} of the people whom others see, and others where nobody is"
            changes.append((v, True, why))
    return changes
