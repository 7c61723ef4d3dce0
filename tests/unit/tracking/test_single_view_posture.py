"""How people hold themselves is learnt while several views show them, and told while one does."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.kernels.tracking.records import State
from posefuse.kernels.tracking.smoothing import apply_changes
from posefuse.kinematics.initial_pose import newborn
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.people import default_noise
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import chosen, joined
from posefuse.tracking.records import Lately
from posefuse.tracking.settings import Settings
from posefuse.tracking.single_view_posture import _leaning, keep_posture, note_posture

DT_S = 0.04


@pytest.fixture(scope="module")
def settings() -> Settings:
    rig = build_rig("ring", 2)
    return Settings.of(rig, shipped_skeleton("body_20"), default_noise(rig, Options()), TrackerOptions())


def somebody(settings: Settings, seed: int) -> State:
    """In a pose of their own, 0.3 rad from rest in each number."""
    tree, rng = settings.tree, np.random.default_rng(seed)
    points = np.full((len(settings.skeleton), 3), np.nan)
    points[settings.skeleton.index("mid_hip")] = [0.0, 0.0, 0.9]
    shape = np.asarray(tree.shape_m)
    state = newborn(tree, points, shape, tree.shape_covariance, settings.options.motion)
    change = np.zeros((1, state.covariance.shape[1]))
    change[0, : tree.n_pose] = 0.3 * rng.normal(size=tree.n_pose)
    apply_changes(change, state)
    return state


def nothing_known(settings: Settings, people: int) -> Lately:
    tree = settings.tree
    return Lately.unknown(people, 2, settings.n_groups, len(settings.skeleton), len(tree.segments) + len(tree.bones))


def axes_of(state: State) -> np.ndarray:
    return np.concatenate([state.turns[0, :, :, 2], state.bones[0, :, :, 2]])


def leans_of(state: State) -> np.ndarray:
    return axes_of(state) @ state.turns[0, 0, :, 2]


def turned_round(state: State, by: Rotation) -> State:
    matrix = by.as_matrix()
    return chosen(state, [0])._replace(turns=matrix @ state.turns, bones=matrix @ state.bones)


def test_what_is_learnt_is_the_mean_and_the_variance(settings: Settings):
    lately, shown = nothing_known(settings, 1), [somebody(settings, seed) for seed in range(6)]
    for state in shown:
        note_posture(state, lately, np.array([3]), DT_S)
    leans = np.array([leans_of(state) for state in shown])
    np.testing.assert_allclose(lately.leans[0], leans.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(lately.leans_variance[0], leans.var(axis=0), atol=1e-12)
    np.testing.assert_allclose(lately.upright[0], np.mean([axes_of(state)[0] for state in shown], axis=0), atol=1e-12)
    assert lately.looked_s[0] == pytest.approx(6 * DT_S)


def test_one_view_alone_teaches_nothing(settings: Settings):
    lately = nothing_known(settings, 2)
    note_posture(joined(somebody(settings, 0), somebody(settings, 1)), lately, np.array([1, 2]), DT_S)
    assert lately.looked_s.tolist() == [0.0, DT_S]
    assert not lately.leans[0].any()


def test_leans_go_with_the_pose_as_differences_say(settings: Settings):
    state, lately = somebody(settings, 3), nothing_known(settings, 1)
    note_posture(somebody(settings, 4), lately, np.array([2]), DT_S)
    rows, _, _ = _leaning(state, lately, 0)
    for c in range(settings.tree.n_pose):
        change = np.zeros((1, state.covariance.shape[1]))
        change[0, c] = 1e-6
        moved = chosen(state, [0])
        apply_changes(change, moved)
        np.testing.assert_allclose((leans_of(moved) - leans_of(state))[1:] / 1e-6, rows[2:, c], atol=1e-5)


def test_who_turned_round_is_told_to_stand_as_before(settings: Settings):
    """Leans are from the trunk, and the trunk's own is from the world's up: turning about that changes nothing."""
    state, lately = somebody(settings, 5), nothing_known(settings, 1)
    for _ in range(30):
        note_posture(state, lately, np.array([2]), DT_S)
    about = Rotation.from_rotvec(1.3 * state.turns[0, 0, :, 2])
    turned = turned_round(state, about)
    keep_posture(turned, lately, np.array([True]), DT_S, settings)
    np.testing.assert_allclose(turned.turns, turned_round(state, about).turns, atol=1e-9)
    np.testing.assert_allclose(turned.bones, turned_round(state, about).bones, atol=1e-9)


def test_who_leans_otherwise_is_drawn_back_and_known_better(settings: Settings):
    before, lately = somebody(settings, 6), nothing_known(settings, 1)
    for _ in range(30):
        note_posture(before, lately, np.array([2]), DT_S)
    state = somebody(settings, 7)
    off, known = np.abs(leans_of(state) - leans_of(before)).mean(), state.covariance.copy()
    for _ in range(40):
        keep_posture(state, lately, np.array([True]), DT_S, settings)
    assert np.abs(leans_of(state) - leans_of(before)).mean() < 0.3 * off
    n = settings.tree.n_pose
    assert np.linalg.eigvalsh(state.covariance[0, :n, :n]).min() > 0.0
    assert np.linalg.eigvalsh((known - state.covariance)[0, :n, :n]).min() > -1e-9


def test_of_whom_little_is_known_nothing_is_told(settings: Settings):
    state, lately = somebody(settings, 8), nothing_known(settings, 1)
    note_posture(somebody(settings, 9), lately, np.array([2]), DT_S)
    same = chosen(state, [0])
    keep_posture(same, lately, np.array([True]), DT_S, settings)
    np.testing.assert_array_equal(same.bones, state.bones)
    np.testing.assert_array_equal(same.covariance, state.covariance)
