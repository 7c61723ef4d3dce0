"""How detections err before anybody is followed."""

from dataclasses import replace

import numpy as np

from posefuse.association.proposals import propose
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.proposals import Proposals
from posefuse.noise.survey import known_noise
from posefuse.skeleton.skeletons import Skeleton

_PX_AT_1000 = 4.5
_EXPONENT = 1.0
_SAMPLED_FRAMES = 60
_ROUNDS = 3
_EXPECTED_SIGMA = 1.22
"""The median distance, in sigmas, of detections of the assumed law from the points that most views agree on."""
_FACTORS = (0.2, 5.0)


def default_noise(rig: CameraRig, options: Options) -> NoiseModel:
    """The noise that the options fix, or else what detectors usually do: 4.5 px / confidence at 1000 px width."""
    widths = np.array([camera.size_px[0] for camera in rig.cameras]) / 1000.0
    return known_noise(rig, options) or NoiseModel(_PX_AT_1000 * widths, _EXPONENT, "assumed")


def rough_noise(rig: CameraRig, detections: Detections, options: Options) -> NoiseModel:
    """The usual noise, as large as a sample of the frames says that it is here."""
    noise = default_noise(rig, options)
    if noise.origin != "assumed":
        return noise
    frames = sampled_frames(detections)
    for _ in range(_ROUNDS):
        errors: list[float] = []
        for frame in frames:
            found = proposed(rig, frame, noise, detections.skeleton, options)
            errors.extend(found.error_sigma[(found.n_views > 2) & np.isfinite(found.error_sigma)].tolist())
        if not errors:
            return noise
        factor = float(np.clip(np.median(errors) / _EXPECTED_SIGMA, *_FACTORS))
        noise = replace(noise, scale_px=noise.scale_px * factor, origin="estimated")
    return noise


def sampled_frames(detections: Detections) -> list[Frame]:
    """Frames spread evenly over a recording."""
    sampled = np.unique(np.linspace(0, detections.n_frames - 1, _SAMPLED_FRAMES).astype(int))
    return [Frame.of(detections, int(i)) for i in sampled]


def proposed(rig: CameraRig, frame: Frame, noise: NoiseModel, skeleton: Skeleton, options: Options) -> Proposals:
    """What all detections of a frame propose."""
    return propose_people(rig, noise, skeleton, options, frame, np.ones(len(frame.view), dtype=bool))


def propose_people(
    rig: CameraRig, noise: NoiseModel, skeleton: Skeleton, options: Options, frame: Frame, free: np.ndarray
) -> Proposals:
    """What the detections that are free propose, as the options say; ``free``: shape (detection,), bool."""
    association = (
        options.association if skeleton.tree is None else options.association.in_proportion(skeleton.tree.scale)
    )
    return propose(rig, frame, noise, skeleton, free, association)
