"""Covariance of a calibration by people, by the parameters of the lenses."""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.stated_covariance import POSE_AND_LENS
from posefuse.kernels.calibration.joint import PRINCIPAL
from posefuse.model.cameras import CameraRig

_POSE = 6
_FX, _FY, _CX = 6, 7, 8
_LOG_FOCAL, _RADIAL = 8, 9


@dataclass(frozen=True, eq=False)
class OtherLens:
    """Uncertain parameters of lenses that are not among the ten of each view: distortion, and the principal point.

    Attributes:
        follow: shape (view, 10, k): by how much the estimated parameters follow these.
        covariance: shape (k, k).
        parameters: shape (k, 2), int: view and index in the order of the 18 parameters; fy stands for the logarithm of
            fx / fy.
    """

    follow: np.ndarray
    covariance: np.ndarray
    parameters: np.ndarray

    def __add__(self, more: "OtherLens") -> "OtherLens":
        """Return both, which are independent of each other."""
        k, m = len(self.covariance), len(more.covariance)
        covariance = np.zeros((k + m, k + m))
        covariance[:k, :k], covariance[k:, k:] = self.covariance, more.covariance
        follow = np.concatenate([self.follow, more.follow], axis=2)
        return OtherLens(follow, covariance, np.concatenate([self.parameters, more.parameters]))

    def spread(self) -> np.ndarray:
        """Return their part of the covariance of the estimated parameters, shape (view, 10, view, 10)."""
        return np.einsum("vik,kl,wjl->viwj", self.follow, self.covariance, self.follow, optimize=True)


def principal_points(covariance: np.ndarray, focal_px: np.ndarray, unknown: np.ndarray) -> OtherLens:
    """Return the principal points of a joint estimate, and how the other parameters follow them.

    Args:
        covariance: shape (view * 12, view * 12): of a joint estimate with lenses.
        focal_px: shape (view,): focal lengths of the recording's coordinates.
        unknown: shape (view,), bool: whether each principal point is unknown.
    """
    n = len(unknown)
    views = np.repeat(np.flatnonzero(unknown), 2)
    axes = np.tile([0, 1], len(views) // 2)
    at = views * (PRINCIPAL + 2) + PRINCIPAL + axes
    rest = np.arange(n * (PRINCIPAL + 2)).reshape(n, -1)[:, :PRINCIPAL].ravel()
    own = covariance[np.ix_(at, at)]
    follow = np.linalg.solve(own, covariance[np.ix_(at, rest)]).T / focal_px[views]
    own = own * np.outer(focal_px[views], focal_px[views])
    return OtherLens(follow.reshape(n, PRINCIPAL, -1), own, np.stack([views, _CX + axes], axis=1))


def by_lens(rig: CameraRig, covariance: np.ndarray, other: OtherLens | None = None) -> np.ndarray:
    """Return a covariance by rotation, center and the twelve parameters of the lens, shape (view, 18, view, 18).

    Args:
        rig: the cameras.
        covariance: shape (view, 10, view, 10): as in :class:`posefuse.calibration.people.result.PeopleCalibration`.
        other: parameters of the lenses that ``covariance`` accounts for, but does not contain.
    """
    n, size = covariance.shape[:2]
    step = np.zeros((n, POSE_AND_LENS, size))
    step[:, :_POSE, :_POSE] = np.eye(_POSE)
    for v, camera in enumerate(rig.cameras):
        step[v, _FX, _LOG_FOCAL], step[v, _FY, _LOG_FOCAL] = camera.matrix[0, 0], camera.matrix[1, 1]
        step[v, 10, _RADIAL] = 1.0
    own = covariance if other is None else covariance - other.spread()
    out = np.einsum("vij,vjwk,wlk->viwl", step, own, step, optimize=True)
    if other is None:
        return out
    follow = step @ other.follow
    for k, (v, i) in enumerate(other.parameters):
        if i == _FY:
            matrix = rig.cameras[v].matrix
            follow[v, _FX, k] += 0.5 * matrix[0, 0]
            follow[v, _FY, k] -= 0.5 * matrix[1, 1]
        else:
            follow[v, i, k] += 1.0
    return out + np.einsum("vik,kl,wjl->viwj", follow, other.covariance, follow, optimize=True)
