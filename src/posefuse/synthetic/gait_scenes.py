"""Recordings of motions with known contacts."""

from dataclasses import dataclass, field

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.detector import detect
from posefuse.synthetic.figures import human
from posefuse.synthetic.gait_motions import GaitMotion
from posefuse.synthetic.options import CURRENT, DetectorOptions
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.scenes import Scene, truth_of


@dataclass(frozen=True)
class GaitSceneOptions:
    """Options of a recording of one person with known contacts.

    Attributes:
        stature_m: stature of the person.
        cameras: number of cameras in a ring.
        radius_m: radius of the ring.
        rate_hz: frame rate.
        skeleton: name of a built-in human skeleton.
        seed: random seed.
        detector: errors of the detector.
    """

    stature_m: float = 1.75
    cameras: int = 5
    radius_m: float = 5.0
    rate_hz: float = 60.0
    skeleton: str = "halpe_26"
    seed: int = 0
    detector: DetectorOptions = field(default_factory=lambda: CURRENT)


def simulate_gait(motion: GaitMotion, duration_s: float, options: GaitSceneOptions | None = None) -> Scene:
    """Simulate a recording of a motion.

    Args:
        motion: the motion.
        duration_s: duration of the recording.
        options: options of the recording.
    """
    options = options or GaitSceneOptions()
    rng = np.random.default_rng(options.seed)
    skeleton, figure = find_skeleton(options.skeleton), human(options.stature_m)
    rig: CameraRig = build_rig("ring", options.cameras, radius_m=options.radius_m)
    time_s = np.arange(round(duration_s * options.rate_hz)) / options.rate_hz
    points = motion.positions(figure, time_s)[:, figure.columns(skeleton)]
    seen = np.repeat(points[:, None], len(rig), axis=1)
    detections = detect(rig, seen, skeleton, options.rate_hz, options.detector, rng)
    return Scene(rig, detections, truth_of(rig, skeleton, points, options.rate_hz), np.zeros(len(rig)))
