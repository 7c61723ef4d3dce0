"""Calibrate the error model of a detector."""

from posefuse.arguments import checked
from posefuse.association.one_subject import SingleSubject
from posefuse.errors import DetectionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.noise.estimate import calibrate_error_model
from posefuse.noise.samples import take_samples
from posefuse.pipeline.defaults import cut_time
from posefuse.preprocess.match_cameras import match_views
from posefuse.progress import Progress, Silent


@checked
def calibrate_noise(
    rig: CameraRig, detections: Detections, options: Options | None = None, *, progress: Progress | None = None
) -> NoiseModel:
    """Estimate the error model of a recording's detections by leaving views out.

    See docs/methods/noise.md.

    Args:
        rig: calibrated cameras.
        detections: 2D keypoints, with confidences if errors are to depend on them.
        options: options as of :func:`reconstruct`; those that fix the noise are ignored.
        progress: receives the progress.

    Returns:
        The scale of each camera, the exponent of the confidence, the spread of accepted errors, and the tails.

    Raises:
        MatchError: if views and cameras do not match.
        DetectionsError: if too few points are seen by three views that agree.
    """
    options = options or Options()
    rig, detections, _ = match_views(rig, detections, options)
    if len(rig) < 2:
        raise DetectionsError(
            "calibrate-noise needs points that three views show, because it leaves views out; one camera is used."
        )
    detections = cut_time(detections, options)
    samples = take_samples(detections, SingleSubject.of(detections, options.pick))
    return calibrate_error_model(rig, samples, options, progress or Silent())
