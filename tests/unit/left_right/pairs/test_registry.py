"""Pair solvers, which do not trust the labels."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.pairs import OPTIONS, Scene, errors_mm, oracle, scene, solved
from scipy.spatial.transform import Rotation

from posefuse.errors import OptionsError
from posefuse.left_right.pairs import enumerated, population_search
from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import Options
from posefuse.model.options.pairs import PairOptions, SdsOptions
from posefuse.model.options.triangulation import ConsensusOptions
from posefuse.model.reconstruction import unpack_covariance
from posefuse.model.status import PointStatus, ViewStatus
from tests.reference.pairs import cheapest

FULL, NONE = ConsensusOptions().full_weight_sigma ** 2, ConsensusOptions().zero_weight_sigma ** 2
FAULTS = {"outlier": 0.1, "missing": 0.1}
# Steps end at a hundredth of a standard error, which is some 15 mm here.
CLOSE_M = 1e-3


def select_views(data: Scene, views: list[int]) -> Scene:
    """Return the scene as seen by some of the cameras, in that order."""
    rig = data.rig.select([data.rig.names[v] for v in views])
    return replace(
        data, rig=rig, pixels=data.pixels[:, views], truth=data.truth[:, views], inlier=data.inlier[:, views]
    )


def sorted_points(result: SolvedPairs) -> np.ndarray:
    """Return both points in an order independent of the labels, shape (trial, 2, 3); NaN last."""
    points = result.points_m[:, 0].copy()
    order = np.argsort(points[..., 0], axis=1)
    return np.take_along_axis(points, order[..., None], axis=1)


def cost_gaps(trials: int, seed: int) -> np.ndarray:
    """Return by how much the cost exceeds the minimum over all states of two to six views."""
    bound = FULL + (NONE - FULL) / 3
    out = []
    for views in (2, 3, 4, 5, 6):
        data = scene(trials, 7, outlier=0.2, missing=0.15, apart_m=0.25, seed=seed + views)
        data = select_views(data, list(np.random.default_rng(views).permutation(7)[:views]))
        # Without a point every observation costs the bound, except one that may belong to an undetermined point.
        visible = np.isfinite(data.pixels).all(axis=-1).sum(axis=(1, 2))
        cost = solved(data, enumerated.solve).cost[:, 0]
        cost = np.where(np.isnan(cost), bound * np.maximum(visible - 1, 0), cost)
        least = [cheapest(data.rig, pixels, data.sigma_px, FULL, NONE) for pixels in data.pixels]
        out.append(cost - least)
    return np.concatenate(out)


def test_cost_is_the_exhaustive_minimum():
    assert np.abs(cost_gaps(20, 100)).max() < 2e-3


@pytest.mark.long
def test_cost_is_the_exhaustive_minimum_on_two_thousand_cases():
    assert np.abs(cost_gaps(400, 200)).max() < 2e-3


@pytest.mark.parametrize("cameras", [4, 5, 8, 16])
def test_errors_are_close_to_the_oracle(cameras):
    data = scene(600, cameras, outlier=0.05, missing=0.05)
    actual = errors_mm(solved(data, enumerated.solve).points_m[:, 0], data.points_m)
    best = errors_mm(oracle(data), data.points_m)
    both = np.isfinite(actual) & np.isfinite(best)
    assert both.mean() > 0.97
    assert np.median(actual[both]) < 1.05 * np.median(best[both])


def test_swapping_a_views_labels_changes_only_the_order():
    data = scene(300, 6, **FAULTS)
    pixels = data.pixels.copy()
    pixels[:, [1, 4]] = pixels[:, [1, 4]][:, :, ::-1]
    one, other = solved(data, enumerated.solve), solved(replace(data, pixels=pixels), enumerated.solve)
    np.testing.assert_allclose(sorted_points(one), sorted_points(other), atol=CLOSE_M)
    np.testing.assert_allclose(one.cost, other.cost, atol=2e-3)


def test_result_is_independent_of_the_order_of_views():
    data = scene(300, 6, **FAULTS)
    order = [3, 0, 5, 1, 4, 2]
    one, other = solved(data, enumerated.solve), solved(select_views(data, order), enumerated.solve)
    np.testing.assert_allclose(one.points_m, other.points_m, atol=CLOSE_M)
    np.testing.assert_array_equal(one.used[:, :, order], other.used)
    np.testing.assert_allclose(one.evidence[:, :, order], other.evidence, atol=0.05)


def test_result_is_independent_of_world_pose_and_scale():
    data = scene(200, 6, **FAULTS)
    turn, shift, scale = Rotation.random(random_state=3).as_matrix(), np.array([3.0, -20.0, 7.0]), 4.0

    def moved_pose(pose: np.ndarray) -> np.ndarray:
        out = pose.copy()
        out[:3, :3] = pose[:3, :3] @ turn.T
        out[:3, 3] = scale * pose[:3, 3] - out[:3, :3] @ shift
        return out

    cameras = tuple(
        replace(camera, camera_from_world=moved_pose(camera.camera_from_world)) for camera in data.rig.cameras
    )
    moved = replace(data, rig=CameraRig(cameras, up_axis=None))
    one, other = solved(data, enumerated.solve), solved(moved, enumerated.solve)
    np.testing.assert_array_equal(one.status, other.status)
    np.testing.assert_allclose(scale * one.points_m @ turn.T + shift, other.points_m, atol=scale * CLOSE_M)


@pytest.mark.parametrize("method", [enumerated.solve, population_search.solve])
def test_same_seed_gives_the_same_result(method):
    data = scene(20, 5, **FAULTS)
    one, other = solved(data, method), solved(data, method)
    for a, b in zip(one.arrays, other.arrays, strict=True):
        assert a.tobytes() == b.tobytes()


def test_other_seed_gives_a_similar_result():
    data = scene(20, 8, swap=0.25)
    one = solved(data, population_search.solve, PairOptions(seed=0))
    other = solved(data, population_search.solve, PairOptions(seed=1))
    distance = errors_mm(one.points_m[:, 0], other.points_m[:, 0])
    assert 0.0 < np.median(distance) < 5.0


def test_pairs_are_independent():
    data = scene(70, 6, **FAULTS)
    alone = replace(data, pixels=data.pixels[40:41])
    whole, part = solved(data, enumerated.solve), solved(alone, enumerated.solve)
    np.testing.assert_array_equal(whole.points_m[40], part.points_m[0])
    np.testing.assert_array_equal(whole.status[40], part.status[0])


def test_random_numbers_are_independent_of_ranges():
    data = scene(12, 5)
    later = replace(data, pixels=data.pixels[5:])
    whole = solved(data, population_search.solve)
    detections = replace(later.detections, frame_numbers=5 + later.detections.frame_numbers)
    part = population_search.solve(later.rig, detections, later.tracks, later.noise, OPTIONS, [(0, 1)])
    np.testing.assert_array_equal(whole.points_m[5:], part.points_m)


def test_covariances_match_the_errors():
    data = scene(4000, 6, swap=0.25)
    result = solved(data, enumerated.solve)
    points = result.points_m[:, 0]
    straight = np.linalg.norm(points - data.points_m, axis=-1).sum(axis=1)
    crossed = np.linalg.norm(points[:, ::-1] - data.points_m, axis=-1).sum(axis=1)
    truth = np.where((straight <= crossed)[:, None, None], data.points_m, data.points_m[:, ::-1])
    offset = points - truth
    has = (result.status[:, 0] < PointStatus.NOT_SEEN).all(axis=1)
    inverse = np.linalg.inv(unpack_covariance(result.covariance_m2[:, 0])[has])
    squared = np.einsum("nsi,nsij,nsj->ns", offset[has], inverse, offset[has])
    assert (squared < 3.5059).mean() == pytest.approx(0.68, abs=0.02)
    assert (squared < 7.8147).mean() == pytest.approx(0.95, abs=0.012)


def test_both_labels_on_one_limb_give_one_point():
    data = scene(200, 6, swap=0.0)
    rng = np.random.default_rng(4)
    pixels = data.pixels.copy()
    pixels[:, 2, 1] = pixels[:, 2, 0] + 3.0 * rng.standard_normal((200, 2))
    result = solved(replace(data, pixels=pixels), enumerated.solve)
    projected = data.rig.project(data.points_m)[:, 2]
    clear = np.linalg.norm(projected[:, 0] - projected[:, 1], axis=-1) > 60.0
    assert clear.sum() > 50
    right = np.where((result.used[:, 0, 0, 0] == 0)[:, None], [0, 1], [1, 0])[:, 1]
    rests = np.take_along_axis(result.used[:, 0, 2], right[:, None], axis=1)[:, 0]
    assert (rests[clear] == -1).all()
    assert (errors_mm(result.points_m[:, 0], data.points_m) < 60.0).all()


def test_fewer_than_four_rays_give_the_visible_point():
    data = scene(50, 3, swap=0.0)
    pixels = data.pixels.copy()
    pixels[:, :, 0] = np.nan
    result = solved(replace(data, pixels=pixels), enumerated.solve)
    assert np.isin(result.status[:, 0, 1], (PointStatus.OK, PointStatus.AMBIGUOUS)).all()
    assert (result.status[:, 0, 1] == PointStatus.OK).mean() > 0.9
    assert np.isin(result.status[:, 0, 0], (PointStatus.NOT_SEEN, PointStatus.TOO_FEW_VIEWS)).all()
    assert np.isnan(result.points_m[:, 0, 0]).all()
    assert np.linalg.norm(result.points_m[:, 0, 1] - data.points_m[:, 1], axis=-1).max() < 0.2
    assert (result.view_status[:, 0, :, 0] == ViewStatus.UNSEEN).all()
    assert (solved(replace(data, pixels=pixels), population_search.solve).status == PointStatus.TOO_FEW_VIEWS).all()


def test_no_observations_give_no_point():
    data = scene(3, 4)
    result = solved(replace(data, pixels=np.full_like(data.pixels, np.nan)), enumerated.solve)
    assert (result.status == PointStatus.NOT_SEEN).all()
    assert np.isnan(result.points_m).all()
    assert np.isnan(result.covariance_m2).all()
    assert (result.used == -1).all()
    assert np.isnan(result.view_error_px).all()
    assert (result.evidence == 0.0).all()


def test_points_of_two_views_are_ambiguous():
    result = solved(select_views(scene(100, 7, swap=0.0), [0, 2]), enumerated.solve)
    has = result.status < PointStatus.NOT_SEEN
    assert has.any()
    assert (result.status[has] == PointStatus.AMBIGUOUS).all()


def test_evidence_identifies_swapped_views():
    data = scene(400, 8, swap=0.2)
    result = solved(data, enumerated.solve)
    swapped = data.truth[..., 0] == 1
    straight = np.linalg.norm(result.points_m[:, 0] - data.points_m, axis=-1).sum(axis=1)
    crossed = np.linalg.norm(result.points_m[:, 0, ::-1] - data.points_m, axis=-1).sum(axis=1)
    in_order = straight <= crossed
    warnings = result.evidence[:, 0] > 0
    sure = np.abs(result.evidence[:, 0]) > 6.0
    assert in_order.mean() > 0.9
    agree = warnings == np.where(in_order[:, None], swapped, ~swapped)
    assert agree[sure].mean() > 0.99


def test_previous_frame_resolves_ambiguity():
    data = scene(900, 4, walk=True, outlier=0.15, missing=0.15, seed=5)
    alone = solved(data, enumerated.solve)
    helped = solved(data, enumerated.solve, PairOptions(motion_sd_m=0.05))

    def wrong(result: SolvedPairs) -> int:
        points = result.points_m[:, 0]
        return int((np.isnan(points).any(axis=(1, 2)) | (errors_mm(points, data.points_m) > 100.0)).sum())

    assert wrong(helped) <= wrong(alone)


def test_sds_weights_are_options():
    data = scene(40, 8, swap=0.25)
    usual = errors_mm(solved(data, population_search.solve).points_m[:, 0], data.points_m)
    deaf = PairOptions(sds=SdsOptions(ray_weight=0.0))
    assert (
        np.median(usual)
        < 20.0
        < np.median(errors_mm(solved(data, population_search.solve, deaf).points_m[:, 0], data.points_m))
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Options(**{"pairs": "enumerated"}), "pairs must be one of enumerate, sds, labels, got 'enumerated'"),
        (lambda: PairOptions(motion_sd_m=0.0), "pair_search.motion_sd_m must be a number above 0"),
        (lambda: PairOptions(seed=-1), "pair_search.seed must be an integer of at least 0"),
        (lambda: SdsOptions(ray_weight=-1.0), "pair_search.sds.ray_weight must be a finite number of at least 0"),
        (lambda: SdsOptions(jitter_mm=0.0), "pair_search.sds.jitter_mm must be a finite number above 0"),
        (lambda: SdsOptions(agents=1), "pair_search.sds.agents must be an integer from 2 to 10000"),
        (lambda: SdsOptions(max_iterations=0), "pair_search.sds.max_iterations must be an integer from 1 to"),
    ],
)
def test_invalid_options_are_errors(make, message):
    with pytest.raises(OptionsError, match=message):
        make()
