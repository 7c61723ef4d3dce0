"""Simulated scenes with one subject: rig, ground truth and detections."""

from dataclasses import dataclass
from importlib.metadata import version

import numpy as np

from posefuse.arguments import checked
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Layer, Provenance, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.synthetic.detector import clock_offsets, detect
from posefuse.synthetic.figures import creature, human
from posefuse.synthetic.motions import CreatureMotion, HumanMotion
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.rigs import build_rig


@dataclass(frozen=True)
class Scene:
    """A simulated recording.

    Attributes:
        rig: cameras.
        detections: simulated detections.
        truth: true keypoint positions.
        offsets_s: shape (view,): time offset of each view's clock, in seconds.
    """

    rig: CameraRig
    detections: Detections
    truth: Reconstruction
    offsets_s: np.ndarray


@checked
def simulate(options: SceneOptions | None = None) -> Scene:
    """Simulate a recording of one subject.

    Raises:
        OptionsError: if the options are invalid.
        SkeletonError: if the skeleton does not exist.
    """
    options = options or SceneOptions()
    rng = np.random.default_rng(options.seed)
    skeleton = find_skeleton(options.skeleton)
    figure = human(float(rng.uniform(1.6, 1.85)))
    target, radius = (0.0, 0.0, 0.9), 5.0
    motion: HumanMotion | CreatureMotion
    if figure.has(skeleton):
        motion = HumanMotion.random(options.activities, rng)
    else:
        figure = creature(skeleton, options.size_m, rng)
        motion = CreatureMotion(int(rng.integers(2**31)), options.size_m, height_m=options.size_m)
        target, radius = (0.0, 0.0, options.size_m), 6.0 * options.size_m
    rig = build_rig(options.layout, options.cameras, options.lens, radius_m=radius, target_m=target)
    n_frames = max(1, round(options.duration_s * options.rate_hz))
    time_s = np.arange(n_frames) / options.rate_hz
    offsets = clock_offsets(rig, options.detector, rng)
    columns = figure.columns(skeleton)
    # A clock may be ahead of the start of the recording, so motions start after time 0.
    taken = time_s[:, None] + offsets[None, :] + options.detector.max_offset_s
    seen = motion.positions(figure, taken.ravel())[:, columns].reshape(n_frames, len(rig), len(skeleton), 3)
    points = motion.positions(figure, time_s + options.detector.max_offset_s)[:, columns]
    detections = detect(rig, seen, skeleton, options.rate_hz, options.detector, rng)
    return Scene(rig, detections, truth_of(rig, skeleton, points, options.rate_hz), offsets)


def truth_of(rig: CameraRig, skeleton: Skeleton, points_m: np.ndarray, rate_hz: float) -> Reconstruction:
    """Return ground truth as a reconstruction.

    Args:
        rig: cameras of the scene.
        skeleton: skeleton of the keypoints.
        points_m: shape (frame, keypoint, 3) of one person, or (frame, person, keypoint, 3); NaN where absent.
        rate_hz: frame rate.
    """
    points = np.asarray(points_m, dtype=np.float64)
    points = points[:, None] if points.ndim == 3 else points
    shape, views = points.shape[:3], len(rig)
    known = np.asarray(np.isfinite(points).all(axis=-1))
    layer = Layer(
        points_m=points,
        covariance_m2=np.where(known[..., None], np.zeros(6), np.nan),
        status=np.where(known, PointStatus.OK, PointStatus.NOT_SEEN).astype(np.int8),
        source=np.where(known, Source.TRUTH, Source.NONE).astype(np.int8),
        reprojection_error_px=np.full(shape, np.nan),
        view_status=np.full((*shape, views), ViewStatus.UNSEEN, dtype=np.int8),
        view_error_px=np.full((*shape, views), np.nan, dtype=np.float32),
    )
    return Reconstruction(
        rig=rig,
        skeleton=skeleton,
        person_ids=tuple(f"person_{p + 1}" for p in range(points.shape[1])),
        frame_numbers=np.arange(len(points)),
        time_s=np.arange(len(points)) / rate_hz,
        layers={"measured": layer},
        rate_hz=rate_hz,
        provenance=Provenance(versions={"posefuse": version("posefuse")}, notes=("Simulated truth.",)),
    )
