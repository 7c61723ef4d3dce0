"""Hypothetical description of a recording: the calibration as given plus the corrections found so far."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from posefuse.diagnostics.observations import TrackedObservations
from posefuse.model.cameras import rotation_from_vector


class Parameter(IntEnum):
    """Enumerate the parameters of one view that the linearized problem can correct."""

    ROTATION_X = 0
    ROTATION_Y = 1
    ROTATION_Z = 2
    TRANSLATION_X = 3
    TRANSLATION_Y = 4
    TRANSLATION_Z = 5
    FOCAL = 6
    ASPECT = 7
    K1 = 8
    OFFSET = 9


N_PARAMETERS = len(Parameter)
POSE_PARAMETERS = tuple(range(Parameter.TRANSLATION_Z + 1))


@dataclass(frozen=True)
class ImageTransform:
    """Describe how the images of a view differ from the images its camera was calibrated with.

    Attributes:
        quarter_turns: clockwise quarter turns.
        mirrored: whether the images were mirrored left to right, before the turn.
        scale: pixels of the view per pixel of the calibration.
    """

    quarter_turns: int = 0
    mirrored: bool = False
    scale: float = 1.0

    def undo(self, pixels: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
        """Map pixels of the view to pixels of the calibrated images, shape (..., 2).

        Args:
            pixels: shape (..., 2), of the view.
            size_px: width and height of the calibrated images.
        """
        width, height = size_px
        u, v = ((pixels + 0.5) / self.scale - 0.5)[..., 0], ((pixels + 0.5) / self.scale - 0.5)[..., 1]
        if self.quarter_turns == 1:
            u, v = v, height - 1 - u
        elif self.quarter_turns == 2:
            u, v = width - 1 - u, height - 1 - v
        elif self.quarter_turns == 3:
            u, v = width - 1 - v, u
        return np.stack([width - 1 - u if self.mirrored else u, v], axis=-1)


@dataclass(frozen=True, eq=False)
class RecordingModel:
    """Hold one hypothesis about a recording.

    Attributes:
        frames: shape (sample,), int: sampled frames of the observations.
        cameras: index of the camera whose calibration each view uses.
        images: transform of each view's images.
        swapped: for each view, whether its left and right labels are swapped.
        rotation: shape (sample, view, 3, 3): R of ``x_camera = R x_world + t``.
        translation_m: shape (sample, view, 3): t.
        focal_ratio: shape (sample, view, 2): true focal lengths divided by the calibrated ones.
        k1_correction: shape (sample, view): amount to add to the first radial distortion coefficient.
        offset_s: shape (sample, view): time offset, the true time of a frame minus its timestamp.
    """

    frames: np.ndarray
    cameras: tuple[int, ...]
    images: tuple[ImageTransform, ...]
    swapped: tuple[bool, ...]
    rotation: np.ndarray
    translation_m: np.ndarray
    focal_ratio: np.ndarray
    k1_correction: np.ndarray
    offset_s: np.ndarray

    @classmethod
    def from_calibration(cls, observations: TrackedObservations, frames: np.ndarray) -> "RecordingModel":
        """Return the model without corrections."""
        views, samples = observations.n_views, len(frames)
        poses = np.stack([camera.camera_from_world for camera in observations.rig.cameras])
        return cls(
            frames=frames,
            cameras=tuple(range(views)),
            images=(ImageTransform(),) * views,
            swapped=(False,) * views,
            rotation=np.repeat(poses[None, :, :3, :3], samples, axis=0),
            translation_m=np.repeat(poses[None, :, :3, 3], samples, axis=0),
            focal_ratio=np.ones((samples, views, 2)),
            k1_correction=np.zeros((samples, views)),
            offset_s=np.zeros((samples, views)),
        )

    def resampled(self, frames: np.ndarray) -> "RecordingModel":
        """Return the same model at other frames, with the values of the nearest sample, and times interpolated."""
        right = np.clip(np.searchsorted(self.frames, frames), 0, len(self.frames) - 1)
        left = np.maximum(right - 1, 0)
        nearer = np.abs(self.frames[left] - frames) <= np.abs(self.frames[right] - frames)
        place = np.where(nearer, left, right)
        names = ("rotation", "translation_m", "focal_ratio", "k1_correction")
        offsets = _interpolated(self.frames, self.offset_s, frames)
        return replace(self, frames=frames, offset_s=offsets, **{name: getattr(self, name)[place] for name in names})

    def with_camera(self, observations: TrackedObservations, view: int, camera: int) -> "RecordingModel":
        """Return a copy in which the view uses another camera's calibration."""
        pose = observations.rig.cameras[camera].camera_from_world
        return replace(self, cameras=_set(self.cameras, view, camera)).with_pose(view, pose)

    def with_pose(self, view: int, camera_from_world: np.ndarray) -> "RecordingModel":
        """Return a copy in which the view has another camera pose at all samples."""
        rotation, translation = self.rotation.copy(), self.translation_m.copy()
        rotation[:, view], translation[:, view] = camera_from_world[:3, :3], camera_from_world[:3, 3]
        return replace(self, rotation=rotation, translation_m=translation)

    def with_image(self, view: int, image: ImageTransform) -> "RecordingModel":
        """Return a copy with another image transform of the view."""
        return replace(self, images=_set(self.images, view, image))

    def with_swap(self, view: int, swapped: bool) -> "RecordingModel":
        """Return a copy that states whether the view's left and right labels are swapped."""
        return replace(self, swapped=_set(self.swapped, view, swapped))

    def with_offset(self, view: int, offset_s: np.ndarray | float) -> "RecordingModel":
        """Return a copy with ``offset_s`` added to the view's time offset."""
        offsets = self.offset_s.copy()
        offsets[:, view] += offset_s
        return replace(self, offset_s=offsets)

    def with_focal(self, view: int, factor: float) -> "RecordingModel":
        """Return a copy with the view's focal lengths multiplied by ``factor``."""
        focal = self.focal_ratio.copy()
        focal[:, view] *= factor
        return replace(self, focal_ratio=focal)

    def corrected(self, changes: np.ndarray) -> "RecordingModel":
        """Return a copy with small corrections applied.

        Args:
            changes: shape (sample, view, parameter), see :class:`Parameter`.
        """
        rotation, translation = self.rotation.copy(), self.translation_m.copy()
        focal = self.focal_ratio.copy()
        for v in range(changes.shape[1]):
            distinct, place = np.unique(changes[:, v, : Parameter.TRANSLATION_Z + 1], axis=0, return_inverse=True)
            rotations = np.stack([rotation_from_vector(row[:3]) for row in distinct])[place.ravel()]
            rotation[:, v] = rotations @ rotation[:, v]
            translation[:, v] = (rotations @ translation[:, v, :, None])[..., 0] + changes[:, v, 3:6]
        aspect = np.stack([changes[..., Parameter.ASPECT], -changes[..., Parameter.ASPECT]], axis=-1) / 2.0
        focal *= np.exp(changes[..., Parameter.FOCAL, None] + aspect)
        return replace(
            self,
            rotation=rotation,
            translation_m=translation,
            focal_ratio=focal,
            k1_correction=self.k1_correction + changes[..., Parameter.K1],
            offset_s=self.offset_s + changes[..., Parameter.OFFSET],
        )


def _set(values: tuple, place: int, value: object) -> tuple:
    return (*values[:place], value, *values[place + 1 :])


def _interpolated(frames: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return values at other frames by linear interpolation, continued beyond the ends, shape (sample, view)."""
    if len(frames) < 2:
        return np.repeat(values[:1], len(at), axis=0)
    after = np.clip(np.searchsorted(frames, at), 1, len(frames) - 1)
    share = (at - frames[after - 1]) / (frames[after] - frames[after - 1])
    return values[after - 1] + share[:, None] * (values[after] - values[after - 1])
