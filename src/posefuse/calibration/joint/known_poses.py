"""What is known of the poses of some cameras before a recording: their poses relative to each other, with covariance.

Such a prior does not depend on the world: it has no information about a common rotation or shift of a group of cameras
that are known relative to each other. It does determine the scale.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.kernels.calibration.joint import FOCAL, RADIAL
from posefuse.model.camera_covariance import parameter_names
from posefuse.model.cameras import Camera, CameraRig

_POSE = 6
_FX, _FY = 6, 7
_RANK_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class KnownPoses:
    """A normal prior of the changes of poses and focal lengths from known ones.

    Attributes:
        precision: shape (view, 10, view, 10): inverse covariance, by the parameters of a joint estimate.
        other: shape (view, 10, k): by how much the changes follow those of other parameters of the lenses, such as the
            principal point, which an estimate from people holds fixed.
        other_covariance: shape (k, k): of these parameters.
        other_parameters: shape (k, 2), int: view and index, as in a camera's covariance, of these parameters.
    """

    precision: np.ndarray
    other: np.ndarray
    other_covariance: np.ndarray
    other_parameters: np.ndarray

    @classmethod
    def nothing(cls, n_views: int) -> Self:
        """Return a prior without information."""
        size = RADIAL + 1
        precision, other = np.zeros((n_views, size, n_views, size)), np.zeros((n_views, size, 0))
        return cls(precision, other, np.zeros((0, 0)), np.zeros((0, 2), dtype=np.int64))

    @classmethod
    def of(cls, rig: CameraRig, views: np.ndarray, n_views: int, least_sd: tuple[float, float]) -> Self:
        """Return what is known of cameras with a covariance.

        Parameters of a lens that are not in a joint estimate are held fixed in the prior: people and the board see the
        same rays, so that a pose follows, say, a shift of the principal point in the same way.

        Args:
            rig: the cameras, in the world of the estimate.
            views: shape (camera,), int: their indices in the estimate.
            n_views: number of views of the estimate.
            least_sd: standard deviations that are added to those of every pose: rad, m.
        """
        used, rest, names = _split(rig)
        covariance = _by_logarithms(rig, names, _covariance(rig, names))
        both = covariance[np.ix_(used, rest)]
        own = covariance[np.ix_(rest, rest)]
        follow = both @ _inverse(own)
        inside = covariance[np.ix_(used, used)] - follow @ both.T
        place = np.array([(int(views[camera]), names[camera].index(name)) for camera, name in _at(names, used)])
        column = np.where(place[:, 1] < _POSE, place[:, 1], FOCAL)
        is_turn, is_shift = column < 3, (column >= 3) & (column < _POSE)
        inside[np.diag_indices_from(inside)] += np.where(
            is_turn, least_sd[0] ** 2, np.where(is_shift, least_sd[1] ** 2, 0.0)
        )
        turn = _to_camera_axes(rig, column, place[:, 0], views)
        precision = _without_world(rig, turn.T @ _inverse(inside) @ turn, column, place[:, 0], views)
        out = cls.nothing(n_views)
        out.precision[place[:, 0][:, None], column[:, None], place[:, 0], column] = precision
        other = np.zeros((n_views, RADIAL + 1, len(rest)))
        other[place[:, 0], column] = turn.T @ follow
        chosen = np.array([(views[c], names[c].index(name)) for c, name in _at(names, rest)], dtype=np.int64)
        return cls(out.precision, other, own, chosen.reshape(-1, 2))

    def __add__(self, more: "KnownPoses") -> "KnownPoses":
        """Return what is known of different groups of cameras."""
        k, m = len(self.other_covariance), len(more.other_covariance)
        covariance = np.zeros((k + m, k + m))
        covariance[:k, :k], covariance[k:, k:] = self.other_covariance, more.other_covariance
        return KnownPoses(
            self.precision + more.precision,
            np.concatenate([self.other, more.other], axis=2),
            covariance,
            np.concatenate([self.other_parameters, more.other_parameters]),
        )

    def matrix(self, size: int) -> np.ndarray:
        """Return the inverse covariance of the first ``size`` parameters of each view, shape (view * size,) twice."""
        n, own = len(self.precision), min(size, self.precision.shape[1])
        out = np.zeros((n, size, n, size))
        out[:, :own, :, :own] = self.precision[:, :own, :, :own]
        return out.reshape(n * size, n * size)


def _split(rig: CameraRig) -> tuple[np.ndarray, np.ndarray, list[tuple[str, ...]]]:
    """Return the rows of poses and of estimated focal lengths, those of other estimated parameters, and all names."""
    names = [parameter_names(camera.lens) for camera in rig.cameras]
    used, rest, start = [], [], 0
    for camera, own in zip(rig.cameras, names, strict=True):
        known = rig.covariance(camera.name)
        estimated = () if known is None else known.parameters
        used += list(range(start, start + _POSE))
        if own[_FX] in estimated:
            used.append(start + _FX)
        rest += [start + i for i, name in enumerate(own) if i > _FX and name in estimated]
        start += len(own)
    return np.array(used), np.array(rest, dtype=int), names


def _at(names: list[tuple[str, ...]], rows: np.ndarray) -> list[tuple[int, str]]:
    every = [(camera, name) for camera, own in enumerate(names) for name in own]
    return [every[int(row)] for row in rows]


def _covariance(rig: CameraRig, names: list[tuple[str, ...]]) -> np.ndarray:
    """Return the covariance of all parameters; without correlations between cameras if the file does not state them."""
    every = [(camera.name, name) for camera, own in zip(rig.cameras, names, strict=True) for name in own]
    joint = rig.covariance()
    if joint is not None:
        return joint.block(every)
    out, start = np.zeros((len(every), len(every))), 0
    for camera, own in zip(rig.cameras, names, strict=True):
        known = rig.covariance(camera.name)
        if known is not None:
            out[start : start + len(own), start : start + len(own)] = known.block(own)
        start += len(own)
    return out


def _by_logarithms(rig: CameraRig, names: list[tuple[str, ...]], covariance: np.ndarray) -> np.ndarray:
    """Return a covariance with the logarithm of the mean focal length, and of the ratio fx / fy, for fx and fy."""
    step, start = np.eye(len(covariance)), 0
    for camera, own in zip(rig.cameras, names, strict=True):
        fx, fy = camera.matrix[0, 0], camera.matrix[1, 1]
        at = slice(start + _FX, start + _FY + 1)
        step[at, at] = [[0.5 / fx, 0.5 / fy], [1.0 / fx, -1.0 / fy]]
        start += len(own)
    return step @ covariance @ step.T


def _inverse(covariance: np.ndarray) -> np.ndarray:
    """Return the inverse of a covariance of parameters with different units; 0 where it is singular."""
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return np.linalg.pinv(covariance / np.outer(sd, sd), rcond=_RANK_TOLERANCE, hermitian=True) / np.outer(sd, sd)


def _to_camera_axes(rig: CameraRig, column: np.ndarray, place: np.ndarray, views: np.ndarray) -> np.ndarray:
    """Return the matrix that turns shifts of centers in the world to those along the cameras' axes."""
    turn = np.eye(len(column))
    for camera, view in zip(rig.cameras, views, strict=True):
        at = np.flatnonzero((place == view) & (column >= 3) & (column < _POSE))
        turn[np.ix_(at, at)] = camera.rotation
    return turn


def _without_world(
    rig: CameraRig, precision: np.ndarray, column: np.ndarray, place: np.ndarray, views: np.ndarray
) -> np.ndarray:
    """Return a precision without information about rotations and shifts that all cameras share."""
    common = np.zeros((len(column), 6))
    for camera, view in zip(rig.cameras, views, strict=True):
        own = place == view
        common[np.flatnonzero(own & (column < _POSE))] = rigid_changes(camera)
    along = precision @ common
    out = precision - along @ np.linalg.pinv(common.T @ along, rcond=_RANK_TOLERANCE, hermitian=True) @ along.T
    # What remains of a single camera is its lens and, of its pose, rounding errors of large numbers.
    unit = np.sqrt(np.maximum(np.diag(precision), 1e-300))
    values, vectors = np.linalg.eigh(0.5 * (out + out.T) / np.outer(unit, unit))
    half = unit[:, None] * vectors * np.sqrt(np.where(values > _RANK_TOLERANCE * values[-1], values, 0.0))
    return half @ half.T


def rigid_changes(camera: Camera) -> np.ndarray:
    """Return the changes of a pose by a small rotation and shift of the world, shape (6, 6)."""
    x, y, z = camera.center_m
    out = np.zeros((6, 6))
    out[:3, :3] = -camera.rotation
    out[3:, :3] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    out[3:, 3:] = np.eye(3)
    return out
