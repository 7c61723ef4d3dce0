"""Derivatives of the linearized problem against finite differences."""

import numpy as np
import pytest

from posefuse.diagnostics.linear_system import derivatives, velocities
from posefuse.diagnostics.normalized_views import normalize_views
from posefuse.diagnostics.observations import sample_frames
from posefuse.diagnostics.recording_model import N_PARAMETERS, Parameter, RecordingModel
from posefuse.diagnostics.sample_points import triangulate_samples

from .conftest import observe


@pytest.fixture(scope="module")
def triangulated(walk):
    observations = observe(walk)
    frames = sample_frames(len(observations.pixels), observations.runs, observations.period_s, 0.2, 60)
    model = RecordingModel.from_calibration(observations, frames)
    return observations, model, triangulate_samples(observations, model, normalize_views(observations, model))


@pytest.mark.parametrize("parameter", [p for p in Parameter if p is not Parameter.OFFSET])
def test_derivatives_match_finite_differences(triangulated, parameter):
    observations, model, points = triangulated
    speed = velocities(points.points_m, observations.frame_time_s[model.frames], observations.runs[model.frames])
    analytic = derivatives(points, speed, model)[..., 1, :, parameter]
    step = 1e-5
    changes = np.zeros((len(model.frames), observations.n_views, N_PARAMETERS))
    changes[:, 1, parameter] = step
    moved = model.corrected(changes)

    def residual(tested: RecordingModel) -> np.ndarray:
        camera_xyz = np.einsum("sij,scj->sci", tested.rotation[:, 1], points.points_m)
        camera_xyz = camera_xyz + tested.translation_m[:, None, 1]
        xy = normalize_views(observations, tested).xy[:, :, 1]
        return (xy - camera_xyz[..., :2] / camera_xyz[..., 2:]) / points.sigma[:, :, 1, None]

    numeric = -(residual(moved) - residual(model)) / step
    visible = points.weight[..., 1] > 0
    # Intrinsics act at the detection, a few px from the projected point.
    assert np.median(np.abs(numeric - analytic)[visible]) < 0.02 * np.median(np.abs(analytic[visible])) + 1e-3
