"""Simulate recordings with known truth that are difficult over time: fast motion, periods of faults, irregular frames.

Each is a :class:`~benchmarks.walking.Walk`; equal seeds give equal recordings.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks import panoptic
from benchmarks.walking import RATE_HZ, Walk, observe, walk
from posefuse.model.cameras import CameraRig
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.detector import add_errors, on_intervals
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import HumanMotion, smooth_step
from posefuse.synthetic.options import Activity, DetectorOptions
from posefuse.synthetic.rigs import build_rig

MEASURED_PX = 4.5 * 1.92
"""Standard deviation of the measured error model at 1920 px image width, times the confidence."""
WAVE_HZ, WAVE_M = 3.0, 0.30
LANDING_RATE_HZ = 100.0
DROP_M = 0.30
_GRAVITY = 9.81
_LEG = ("hip", "knee", "ankle", "heel", "big_toe", "small_toe")


def figure_at(
    time_s: np.ndarray, activities: tuple[Activity, ...] = ("walk",), seed: int = 0, skeleton: str = "halpe_26"
) -> np.ndarray:
    """Return the keypoints of a human of 1.75 m at these times, shape (frame, keypoint, 3)."""
    figure = human(1.75)
    motion = HumanMotion.random(activities, np.random.default_rng(seed))
    return motion.positions(figure, time_s)[:, figure.columns(find_skeleton(skeleton))]


def with_lasting_noise(data: Walk, seed: int = 3) -> Walk:
    """Simulate the detections of a motion with measured errors, 1 % gross outliers, and 2 % misses in periods.

    Errors are correlated (0.85 between frames at 25 fps), have heavy tails, and grow with lower confidence.
    """
    rng = np.random.default_rng(seed)
    exact = data.rig.project(data.points_m)
    sizes = np.array([camera.size_px for camera in data.rig.cameras])
    law = DetectorOptions(outlier_share=0.0, swap_share=0.0)
    pixels, confidence = add_errors(exact, sizes, find_skeleton(data.skeleton), data.rate_hz, law, rng)
    thrown = rng.random(confidence.shape) < DetectorOptions().outlier_share
    angle, distance = rng.uniform(0, 2 * np.pi, thrown.shape), rng.uniform(30.0, 300.0, thrown.shape)
    pixels += (thrown * distance)[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    inlier = np.isfinite(confidence) & ~thrown
    return replace(data, pixels=pixels, confidence=confidence, inlier=inlier, white=False)


def acts(frames: int) -> Walk:
    """Simulate a person who walks, turns, reaches, sits and jumps, three seconds each, with measured errors."""
    points = figure_at(np.arange(frames) / RATE_HZ, ("walk", "turn", "reach", "sit", "jump"))
    return with_lasting_noise(observe(build_rig("ring", 5), points, np.random.default_rng(0)))


def with_swapped_legs(data: Walk, share: float = 0.15, dwell_s: float = 0.0, seed: int = 2) -> Walk:
    """Swap the left and the right leg in a share of the views.

    Args:
        data: recording of a human.
        share: share of all views and frames.
        dwell_s: mean duration of a swap in a view; 0 for independent frames.
        seed: random seed.
    """
    rng = np.random.default_rng(seed)
    shape = data.pixels.shape[:2]
    swapped = on_intervals(shape, share, dwell_s, data.rate_hz, rng) if dwell_s else rng.random(shape) < share
    return exchanged(data, swapped)


def exchanged(data: Walk, swapped: np.ndarray) -> Walk:
    """Swap the legs where ``swapped``, shape (frame, view), is true."""
    skeleton = find_skeleton(data.skeleton)
    parts = [part for part in _LEG if f"left_{part}" in skeleton.keypoints]
    left, right = ([skeleton.index(f"{side}_{part}") for part in parts] for side in ("left", "right"))
    pixels, inlier = data.pixels.copy(), data.inlier.copy()
    f, v = np.nonzero(swapped)
    for here, there in ((left, right), (right, left)):
        pixels[f[:, None], v[:, None], here] = data.pixels[f[:, None], v[:, None], there]
        inlier[f[:, None], v[:, None], here] = False
    return replace(data, pixels=pixels, inlier=inlier)


def panoptic_at_60_hz(folder: Path, frames: int, outlier_share: float = 0.05, start_s: float = 70.0) -> Walk:
    """Return a real person's motion (``panoptic_motion``), resampled by cubic splines, with the real lenses.

    Args:
        folder: folder of the recordings.
        frames: number of frames, at 60 Hz.
        outlier_share: share of gross outliers of 30 to 300 px.
        start_s: start in the recording.
    """
    motion = panoptic.one_person(folder)
    points = motion.points_m[:, 0]
    given_s = (motion.frame_numbers - motion.frame_numbers[0]) / motion.rate_hz
    spline = CubicSpline(given_s, points)
    data = observe(
        motion.rig,
        spline(start_s + np.arange(frames) / RATE_HZ),
        np.random.default_rng(0),
        outlier_share=outlier_share,
    )
    return replace(data, skeleton=motion.skeleton.name)


def waving(frames: int, rig: CameraRig | None = None, *, start_s: float = 0.0, end_s: float = np.inf) -> Walk:
    """Simulate a standing person who waves the right hand at 3 Hz, 30 cm wide, by rotating the forearm.

    Args:
        frames: number of frames, at 60 Hz.
        rig: cameras; by default five in a ring.
        start_s: start of waving; the hand rests before and after it.
        end_s: end of waving.
    """
    skeleton = find_skeleton("halpe_26")
    time_s = np.arange(frames) / RATE_HZ
    points = figure_at(time_s, ("stand",))
    elbow, wrist = skeleton.index("right_elbow"), skeleton.index("right_wrist")
    forearm = float(np.linalg.norm(points[0, wrist] - points[0, elbow]))
    on = smooth_step((time_s - start_s) / 0.3) * smooth_step((end_s - time_s) / 0.3)
    angle = on * np.arcsin(0.5 * WAVE_M / forearm) * np.sin(2 * np.pi * WAVE_HZ * time_s)
    across = points[0, skeleton.index("left_shoulder")] - points[0, skeleton.index("right_shoulder")]
    across /= np.linalg.norm(across)
    up = np.array([0.0, 0.0, 1.0])
    points[:, wrist] = points[:, elbow] + forearm * (np.sin(angle)[:, None] * across - np.cos(angle)[:, None] * up)
    return observe(rig or build_rig("ring", 5), points, np.random.default_rng(0), outlier_share=0.05)


def landing(jumps: int, rig: CameraRig | None = None, absorb_s: float = 0.04) -> Walk:
    """Simulate a person who drops 30 cm repeatedly at 100 fps, with constant bone lengths.

    Feet stop within ``absorb_s``, the pelvis within 0.25 s while the knees bend. Each drop takes two seconds: a slow
    lift, a pause, and a fall under gravity.
    """
    skeleton = find_skeleton("halpe_26")
    time_s = np.arange(jumps * round(2 * LANDING_RATE_HZ)) / LANDING_RATE_HZ
    points = figure_at(time_s, ("stand",))
    ankle_m, pelvis_m = drop_heights(time_s % 2.0, absorb_s), drop_heights(time_s % 2.0, 0.25)
    points[..., 2] += pelvis_m[:, None]
    forward = np.cross(points[0, skeleton.index("right_hip")] - points[0, skeleton.index("left_hip")], [0, 0, 1.0])
    forward /= -np.linalg.norm(forward)
    for side in ("left", "right"):
        hip, knee, ankle, *foot = (skeleton.index(f"{side}_{part}") for part in _LEG)
        moved = ankle_m - pelvis_m
        thigh, shank = (np.linalg.norm(points[0, a] - points[0, b]) for a, b in ((hip, knee), (knee, ankle)))
        points[:, [ankle, *foot], 2] += moved[:, None]
        points[:, knee] = knees(points[:, hip], points[:, ankle], float(thigh), float(shank), forward)
    data = observe(rig or build_rig("ring", 5), points, np.random.default_rng(0), outlier_share=0.05)
    return replace(data, rate_hz=LANDING_RATE_HZ)


def drop_heights(since_s: np.ndarray, absorb_s: float) -> np.ndarray:
    """Return the height above the standing position in m, shape (frame,).

    It rises in the first second and falls in the next. The velocity v of the fall is absorbed over ``absorb_s``, down
    to v absorb_s / 2 below the start; then the height returns to 0.
    """
    fall_s = np.sqrt(2 * DROP_M / _GRAVITY)
    speed = _GRAVITY * fall_s
    t = since_s - 1.0
    u = np.clip((t - fall_s) / absorb_s, 0.0, 1.0)
    # Velocity falls as 1 - smooth half cosine; its integral is that of a cosine bell.
    sunk = speed * absorb_s * (0.5 * u + np.sin(np.pi * u) / (2 * np.pi))
    risen = DROP_M * smooth_step((since_s - 0.1) / 0.7)
    falling = DROP_M - 0.5 * _GRAVITY * np.square(np.clip(t, 0.0, fall_s))
    back = 0.5 * speed * absorb_s * smooth_step((t - fall_s - 0.3) / 0.4)
    return np.where(t < 0, risen, falling - sunk + back)


def knees(hip: np.ndarray, ankle: np.ndarray, thigh_m: float, shank_m: float, forward: np.ndarray) -> np.ndarray:
    """Return knees in front of the line from hip to ankle, from both bone lengths, shape (frame, 3)."""
    along = ankle - hip
    far = np.linalg.norm(along, axis=1, keepdims=True)
    far = np.minimum(far, thigh_m + shank_m)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    down = (np.square(far) + thigh_m**2 - shank_m**2) / (2 * far)
    ahead = forward - (along @ forward)[:, None] * along
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    return hip + down * along + np.sqrt(np.maximum(thigh_m**2 - np.square(down), 0.0)) * ahead


def stand_then_jump(frames: int) -> Walk:
    """Simulate a person who repeatedly stands still for three seconds and jumps."""
    points = figure_at(np.arange(frames) / RATE_HZ, ("stand", "jump"))
    return observe(build_rig("ring", 5), points, np.random.default_rng(0), outlier_share=0.05)


def hidden(frames: int, keypoint: str = "right_wrist", hidden_s: float = 0.5, every_s: float = 2.0) -> Walk:
    """Hide a keypoint from all cameras for half a second, every two seconds."""
    data = walk(frames, outlier_share=0.05)
    gone = data.times_s % every_s >= every_s - hidden_s
    return without(data, keypoint, gone[:, None] & np.ones(len(data.rig), dtype=bool))


def one_camera(frames: int, keypoint: str = "right_wrist", for_s: float = 0.5, every_s: float = 2.0) -> Walk:
    """Hide a keypoint from all but the first camera for half a second, every two seconds."""
    data = walk(frames, outlier_share=0.05)
    lonely = data.times_s % every_s >= every_s - for_s
    return without(data, keypoint, lonely[:, None] & (np.arange(len(data.rig)) > 0))


def two_cameras(frames: int, for_s: float = 1.0, every_s: float = 3.0) -> Walk:
    """Omit the detections of all but two cameras for a second, every three seconds."""
    data = walk(frames, outlier_share=0.05)
    few = data.times_s % every_s >= every_s - for_s
    gone = few[:, None] & (np.arange(len(data.rig)) > 1)
    return replace(
        data,
        pixels=np.where(gone[:, :, None, None], np.nan, data.pixels),
        inlier=data.inlier & ~gone[:, :, None],
    )


def without(data: Walk, keypoint: str, gone: np.ndarray) -> Walk:
    """Remove a keypoint where ``gone``, shape (frame, view), is true."""
    k = find_skeleton(data.skeleton).index(keypoint)
    pixels, inlier = data.pixels.copy(), data.inlier.copy()
    pixels[:, :, k][gone] = np.nan
    inlier[:, :, k][gone] = False
    return replace(data, pixels=pixels, inlier=inlier)


def bursts(frames: int, length: int = 10, share: float = 0.05, size_px: float = 60.0, seed: int = 4) -> Walk:
    """Displace a keypoint in one view by a constant offset for ten frames, 5 % of the time."""
    data = walk(frames)
    rng = np.random.default_rng(seed)
    shape = data.inlier.shape
    blocks = -(-shape[0] // length), *shape[1:]
    wrong = np.repeat(rng.random(blocks) < share, length, axis=0)[: shape[0]]
    angle = np.repeat(rng.uniform(0, 2 * np.pi, blocks), length, axis=0)[: shape[0]]
    moved = size_px * wrong[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return replace(data, pixels=data.pixels + moved, inlier=data.inlier & ~wrong)


def swapped_for_a_moment(frames: int, for_s: float = 0.3, every_s: float = 1.5) -> Walk:
    """Swap the legs in two of five views at once for 0.3 s, every 1.5 s."""
    data = walk(frames, outlier_share=0.05)
    late = data.times_s % every_s >= every_s - for_s
    return exchanged(data, late[:, None] & (np.arange(len(data.rig)) < 2))


def irregular(frames: int, seed: int = 5) -> Walk:
    """Simulate irregular frames: 60 per second on average, every fifth dropped, the others off by 2 ms."""
    rng = np.random.default_rng(seed)
    kept = rng.random(2 * frames) > 0.2
    time_s = ((np.arange(2 * frames) / RATE_HZ) + rng.uniform(-0.002, 0.002, 2 * frames))[kept][:frames]
    data = observe(build_rig("ring", 5), figure_at(time_s), rng, outlier_share=0.05)
    return replace(data, time_s=time_s)


def scaled(data: Walk, factor: float) -> Walk:
    """Scale rig and world by ``factor``, without changing pixels."""

    def larger(pose: np.ndarray) -> np.ndarray:
        pose = np.array(pose)
        pose[:3, 3] *= factor
        return pose

    cameras = tuple(replace(each, camera_from_world=larger(each.camera_from_world)) for each in data.rig.cameras)
    return replace(data, rig=replace(data.rig, cameras=cameras), points_m=factor * data.points_m)


def still(frames: int) -> Walk:
    """Simulate a statue, without any motion."""
    points = np.repeat(figure_at(np.array([1.0])), frames, axis=0)
    return observe(build_rig("ring", 5), points, np.random.default_rng(0), outlier_share=0.05)
