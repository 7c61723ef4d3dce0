"""Parameters of a camera that a board calibrates: nineteen numbers, to which small changes are added.

In this order: three rotations about the camera's own axes (rad), three shifts of its center in the world (m), fx, fy,
cx and cy (px), eight distortion coefficients in OpenCV's order (four for a fisheye), and the time offset (s).
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.model.cameras import Camera, LensModel, rotation_from_vector
from posefuse.model.lenses import N_COEFFICIENTS

N_PARAMETERS = 19
POSE = slice(0, 6)
ROTATION = slice(0, 3)
CENTER = slice(3, 6)
LENS = slice(6, 18)
FOCAL = slice(6, 8)
PRINCIPAL = slice(8, 10)
DISTORTION = slice(10, 18)
OFFSET = 18


_PRINCIPAL_SD_SHARE, _PRINCIPAL_DOF = 0.01, 3.0
_ASPECT_SD = 0.01
_COEFFICIENT_SD = {LensModel.PINHOLE: 1.0, LensModel.BROWN: 0.5, LensModel.RATIONAL: 1.0, LensModel.FISHEYE: 0.5}
_TANGENTIAL_SD = 0.01


@dataclass(frozen=True, eq=False)
class LensPrior:
    """A prior of the lens of one camera, which keeps parameters that few corners determine close to usual values.

    Pixels are nearly square (sd 1 %), and distortion is moderate. The principal point is near the center of the image:
    1 % of its longer side, as in calibrations by people, with the tails of Student's t, because videos may be cropped.

    Attributes:
        mean: shape (19,).
        precision: shape (19, 19), without the principal point.
        principal_px: scale of the distance of the principal point from the center along each axis.
    """

    mean: np.ndarray
    precision: np.ndarray
    principal_px: float

    @classmethod
    def of(cls, camera: Camera) -> "LensPrior":
        """Return the prior of a camera's size and lens model."""
        mean, precision = np.zeros(N_PARAMETERS), np.zeros((N_PARAMETERS, N_PARAMETERS))
        width, height = camera.size_px
        mean[PRINCIPAL] = (width - 1) / 2, (height - 1) / 2
        difference = np.array([[1.0, -1.0], [-1.0, 1.0]])
        precision[FOCAL, FOCAL] = difference / (_ASPECT_SD * camera.matrix[0, 0]) ** 2
        n = N_COEFFICIENTS[camera.lens]
        sd = np.full(n, _COEFFICIENT_SD[camera.lens])
        if camera.lens in (LensModel.BROWN, LensModel.RATIONAL):
            sd[2:4] = _TANGENTIAL_SD
        at = np.arange(DISTORTION.start, DISTORTION.start + n)
        precision[at, at] = 1.0 / sd**2
        return cls(mean, precision, _PRINCIPAL_SD_SHARE * max(width, height))

    def matrix(self, away: np.ndarray) -> np.ndarray:
        """Return the precision at a distance from the mean, shape (19,), with the weights of the t distribution."""
        out, at = self.precision.copy(), np.arange(PRINCIPAL.start, PRINCIPAL.stop)
        out[at, at] = (_PRINCIPAL_DOF + 1.0) / (_PRINCIPAL_DOF * self.principal_px**2 + away[PRINCIPAL] ** 2)
        return out

    def cost(self, away: np.ndarray) -> float:
        """Return the negative logarithm of the prior at a distance from the mean, shape (19,)."""
        squared = (away[PRINCIPAL] / self.principal_px) ** 2
        principal = 0.5 * (_PRINCIPAL_DOF + 1.0) * np.log1p(squared / _PRINCIPAL_DOF).sum()
        return 0.5 * float(away @ self.precision @ away) + float(principal)


def lens_values(camera: Camera) -> np.ndarray:
    """Return the lens parameters of a camera in a row of all parameters, shape (19,); other entries are 0."""
    out = np.zeros(N_PARAMETERS)
    k = camera.matrix
    out[FOCAL], out[PRINCIPAL] = (k[0, 0], k[1, 1]), (k[0, 2], k[1, 2])
    out[DISTORTION.start : DISTORTION.start + len(camera.distortion)] = camera.distortion
    return out


def free_lens(camera: Camera) -> np.ndarray:
    """Return which parameters the lens model of a camera has, shape (19,), bool."""
    out = np.zeros(N_PARAMETERS, dtype=bool)
    out[LENS.start : DISTORTION.start + N_COEFFICIENTS[camera.lens]] = True
    return out


def changed(camera: Camera, row: np.ndarray) -> Camera:
    """Return a camera after a change of its pose and lens, shape (19,)."""
    if not row[:OFFSET].any():
        return camera
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_vector(row[ROTATION]) @ camera.rotation
    pose[:3, 3] = -pose[:3, :3] @ (camera.center_m + row[CENTER])
    matrix = camera.matrix.copy()
    matrix[0, 0] += row[FOCAL.start]
    matrix[1, 1] += row[FOCAL.start + 1]
    matrix[:2, 2] += row[PRINCIPAL]
    n = len(camera.distortion)
    distortion = tuple(np.array(camera.distortion) + row[DISTORTION.start : DISTORTION.start + n])
    return replace(camera, camera_from_world=pose, matrix=matrix, distortion=distortion)


def with_lens(camera: Camera, lens: LensModel) -> Camera:
    """Return a camera with a lens model without distortion, or unchanged if it has that model."""
    if camera.lens is lens:
        return camera
    return replace(camera, lens=lens, distortion=(0.0,) * N_COEFFICIENTS[lens])
