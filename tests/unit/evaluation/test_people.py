"""Many people's scores together, from arrays and from reconstructions."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import ResultError
from posefuse.evaluation.head_points import HEAD_RULES, JOINTS, joints_14
from posefuse.evaluation.paired_results import PeoplePoints, only_in_states, people_points
from posefuse.evaluation.people import ScoringOptions, score_people
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.tracks import Tracks, TrackState
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.synthetic.scenes import truth_of
from tests.scenes import body_points, ring

COCO = find_skeleton("coco_17")


def drifting_people(rng, frames: int, people: int) -> np.ndarray:
    """People who keep their pose and drift, 3 m apart: shape (frame, person, 17, 3)."""
    pose = body_points(rng, people)
    drift = np.cumsum(rng.normal(scale=0.002, size=(frames, people, 1, 3)), axis=0)
    return pose + drift + 3.0 * np.arange(people)[:, None, None] * np.array([1.0, 0, 0])


def result_of(points: np.ndarray, covariance_m2: float = 0.0) -> Reconstruction:
    """Points (frame, person, 17, 3) as a reconstruction."""
    one = [truth_of(ring(3), COCO, points[:, p], 25.0) for p in range(points.shape[1])]
    layers = [each.layers["measured"] for each in one]
    joined = {name: np.concatenate([getattr(each, name) for each in layers], axis=1) for name in vars(layers[0])}
    joined["covariance_m2"] = joined["covariance_m2"] + covariance_m2 * np.array([1.0, 0, 0, 1, 0, 1])
    layer = replace(layers[0], **joined)
    ids = tuple(f"person_{p + 1}" for p in range(points.shape[1]))
    return replace(one[0], person_ids=ids, layers={"measured": layer})


def test_reconstructions_of_several_people(rng):
    truth = drifting_people(rng, 50, 3)
    points = truth[:, [2, 0, 1]] + 0.01 * rng.normal(size=truth.shape)
    actual = score_people(people_points(result_of(points, 1e-4), result_of(truth)))
    assert [person.counterpart for person in actual.people] == ["person_2", "person_3", "person_1"]
    assert (actual.clear[0].mota, actual.clear[1].mota, actual.identity.idf1) == (1, 1, 1)
    assert [each.gate_m for each in actual.clear] == [0.5, 0.25]
    assert actual.mpjpe_mm == pytest.approx(10 * math.sqrt(8 / math.pi), rel=0.03)
    assert actual.mpjpe_mm_of["nose"] == pytest.approx(actual.mpjpe_mm, rel=0.2)
    assert actual.nees.mean == pytest.approx(3, rel=0.05)
    assert actual.nees.covered_68 == pytest.approx(0.68, abs=0.03)
    assert actual.pck["0.05"] == pytest.approx(1, abs=0.001)
    assert actual.parts.average_first_three == 1
    assert actual.jitter.ratio > 2
    assert set(actual.bone_variation_of) == {f"{a}-{b}" for a, b in COCO.edges}
    assert actual.recall_after_entry == 1


@pytest.mark.parametrize("scale", [0.057, 1.0, 3.0])
def test_matching_distance_scales_with_the_body(rng, scale):
    truth = drifting_people(rng, 30, 3)
    points = truth + 0.02 * rng.normal(size=(30, 3, 1, 3))
    points[10:20, 0] += np.array([0.8, 0.0, 0.0])
    life = score_people(PeoplePoints(COCO, points, truth))
    actual = score_people(PeoplePoints(COCO, scale * points, scale * truth, scale=scale))
    assert life.clear[0].misses == 10
    assert (actual.clear[0].misses, actual.clear[0].switches) == (life.clear[0].misses, life.clear[0].switches)
    assert [each.gate_m for each in actual.clear] == pytest.approx([0.5 * scale, 0.25 * scale], rel=0.05)
    original = score_people(PeoplePoints(COCO, scale * points, scale * truth, scale=scale), ScoringOptions((7.0,)))
    assert [each.gate_m for each in original.clear] == [7.0]


def test_every_nan_has_its_reason(rng):
    truth = drifting_people(rng, 10, 2)
    away = PeoplePoints(COCO, truth + 50.0, truth)
    actual = score_people(away)
    assert math.isnan(actual.mpjpe_mm)
    assert actual.undefined["mpjpe_mm"] == "no person is matched within 0.5 m"
    assert actual.undefined["recall_after_entry"] == "the frames have no times"
    assert actual.undefined["nees.mean"] == "the layer carries no covariance"
    assert actual.undefined["parts.by_part.9"].startswith("head rule none")
    empty = score_people(PeoplePoints(COCO, truth[:, :0], truth, np.arange(10) / 25))
    assert empty.undefined["clear.0.precision"] == "the result contains no person in these frames"
    assert empty.undefined["bone_variation"] == "no bone is seen twice"
    assert (empty.clear[0].recall, empty.identity.idf1, empty.parts.average) == (0, 0, 0)
    perfect = score_people(PeoplePoints(COCO, truth, truth, np.arange(10) / 25))
    numbers = {path for path, _ in perfect.undefined.items()}
    assert all(path.startswith(("nees", "recall_after_entry", "parts.by")) for path in numbers), numbers


def test_only_shared_frames_count(rng):
    truth = drifting_people(rng, 30, 2)
    later = replace(result_of(truth), frame_numbers=np.arange(30) + 10)
    reference = result_of(np.concatenate([np.zeros_like(truth[:10]), truth])).frames(0, 35)
    actual = score_people(people_points(later, reference))
    assert (actual.n_frames, actual.clear[0].false_people, actual.mpjpe_mm) == (25, 0, 0)
    with pytest.raises(ResultError, match="share no frame number"):
        people_points(replace(later, frame_numbers=np.arange(30) + 100), reference)


def test_truth_may_have_another_rate(rng):
    """People on straight lines, the truth at twice the rate: no error of the matching's own."""
    at = np.arange(41) / 50.0
    pose = body_points(rng, 2) + np.array([0.0, 4.0])[:, None, None]
    fast = pose + at[:, None, None, None]
    reference = result_of(fast)
    reference = replace(reference, rate_hz=50.0, time_s=at)
    actual = score_people(people_points(result_of(fast[::2]), reference))
    assert (actual.matched_by, actual.n_frames) == ("time", 21)
    assert actual.mpjpe_mm < 1e-9


def test_derived_keypoints_are_computed_from_the_result(rng):
    truth = drifting_people(rng, 10, 2)
    panoptic = find_skeleton("panoptic_19")
    reference = np.zeros((10, 2, len(panoptic), 3))
    for name, parts in COCO.sources_of(panoptic).items():
        reference[:, :, panoptic.index(name)] = truth[:, :, [COCO.index(part) for part in parts]].mean(axis=2)
    result = result_of(truth, 1e-4)
    one = truth_of(ring(3), panoptic, reference[:, 0], 25.0)
    data = people_points(result, one)
    assert "neck" in data.skeleton.keypoints
    neck = data.skeleton.index("neck")
    assert data.covariance_m2 is not None
    assert np.isnan(data.covariance_m2[:, :, neck]).all()
    assert np.isfinite(data.covariance_m2[:, :, data.skeleton.index("nose")]).all()
    actual = score_people(data)
    assert actual.mpjpe_mm_of["neck"] == 0
    assert actual.clear[0].false_people == 10
    assert actual.ghosts[0].longest == 10


def test_scores_are_invariant_to_rigid_motion_and_person_order(rng):
    truth = drifting_people(rng, 20, 3)
    points = truth + 0.05 * rng.normal(size=truth.shape)
    points[5:8, 1] = np.nan
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    covariance = np.broadcast_to(np.diag([1.0, 2.0, 3.0]) * 1e-3, (*points.shape, 3))
    times = np.arange(20) / 25
    first = score_people(PeoplePoints(COCO, points, truth, times, covariance))
    order = [2, 0, 1]
    other = score_people(
        PeoplePoints(
            COCO, points[:, order] @ turn.T + 3.0, truth @ turn.T + 3.0, times, turn @ covariance[:, order] @ turn.T
        )
    )
    for name in ("mpjpe_mm", "median_mm", "bone_variation", "recall_after_entry"):
        assert getattr(other, name) == pytest.approx(getattr(first, name)), name
    for name in ("clear", "identity", "hota", "jitter", "nees", "parts"):
        assert flat(getattr(other, name)) == pytest.approx(flat(getattr(first, name)), nan_ok=True), name


def flat(record: object) -> list[float]:
    if isinstance(record, (tuple, list)):
        return [number for each in record for number in flat(each)]
    if isinstance(record, (int, float)):
        return [float(record)]
    return flat(list(vars(record).values())) if hasattr(record, "__dict__") else []


def test_heads_are_derived_from_keypoints_without_truth(rng):
    """A truth of Shelf's 14 joints with heads of its own, made here by Campus's rule from nose and ears."""
    points = drifting_people(rng, 10, 2)
    joints = joints_14(points, COCO, "campus")
    one = [truth_of(ring(3), Skeleton("shelf", JOINTS), joints[:, p], 25.0) for p in range(2)]
    layers = [each.layers["measured"] for each in one]
    layer = replace(
        layers[0], **{f: np.concatenate([getattr(each, f) for each in layers], axis=1) for f in vars(layers[0])}
    )
    reference = replace(one[0], person_ids=("a", "b"), layers={"measured": layer})
    data = people_points(result_of(points), reference)
    assert len(data.skeleton) == 12
    by_rule = {rule: score_people(data, ScoringOptions(head_rule=rule)).parts for rule in HEAD_RULES}
    assert by_rule["campus"].by_part == (1,) * 10
    assert by_rule["none"].by_part[:8] == (1,) * 8
    assert by_rule["shelf"].by_part[8] < 1


def test_evaluation_can_be_limited_to_active_people(rng):
    """Lost for 5 of 20 frames, tentative in 2."""
    truth = result_of(drifting_people(rng, 20, 2))
    state = np.full((20, 2), TrackState.ACTIVE, dtype=np.int8)
    state[:2, 0], state[10:15, 0] = TrackState.TENTATIVE, TrackState.LOST
    result = replace(truth, tracks=Tracks(truth.person_ids, np.zeros((20, 2, 3), dtype=np.int32), state))
    assert score_people(people_points(result, truth)).clear[0].misses == 0
    active = score_people(people_points(only_in_states(result, [TrackState.ACTIVE]), truth)).clear[0]
    assert (active.misses, active.n_found, active.fragments) == (7, 33, 1)
    with pytest.raises(ResultError, match="no tracks"):
        only_in_states(truth, [TrackState.ACTIVE])


def test_arrays_of_other_shapes_are_refused(rng):
    truth = drifting_people(rng, 5, 2)
    with pytest.raises(ResultError, match="points_m: expected"):
        PeoplePoints(COCO, truth[..., :5, :], truth)
    with pytest.raises(ResultError, match="truth_m: expected"):
        PeoplePoints(COCO, truth, truth[:4])
    with pytest.raises(ResultError, match="increasing times"):
        PeoplePoints(COCO, truth, truth, np.zeros(5))
    with pytest.raises(ResultError, match="one name for each of 2 people, got 3"):
        PeoplePoints(COCO, truth, truth, person_ids=("a", "b", "c"))
    with pytest.raises(ResultError, match="covariance_m2: expected"):
        PeoplePoints(COCO, truth, truth, None, np.zeros((5, 2, 17, 6)))
    with pytest.raises(ResultError, match="The truth contains no person"):
        score_people(PeoplePoints(COCO, truth, truth[:, :0]))
    with pytest.raises(ResultError, match="distances above 0 m"):
        ScoringOptions(gates_m=(0.0,))


def test_minute_of_ten_people_is_evaluated_in_seconds(rng):
    truth = drifting_people(rng, 1500, 10)
    points = truth + 0.02 * rng.normal(size=truth.shape)
    covariance = np.broadcast_to(4e-4 * np.eye(3), (*points.shape, 3))
    began = time.process_time()
    score_people(PeoplePoints(COCO, points, truth, np.arange(1500) / 25, covariance))
    assert time.process_time() - began < 15
