"""A look at a sample of a recording before it is reconstructed: how noisy it is, and whether its parts fit together."""

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from posefuse.diagnostics.floor import floor_findings
from posefuse.diagnostics.view_agreement import agreement_finding, camera_finding, coincidence_finding
from posefuse.diagnostics.world_scale import scale_finding
from posefuse.errors import DetectionsError, OptionsError, PosefuseWarning, choices
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.subjects import Subjects
from posefuse.model.tracks import Tracks
from posefuse.noise import leave_one_out
from posefuse.noise import scale as noise_scale
from posefuse.noise.leave_one_out import Sample
from posefuse.progress import Progress
from posefuse.skeleton.skeletons import Skeleton
from posefuse.triangulation import consensus

_LAW_ROUNDS = 4
_SAME_EXPONENT = 0.03


def survey(
    rig: CameraRig, detections: Detections, options: Options, subjects: Subjects, progress: Progress
) -> tuple[NoiseModel, Layer | None]:
    """Triangulate a sample of the recording: how noisy the detections are, and its points; None with one camera."""
    noise = known_noise(rig, options) or noise_scale.assumed(rig, options.triangulation.confidence_exponent)
    if len(rig) == 1:
        return noise, None
    sampled = partial(_sample, detections, subjects)
    agree = partial(_agree, rig, _agreeing(options))
    if noise.origin != "assumed":
        return noise, agree(sampled(few=True), noise)
    return find_noise(rig, sampled, agree, noise, progress)


def findings(rig: CameraRig, layer: Layer, noise: NoiseModel, skeleton: Skeleton) -> tuple[str, ...]:
    """What a sample of points shows to be wrong, each with a warning: cameras that disagree, scale, floor.

    Args:
        rig: the cameras.
        layer: the sample, as :func:`survey` measured it.
        noise: of the detections.
        skeleton: of the keypoints.
    """
    points = [np.asarray(layer.points_m)]
    found = (
        coincidence_finding(rig),
        agreement_finding([layer], rig, noise),
        camera_finding([layer], rig),
        scale_finding(points, skeleton, rig.metres_per_unit),
        *floor_findings(points, skeleton, rig),
    )
    said = tuple(finding for finding in found if finding is not None)
    for finding in said:
        warnings.warn(finding, PosefuseWarning, stacklevel=5)
    return said


def known_noise(rig: CameraRig, options: Options) -> NoiseModel | None:
    """The noise that the options fix, if they do.

    Raises:
        OptionsError: if they fix it for other cameras.
    """
    exponent, noise = options.triangulation.confidence_exponent, options.noise
    if options.noise_scale_px is not None:
        return NoiseModel(np.full(len(rig), options.noise_scale_px), exponent)
    if not noise.cameras:
        return None
    scale_of = dict(zip(noise.cameras, noise.scale_px, strict=True))
    missing = [name for name in rig.names if name not in scale_of]
    if missing:
        raise OptionsError(
            f"noise.cameras has no scale for {choices(missing)}; it names {choices(noise.cameras)}. Calibrate the "
            "noise with this rig, or leave the table [noise] out."
        )
    scales = np.array([scale_of[name] for name in rig.names])
    return NoiseModel(scales, exponent, "calibrated", noise.spread, math.nan if noise.nu is None else noise.nu)


def find_law(
    rig: CameraRig, detections: Detections, options: Options, subjects: Subjects, progress: Progress
) -> NoiseModel:
    """The noise with all that a recording tells of its law.

    The exponent of the confidence weighs the views that make the points that tell the exponent, so it is sought anew
    until it stays.

    Raises:
        DetectionsError: if too few points are seen by three views that agree.
    """
    # SciPy's optimisation and statistics take a second to load, and reconstructions need neither.
    from posefuse.noise.error_law import fit_law

    sampled = partial(_sample, detections, subjects)
    agree = partial(_agree, rig, _agreeing(options))
    exponent = 0.0
    rounds = 0
    while True:
        noise, layer = find_noise(rig, sampled, agree, noise_scale.assumed(rig, exponent), progress)
        law = fit_law(leave_one_out.gather(rig, sampled(few=False), layer, noise), exponent)
        if law is None or noise.origin == "assumed":
            raise DetectionsError(
                "Too few points are seen by three views that agree: a detector's noise cannot be told from them. "
                "Longer recordings, or more cameras, tell more."
            )
        rounds += 1
        if abs(law.exponent - exponent) < _SAME_EXPONENT or rounds == _LAW_ROUNDS:
            return replace(noise, origin="calibrated", nu=law.nu)
        exponent = law.exponent


def _agreeing(options: Options) -> TriangulationOptions:
    """How a sample is triangulated to see what agrees."""
    return replace(options.triangulation, min_views=2)


def find_noise(
    rig: CameraRig,
    sampled: Callable[..., Sample],
    agree: Callable[[Sample, NoiseModel], Layer],
    otherwise: NoiseModel,
    progress: Progress,
) -> tuple[NoiseModel, Layer]:
    """The noise of a recording: from below up to the first that explains itself, see docs/methods.md, "Noise".

    Returns:
        The noise, or ``otherwise`` where the recording tells too little; and the sample as it was triangulated.
    """
    sample = sampled(few=True)
    trial = noise_scale.finest(rig, otherwise.exponent)
    progress.start("surveying", noise_scale.MOST_ROUNDS)
    for _ in range(noise_scale.MOST_ROUNDS):
        found = noise_scale.estimate(rig, sample, agree(sample, trial), trial)
        progress.advance(1)
        following = noise_scale.coarser(trial, found)
        if following is None:
            break
        trial = following
    else:
        trial = otherwise
    sample = sampled(few=False)
    layer = agree(sample, trial)
    progress.finish()
    noise = noise_scale.of_right_views(rig, sample, layer, trial)
    if noise is None:
        return otherwise, layer
    layer = agree(sample, noise)
    return replace(noise, spread=noise_scale.spread(rig, sample, layer, noise)), layer


def _sample(detections: Detections, subjects: Subjects, *, few: bool) -> Sample:
    spans = noise_scale.spans(detections, few=few)
    starts = np.cumsum([0, *(stop - start for start, stop in spans[:-1])])
    tracks = Tracks.concatenate([subjects.tracks(*span) for span in spans])
    return Sample(detections.pieces(spans), tracks, tuple(starts.tolist()))


def _agree(rig: CameraRig, options: TriangulationOptions, sample: Sample, noise: NoiseModel) -> Layer:
    return consensus.solve(rig, sample.detections, sample.tracks, noise, options)
