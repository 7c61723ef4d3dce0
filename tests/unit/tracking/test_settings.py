"""The distance of a person in a single view is as uncertain as correlated errors require."""

import numpy as np
import pytest

from posefuse.kernels.tracking.projection import project_people
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.reconstruction import unpack_covariance
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.records import Person
from posefuse.tracking.settings import TrackerSettings, filter_memory_s, tempering_factor
from posefuse.tracking.tracker import ArticulatedTracker

SKELETON = shipped_skeleton("body_20")
RIG = build_rig("ring", 5)
DT_S, FIRM_S, ALONE_S, LASTS_S = 0.04, 1.0, 1.6, 0.25


def tracker_of_ring() -> ArticulatedTracker:
    return tracker_of(RIG, SKELETON, default_noise(RIG, Options()), Options())


def standing(tracker: ArticulatedTracker) -> ProjectedBodies:
    tree = tracker.settings.tree
    points = np.full((len(SKELETON), 3), np.nan)
    points[SKELETON.index("mid_hip")] = [0.1, 0.2, 0.95]
    body = initial_state(tree, points, np.asarray(tree.shape_m), tree.shape_covariance, tracker.settings.options.motion)
    projected = ProjectedBodies.allocate(1, len(RIG), len(SKELETON))
    project_people(tracker.settings.cameras, tracker.settings.body, body, projected.arrays)
    return projected


def correlated_errors(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """Return correlated errors with unit variance, frames first."""
    keep = np.exp(-DT_S / LASTS_S)
    errors = rng.normal(size=shape)
    for i in range(1, shape[0]):
        errors[i] = keep * errors[i - 1] + np.sqrt(1.0 - keep**2) * errors[i]
    return errors


def track_in_one_view(seed: int) -> tuple[np.ndarray, list[Person]]:
    """Return the points of a standing person, and the tracked person while only view 0 shows them."""
    tracker = tracker_of_ring()
    projected, rng = standing(tracker), np.random.default_rng(seed)
    frames = round((FIRM_S + ALONE_S) / DT_S)
    pixels = projected.pixels[0] + 4.5 * correlated_errors((frames, *projected.pixels[0].shape), rng)
    results = []
    for i in range(frames):
        views = np.arange(1 if i * DT_S >= FIRM_S else len(RIG))
        frame = Frame(
            pixels[i, views],
            np.ones((len(views), len(SKELETON))),
            views,
            np.full(len(views), -1),
            np.full(len(RIG), i * DT_S),
            np.ones(len(RIG), dtype=bool),
            i,
        )
        people = tracker.update(frame).people
        if i * DT_S >= FIRM_S:
            results += people[:1]
    return projected.points_m[0], results


def memory_of(n_views: list[int], single_view_s: float = 0.0, dt_s: float = DT_S, **options: float) -> list[float]:
    n = len(n_views)
    return filter_memory_s(
        np.array(n_views), np.full(n, single_view_s), np.full(n, dt_s), TrackerOptions(**options)
    ).tolist()


def test_error_memory_is_longer_after_some_time_in_a_single_view():
    assert memory_of([1], 0.3, smoother_error_memory_s=0.25) == [0.25]
    assert memory_of([1], 0.1, smoother_error_memory_s=0.25)[0] < 0.25
    longer = memory_of([1], 0.3, error_memory_s=0.5, smoother_error_memory_s=0.25)
    assert longer == memory_of([1], 0.1, error_memory_s=0.5)


def test_error_memory_is_longer_with_fewer_views_and_frames():
    assert memory_of([5], dt_s=0.05) == pytest.approx([0.06], rel=0.1)
    assert sorted(memory_of([2, 3, 5, 8]), reverse=True) == memory_of([2, 3, 5, 8])
    assert memory_of([2])[0] < 2.0 * memory_of([5])[0]
    rates = [memory_of([5], dt_s=dt_s)[0] for dt_s in (0.01, 0.02, 0.04, 0.1)]
    assert rates == sorted(rates)
    assert memory_of([5], dt_s=np.inf)[0] < 3.0 * rates[0] + 0.1
    assert memory_of([3], error_memory_s=0.0) == [0.0]


def test_information_per_second_does_not_depend_on_the_frame_rate():
    """A single view averages over more frames at a higher rate."""
    rates_hz = np.array([50.0, 100.0])
    a_second = [rate / tempering_factor(np.array(1.0 / rate), memory_of([1], 1.0, 1.0 / rate)[0]) for rate in rates_hz]
    assert a_second[0] == pytest.approx(a_second[1], rel=0.01)


def test_distance_uncertainty_covers_the_error():
    """Along the view's ray, one and two standard deviations cover at least the nominal shares."""
    squared = []
    for seed in range(4):
        truth, results = track_in_one_view(seed)
        ray = truth.mean(axis=0) - RIG.cameras[0].center_m
        ray /= np.linalg.norm(ray)
        assert len(results) == round(ALONE_S / DT_S)
        for person in results:
            off = (person.points_m - truth) @ ray
            squared.append(off**2 / (ray @ unpack_covariance(person.covariance_m2) @ ray))
    assert np.mean(np.array(squared) < 1.0) > 0.68
    assert np.mean(np.array(squared) < 4.0) > 0.95


def test_posture_prior_reduces_the_distance_bias(monkeypatch: pytest.MonkeyPatch):
    """Without the prior, errors that lengthen bones bias the distance."""
    off_m = []
    for _ in range(2):
        off_m.append([])
        for seed in range(4, 8):
            truth, results = track_in_one_view(seed)
            ray = truth.mean(axis=0) - RIG.cameras[0].center_m
            off_m[-1] += [((person.points_m - truth) @ ray / np.linalg.norm(ray)).mean() for person in results]
        monkeypatch.setattr("posefuse.tracking.update.apply_posture_prior", lambda *_: None)
    results, untold = np.abs(np.mean(off_m, axis=1))
    assert results < 0.8 * untold


def test_offsets_of_keypoints_follow_the_skeleton():
    mouse = shipped_skeleton("mouse_22")
    assert mouse.tree is not None
    law = TrackerSettings.of(RIG, mouse, NoiseModel(np.full(len(RIG), 4.5), 1.0), TrackerOptions()).law
    assert law.floor_m == pytest.approx(0.015 * mouse.tree.scale * 3.0)
