"""What may change of a camera: nine numbers, small changes of which are added to it.

In this order: three turns about the camera's own axes in radians, three shifts of its centre in the world in metres,
the logarithm of its focal length, and the changes of k1 and k2. A turn is about the centre, so that a camera that was
only turned stays where it is: ``x_camera = exp(turn) R (x_world - centre - shift)``.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.model.cameras import Camera, CameraRig, LensModel, rotation_from_vector
from posefuse.model.options.refinement import Refine

N_PARAMETERS = 9
POSE = slice(0, 6)
TURN = slice(0, 3)
SHIFT = slice(3, 6)
FOCAL = 6
LENS = slice(6, 9)
_COUNTS: dict[Refine, int] = {"extrinsics": 6, "focal": 7, "lens": 9}


@dataclass(frozen=True, eq=False)
class Freedom:
    """Which numbers of which cameras may change.

    Attributes:
        free: shape (view, 9), bool.
    """

    free: np.ndarray

    @classmethod
    def of(cls, rig: CameraRig, refine: Refine, fixed: tuple[str, ...] = ()) -> "Freedom":
        """The freedom that a user gives: all cameras alike, but for those that are fixed."""
        free = np.zeros((len(rig), N_PARAMETERS), dtype=bool)
        free[:, : _COUNTS[refine]] = True
        for name in fixed:
            free[rig.index(name)] = False
        return cls(free)

    @property
    def columns(self) -> np.ndarray:
        """Places of the free numbers among all, cameras one after the other."""
        return np.flatnonzero(self.free.ravel())


def changed(rig: CameraRig, change: np.ndarray) -> CameraRig:
    """The rig after a change, shape (view, 9)."""
    return replace(rig, cameras=tuple(_changed(camera, row) for camera, row in zip(rig.cameras, change, strict=True)))


def _changed(camera: Camera, row: np.ndarray) -> Camera:
    if not row.any():
        return camera
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_vector(row[TURN]) @ camera.rotation
    pose[:3, 3] = -pose[:3, :3] @ (camera.centre_m + row[SHIFT])
    matrix = camera.matrix.copy()
    matrix[:2, :2] *= np.exp(row[FOCAL])
    distortion = camera.distortion
    if distortion:
        distortion = (distortion[0] + row[FOCAL + 1], distortion[1] + row[FOCAL + 2], *distortion[2:])
    return replace(camera, camera_from_world=pose, matrix=matrix, distortion=distortion)


def with_distortion(rig: CameraRig) -> CameraRig:
    """The same rig, with a lens model whose terms can change: a pinhole is a Brown lens without distortion."""
    cameras = tuple(
        replace(camera, lens=LensModel.BROWN, distortion=(0.0,) * 5) if camera.lens is LensModel.PINHOLE else camera
        for camera in rig.cameras
    )
    return replace(rig, cameras=cameras)
