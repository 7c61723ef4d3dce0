"""Tracking of hands and faces, which does not change the bodies."""

import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from posefuse.arrays import frozen
from posefuse.biomechanics.tables import keypoint_angles
from posefuse.evaluation.consistency import consistency, normalized_squares
from posefuse.kernels.tracking.anchors import update_from_anchors
from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.smoothing import apply_changes
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.reconstruction import unpack_covariance
from posefuse.model.status import PointStatus
from posefuse.model.tracks import TrackState
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton
from posefuse.synthetic.crowd_options import NO_FAULTS, CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd
from posefuse.synthetic.options import CLEAN
from posefuse.tracking.body_states import ProjectedBodies, select_states
from posefuse.tracking.parts import certain_directions
from posefuse.tracking.records import People, Person

WHOLE = shipped_skeleton("coco_wholebody_133")
LEFT, RIGHT, FACE = WHOLE.parts
assert WHOLE.tree is not None
BODY = np.flatnonzero(WHOLE.tree.keypoint_nodes >= 0)
RATE_HZ = 25.0


@pytest.fixture(scope="module")
def scene() -> CrowdScene:
    """Return one person whose fingers open and close, in 50 frames of an accurate detector."""
    return simulate_crowd(
        CrowdOptions(people=1, duration_s=2.0, seed=3, skeleton=WHOLE.name, detector=CLEAN, faults=NO_FAULTS)
    )


def run(
    scene: CrowdScene, skeleton: Skeleton = WHOLE, change: Callable[[int, Frame], Frame] = lambda _, frame: frame
) -> list[People]:
    options = Options()
    tracker = tracker_of(scene.rig, skeleton, default_noise(scene.rig, options), options)
    return [tracker.update(change(i, Frame.of(scene.detections, i))) for i in range(scene.detections.n_frames)]


@pytest.fixture(scope="module")
def tracked(scene: CrowdScene) -> list[People]:
    return run(scene)


def one(people: People) -> Person:
    return next(person for person in people.people if person.state == TrackState.ACTIVE)


def error_m(scene: CrowdScene, results: Sequence[People], keypoints: np.ndarray, frame: int) -> float:
    truth = np.asarray(scene.truth.layers["measured"].points_m)[frame, 0, keypoints]
    return float(np.linalg.norm(one(results[frame]).points_m[keypoints] - truth, axis=1).mean())


def without(frame: Frame, keypoints: np.ndarray) -> Frame:
    pixels, confidence = frame.keypoints_px.copy(), frame.confidence.copy()
    pixels[:, keypoints], confidence[:, keypoints] = np.nan, np.nan
    return replace(frame, keypoints_px=frozen(pixels), confidence=frozen(confidence))


def test_hands_and_faces_are_accurate(scene, tracked):
    for part in WHOLE.parts:
        assert error_m(scene, tracked, part.keypoints, -1) < 0.02
        person = one(tracked[-1])
        assert np.isfinite(person.covariance_m2[part.keypoints]).all()
        assert person.used[:, part.keypoints].mean() > 0.9


def test_parts_do_not_change_bodies(scene, tracked):
    bare = run(scene, replace(WHOLE, parts=()))
    for first, second in zip(tracked, bare, strict=True):
        for a, b in zip(first.people, second.people, strict=True):
            np.testing.assert_array_equal(a.points_m[BODY], b.points_m[BODY])
            np.testing.assert_array_equal(a.covariance_m2[BODY], b.covariance_m2[BODY])
    assert np.isnan(one(bare[-1]).points_m[LEFT.keypoints]).all()


def test_unseen_hand_is_dropped_and_starts_again(scene):
    hidden_from, back = 20, 40

    def change(i: int, frame: Frame) -> Frame:
        return without(frame, LEFT.keypoints) if hidden_from <= i < back else frame

    results = run(scene, change=change)
    present = [bool(np.isfinite(one(people).points_m[LEFT.keypoints]).all()) for people in results[hidden_from:]]
    stays = int(TrackerOptions().lost_after_s * RATE_HZ) - 1
    assert all(present[:stays])
    assert not any(present[stays + 2 : back - hidden_from])
    assert all(present[back - hidden_from :])
    assert not one(results[back - 1]).used[:, LEFT.keypoints].any()
    assert error_m(scene, results, RIGHT.keypoints, -1) < 0.02
    assert error_m(scene, results, LEFT.keypoints, -1) < 0.03


def test_terminated_track_leaves_no_parts(scene):
    """The memory of a live tracker does not grow with the number of past people."""
    options = Options(tracker=TrackerOptions(lost_after_s=0.1, terminate_after_s=0.2))
    tracker = tracker_of(scene.rig, WHOLE, default_noise(scene.rig, options), options)
    for i in range(20):
        tracker.update(Frame.of(scene.detections, i))
    assert all(part.known for part in tracker.parts)
    observed = Frame.of(scene.detections, 19)
    for i in range(20, 40):
        time_s = observed.time_s + (i - 19) / RATE_HZ
        empty = replace(without(observed, np.arange(len(WHOLE))), time_s=time_s, number=observed.number + i - 19)
        tracker.update(empty)
    assert not tracker.tracks
    assert not any(part.known or part.tracks for part in tracker.parts)


def test_hand_continues_in_one_view(scene):
    def change(i: int, frame: Frame) -> Frame:
        if i < 35:
            return frame
        lone, first = without(frame, RIGHT.keypoints), frame.view[:, None] == 0
        pixels = np.where(first[..., None], frame.keypoints_px, lone.keypoints_px)
        return replace(
            lone,
            keypoints_px=frozen(pixels),
            confidence=frozen(np.where(first, frame.confidence, lone.confidence)),
        )

    results = run(scene, change=change)
    used = one(results[-1]).used[:, RIGHT.keypoints]
    assert used[0].any()
    assert not used[1:].any()
    assert error_m(scene, results, RIGHT.keypoints, -1) < 0.08


def test_swapped_hands_in_a_view_are_corrected(scene, tracked):
    def change(_: int, frame: Frame) -> Frame:
        rows = frame.rows_of(1)
        pixels = frame.keypoints_px.copy()
        both = np.concatenate([LEFT.keypoints, RIGHT.keypoints])
        pixels[rows[:, None], both] = frame.keypoints_px[rows[:, None], WHOLE.mirror[both]]
        return replace(frame, keypoints_px=frozen(pixels))

    swapped = run(scene, change=change)
    for part in (LEFT, RIGHT):
        assert error_m(scene, swapped, part.keypoints, -1) < error_m(scene, tracked, part.keypoints, -1) + 0.005


def test_pickled_tracker_with_hands_resumes(scene):
    options = Options()
    tracker = tracker_of(scene.rig, WHOLE, default_noise(scene.rig, options), options)
    frames = [Frame.of(scene.detections, i) for i in range(20)]
    for frame in frames[:15]:
        tracker.update(frame)
    other = pickle.loads(pickle.dumps(tracker))
    for frame in frames[15:]:
        first, second = tracker.update(frame), other.update(frame)
        np.testing.assert_allclose(one(first).points_m, one(second).points_m, rtol=0, atol=1e-9)


def test_anchor_update_is_a_kalman_update(rng):
    tree = FACE.tree
    state = initial_state(
        tree, rng.normal(size=(len(FACE.keypoints), 3)), tree.shape_m, tree.shape_covariance, TrackerOptions().motion
    )
    size = state.covariance.shape[1]
    root = rng.normal(size=(size, size)) / size
    state.covariance[0] += root @ root.T
    before = select_states(state, [0])
    place, noise = state.root + 0.1, np.diag([0.01, 0.02, 0.03])
    packed = noise[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]][None]
    nothing = np.full((1, 3, 3), np.nan)
    update_from_anchors(place, packed, nothing, np.zeros((1, 6)), np.empty((6, size)), np.empty(size), state)
    observed = np.eye(size)[:3]
    gain = before.covariance[0] @ observed.T @ np.linalg.inv(observed @ before.covariance[0] @ observed.T + noise)
    expected = (np.eye(size) - gain @ observed) @ before.covariance[0]
    np.testing.assert_allclose(state.covariance[0], expected, atol=1e-12)
    apply_changes((gain @ [0.1, 0.1, 0.1])[None], before)
    np.testing.assert_allclose(state.root, before.root)
    np.testing.assert_allclose(state.turns, before.turns)
    np.testing.assert_allclose(state.shape, before.shape)


def test_certain_anchor_turn_is_adopted(rng):
    tree = FACE.tree
    state = initial_state(
        tree, rng.normal(size=(len(FACE.keypoints), 3)), tree.shape_m, tree.shape_covariance, TrackerOptions().motion
    )
    size = state.covariance.shape[1]
    turn = state.turns[0, 0] @ np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    sure = np.array([[1.0, 0.0, 0.0, 1.0, 0.0, 1.0]]) * 1e-12
    update_from_anchors(np.full((1, 3), np.nan), sure, turn[None], sure, np.empty((6, size)), np.empty(size), state)
    np.testing.assert_allclose(state.turns[0, 0], turn, atol=1e-6)


def test_whole_body_recording_is_reconstructed(scene):
    result = reconstruct(scene.rig, scene.detections, Options(people="many"))
    model, measured = result.layers["model"], result.layers["measured"]
    truth = np.asarray(scene.truth.layers["measured"].points_m)
    status = np.asarray(model.status)
    hands = np.concatenate([LEFT.keypoints, RIGHT.keypoints])
    assert (status[10:, 0] == PointStatus.OK).all()
    assert np.isfinite(np.asarray(model.covariance_m2)[10:, 0]).all()
    off = np.linalg.norm(np.asarray(model.points_m)[10:, 0] - truth[10:, 0], axis=-1)
    assert off[:, hands].mean() < 0.02
    assert off[:, FACE.keypoints].mean() < 0.02
    assert (np.asarray(model.n_views)[10:, 0, hands] > 2).mean() > 0.9
    assert np.isfinite(np.asarray(measured.points_m)[10:, 0, hands]).all()
    assert result.poses is not None
    assert result.poses.segments[-4:] == ("left_palm", "right_palm", "face", "jaw")
    names, degrees, sds = keypoint_angles(result)
    assert len(set(names)) == len(names) == degrees.shape[-1]
    # Angles have standard deviations unless a limb with an unobserved twist carries them.
    twisted = [name.split(".")[0] in ("left_foot", "right_foot", "left_palm", "right_palm") for name in names]
    messages = np.isfinite(sds[10:, 0])
    assert not messages[np.isnan(degrees[10:, 0])].any()
    assert messages[:, ~np.array(twisted)][np.isfinite(degrees[10:, 0])[:, ~np.array(twisted)]].mean() > 0.99
    assert 1.0 < np.nanmedian(sds[10:, 0]) < 30.0
    assert np.isfinite(degrees[10:, 0, names.index("left_palm.bend")]).all()
    # The index finger opens and closes.
    assert np.ptp(degrees[10:, 0, names.index("left_index_finger_2.flexion")]) > 30.0


def test_projections_of_other_parts_are_missing(scene):
    settings = tracker_of(scene.rig, WHOLE, default_noise(scene.rig, Options()), Options()).settings
    projected = ProjectedBodies.allocate(1, len(settings.cameras), len(WHOLE))
    for array in projected.arrays:
        array[:] = 7.0
    tree, motion = settings.tree, settings.options.motion
    points = np.asarray(scene.truth.layers["measured"].points_m)[0, 0]
    state = initial_state(tree, points, tree.shape_m, tree.shape_covariance, motion)
    project_people(settings.cameras, settings.body, state, projected.arrays)
    assert np.isnan(projected.px_per_m[..., FACE.keypoints]).all()
    assert np.isnan(projected.pixel_covariance_px2[:, :, FACE.keypoints]).all()
    assert np.isfinite(projected.px_per_m[..., BODY]).all()


@pytest.mark.long
def test_regions_of_smoothed_hands_and_faces_contain_the_truth():
    shares = []
    for seed in range(2):
        scene = simulate_crowd(CrowdOptions(people=1, duration_s=5.0, seed=seed, skeleton=WHOLE.name))
        layer = reconstruct(scene.rig, scene.detections, Options(people="many", solve="frame")).layers["model"]
        truth = np.asarray(scene.truth.layers["measured"].points_m)[:, 0]
        squares = normalized_squares(
            np.asarray(layer.points_m)[:, 0] - truth, unpack_covariance(np.asarray(layer.covariance_m2)[:, 0])
        )
        hands = np.concatenate([LEFT.keypoints, RIGHT.keypoints])
        found = [consistency(squares[:, keypoints], 3) for keypoints in (hands, FACE.keypoints)]
        shares.append([(each.covered_68, each.covered_95) for each in found])
    for covered_68, covered_95 in np.mean(shares, axis=0):
        assert 0.60 < covered_68 < 0.82
        assert 0.89 < covered_95 < 0.99


def test_direction_needs_a_joint_more_certain_than_the_bone_length():
    tree = LEFT.tree
    ends = [n for n, node in enumerate(tree.nodes) if node.is_bone]
    place = {int(node): k for k, node in enumerate(tree.keypoint_nodes) if node >= 0}
    tip = ends[-1]
    points = np.zeros((2, len(LEFT.keypoints), 3))
    points[:, place[tip], 0] = 0.02
    covariance = np.zeros((2, len(LEFT.keypoints), 6))
    covariance[:, :, [0, 3, 5]] = 1e-12
    covariance[1, place[tip], [0, 3, 5]] = 0.03**2
    directions = np.ones((2, len(tree.bones), 3))
    sure = certain_directions(tree, directions, points, covariance)
    bone = tree.nodes[tip].mover
    assert np.isfinite(sure[0, bone]).all()
    assert np.isnan(sure[1, bone]).all()
    assert np.isfinite(directions).all()
