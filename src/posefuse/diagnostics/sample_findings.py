"""Findings from the sample of points that noise estimation triangulates."""

import warnings

import numpy as np

from posefuse.diagnostics.floor import floor_findings
from posefuse.diagnostics.view_agreement import agreement_finding, camera_finding, coincidence_finding
from posefuse.diagnostics.world_scale import scale_finding
from posefuse.errors import PosefuseWarning
from posefuse.model.cameras import CameraRig
from posefuse.model.findings import Finding
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.skeleton.skeletons import Skeleton


def sample_findings(
    rig: CameraRig, layer: Layer, noise: NoiseModel, skeleton: Skeleton
) -> tuple[tuple[str, ...], tuple[Finding, ...]]:
    """Return and warn of problems that a sample of points shows: cameras that disagree, wrong scale, wrong floor.

    Args:
        rig: calibrated cameras.
        layer: the sample, triangulated with outliers rejected.
        noise: noise of the detections.
        skeleton: skeleton of the keypoints.

    Returns:
        Problems in sentences, and those that are findings.
    """
    points = [np.asarray(layer.points_m)]
    found = (
        coincidence_finding(rig),
        agreement_finding([layer], rig, noise),
        camera_finding([layer], rig, noise),
        *floor_findings(points, skeleton, rig),
    )
    sentences = tuple(finding for finding in found if finding is not None)
    scale = scale_finding(points, skeleton, rig.meters_per_unit)
    findings = () if scale is None else (scale,)
    for sentence in (*sentences, *(f"{finding.sentence} {finding.remedy}" for finding in findings)):
        warnings.warn(sentence, PosefuseWarning, stacklevel=5)
    return sentences, findings
