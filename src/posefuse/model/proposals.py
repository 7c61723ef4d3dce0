"""Proposals: people in one frame, each with the detections that show it."""

from dataclasses import dataclass, fields

import numpy as np

from posefuse.arrays import same
from posefuse.kernels import status_codes


@dataclass(frozen=True, eq=False)
class Proposals:
    """People on whom the views of one frame agree, the most likely first.

    Attributes:
        rows: shape (proposal, view), int64: row of the frame that shows the person, -1 for none. No row is in two
            proposals.
        swapped: shape (proposal, view), bool: whether left and right of a detection are swapped relative to the other
            views.
        points_m: shape (proposal, keypoint, 3), NaN where missing.
        covariance_m2: shape (proposal, keypoint, 6): xx xy xz yy yz zz, with the noise that ``sigma_factor`` allows.
        status: shape (proposal, keypoint), int8, point codes.
        used: shape (proposal, keypoint, view), bool: views from which each point is triangulated.
        torso_m: shape (proposal, 3): center of the trunk, see :mod:`posefuse.association.trunk`.
        torso_covariance_m2: shape (proposal, 6).
        log_odds: shape (proposal,): natural logarithm of the odds that the detections show one person and not several
            things that fit by chance; the pairwise baseline stores the logit of its score.
        error_sigma: shape (proposal,): median reprojection error of the used observations, in standard deviations of
            the noise model (per axis; 1.18 if the model holds).
        n_views: shape (proposal,), int64.
        n_pairs: shape (proposal,), int64: number of pairs of detections that agree on their own.
        duplicates: shape (duplicate, 2), int64: a row that shows a person whom a better row of the same view shows,
            and the index of the proposal.
    """

    rows: np.ndarray
    swapped: np.ndarray
    points_m: np.ndarray
    covariance_m2: np.ndarray
    status: np.ndarray
    used: np.ndarray
    torso_m: np.ndarray
    torso_covariance_m2: np.ndarray
    log_odds: np.ndarray
    error_sigma: np.ndarray
    n_views: np.ndarray
    n_pairs: np.ndarray
    duplicates: np.ndarray

    @classmethod
    def none(cls, n_keypoints: int, n_views: int) -> "Proposals":
        """Return no proposals.

        Args:
            n_keypoints: Number of keypoints of the skeleton.
            n_views: Number of views of the rig.
        """
        return cls(
            rows=np.empty((0, n_views), dtype=np.int64),
            swapped=np.empty((0, n_views), dtype=bool),
            points_m=np.empty((0, n_keypoints, 3)),
            covariance_m2=np.empty((0, n_keypoints, 6)),
            status=np.empty((0, n_keypoints), dtype=np.int8),
            used=np.empty((0, n_keypoints, n_views), dtype=bool),
            torso_m=np.empty((0, 3)),
            torso_covariance_m2=np.empty((0, 6)),
            log_odds=np.empty(0),
            error_sigma=np.empty(0),
            n_views=np.empty(0, dtype=np.int64),
            n_pairs=np.empty(0, dtype=np.int64),
            duplicates=np.empty((0, 2), dtype=np.int64),
        )

    def solvable(self) -> "Proposals":
        """Return the proposals with at least one point; the rows of the others become unassigned."""
        kept = np.asarray(self.has_point.any(axis=1))
        if kept.all():
            return self
        duplicates = self.duplicates[kept[self.duplicates[:, 1]]]
        duplicates[:, 1] = np.cumsum(kept)[duplicates[:, 1]] - 1
        own = {field.name: getattr(self, field.name)[kept] for field in fields(self) if field.name != "duplicates"}
        return Proposals(**own, duplicates=duplicates)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def has_point(self) -> np.ndarray:
        """Whether each keypoint has a point, shape (proposal, keypoint), bool."""
        return self.status < status_codes.POINT_MISSING

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Proposals) and all(
            same(getattr(self, field.name), getattr(other, field.name)) for field in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]
