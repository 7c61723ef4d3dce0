"""Simulate recordings with and without faults for the recording check."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from posefuse.errors import OptionsError, suggestion
from posefuse.model.cameras import Camera, CameraRig, LensModel, rotation_from_vector
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.synthetic.detector import add_errors, on_intervals
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import HumanMotion
from posefuse.synthetic.options import Activity, DetectorOptions, LensKind
from posefuse.synthetic.rigs import build_rig, look_at

Fault = Literal[
    "turned",
    "moved across",
    "moved along",
    "bumped",
    "focal",
    "lens",
    "rotated image",
    "resized image",
    "order",
    "copied pose",
    "late",
    "drift",
    "dropped",
    "repeated",
    "sides",
    "confidence",
    "another rig",
    "moved across later",
    "moved along later",
]
FAULTS: tuple[Fault, ...] = get_args(Fault)


@dataclass(frozen=True)
class Planted:
    """A simulated fault.

    Attributes:
        fault: name of the fault.
        cameras: names of the affected cameras; empty if all are.
        size: size in the unit of the fault: degrees, meters, frames, ppm, a factor or a share.
    """

    fault: Fault
    cameras: tuple[str, ...]
    size: float


@dataclass(frozen=True, eq=False)
class Scene:
    """A walk in front of cameras, before detection.

    Attributes:
        rig: true rig.
        given: calibrated rig.
        later: true rig from the middle of the recording onward.
        motion: motion of the person.
        figure_m: height of the person.
        skeleton: skeleton of the keypoints.
        rate_hz: frames per second.
        n_frames: number of frames.
        late_s: shape (frame, view): delay of each capture relative to its timestamp.
        seed: random seed of the detector.
        after: change of detected pixels and confidences, shape (frame, view, keypoint, ...).
    """

    rig: CameraRig
    given: CameraRig
    later: CameraRig
    motion: HumanMotion
    figure_m: float
    skeleton: Skeleton
    rate_hz: float
    n_frames: int
    late_s: np.ndarray
    seed: int
    after: tuple[Callable[[np.ndarray, np.ndarray, np.random.Generator], tuple[np.ndarray, np.ndarray]], ...] = ()

    def watch(self, options: DetectorOptions | None = None) -> tuple[CameraRig, Detections]:
        """Return the calibration and the detections of the walk."""
        rng = np.random.default_rng(self.seed)
        figure = human(self.figure_m)
        early = max(0.0, -float(self.late_s.min())) + 0.1
        taken = np.arange(self.n_frames)[:, None] / self.rate_hz + self.late_s + early
        columns = figure.columns(self.skeleton)
        moments, which = np.unique(np.round(taken, 9), return_inverse=True)
        points = self.motion.positions(figure, moments)[:, columns]
        points = points[which.ravel()].reshape(self.n_frames, len(self.rig), len(self.skeleton), 3)
        sizes = np.array([camera.size_px for camera in self.rig.cameras])
        exact = self._projected(points)
        pixels, confidence = add_errors(exact, sizes, self.skeleton, self.rate_hz, options or DetectorOptions(), rng)
        for change in self.after:
            pixels, confidence = change(pixels.copy(), confidence.copy(), rng)
        return self.given, Detections.from_dense(
            self.skeleton, self.rig.names, pixels, confidence, rate_hz=self.rate_hz
        )

    def _projected(self, points_m: np.ndarray) -> np.ndarray:
        """Return the projections at the capture times, shape (frame, view, keypoint, 2)."""
        half = self.n_frames // 2
        pixels = np.empty((*points_m.shape[:3], 2))
        for v, (camera, later) in enumerate(zip(self.rig.cameras, self.later.cameras, strict=True)):
            pixels[:half, v] = camera.project(points_m[:half, v])[0]
            pixels[half:, v] = later.project(points_m[half:, v])[0]
        return pixels


def healthy(
    seed: int,
    *,
    cameras: int | None = None,
    duration_s: float = 30.0,
    rate_hz: float | None = None,
    activities: Sequence[Activity] | None = None,
) -> Scene:
    """Return a scene without faults; rig, lenses, person and motion depend on the seed.

    Args:
        seed: random seed.
        cameras: number of cameras, 4 to 8 by default.
        duration_s: duration.
        rate_hz: frames per second; 25, 30, 50 or 60 by default.
        activities: activities of the person; walking and another one by default.
    """
    rng = np.random.default_rng([seed, 8])
    n = cameras or int(rng.integers(4, 9))
    lens: LensKind = ("pinhole", "pinhole", "barrel")[int(rng.integers(3))]
    rig = build_rig("ring", n, lens, radius_m=5.0)
    moved = tuple(placed(camera, rng) for camera in rig.cameras)
    others: tuple[Activity, ...] = ("turn", "reach", "sit", "walk", "stand")
    doing = tuple(activities or ("walk", "walk", others[int(rng.integers(len(others)))]))
    rate = rate_hz or float(rng.choice([25.0, 30.0, 50.0, 60.0]))
    names = ("halpe_26", "coco_17", "body_25b")
    rig = replace(rig, cameras=moved)
    frames = round(duration_s * rate)
    return Scene(
        rig=rig,
        given=rig,
        later=rig,
        motion=HumanMotion.random(doing, rng),
        figure_m=float(rng.uniform(1.55, 1.9)),
        skeleton=find_skeleton(names[int(rng.integers(len(names)))]),
        rate_hz=rate,
        n_frames=frames,
        late_s=np.zeros((frames, n)),
        seed=seed,
    )


def placed(camera: Camera, rng: np.random.Generator) -> Camera:
    """Return a camera at another place on the same side of the room, with another focal length."""
    center = camera.center_m * np.array([*[rng.uniform(0.8, 1.15)] * 2, 1.0]) + rng.uniform(-0.4, 0.4, 3)
    target = np.array([0.0, 0.0, 0.9]) + rng.uniform(-0.2, 0.2, 3)
    matrix = camera.matrix.copy()
    matrix[[0, 1], [0, 1]] *= rng.uniform(0.85, 1.2)
    return replace(camera, matrix=matrix, camera_from_world=look_at(center, target))


def plant(scene: Scene, fault: Fault, views: Sequence[int], size: float | None = None) -> tuple[Scene, Planted]:
    """Return the scene with a fault in some views.

    Args:
        scene: the scene.
        fault: one of :data:`FAULTS`.
        views: affected views; two for ``order``, and for ``copied pose`` the copy, then the original.
        size: size of the fault; see :data:`USUAL` for the default.

    Raises:
        OptionsError: if there is no such fault.
    """
    if fault not in FAULTS:
        raise OptionsError(f"No fault {fault!r}. {suggestion(fault, FAULTS)}")
    size = USUAL[fault] if size is None else size
    rng = np.random.default_rng([scene.seed, *views, FAULTS.index(fault)])
    names = tuple(scene.rig.names[v] for v in views)
    return _PLANTERS[fault](scene, tuple(views), size, rng), Planted(fault, names, size)


def _given(scene: Scene, view: int, camera: Camera) -> Scene:
    named = replace(camera, name=scene.given.names[view])
    return replace(scene, given=_with(scene.given, view, named))


def _moved(camera: Camera, turn: np.ndarray, shift_m: np.ndarray) -> Camera:
    pose = camera.camera_from_world.copy()
    rotation = rotation_from_vector(turn)
    pose[:3, :3] = rotation @ pose[:3, :3]
    pose[:3, 3] = rotation @ pose[:3, 3] + shift_m
    return replace(camera, camera_from_world=pose)


def _direction(rng: np.random.Generator, size: int) -> np.ndarray:
    vector = rng.standard_normal(size)
    return vector / np.linalg.norm(vector)


def _turned(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    for v in views:
        turn = np.radians(size) * _direction(rng, 3)
        scene = _given(scene, v, _moved(scene.given.cameras[v], turn, np.zeros(3)))
    return scene


def _across(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    for v in views:
        shift = np.append(size * _direction(rng, 2), 0.0)
        scene = _given(scene, v, _moved(scene.given.cameras[v], np.zeros(3), shift))
    return scene


def _along(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    for v in views:
        shift = np.array([0.0, 0.0, size * rng.choice([-1.0, 1.0])])
        scene = _given(scene, v, _moved(scene.given.cameras[v], np.zeros(3), shift))
    return scene


def _later(scene: Scene, view: int, turn: np.ndarray, shift_m: np.ndarray) -> Scene:
    """Move or rotate the camera from the middle of the recording onward."""
    return replace(scene, later=_with(scene.later, view, _moved(scene.later.cameras[view], turn, shift_m)))


def _bumped(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    for v in views:
        scene = _later(scene, v, np.radians(size) * _direction(rng, 3), np.zeros(3))
    return scene


def _across_later(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    for v in views:
        scene = _later(scene, v, np.zeros(3), np.append(size * _direction(rng, 2), 0.0))
    return scene


def _along_later(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    for v in views:
        scene = _later(scene, v, np.zeros(3), np.array([0.0, 0.0, size * rng.choice([-1.0, 1.0])]))
    return scene


def _focal(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    for v in views:
        camera = scene.given.cameras[v]
        matrix = camera.matrix.copy()
        matrix[[0, 1], [0, 1]] *= size
        scene = _given(scene, v, replace(camera, matrix=matrix))
    return scene


def _with(rig: CameraRig, view: int, camera: Camera) -> CameraRig:
    return replace(rig, cameras=(*rig.cameras[:view], camera, *rig.cameras[view + 1 :]))


def _lens(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    """Remove the view's distortion from the calibration."""
    for v in views:
        rigs = {
            name: _with(rig, v, replace(rig.cameras[v], lens=LensModel.BROWN, distortion=(size, 0.0, 0.0, 0.0, 0.0)))
            for name, rig in (("rig", scene.rig), ("later", scene.later))
        }
        scene = replace(scene, **rigs)
        scene = _given(scene, v, replace(scene.given.cameras[v], lens=LensModel.PINHOLE, distortion=()))
    return scene


def _rotated(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    turns = round(size / 90.0) % 4

    def change(pixels: np.ndarray, trust: np.ndarray, _: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        for v in views:
            width, height = scene.rig.cameras[v].size_px
            u, w = pixels[:, v, :, 0].copy(), pixels[:, v, :, 1].copy()
            turned = {0: (u, w), 1: (height - 1 - w, u), 2: (width - 1 - u, height - 1 - w), 3: (w, width - 1 - u)}
            pixels[:, v] = np.stack(turned[turns], axis=-1)
        return pixels, trust

    return replace(scene, after=(*scene.after, change))


def _resized(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    def change(pixels: np.ndarray, trust: np.ndarray, _: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        for v in views:
            pixels[:, v] = (pixels[:, v] + 0.5) * size - 0.5
        return pixels, trust

    return replace(scene, after=(*scene.after, change))


def _order(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    before = scene.given.cameras
    for v, other in zip(views, (*views[1:], views[0]), strict=True):
        scene = _given(scene, v, before[other])
    return scene


def _copied(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    copy, original = views[:2]
    pose = scene.given.cameras[original].camera_from_world
    return _given(scene, copy, replace(scene.given.cameras[copy], camera_from_world=pose))


def _late_by(scene: Scene, views: tuple[int, ...], late_s: np.ndarray) -> Scene:
    late = scene.late_s.copy()
    late[:, list(views)] += late_s[:, None]
    return replace(scene, late_s=late)


def _late(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    return _late_by(scene, views, np.full(scene.n_frames, size / scene.rate_hz))


def _drift(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    return _late_by(scene, views, 1e-6 * size * np.arange(scene.n_frames) / scene.rate_hz)


def _dropped(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    at = int(scene.n_frames * rng.uniform(0.35, 0.65))
    return _late_by(scene, views, np.where(np.arange(scene.n_frames) >= at, size, 0.0) / scene.rate_hz)


def _repeated(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    def change(pixels: np.ndarray, trust: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        for v in views:
            again = rng.random(len(pixels)) < size
            again[0] = False
            source = np.maximum.accumulate(np.where(again, 0, np.arange(len(pixels))))
            pixels[:, v], trust[:, v] = pixels[source, v], trust[source, v]
        return pixels, trust

    return replace(scene, after=(*scene.after, change))


def _sides(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    mirror = scene.skeleton.mirror

    def change(pixels: np.ndarray, trust: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        for v in views:
            wrong = on_intervals((len(pixels), 1), size, 1.0, scene.rate_hz, rng)[:, 0] if size < 1 else slice(None)
            pixels[wrong, v], trust[wrong, v] = pixels[wrong, v][:, mirror], trust[wrong, v][:, mirror]
        return pixels, trust

    return replace(scene, after=(*scene.after, change))


def _confidence(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    def change(pixels: np.ndarray, trust: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        for v in views or range(pixels.shape[1]):
            seen = np.isfinite(trust[:, v])
            trust[:, v][seen] = rng.permutation(trust[:, v][seen])
        return pixels, trust

    return replace(scene, after=(*scene.after, change))


def _another(scene: Scene, views: tuple[int, ...], size: float, rng: np.random.Generator) -> Scene:
    other = build_rig("corners", len(scene.rig), "pinhole", radius_m=4.0)
    cameras = tuple(
        replace(camera, name=name)
        for camera, name in zip((placed(camera, rng) for camera in other.cameras), scene.rig.names, strict=True)
    )
    return replace(scene, given=replace(scene.given, cameras=cameras))


USUAL: dict[Fault, float] = {
    "turned": 1.0,
    "moved across": 0.02,
    "moved along": 0.05,
    "bumped": 1.0,
    "moved across later": 0.02,
    "moved along later": 0.05,
    "focal": 1.15,
    "lens": -0.28,
    "rotated image": 180.0,
    "resized image": 0.5,
    "order": 0.0,
    "copied pose": 0.0,
    "late": 2.0,
    "drift": 1000.0,
    "dropped": 3.0,
    "repeated": 0.1,
    "sides": 0.4,
    "confidence": 1.0,
    "another rig": 0.0,
}
"""Default size of a fault."""

_PLANTERS: dict[Fault, Callable[[Scene, tuple[int, ...], float, np.random.Generator], Scene]] = {
    "turned": _turned,
    "moved across": _across,
    "moved along": _along,
    "bumped": _bumped,
    "moved across later": _across_later,
    "moved along later": _along_later,
    "focal": _focal,
    "lens": _lens,
    "rotated image": _rotated,
    "resized image": _resized,
    "order": _order,
    "copied pose": _copied,
    "late": _late,
    "drift": _drift,
    "dropped": _dropped,
    "repeated": _repeated,
    "sides": _sides,
    "confidence": _confidence,
    "another rig": _another,
}
