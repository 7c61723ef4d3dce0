"""Poses, clocks and focal lengths of all views."""

from dataclasses import dataclass

import numpy as np

from posefuse.kernels.calibration.joint import FOCAL, PRINCIPAL, RADIAL, VIEW_PARAMETERS, undistort_radial
from posefuse.model.cameras import rotation_from_vector, vector_from_rotation


@dataclass(frozen=True, eq=False)
class JointParameters:
    """Hold poses and clocks of all views, and their lenses unless these are fixed.

    Attributes:
        rotation: shape (view, 3, 3): camera_from_world.
        center_m: shape (view, 3).
        offset_s: shape (view,): true time minus timestamp in the middle of the recording.
        drift: shape (view,): change of the offset per second.
        log_focal: shape (view,): logarithm of the focal length relative to the one of the recording's coordinates; None
            if all lenses are fixed.
        radial: shape (view,): first coefficient of radial distortion of the recording's coordinates; None if all
            lenses are fixed.
        principal: shape (view, 2): principal point in the recording's coordinates; None if all lenses are fixed.
    """

    rotation: np.ndarray
    center_m: np.ndarray
    offset_s: np.ndarray
    drift: np.ndarray
    log_focal: np.ndarray | None = None
    radial: np.ndarray | None = None
    principal: np.ndarray | None = None

    @property
    def size(self) -> int:
        """Return the number of parameters of each view."""
        lens = (self.log_focal is not None) + (self.radial is not None) + 2 * (self.principal is not None)
        return VIEW_PARAMETERS + lens

    @property
    def lens(self) -> np.ndarray:
        """Return radial distortions and sizes of the ideal image planes, shape (view, 2)."""
        n = len(self.rotation)
        radial = np.zeros(n) if self.radial is None else self.radial
        shorter = np.ones(n) if self.log_focal is None else np.exp(-self.log_focal)
        return np.stack([radial, shorter], axis=1)

    def without_lens(self, xy: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return coordinates of the ideal camera of unit focal length, and their noise.

        Args:
            xy: shape (..., view, 2): coordinates of the recording.
            sigma: shape (..., view): their noise.
        """
        if self.log_focal is None:
            return xy, sigma
        shorter = np.exp(-self.log_focal)
        centered = xy if self.principal is None else xy - self.principal
        xy, sigma = centered * shorter[:, None], sigma * shorter
        if self.radial is not None:
            undistort_radial(self.radial, xy.reshape(-1, *xy.shape[-2:]), sigma.reshape(-1, sigma.shape[-1]))
        return xy, sigma

    def changed(self, change: np.ndarray) -> "JointParameters":
        """Return the parameters after a change, shape (view, parameter)."""
        turned = np.stack([rotation_from_vector(row[:3]) for row in change]) @ self.rotation
        return JointParameters(
            turned,
            self.center_m + change[:, 3:6],
            self.offset_s + change[:, 6],
            self.drift + change[:, 7],
            None if self.log_focal is None else self.log_focal + change[:, FOCAL],
            None if self.radial is None else self.radial + change[:, RADIAL],
            None if self.principal is None else self.principal + change[:, PRINCIPAL : PRINCIPAL + 2],
        )


def difference(before: JointParameters, after: JointParameters) -> np.ndarray:
    """Return the change from one set of parameters to another, shape (view, parameter)."""
    turns = [vector_from_rotation(b @ a.T) for a, b in zip(before.rotation, after.rotation, strict=True)]
    columns = [np.array(turns), after.center_m - before.center_m]
    columns += [(after.offset_s - before.offset_s)[:, None], (after.drift - before.drift)[:, None]]
    if before.log_focal is not None and after.log_focal is not None:
        columns.append((after.log_focal - before.log_focal)[:, None])
    if before.radial is not None and after.radial is not None:
        columns.append((after.radial - before.radial)[:, None])
    if before.principal is not None and after.principal is not None:
        columns.append(after.principal - before.principal)
    return np.concatenate(columns, axis=1)
