"""The linearised problem against finite differences, images put back, epipolar distances by hand."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.diagnostics.epipolar import PosedView, distances2, looks, table
from posefuse.diagnostics.linear_system import derivatives, velocities
from posefuse.diagnostics.sample_points import triangulate_samples
from posefuse.diagnostics.recording_model import N_PARAMETERS, Parameter, ImageTransform, RecordingModel, normalize_views, sample_frames, straight
from posefuse.model.cameras import LensModel
from posefuse.synthetic.faults import plant

from .conftest import observations_of


@pytest.fixture(scope="module")
def looked(walk):
    observations = observations_of(walk)
    frames = sample_frames(len(observations.pixels), observations.runs, observations.period_s, 0.2, 60)
    model = RecordingModel.from_calibration(observations, frames)
    return observations, model, triangulate_samples(observations, model, normalize_views(observations, model))


@pytest.mark.parametrize("column", [c for c in Parameter if c is not Parameter.OFFSET])
def test_derivatives_are_those_of_the_state(looked, column):
    observations, model, points = looked
    speed = velocities(points.points_m, observations.frame_time_s[model.frames], observations.runs[model.frames])
    told = derivatives(points, speed, model)[..., 1, :, column]
    step = 1e-5
    changes = np.zeros((len(model.frames), observations.n_views, N_PARAMETERS))
    changes[:, 1, column] = step
    moved = model.corrected(changes)

    def residual(believed: RecordingModel) -> np.ndarray:
        inside = (
            np.einsum("sij,scj->sci", believed.rotation[:, 1], points.points_m) + believed.translation_m[:, None, 1]
        )
        at = normalize_views(observations, believed).xy[:, :, 1]
        return (at - inside[..., :2] / inside[..., 2:]) / points.sigma[:, :, 1, None]

    found = -(residual(moved) - residual(model)) / step
    seen = points.weight[..., 1] > 0
    # What the inner parameters change is seen where the detection is, a few px from where the point is.
    assert np.median(np.abs(found - told)[seen]) < 0.02 * np.median(np.abs(told[seen])) + 1e-3


def test_a_lacking_distortion_bends_and_stretches_as_the_lens_does(looked):
    observations, model, _ = looked
    pinhole = observations.rig.cameras[1]
    bent = replace(pinhole, lens=LensModel.BROWN, distortion=(-0.2, 0.0, 0.0, 0.0, 0.0))
    changes = np.zeros((len(model.frames), observations.n_views, N_PARAMETERS))
    changes[:, 1, Parameter.K1] = -0.2
    normalized = normalize_views(observations, model.corrected(changes))
    at, pixel_size = straight(bent, observations.pixels[model.frames, 1])
    seen = np.isfinite(normalized.xy[:, :, 1]).all(axis=-1)
    radius = np.linalg.norm(at[seen], axis=-1)
    assert radius.max() > 0.25
    assert np.abs(normalized.xy[:, :, 1][seen] - at[seen]).max() < 2e-3
    assert np.abs(normalized.pixel_size[:, :, 1][seen] / pixel_size[seen] - 1.0).max() < 5e-3


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("mirrored", [False, True])
def test_images_are_put_back(turns, mirrored, rng):
    size = (7, 5)
    u, v = np.meshgrid(np.arange(7.0), np.arange(5.0))
    picture = rng.random((5, 7))
    done = np.rot90(picture[:, ::-1] if mirrored else picture, -turns)
    height, width = done.shape
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    back = ImageTransform(turns, mirrored).undo(np.stack([x, y], axis=-1).astype(float), size).astype(int)
    assert (picture[back[..., 1], back[..., 0]] == done).all()
    assert u.shape == v.shape == picture.shape


def test_a_resized_image_keeps_its_corner():
    corner = ImageTransform(scale=0.5).undo(np.array([-0.5, -0.5]), (8, 6))
    assert corner == pytest.approx([-0.5, -0.5])


def test_an_epipolar_distance_by_hand():
    # Two cameras side by side: epipolar lines are rows, and a point a row off in one is off by that row.
    eye, sigma = np.eye(3)[None], np.full(1, 0.01)
    a = PosedView(np.array([[0.1, 0.0]]), sigma, eye, np.zeros((1, 3)))
    b = PosedView(np.array([[-0.1, 0.03]]), sigma, eye, np.array([[1.0, 0.0, 0.0]]))
    assert distances2(a, b) == pytest.approx(0.03**2 / (2 * 0.01**2))
    assert distances2(b, a) == pytest.approx(distances2(a, b))


def test_only_the_pairs_of_a_wrong_view_disagree(walk):
    scene, _ = plant(walk, "rotated image", (2,), 180.0)
    observations = observations_of(scene)
    frames = sample_frames(len(observations.pixels), observations.runs, observations.period_s, 0.2, 40)
    model = RecordingModel.from_calibration(observations, frames)
    disagreements = table(posed_views(observations, model, normalize_views(observations, model), 1.0))
    wrong = np.zeros((4, 4), dtype=bool)
    wrong[2], wrong[:, 2] = True, True
    known = np.isfinite(disagreements)
    assert disagreements[known & wrong].min() > 2 * disagreements[known & ~wrong].max()


def test_a_late_view_is_seen_at_the_frames_times(walk):
    late, _ = plant(walk, "late", (1,), 2.5)
    observations, straight = observations_of(late), observations_of(walk)
    frames = np.arange(50, 150, 10)
    model = RecordingModel.from_calibration(observations, frames).with_offset(1, 2.5 * observations.period_s)
    seen, there = normalize_views(observations, model).xy[:, :, 1], normalize_views(straight, RecordingModel.from_calibration(straight, frames)).xy[:, :, 1]
    assert np.nanmedian(np.abs(seen - there)) < 0.003


def test_nothing_is_made_up_across_a_gap(walk):
    observations = observations_of(walk)
    runs = (np.arange(len(observations.pixels)) >= 100).astype(int)
    model = RecordingModel.from_calibration(observations, np.array([99])).with_offset(0, -0.5 * observations.period_s)
    assert np.isfinite(normalize_views(observations, model).xy[0, :, 0]).any()
    assert not np.isfinite(normalize_views(replace(observations, runs=runs), model).xy[0, :, 0]).any()
