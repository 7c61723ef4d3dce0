"""What is believed of a recording while it is examined: the calibration as given, and what has been found wrong."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from posefuse.arrays import ranges
from posefuse.diagnostics.observations import Evidence
from posefuse.model.cameras import Camera, rotation_from_vector

_LEAST_STRETCH = 0.2
_FEWEST_FRONT = 0.05
_NEAR = 0.02
"""Times within this share of a frame are the frame's."""


class Column(IntEnum):
    """What can be a little wrong with a view: the unknowns of the linearised problem."""

    TURN_X = 0
    TURN_Y = 1
    TURN_Z = 2
    SHIFT_X = 3
    SHIFT_Y = 4
    SHIFT_Z = 5
    FOCAL = 6
    ASPECT = 7
    BEND = 8
    LATE = 9


N_COLUMNS = len(Column)
POSE = tuple(range(Column.SHIFT_Z + 1))


@dataclass(frozen=True)
class Image:
    """What was done to a view's images after it was calibrated.

    Attributes:
        turns: quarter turns clockwise.
        mirrored: left for right, before it was turned.
        scale: how many of its pixels make one of the calibration's.
    """

    turns: int = 0
    mirrored: bool = False
    scale: float = 1.0

    def undo(self, pixels: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
        """Pixels of the images the camera was calibrated with, shape (..., 2).

        Args:
            pixels: shape (..., 2), of the view.
            size_px: of the calibration's images.
        """
        width, height = size_px
        u, v = ((pixels + 0.5) / self.scale - 0.5)[..., 0], ((pixels + 0.5) / self.scale - 0.5)[..., 1]
        if self.turns == 1:
            u, v = v, height - 1 - u
        elif self.turns == 2:
            u, v = width - 1 - u, height - 1 - v
        elif self.turns == 3:
            u, v = width - 1 - v, u
        return np.stack([width - 1 - u if self.mirrored else u, v], axis=-1)


@dataclass(frozen=True, eq=False)
class State:
    """What is believed.

    Attributes:
        frames: shape (sample,), int: frames of the evidence that are looked at.
        cameras: for each view, whose calibration it has.
        images: for each view, what was done to its images.
        swapped: for each view, whether its left is right.
        rotation: shape (sample, view, 3, 3): R of ``x_camera = R x_world + t``.
        translation_m: shape (sample, view, 3): t.
        focal: shape (sample, view, 2): true focal lengths over the calibration's.
        bend: shape (sample, view): what the first distortion term lacks.
        late_s: shape (sample, view): how much later than it says the view took its frames.
    """

    frames: np.ndarray
    cameras: tuple[int, ...]
    images: tuple[Image, ...]
    swapped: tuple[bool, ...]
    rotation: np.ndarray
    translation_m: np.ndarray
    focal: np.ndarray
    bend: np.ndarray
    late_s: np.ndarray

    @classmethod
    def given(cls, evidence: Evidence, frames: np.ndarray) -> "State":
        """The recording as it says it is."""
        views, samples = evidence.n_views, len(frames)
        poses = np.stack([camera.camera_from_world for camera in evidence.rig.cameras])
        return cls(
            frames=frames,
            cameras=tuple(range(views)),
            images=(Image(),) * views,
            swapped=(False,) * views,
            rotation=np.repeat(poses[None, :, :3, :3], samples, axis=0),
            translation_m=np.repeat(poses[None, :, :3, 3], samples, axis=0),
            focal=np.ones((samples, views, 2)),
            bend=np.zeros((samples, views)),
            late_s=np.zeros((samples, views)),
        )

    def at(self, frames: np.ndarray) -> "State":
        """The same beliefs of other frames, taken from the nearest sample."""
        right = np.clip(np.searchsorted(self.frames, frames), 0, len(self.frames) - 1)
        left = np.maximum(right - 1, 0)
        nearer = np.abs(self.frames[left] - frames) <= np.abs(self.frames[right] - frames)
        place = np.where(nearer, left, right)
        names = ("rotation", "translation_m", "focal", "bend", "late_s")
        return replace(self, frames=frames, **{name: getattr(self, name)[place] for name in names})

    def with_camera(self, evidence: Evidence, view: int, camera: int) -> "State":
        """The view has another camera's calibration."""
        pose = evidence.rig.cameras[camera].camera_from_world
        return replace(self, cameras=_set(self.cameras, view, camera)).with_pose(view, pose)

    def with_pose(self, view: int, camera_from_world: np.ndarray) -> "State":
        """The view's camera stands elsewhere, all the time."""
        rotation, translation = self.rotation.copy(), self.translation_m.copy()
        rotation[:, view], translation[:, view] = camera_from_world[:3, :3], camera_from_world[:3, 3]
        return replace(self, rotation=rotation, translation_m=translation)

    def with_image(self, view: int, image: Image) -> "State":
        """The view's images were turned or resized."""
        return replace(self, images=_set(self.images, view, image))

    def with_sides(self, view: int, swapped: bool) -> "State":
        """The view's left is right, or is not."""
        return replace(self, swapped=_set(self.swapped, view, swapped))

    def with_late(self, view: int, late_s: np.ndarray | float) -> "State":
        """The view is so much later than believed so far."""
        late = self.late_s.copy()
        late[:, view] += late_s
        return replace(self, late_s=late)

    def with_focal(self, view: int, factor: float) -> "State":
        """The view's focal lengths are so many times longer than believed so far."""
        focal = self.focal.copy()
        focal[:, view] *= factor
        return replace(self, focal=focal)

    def corrected(self, changes: np.ndarray) -> "State":
        """With small changes.

        Args:
            changes: shape (sample, view, column): see :class:`Column`.
        """
        rotation, translation = self.rotation.copy(), self.translation_m.copy()
        focal = self.focal.copy()
        for v in range(changes.shape[1]):
            distinct, place = np.unique(changes[:, v, : Column.SHIFT_Z + 1], axis=0, return_inverse=True)
            turns = np.stack([rotation_from_vector(row[:3]) for row in distinct])[place.ravel()]
            rotation[:, v] = turns @ rotation[:, v]
            translation[:, v] = (turns @ translation[:, v, :, None])[..., 0] + changes[:, v, 3:6]
        both = np.stack([changes[..., Column.ASPECT], -changes[..., Column.ASPECT]], axis=-1) / 2.0
        focal *= np.exp(changes[..., Column.FOCAL, None] + both)
        return replace(
            self,
            rotation=rotation,
            translation_m=translation,
            focal=focal,
            bend=self.bend + changes[..., Column.BEND],
            late_s=self.late_s + changes[..., Column.LATE],
        )


@dataclass(frozen=True, eq=False)
class Sight:
    """Observations as straight lenses of focal length 1 would make them.

    Attributes:
        at: shape (sample, column, view, 2): x/z and y/z, NaN where there is none.
        per_px: shape (sample, column, view): length of a pixel there.
        confidence: shape (sample, column, view).
    """

    at: np.ndarray
    per_px: np.ndarray
    confidence: np.ndarray


def look(evidence: Evidence, state: State) -> Sight:
    """What the views show of the sampled frames, all at the frames' times, if the state is right."""
    parts = [look_one(evidence, state, v) for v in range(evidence.n_views)]
    return Sight(
        *(np.stack([getattr(part, name) for part in parts], axis=2) for name in ("at", "per_px", "confidence"))
    )


def look_one(evidence: Evidence, state: State, view: int) -> Sight:
    """What one view shows; arrays lack the view axis."""
    pixels, confidence = _in_time(evidence, state, view)
    if state.swapped[view]:
        pixels, confidence = pixels[:, evidence.partner], confidence[:, evidence.partner]
    camera = evidence.rig.cameras[state.cameras[view]]
    scale = state.images[view].scale
    at, per_px = straight(camera, state.images[view].undo(pixels, camera.size_px))
    focal = state.focal[:, view][:, None]
    at = at / focal
    radius2 = np.square(at).sum(axis=-1)
    # The lacking term bends outwards what the calibration had straight: undone to first order, twice.
    bend = state.bend[:, view][:, None]
    straightened = at / (1.0 + bend * radius2)[..., None]
    at = at / (1.0 + bend * np.square(straightened).sum(axis=-1))[..., None]
    # What is bent inwards towards the edge is stretched there, and its errors with it: by the root of the area.
    bent = bend * np.square(at).sum(axis=-1)
    stretch = 1.0 / np.sqrt(np.maximum(1.0 + bent, _LEAST_STRETCH) * np.maximum(1.0 + 3.0 * bent, _LEAST_STRETCH))
    return Sight(at, stretch * per_px / focal.mean(axis=-1) / scale, confidence)


def straight(camera: Camera, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Undistorted x/z, y/z of pixels, shape (..., 2), and the length of a pixel there, shape (...)."""
    rays = camera.rays(np.stack([pixels, pixels + np.array([1.0, 0.0]), pixels + np.array([0.0, 1.0])]))[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        at = np.where(rays[..., 2:] > _FEWEST_FRONT, rays[..., :2] / rays[..., 2:], np.nan)
        along, down = at[1] - at[0], at[2] - at[0]
        area = np.abs(along[..., 0] * down[..., 1] - along[..., 1] * down[..., 0])
    return at[0], np.sqrt(area)


def _in_time(evidence: Evidence, state: State, view: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels and confidences of the sampled frames' times, by straight lines between the view's frames."""
    wanted = evidence.frame_time_s[state.frames] - state.late_s[:, view]
    times = evidence.time_s[:, view]
    run = evidence.runs[state.frames]
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1) if len(times) > 1 else np.zeros(len(wanted), int)
    before = np.maximum(after - 1, 0)
    step = np.maximum(times[after] - times[before], 1e-9)
    share = (wanted - times[before]) / step
    fits = (share > -_NEAR) & (share < 1.0 + _NEAR)
    near_before, near_after = share < _NEAR, share > 1.0 - _NEAR
    # Nothing is made up across a gap of frames or between pieces of the recording.
    between = (evidence.runs[before] == run) & (evidence.runs[after] == run) & (step < 2.5 * evidence.period_s)
    share = np.where(near_before, 0.0, np.where(near_after, 1.0, share))
    good = fits & (near_before & (evidence.runs[before] == run) | near_after & (evidence.runs[after] == run) | between)
    return tuple(  # type: ignore[return-value]
        np.where(_wide(good, values), _mixed(values[:, view], before, after, share), np.nan)
        for values in (evidence.pixels, evidence.confidence)
    )


def _wide(mask: np.ndarray, values: np.ndarray) -> np.ndarray:
    return mask.reshape(-1, *[1] * (values.ndim - 2))


def _mixed(values: np.ndarray, before: np.ndarray, after: np.ndarray, share: np.ndarray) -> np.ndarray:
    weight = share.reshape(-1, *[1] * (values.ndim - 1))
    # 0 times NaN is NaN: a frame that does not count must not spoil the other.
    first = np.where(weight < 1.0, values[before] * (1.0 - weight), 0.0)
    return first + np.where(weight > 0.0, values[after] * weight, 0.0)


def _set(values: tuple, place: int, value: object) -> tuple:
    return (*values[:place], value, *values[place + 1 :])


def sample_frames(n_frames: int, runs: np.ndarray, period_s: float, every_s: float, most: int) -> np.ndarray:
    """Frames to look at: evenly spread, no nearer than ``every_s``, at most so many."""
    stride = max(1, round(every_s / period_s), -(-n_frames // most))
    chosen = [np.arange(start, stop) for start, stop in ranges(n_frames, 1 << 30)]
    every = np.concatenate(chosen) if chosen else np.zeros(0, dtype=int)
    return every[(every - np.searchsorted(runs, runs[every])) % stride == 0]
