"""Contact of keypoints with the ground in the trajectory solve: resting keypoints move with the ground.

Contact is estimated from the paths that the views and the motion alone determine, and added in further rounds. Where a
keypoint touches, its velocity changes at once, so the smoothness prior is weak there: landings keep their speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from posefuse.kernels.trajectory.contact_terms import ContactTerms
from posefuse.trajectory.smoothness import Smoothness

_DRIFT_M2_S = 2e-5
"""Growth of the variance of a resting place with time: 3.5 mm in 0.6 s, because feet roll and soft tissue moves."""
_HEIGHT_INDEPENDENT_S = 0.2
"""Time after which the heights of a resting keypoint above its level are independent."""
_LANDING_M_S = 1.0
"""Standard deviation of the change of velocity at touchdown, per axis."""


@dataclass(frozen=True, eq=False)
class GroundContact:
    """Contact of some keypoints of one person.

    Attributes:
        keypoints: indices of the keypoints.
        touching: shape (contact, frame): probability that a keypoint touches the ground; 0 where unknown.
        resting: shape (contact, frame): probability that it touches and does not slide.
        ground_m_s: shape (3,): velocity of the ground, zero except on a treadmill.
        normal: shape (3,): unit vector that points up from the ground.
        heights_m: shape (contact, frame): height of the resting keypoint along the normal; NaN where it is unknown.
        height_sd_m: standard deviation of these heights.
    """

    keypoints: Sequence[int]
    touching: np.ndarray
    resting: np.ndarray
    ground_m_s: np.ndarray
    normal: np.ndarray
    heights_m: np.ndarray
    height_sd_m: float

    def of_keypoints(self, keypoints: np.ndarray) -> Self:
        """Return the same contact with indices into some keypoints, sorted, which all those in contact belong to."""
        return replace(self, keypoints=[int(each) for each in np.searchsorted(keypoints, self.keypoints)])

    def terms(self, time_s: np.ndarray) -> ContactTerms:
        """Return the terms of the trajectory system.

        Args:
            time_s: shape (frame,).
        """
        steps_s = np.diff(time_s)
        rests = self.resting[:, 1:] * self.resting[:, :-1]
        known = np.isfinite(self.heights_m)
        share = np.minimum(np.gradient(time_s) / _HEIGHT_INDEPENDENT_S, 1.0) if len(time_s) > 1 else np.ones(1)
        support = np.where(known, self.touching * share / self.height_sd_m**2, 0.0)
        return ContactTerms(
            np.array(self.keypoints, dtype=np.int64),
            np.ascontiguousarray(rests / (_DRIFT_M2_S * steps_s)),
            steps_s[:, None] * self.ground_m_s,
            np.ascontiguousarray(self.normal, dtype=np.float64),
            np.where(known, self.heights_m, 0.0),
            support,
        )

    def density(self, density: np.ndarray, smoothness: Smoothness, time_s: np.ndarray) -> np.ndarray:
        """Return the density of the smoothness prior with the change of velocity at touchdown.

        Args:
            density: shape (keypoint, row).
            smoothness: smoothness prior.
            time_s: shape (frame,).
        """
        steps_s, order, rows = np.diff(time_s), smoothness.order, density.shape[1]
        lands = self.touching[:, 1:] * (1.0 - self.touching[:, :-1])
        # A change of velocity within one step is jerk with this integrated square, or acceleration.
        jump = lands * _LANDING_M_S**2 / steps_s ** (2 * order - 3)
        out = density.copy()
        for c, keypoint in enumerate(self.keypoints):
            out[keypoint] += np.max([jump[c, step : step + rows] for step in range(order)], axis=0)
        return out


class FindContact(Protocol):
    """Estimates the contact of a person from paths."""

    def __call__(
        self, person: int, time_s: np.ndarray, paths_m: np.ndarray, covariance_m2: np.ndarray
    ) -> GroundContact | None:
        """Return the contact, or None without any.

        Args:
            person: index of the person.
            time_s: shape (frame,).
            paths_m: shape (keypoint, frame, 3), NaN where a keypoint has no point.
            covariance_m2: shape (keypoint, frame, 3, 3).
        """
        ...
