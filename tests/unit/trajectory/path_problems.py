"""Small recordings with known paths."""

from dataclasses import replace

import numpy as np

from posefuse.association.one_subject import SingleSubject
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.skeleton.skeletons import Skeleton
from posefuse.trajectory.observations import MeasuredRange
from posefuse.trajectory.priors import RecordingPriors, estimate_priors
from posefuse.trajectory.solve import solve
from posefuse.triangulation import consensus
from tests.scenes import ring

RATE_HZ = 60.0
ARM = Skeleton("arm", ("shoulder", "elbow", "wrist"), (("shoulder", "elbow"), ("elbow", "wrist")))


def swinging(frames: int, rate_hz: float = RATE_HZ) -> np.ndarray:
    """Shape (frame, 3, 3): an arm that swings, its bones 0.3 and 0.25 m long."""
    t = np.arange(frames) / rate_hz
    upper, lower = 0.8 * np.sin(2.0 * t), 0.5 + 0.9 * np.sin(3.1 * t + 1.0)
    shoulder = np.stack([0.2 * np.sin(t), 0.3 * np.cos(0.7 * t), 1.4 + 0.02 * np.sin(4.0 * t)], axis=-1)
    elbow = shoulder + 0.3 * np.stack([np.sin(upper), 0.2 * np.cos(upper), -np.sqrt(0.96) * np.cos(upper)], axis=-1)
    elbow = shoulder + 0.3 * unit(elbow - shoulder)
    wrist = elbow + 0.25 * unit(np.stack([np.cos(lower), np.sin(lower), -np.cos(upper)], axis=-1))
    return np.stack([shoulder, elbow, wrist], axis=1)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return unit vectors."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def exact_pixels(rig: CameraRig, points_m: np.ndarray) -> np.ndarray:
    """Shape (frame, view, keypoint, 2)."""
    return rig.project(points_m)


def measured(
    points_m: np.ndarray,
    sigma_px: float = 2.0,
    seed: int = 0,
    *,
    rig: CameraRig | None = None,
    pixels: np.ndarray | None = None,
    skeleton: Skeleton = ARM,
    noise_px: float | None = None,
    rate_hz: float = RATE_HZ,
    time_s: np.ndarray | None = None,
) -> MeasuredRange:
    """A recording of points (frame, keypoint, 3), measured by consensus with the true noise."""
    rig = rig or ring(4)
    if pixels is None:
        pixels = exact_pixels(rig, points_m)
        pixels = pixels + sigma_px * np.random.default_rng(seed).standard_normal(pixels.shape)
    times = None if time_s is None else np.repeat(time_s[:, None], len(rig), axis=1)
    detections = Detections.from_dense(skeleton, rig.names, pixels, rate_hz=rate_hz, time_s=times)
    noise = NoiseModel(np.full(len(rig), noise_px or max(sigma_px, 0.05)))
    tracks = SingleSubject.of(detections, None).tracks(0, detections.n_frames)
    layer = consensus.solve(rig, detections, tracks, noise, TriangulationOptions(min_views=2))
    return MeasuredRange(rig, detections, tracks, layer, None, noise)


def part_of(measurements: MeasuredRange, start: int, stop: int) -> MeasuredRange:
    """Return a range of its frames."""
    return replace(
        measurements,
        detections=measurements.detections.frames(start, stop),
        tracks=measurements.tracks.frames(start, stop),
        layer=measurements.layer.frames(start, stop),
    )


def solved(
    measurements: MeasuredRange,
    recording_priors: RecordingPriors | None = None,
    options: TrajectoryOptions | None = None,
) -> Layer:
    """Return its solved layer."""
    options = options or TrajectoryOptions()
    recording_priors = recording_priors or estimate_priors([measurements], measurements.detections.skeleton, options)
    return solve(measurements, recording_priors, options)


def errors_m(layer: Layer, points_m: np.ndarray) -> np.ndarray:
    """Shape (frame, keypoint)."""
    return np.linalg.norm(np.asarray(layer.points_m)[:, 0] - points_m, axis=-1)
