"""The noise that tracking starts with."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from posefuse.association.proposals import propose
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions
from posefuse.model.options.options import Options
from posefuse.model.proposals import Proposals
from posefuse.noise.fixed import fixed_noise
from posefuse.skeleton.skeletons import Skeleton

_PX_AT_1000 = 4.5
_EXPONENT = 1.0
_SAMPLED_FRAMES = 60
_ROUNDS = 3
_EXPECTED_SIGMA = 1.22
"""Median distance, in standard deviations, of detections with the assumed noise from their consensus points."""
_FACTORS = (0.2, 5.0)


def default_noise(rig: CameraRig, options: Options) -> NoiseModel:
    """Return the noise that the options fix, or else a detector's usual noise.

    The usual noise is 4.5 px / confidence at 1000 px image width.
    """
    widths = np.array([camera.size_px[0] for camera in rig.cameras]) / 1000.0
    return fixed_noise(rig, options) or NoiseModel(_PX_AT_1000 * widths, _EXPONENT, "assumed")


def initial_noise(rig: CameraRig, frames: Sequence[Frame], skeleton: Skeleton, options: Options) -> NoiseModel:
    """Return the default noise, scaled to the errors in a sample of frames.

    Args:
        rig: calibrated cameras.
        frames: frames from :func:`sample_frames`.
        skeleton: skeleton of the keypoints.
        options: options of the reconstruction.
    """
    noise = default_noise(rig, options)
    if noise.origin != "assumed":
        return noise
    for _ in range(_ROUNDS):
        errors: list[float] = []
        for frame in frames:
            found = propose_from_all(rig, frame, noise, skeleton, options)
            errors.extend(found.error_sigma[(found.n_views > 2) & np.isfinite(found.error_sigma)].tolist())
        if not errors:
            return noise
        factor = float(np.clip(np.median(errors) / _EXPECTED_SIGMA, *_FACTORS))
        noise = replace(noise, scale_px=noise.scale_px * factor, origin="estimated")
    return noise


def sample_frames(detections: Detections) -> list[Frame]:
    """Return frames evenly spread over a recording."""
    sampled = np.unique(np.linspace(0, detections.n_frames - 1, _SAMPLED_FRAMES).astype(int))
    return [Frame.of(detections, int(i)) for i in sampled]


def propose_from_all(
    rig: CameraRig, frame: Frame, noise: NoiseModel, skeleton: Skeleton, options: Options
) -> Proposals:
    """Return the people that all detections of a frame propose."""
    return propose_people(rig, noise, skeleton, options, frame, np.ones(len(frame.view), dtype=bool))


def propose_people(
    rig: CameraRig, noise: NoiseModel, skeleton: Skeleton, options: Options, frame: Frame, free: np.ndarray
) -> Proposals:
    """Return the people that unassigned detections propose.

    Args:
        rig: calibrated cameras.
        noise: noise of the detections.
        skeleton: skeleton of the keypoints.
        options: options of association.
        frame: detections of one frame.
        free: shape (detection,), bool: the unassigned detections.
    """
    scale = 1.0 if skeleton.tree is None else skeleton.tree.scale
    return propose(rig, frame, noise, skeleton, free, _in_proportion(options.association, scale))


@lru_cache(maxsize=16)
def _in_proportion(options: AssociationOptions, scale: float) -> AssociationOptions:
    """Return options for bodies of another size; to check all fields again takes longer than to propose people."""
    return options.in_proportion(scale)
