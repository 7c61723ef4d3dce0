"""People of a result, estimated from samples of its frames and from the static trial that its options name."""

from dataclasses import dataclass

import numpy as np

from posefuse.arrays import ranges
from posefuse.biomechanics.marker_model import MarkerModel
from posefuse.biomechanics.person_frames import model_world, upright_direction
from posefuse.biomechanics.subject_fit import SubjectFit, fit_subject
from posefuse.biomechanics.subject_samples import CandidateFrames, samples_of
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.pipeline.static_trial import static_frames

_WINDOW = 512
"""Number of frames read at a time."""


@dataclass(frozen=True, eq=False)
class Subjects:
    """The people of a result.

    Attributes:
        fits: one per person.
        verticals: shape (person, 3, 3): rotations to axes with y up.
    """

    fits: tuple[SubjectFit, ...]
    verticals: np.ndarray


def fit_subjects(result: Reconstruction, model: MarkerModel, layer: Layer) -> Subjects:
    """Estimate the people of a result. Without a known up axis, the median direction of a trunk is its vertical.

    Args:
        result: the result, whose options may name a static trial.
        model: the unscaled model of the skeleton.
        layer: the layer whose points are used.

    Raises:
        OptionsError: if the static trial cannot be used.
    """
    candidates = [CandidateFrames(result.n_frames) for _ in result.person_ids]
    for start, stop in ranges(result.n_frames, _WINDOW):
        points, covariance = np.asarray(layer.points_m[start:stop]), np.asarray(layer.covariance_m2[start:stop])
        for p, frames in enumerate(candidates):
            frames.add(start, points[:, p], covariance[:, p])
    up = result.rig.up
    verticals = np.array(
        [
            model_world(np.array(up) if up is not None else upright_direction(*each.names_and_points(result.skeleton)))
            for each in candidates
        ]
    )
    static = static_frames(result, model, layer, verticals)
    rate_hz = frame_rate(result)
    fits = tuple(
        fit_subject(model, samples_of(model, each, vertical, rate_hz, standing))
        for each, vertical, standing in zip(candidates, verticals, static, strict=True)
    )
    return Subjects(fits, verticals)


def frame_rate(result: Reconstruction) -> float:
    """Return the frame rate of a result, or 30 Hz if it is unknown."""
    if result.rate_hz:
        return result.rate_hz
    steps = np.diff(result.time_s)
    median = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else 0.0
    return 1.0 / median if median > 0.0 else 30.0
