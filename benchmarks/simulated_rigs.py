"""Simulated recordings of people with known cameras, for calibrations from people.

A recording has 2 to 12 cameras in a ring, in corners or along an aisle; one person who stands, turns and reaches, one
who walks, or several who walk. Detection errors have the law of :mod:`benchmarks.clock_coverage`: Student-t tails, a
fast and a slow part, outliers. In one view, left and right are swapped in up to a third of the frames.
"""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from benchmarks.calibration_recordings import CalibrationCase, shuffled
from benchmarks.clock_coverage import detect
from benchmarks.fault_scenes import placed
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.synthetic.detector import on_intervals
from posefuse.synthetic.figures import Figure, human
from posefuse.synthetic.motions import HumanMotion
from posefuse.synthetic.options import Layout, LensKind
from posefuse.synthetic.rigs import build_rig, look_at
from posefuse.synthetic.walkers import Attendance, Walk, stroll

People = Literal["stands", "walks", "several"]
LAYOUTS: tuple[Layout, ...] = get_args(Layout)
PEOPLE: tuple[People, ...] = get_args(People)
_EARLY_S = 2.5
_SWAP_S = 1.0
_MISSED = 0.02
_MIN_KEYPOINTS = 4
_SCALE_PX = 4.5 * 1.92


@dataclass(frozen=True)
class RigOptions:
    """Options of a simulated recording.

    Attributes:
        layout: arrangement of the cameras.
        cameras: number of cameras.
        people: what is filmed.
        duration_s: duration.
        rates_hz: frame rates that the cameras have in turn.
        max_offset_s: maximum time between the starts of two cameras.
        swap_share: fraction of the frames of one view in which left and right are swapped.
        lens: lens of the cameras.
        principal_sd: standard deviation of the principal point along each axis around the middle of the image, relative
            to the width of the image.
        noise: factor of the detection errors.
        unrelated: whether the last camera films another person elsewhere.
        skeleton: keypoint set.
        seed: random seed.
    """

    layout: Layout = "ring"
    cameras: int = 4
    people: People = "walks"
    duration_s: float = 15.0
    rates_hz: tuple[float, ...] = (30.0,)
    max_offset_s: float = 0.0
    swap_share: float = 0.0
    lens: LensKind = "pinhole"
    principal_sd: float = 0.0
    noise: float = 1.0
    unrelated: bool = False
    skeleton: str = "halpe_26"
    seed: int = 0


def random_options(seed: int) -> RigOptions:
    """Return the options of a trial: every property is drawn independently."""
    rng = np.random.default_rng([seed, 24])
    together = rng.random() < 0.5
    return RigOptions(
        layout=LAYOUTS[int(rng.integers(len(LAYOUTS)))],
        cameras=int(rng.integers(2, 13)),
        people=PEOPLE[int(rng.integers(len(PEOPLE)))],
        duration_s=float(rng.uniform(10.0, 20.0)),
        rates_hz=((30.0,), (25.0,), (25.0, 30.0))[int(rng.integers(3))],
        max_offset_s=0.0 if together else 2.0,
        swap_share=float(rng.choice([0.0, rng.uniform(0.0, 1.0 / 3.0)])),
        lens=("pinhole", "barrel")[int(rng.integers(2))],
        skeleton=("halpe_26", "body_25b", "coco_17")[int(rng.integers(3))],
        seed=seed,
    )


def simulate_rig(options: RigOptions) -> CalibrationCase:
    """Simulate a recording. Cameras are named ``cam_0`` and so on; the last one is elsewhere if ``unrelated``."""
    rng = np.random.default_rng([options.seed, 23])
    skeleton = find_skeleton(options.skeleton)
    rig = build_rig(options.layout, options.cameras, options.lens)
    cameras = _off_center([placed(camera, rng) for camera in rig.cameras], options)
    if options.unrelated:
        cameras[-1] = _elsewhere(cameras[-1])
    half = 0.5 * options.max_offset_s
    offset_s = rng.uniform(-half, half, len(cameras))
    rates_hz = np.resize(np.array(options.rates_hz), len(cameras))
    people = _people(options, rng)
    swapped = int(rng.integers(len(cameras)))
    views = []
    for v, camera in enumerate(cameras):
        time_s = np.arange(round(options.duration_s * rates_hz[v])) / rates_hz[v]
        at = options.unrelated and v == len(cameras) - 1
        # Elsewhere, other people do something else.
        seen = _people(options, rng) if at else people
        points = np.stack([one.keypoints(time_s + offset_s[v] + _EARLY_S, skeleton) for one in seen], axis=1)
        share = options.swap_share if v == swapped else 0.0
        views.append(_detected(camera, points, skeleton, float(rates_hz[v]), share, options.noise, rng))
    rig = CameraRig(tuple(cameras), up_axis="z", source="simulated")
    detections = _assembled(rig, skeleton, views, rates_hz)
    unrelated = (cameras[-1].name,) if options.unrelated else ()
    case = CalibrationCase("simulated", detections, rig, offset_s, rates_hz, unrelated)
    return shuffled(case, options.seed)


def _off_center(cameras: list[Camera], options: RigOptions) -> list[Camera]:
    """Return the cameras with principal points off the middles of their images."""
    if options.principal_sd == 0.0:
        return cameras
    rng, out = np.random.default_rng([options.seed, 25]), []
    for camera in cameras:
        matrix = np.array(camera.matrix)
        matrix[:2, 2] += options.principal_sd * camera.size_px[0] * rng.standard_normal(2)
        out.append(replace(camera, matrix=matrix))
    return out


def _elsewhere(camera: Camera) -> Camera:
    """Return the camera of another room; its world is unrelated to that of the others."""
    return replace(camera, camera_from_world=look_at(np.array([4.5, 1.0, 1.4]), np.array([0.0, 0.0, 0.9])))


@dataclass(frozen=True)
class _Person:
    """One person and what the person does."""

    motion: HumanMotion | Walk
    figure: Figure

    def keypoints(self, time_s: np.ndarray, skeleton: Skeleton) -> np.ndarray:
        """Return the keypoints at any time, shape (time, keypoint, 3)."""
        return self.motion.positions(self.figure, time_s)[:, self.figure.columns(skeleton)]


def _people(options: RigOptions, rng: np.random.Generator) -> list[_Person]:
    n = int(rng.integers(2, 4)) if options.people == "several" else 1
    statures = rng.uniform(1.55, 1.9, n)
    if options.people == "stands":
        return [_Person(HumanMotion.random(("stand", "reach", "turn"), rng), human(float(statures[0])))]
    length_s = options.duration_s + 2 * _EARLY_S
    walks = stroll((Attendance(),) * n, 1.8, length_s, rng)
    return [_Person(walk, human(float(stature))) for walk, stature in zip(walks, statures, strict=True)]


def _detected(
    camera: Camera,
    points_m: np.ndarray,
    skeleton: Skeleton,
    rate_hz: float,
    swap_share: float,
    noise: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Return pixels, shape (frame, person, keypoint, 2), NaN where not detected, and confidences."""
    exact = camera.project(points_m)[0]
    pixels, sigma = detect(exact, rng, rate_hz)
    pixels, confidence = exact + noise * (pixels - exact), _SCALE_PX / sigma
    turned = on_intervals(exact.shape[:2], swap_share, _SWAP_S, rate_hz, rng)
    mirror = np.asarray(skeleton.mirror)
    pixels = np.where(turned[..., None, None], pixels[:, :, mirror], pixels)
    confidence = np.where(turned[..., None], confidence[:, :, mirror], confidence)
    outside = ((pixels < -0.5) | (pixels > np.array(camera.size_px) - 0.5)).any(axis=-1)
    lost = outside | on_intervals(exact.shape[:3], _MISSED, 0.2, rate_hz, rng) | ~np.isfinite(pixels).all(axis=-1)
    few = (~lost).sum(axis=-1, keepdims=True) < _MIN_KEYPOINTS
    return np.where((lost | few)[..., None], np.nan, pixels), np.where(lost | few, np.nan, confidence)


def _assembled(
    rig: CameraRig, skeleton: Skeleton, views: list[tuple[np.ndarray, np.ndarray]], rates_hz: np.ndarray
) -> Detections:
    """Return the detections of all views by frame number, with identities and the times of each view's own clock."""
    n = max(len(pixels) for pixels, _ in views)
    time_s, recorded = np.full((n, len(rig)), np.nan), np.zeros((n, len(rig)), dtype=bool)
    counts = np.zeros((n, len(rig)), dtype=np.int64)
    seen = []
    for v, (pixels, _) in enumerate(views):
        time_s[: len(pixels), v] = np.arange(len(pixels)) / rates_hz[v]
        recorded[: len(pixels), v] = True
        seen.append(np.isfinite(pixels[..., 0]).any(axis=-1))
        counts[: len(pixels), v] = seen[-1].sum(axis=1)
    rows = [
        (pixels[f, seen[v][f]], trust[f, seen[v][f]])
        for f in range(n)
        for v, (pixels, trust) in enumerate(views)
        if f < len(pixels)
    ]
    people = [np.flatnonzero(seen[v][f]) for f in range(n) for v in range(len(views)) if f < len(seen[v])]
    same = len(set(rates_hz.tolist())) == 1
    return Detections(
        skeleton=skeleton,
        view_names=rig.names,
        frame_numbers=np.arange(n),
        time_s=time_s,
        offsets=np.concatenate([[0], np.cumsum(counts.ravel())]),
        keypoints_px=np.concatenate([pixels for pixels, _ in rows]),
        confidence=np.concatenate([trust for _, trust in rows]),
        recorded=recorded,
        track_ids=np.concatenate(people),
        rate_hz=float(rates_hz[0]) if same else None,
    )
