"""Normalization of observations: lens distortion and time offsets."""

from dataclasses import replace

import numpy as np
from benchmarks.fault_scenes import plant

from posefuse.diagnostics.normalized_views import normalize_views, normalized_coordinates
from posefuse.diagnostics.observations import sample_frames
from posefuse.diagnostics.recording_model import N_PARAMETERS, Parameter, RecordingModel
from posefuse.model.cameras import LensModel

from .conftest import observe


def test_k1_correction_bends_and_stretches_like_the_lens(walk):
    observations = observe(walk)
    frames = sample_frames(len(observations.pixels), observations.runs, observations.period_s, 0.2, 60)
    model = RecordingModel.from_calibration(observations, frames)
    pinhole = observations.rig.cameras[1]
    brown = replace(pinhole, lens=LensModel.BROWN, distortion=(-0.2, 0.0, 0.0, 0.0, 0.0))
    changes = np.zeros((len(model.frames), observations.n_views, N_PARAMETERS))
    changes[:, 1, Parameter.K1] = -0.2
    normalized = normalize_views(observations, model.corrected(changes))
    xy, pixel_size = normalized_coordinates(brown, observations.pixels[model.frames, 1])
    visible = np.isfinite(normalized.xy[:, :, 1]).all(axis=-1)
    radius = np.linalg.norm(xy[visible], axis=-1)
    assert radius.max() > 0.25
    assert np.abs(normalized.xy[:, :, 1][visible] - xy[visible]).max() < 2e-3
    assert np.abs(normalized.pixel_size[:, :, 1][visible] / pixel_size[visible] - 1.0).max() < 5e-3


def test_time_offset_is_removed_by_interpolation(walk):
    late, _ = plant(walk, "late", (1,), 2.5)
    delayed, synchronized = observe(late), observe(walk)
    frames = np.arange(50, 150, 10)
    model = RecordingModel.from_calibration(delayed, frames).with_offset(1, 2.5 * delayed.period_s)
    corrected = normalize_views(delayed, model).xy[:, :, 1]
    expected = normalize_views(synchronized, RecordingModel.from_calibration(synchronized, frames)).xy[:, :, 1]
    assert np.nanmedian(np.abs(corrected - expected)) < 0.003


def test_no_interpolation_between_pieces_of_a_recording(walk):
    observations = observe(walk)
    runs = (np.arange(len(observations.pixels)) >= 100).astype(int)
    model = RecordingModel.from_calibration(observations, np.array([99]))
    model = model.with_offset(0, -0.5 * observations.period_s)
    assert np.isfinite(normalize_views(observations, model).xy[0, :, 0]).any()
    assert not np.isfinite(normalize_views(replace(observations, runs=runs), model).xy[0, :, 0]).any()
