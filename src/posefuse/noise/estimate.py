"""Estimate the noise of a recording's detections from a sample of triangulated points."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.noise import NOT_USED, NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.noise import scales
from posefuse.noise.fixed import fixed_noise
from posefuse.noise.leave_one_out import leave_one_out_points
from posefuse.noise.samples import Sample, Samples
from posefuse.noise.systematic_errors import (
    predicts_as_well,
    with_systematic_errors,
    without_views,
)
from posefuse.progress import Progress
from posefuse.triangulation import consensus

_MAX_ROUNDS = 16
_RESTART = 0.25
"""Part of the common noise at which the search for the noise of unequal cameras starts."""

_MAX_EXPONENT_ROUNDS = 4
_EXPONENT_TOLERANCE = 0.03


@dataclass(frozen=True)
class NoiseEstimate:
    """The noise of a recording and the points it was estimated from.

    Attributes:
        noise: the noise model.
        layer: the sample as the method ``consensus`` triangulates it; None with one camera.
    """

    noise: NoiseModel
    layer: Layer | None


def estimate_noise(rig: CameraRig, samples: Samples | None, options: Options, progress: Progress) -> NoiseEstimate:
    """Estimate the noise of a recording's detections, unless the options fix it.

    Args:
        rig: calibrated cameras.
        samples: samples of the recording; not read with one camera.
        options: options of the reconstruction.
        progress: receives the progress.

    Returns:
        The noise and the sample's points. The noise is a detector's usual noise where the recording has too few points
        with redundant views.

    Raises:
        OptionsError: if the options fix the noise of other cameras.
    """
    noise = fixed_noise(rig, options) or scales.assumed_noise(rig, options.triangulation.confidence_exponent)
    if len(rig) == 1 or samples is None:
        return NoiseEstimate(noise, None)
    agreement = _Agreement(rig, _agreement_options(options))
    if noise.origin != "assumed":
        return NoiseEstimate(noise, agreement(samples.small, noise))
    return _search(agreement, samples, noise, progress)


def calibrate_error_model(rig: CameraRig, samples: Samples, options: Options, progress: Progress) -> NoiseModel:
    """Estimate the full error model of a detector: scale per camera, confidence exponent, spread and tails.

    The exponent weights the views that determine the points from which the exponent is estimated, so the estimation
    repeats until the exponent no longer changes.

    Args:
        rig: calibrated cameras.
        samples: samples of the recording.
        options: options of the reconstruction; those that fix the noise are ignored.
        progress: receives the progress.

    Raises:
        DetectionsError: if too few points are seen by three views that agree.
    """
    # SciPy's optimization and statistics take a second to import, and reconstructions need neither.
    from posefuse.noise.error_model import fit_error_model

    agreement = _Agreement(rig, _agreement_options(options))
    exponent = 0.0
    rounds = 0
    while True:
        found = _search(agreement, samples, scales.assumed_noise(rig, exponent), progress)
        noise, layer = found.noise, found.layer
        assert layer is not None
        model = fit_error_model(leave_one_out_points(rig, samples.large, layer, noise), exponent)
        if model is None or noise.origin == "assumed":
            raise DetectionsError(
                "Too few points are seen by three agreeing views to estimate the detector's noise. Use a longer "
                "recording or more cameras."
            )
        rounds += 1
        if abs(model.exponent - exponent) < _EXPONENT_TOLERANCE or rounds == _MAX_EXPONENT_ROUNDS:
            return replace(noise, origin="calibrated", nu=model.nu)
        exponent = model.exponent


@dataclass(frozen=True)
class _Agreement:
    """Triangulates a sample so that views that contradict the others are rejected."""

    rig: CameraRig
    options: TriangulationOptions

    def __call__(self, sample: Sample, noise: NoiseModel) -> Layer:
        return consensus.solve(self.rig, sample.detections, sample.tracks, noise, self.options)


def _agreement_options(options: Options) -> TriangulationOptions:
    return replace(options.triangulation, min_views=2)


def _search(agreement: _Agreement, samples: Samples, default: NoiseModel, progress: Progress) -> NoiseEstimate:
    """Increase the noise until it explains its own residuals, see docs/methods/noise.md.

    Args:
        agreement: triangulates a sample.
        samples: samples of the recording.
        default: the noise to return where the recording has too few points.
        progress: receives the progress.
    """
    rig, exponent = agreement.rig, default.exponent
    progress.start("estimating noise", 2 * _MAX_ROUNDS)
    start = scales.smallest_noise(rig, exponent)
    trial = _self_consistent(agreement, samples.small, start, np.ones(len(rig)), progress) or default
    sample = samples.large
    layer = agreement(sample, trial)
    factor, wrong = scales.relative_factors(rig, sample, layer, trial)
    while np.ptp(factor) > 0.0:
        unequal = replace(trial, scale_px=np.maximum(_RESTART * trial.scale_px, start.scale_px) * factor)
        found = _self_consistent(agreement, samples.small, unequal, factor, progress)
        # Cameras that are grossly wrong keep the common noise, so that their views are rejected and reported.
        gross = (factor > 1.0) & scales.exceeds_usable_noise(rig, unequal if found is None else found)
        if not gross.any():
            trial = found or trial
            layer = agreement(sample, trial)
            break
        factor, wrong = np.where(gross, 1.0, factor), wrong | gross
    progress.finish()
    noise = scales.inlier_scales(rig, sample, layer, trial)
    if noise is None:
        return NoiseEstimate(default, layer)
    layer = agreement(sample, noise)
    noise = replace(noise, spread=scales.residual_spread(rig, sample, layer, noise))
    if not wrong.any():
        return NoiseEstimate(with_systematic_errors(rig, samples, layer, noise, agreement), layer)
    return NoiseEstimate(_without_wrong_cameras(agreement, samples, default, noise, wrong, progress), layer)


def _without_wrong_cameras(
    agreement: _Agreement,
    samples: Samples,
    default: NoiseModel,
    noise: NoiseModel,
    wrong: np.ndarray,
    progress: Progress,
) -> NoiseModel:
    """Return noise with which cameras that contradict the others determine nothing, if the others agree as well so.

    Args:
        agreement: triangulates a sample.
        samples: samples of the recording.
        default: the noise to return where the recording has too few points.
        noise: the noise with the common scale for all of these cameras.
        wrong: shape (view,), bool: the cameras.
        progress: receives the progress.
    """
    trial = replace(noise, scale_px=np.where(wrong, NOT_USED * noise.scale_px, noise.scale_px))
    if not predicts_as_well(agreement.rig, samples.small, noise, trial, agreement):
        return noise
    others = Samples(*(without_views(each, wrong) for each in (samples.small, samples.large)))
    found = _search(agreement, others, default, progress).noise
    return replace(found, scale_px=np.where(wrong, NOT_USED * found.scale_px, found.scale_px))


def _self_consistent(
    agreement: _Agreement, sample: Sample, start: NoiseModel, factor: np.ndarray, progress: Progress
) -> NoiseModel | None:
    """Return the smallest noise, with these ratios of the cameras, that explains its own residuals; None if none does.

    Args:
        agreement: triangulates a sample.
        sample: small sample of the recording.
        start: the noise to start with, below that of any detector.
        factor: shape (view,): each camera's noise relative to the common scale.
        progress: receives the progress.
    """
    trial = start
    for _ in range(_MAX_ROUNDS):
        found = scales.common_scale(agreement.rig, sample, agreement(sample, trial), trial, factor)
        progress.advance(1)
        following = scales.next_trial(trial, found)
        if following is None:
            return trial
        trial = following
    return None
