"""Priors of fitted paths: motion, lengths and uncertainties from a recording."""

from collections.abc import Iterator

import numpy as np
import pytest
from benchmarks.walking import walk

from posefuse.checkpoint import Spool
from posefuse.io.checkpoints import CheckpointFolder
from posefuse.kernels.tracking.records import State
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.options.tracking_motion import MotionOptions
from posefuse.model.tracks import TrackState
from posefuse.parallel import ONE_JOB, Jobs
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd
from posefuse.tracking import smoothing
from posefuse.tracking.history import History
from posefuse.tracking.path_priors import PathPriors, begin_priors, estimate_priors
from posefuse.tracking.smoothing import PeopleSmoother, SmoothedPerson

REGION_68, REGION_95 = 3.506, 7.815
"""Squared Mahalanobis distances in three dimensions."""


@pytest.fixture(scope="module")
def scene() -> CrowdScene:
    return simulate_crowd(CrowdOptions("crowd", people=2, duration_s=12.0, seed=5))


@pytest.fixture(scope="module")
def history(scene) -> History:
    return record(scene)


def record(scene: CrowdScene, options: Options | None = None, spool: Spool | None = None) -> History:
    options = options or Options()
    noise = default_noise(scene.rig, options)
    tracker = tracker_of(scene.rig, scene.detections.skeleton, noise, options)
    history = History(tracker.settings, spool)
    for f in range(scene.detections.n_frames):
        history.add(tracker, tracker.process(Frame.of(scene.detections, f)))
    return history


def errors_of(people: list[SmoothedPerson], scene: CrowdScene) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield errors in m and covariances of each person's keypoints in frames in which the truth is near."""
    truth = np.asarray(scene.truth.layers["measured"].points_m)
    for each in people:
        away = np.linalg.norm(each.body.points_m[:, None] - truth[each.places], axis=-1).mean(axis=-1)
        owner = int(np.nanargmin(np.nanmedian(away, axis=0)))
        error = each.body.points_m - truth[each.places, owner]
        there = np.isfinite(error).all(axis=(1, 2)) & (each.missing_s < 0.1)
        packed = each.body.covariance_m2[there]
        yield error[there], packed[..., [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def mean_error_mm(people: list[SmoothedPerson], scene: CrowdScene) -> float:
    return 1e3 * float(
        np.mean(np.concatenate([np.linalg.norm(e, axis=-1).ravel() for e, _ in errors_of(people, scene)]))
    )


def test_fitted_paths_are_a_tenth_more_accurate_than_the_smoother(scene, history, monkeypatch):
    fitted = PeopleSmoother(history).take(len(history))
    monkeypatch.setattr(smoothing, "estimate_priors", lambda *_: None)
    smoothed = PeopleSmoother(history).take(len(history))
    assert mean_error_mm(fitted, scene) < 0.9 * mean_error_mm(smoothed, scene)


def test_paths_that_explain_detections_worse_are_not_used():
    """With small, uncorrelated errors, deviations of the body from its model outweigh those of the detections."""
    data = walk(150)
    options = Options(people="one", bodies="fit", solve="frame", health="off")
    layer = reconstruct(data.rig, data.detections, options).layers["model"]
    error_mm = 1e3 * np.linalg.norm(np.asarray(layer.points_m)[:, 0] - data.points_m, axis=-1)
    assert np.nanmedian(error_mm) < 4.0


def test_motion_without_accelerations_is_fitted(scene):
    motion = MotionOptions(root_acceleration=0.0, turn_acceleration=0.0, limb_acceleration=0.0)
    priors = estimate_priors(history := record(scene, Options(tracker=TrackerOptions(motion=motion))), history.settings)
    assert priors is not None
    assert np.isfinite(priors.motion.power).all()


def test_regions_contain_the_truth(scene, history):
    squared = []
    for error, covariance in errors_of(PeopleSmoother(history).take(len(history)), scene):
        squared.append((error * np.linalg.solve(covariance, error[..., None])[..., 0]).sum(axis=-1).ravel())
    shares = [float((np.concatenate(squared) < region).mean()) for region in (REGION_68, REGION_95)]
    assert shares[0] == pytest.approx(0.68, abs=0.1)
    assert shares[1] == pytest.approx(0.94, abs=0.05)


def test_parts_of_a_recording_join_without_a_seam(history):
    whole = {each.number: each for each in PeopleSmoother(history).take(len(history))}
    smoother = PeopleSmoother(history)
    for each in smoother.take(150) + smoother.take(len(history)):
        other = whole[each.number]
        away = each.body.points_m - other.body.points_m[np.searchsorted(other.places, each.places)]
        assert np.nanpercentile(np.abs(away), 99) < 5e-3


def test_points_do_not_depend_on_uncertainties(history):
    both = (PeopleSmoother(history, only_points=only).take(len(history)) for only in (False, True))
    for uncertain, bare in zip(*both, strict=True):
        np.testing.assert_array_equal(uncertain.body.points_m, bare.body.points_m)
        assert np.isnan(bare.body.covariance_m2).all()


def test_the_same_history_gives_the_same_priors(history):
    first, second = (estimate_priors(history, history.settings) for _ in range(2))
    assert isinstance(first, PathPriors)
    assert isinstance(second, PathPriors)
    np.testing.assert_array_equal(first.motion.power, second.motion.power)
    assert first.inflation == second.inflation


def test_priors_estimated_in_another_process_are_the_same(scene, history, tmp_path):
    stored = record(scene, spool=CheckpointFolder(tmp_path / "parts", "key").spool("a.b"))
    with Jobs(2) as jobs:
        assert begin_priors(history, jobs) is None  # no other process can read its temporary file
        wait = begin_priors(stored, jobs)
        assert wait is not None
        found, expected = wait(), estimate_priors(history, history.settings)
        assert wait() is found
    assert found is not None
    assert expected is not None
    np.testing.assert_array_equal(found.motion.power, expected.motion.power)
    assert found.inflation == expected.inflation
    for number, bodies in expected.bodies.items():
        for each, other in zip(found.bodies[number], bodies, strict=True):
            np.testing.assert_array_equal(each.covariance_m2, other.covariance_m2)
    assert begin_priors(stored, ONE_JOB) is None


def test_calm_motion_gets_a_low_density(history):
    """People who walk accelerate less than the filter allows for."""
    priors = estimate_priors(history, history.settings)
    assert priors is not None
    assert np.median(priors.motion.power / history.settings.power) < 0.3


def test_history_without_keypoints_has_no_priors(scene):
    history = History(record(scene).settings)
    assert estimate_priors(history, history.settings) is None


def test_views_at_different_times_are_moved_to_the_time_of_the_frame(scene):
    """Assigned keypoints of late views differ from the detections by the motion since the time of the frame."""
    detections = scene.detections
    options = Options()
    tracker = tracker_of(scene.rig, detections.skeleton, default_noise(scene.rig, options), options)
    moved = 0.0
    for f in range(60):
        frame = Frame.of(detections, f)
        late = frame.time_s + np.where(np.arange(len(scene.rig)) == 0, -0.02, 0.0)
        frame = type(frame)(**{**vars(frame), "time_s": late})
        tracked = tracker.process(frame)
        assert tracked.assigned is not None
        first = np.asarray(frame.view) == 0
        if len(tracker.tracks) and tracked.people.people[0].state == TrackState.ACTIVE:
            change = tracked.assigned.keypoints_px[first] - frame.keypoints_px[first]
            moved = max(moved, float(np.nanmax(np.abs(change))))
            np.testing.assert_allclose(tracked.assigned.keypoints_px[~first], frame.keypoints_px[~first], atol=1e-9)
    assert 1.0 < moved < 60.0


def test_state_keeps_its_shape_until_it_is_replaced(history):
    """Each track of this recording has one epoch of lengths, from its first to its last frame."""
    state = history.runs(0, len(history))[0].state
    assert isinstance(state, State)
    for number, epochs in history.epochs.items():
        places = np.concatenate([run.places for run in history.runs(0, len(history), number)])
        assert (epochs[0].start, epochs[-1].stop) == (places[0], places[-1] + 1)
