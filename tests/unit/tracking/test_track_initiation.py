"""A body fitted to a few frames has the uncertainty that correlated errors allow."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import initial_state, turn_bones
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.records import Observation
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.track_initiation import fit_body

SKELETON = shipped_skeleton("body_20")
RIG = build_rig("ring", 4)
AGE_S = 0.12


def settings_with(**options: float) -> TrackerSettings:
    return TrackerSettings.of(RIG, SKELETON, NoiseModel(np.full(4, 4.5), 1.0), replace(TrackerOptions(), **options))


def standing(
    settings: TrackerSettings, times_s: np.ndarray, posed: Callable[[State], None], size: float = 1.0
) -> list[Observation]:
    """Return observations of a motionless person in a pose and of a size."""
    tree = settings.tree
    points = np.full((len(SKELETON), 3), np.nan)
    points[SKELETON.index("mid_hip")] = [0.0, 0.0, 0.9]
    body = initial_state(tree, points, size * tree.shape_m, tree.shape_covariance, settings.options.motion)
    posed(body)
    projected = ProjectedBodies.allocate(1, len(RIG), len(SKELETON))
    project_people(settings.cameras, settings.body, body, projected.arrays)
    trust = np.ones((len(RIG), len(SKELETON)))
    return [
        Observation(
            float(t), i, projected.pixels[0].copy(), trust, np.zeros(len(RIG), dtype=np.int64),
            projected.points_m[0].copy(),
            projected.covariance_m2[0], projected.points_m[0, 0], 10.0, 1.0,
        )
        for i, t in enumerate(times_s)
    ]  # fmt: skip


def standing_still(settings: TrackerSettings, times_s: np.ndarray, size: float = 1.0) -> list[Observation]:
    """Return observations of a person at rest."""
    return standing(settings, times_s, lambda body: None, size)


def fit_motionless_body(settings: TrackerSettings, times_s: np.ndarray) -> State:
    return fit_body(standing_still(settings, times_s), settings)[0]


def spread(state: State, settings: TrackerSettings) -> np.ndarray:
    """Return the standard deviations of pose and shape."""
    return np.sqrt(np.diagonal(state.covariance[0])[: settings.tree.n_pose + settings.tree.n_shape])


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0])
def test_more_frames_in_the_same_time_add_no_information(rate_hz):
    """Correlated errors repeat in neighboring frames."""
    settings = settings_with()
    few = spread(fit_motionless_body(settings, np.arange(0.0, AGE_S + 1e-9, 0.04)), settings)
    many = spread(fit_motionless_body(settings, np.arange(0.0, AGE_S + 1e-9, 1.0 / rate_hz)), settings)
    n = settings.tree.n_pose
    np.testing.assert_allclose(many[n:], few[n:], rtol=0.02)
    # The last frame is the most recent one, and the body may move.
    assert (many[:n] > 0.99 * few[:n]).all()
    assert (many[:n] < 1.4 * few[:n]).all()


def test_first_frame_counts_fully():
    once = [
        spread(fit_motionless_body(settings_with(error_memory_s=s), np.zeros(1)), settings_with())
        for s in (1e-6, 0.06, 1.0)
    ]
    np.testing.assert_array_equal(once[0], once[1])
    np.testing.assert_array_equal(once[1], once[2])


def test_every_frame_counts_if_errors_are_white():
    """Four frames halve the uncertainty for white errors, and do not reduce it for correlated ones."""
    times_s = np.arange(0.0, AGE_S + 1e-9, 0.04)
    shape = slice(settings_with().tree.n_pose, None)
    white, lasting = settings_with(error_memory_s=1e-6), settings_with(error_memory_s=100.0)
    one = spread(fit_motionless_body(white, times_s[:1]), white)[shape]
    assert np.median(one / spread(fit_motionless_body(white, times_s), white)[shape]) == pytest.approx(1.7, abs=0.3)
    np.testing.assert_allclose(spread(fit_motionless_body(lasting, times_s), lasting)[shape], one, rtol=0.02)


@pytest.mark.parametrize("thigh", [[0.6, 0.0, 0.8], [0.4, -0.3, 0.9]])
def test_leg_detected_late_is_fitted(thigh):
    """Gauss-Newton steps from the rest pose fail, because robust weights of distant keypoints vanish."""
    settings = settings_with()
    tree, leg = settings.tree, [SKELETON.index(name) for name in ("right_knee", "right_ankle")]
    shown = np.full((len(tree.bones), 3), np.nan)
    shown[tree.bones.index("right_knee")] = thigh

    def lift_leg(body: State) -> None:
        turn_bones(body.bones[0], shown, range(len(tree.bones)))

    observed = standing(settings, np.arange(5) / 25.0, lift_leg)
    for each in observed[:3]:
        each.keypoints_px[:, leg], each.points_m[leg] = np.nan, np.nan
    state = fit_body(observed, settings)[0]
    projected = ProjectedBodies.allocate(1, 0, len(SKELETON))
    project_people(settings.cameras[:0], settings.body, state, projected.arrays)
    np.testing.assert_allclose(projected.points_m[0, leg], observed[-1].points_m[leg], atol=0.05)
