"""Parameters of a camera: nine numbers, to which small changes are added.

In this order: three rotations about the camera's own axes (rad), three shifts of its center in the world (m), the
logarithm of its focal length, and the changes of k1 and k2. Rotations are about the center, so a camera that was
only rotated keeps its position: ``x_camera = exp(rotation) R (x_world - center - shift)``.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.model.cameras import Camera, CameraRig, LensModel, rotation_from_vector
from posefuse.model.options.refinement import Refine

N_PARAMETERS = 9
POSE = slice(0, 6)
ROTATION = slice(0, 3)
TRANSLATION = slice(3, 6)
FOCAL = 6
LENS = slice(6, 9)
_N_FREE: dict[Refine, int] = {"extrinsics": 6, "focal": 7, "lens": 9}


@dataclass(frozen=True, eq=False)
class FreeParameters:
    """Select the free parameters of all cameras.

    Attributes:
        free: shape (view, 9), bool.
    """

    free: np.ndarray

    @classmethod
    def of(cls, rig: CameraRig, refine: Refine, fixed: tuple[str, ...] = ()) -> "FreeParameters":
        """Return the same free parameters for all cameras except fixed ones."""
        free = np.zeros((len(rig), N_PARAMETERS), dtype=bool)
        free[:, : _N_FREE[refine]] = True
        for name in fixed:
            free[rig.index(name)] = False
        return cls(free)

    @property
    def columns(self) -> np.ndarray:
        """Return the indices of the free parameters among those of all cameras."""
        return np.flatnonzero(self.free.ravel())


def apply_changes(rig: CameraRig, change: np.ndarray) -> CameraRig:
    """Return the rig after a parameter change, shape (view, 9)."""
    cameras = tuple(_apply(camera, row) for camera, row in zip(rig.cameras, change, strict=True))
    return replace(rig, cameras=cameras, covariances=(), correlation=None)


def _apply(camera: Camera, row: np.ndarray) -> Camera:
    """Return one camera after a parameter change, shape (9,)."""
    if not row.any():
        return camera
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_vector(row[ROTATION]) @ camera.rotation
    pose[:3, 3] = -pose[:3, :3] @ (camera.center_m + row[TRANSLATION])
    matrix = camera.matrix.copy()
    matrix[:2, :2] *= np.exp(row[FOCAL])
    distortion = camera.distortion
    if distortion:
        distortion = (distortion[0] + row[FOCAL + 1], distortion[1] + row[FOCAL + 2], *distortion[2:])
    return replace(camera, camera_from_world=pose, matrix=matrix, distortion=distortion)


def with_distortion(rig: CameraRig) -> CameraRig:
    """Return the rig with lens models that have distortion; a pinhole becomes a Brown lens without distortion."""
    cameras = tuple(
        replace(camera, lens=LensModel.BROWN, distortion=(0.0,) * 5) if camera.lens is LensModel.PINHOLE else camera
        for camera in rig.cameras
    )
    return replace(rig, cameras=cameras)
