"""Proposals of people from single frames, for any order, rig and detector errors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.association.proposals import propose
from posefuse.errors import DetectionsError, OptionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions, RptOptions
from posefuse.model.proposals import Proposals
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import HumanMotion
from posefuse.synthetic.rigs import build_rig
from tests.properties import examples

SKELETON = find_skeleton("coco_17")
GROUPS = AssociationOptions()
PLACES_M = np.array([[-1.6, -1.2], [1.4, -1.0], [-1.0, 1.5], [1.2, 1.4], [0.1, 0.2], [2.0, 0.3]])


def people(n: int, seed: int = 0) -> np.ndarray:
    """Return separated people, shape (n, keypoint, 3)."""
    rng = np.random.default_rng(seed)
    found = []
    for place in PLACES_M[:n]:
        figure = human(float(rng.uniform(1.6, 1.85)))
        motion = HumanMotion.random(("walk", "reach"), rng)
        points = motion.positions(figure, np.array([rng.uniform(0, 5)]))[0, figure.columns(SKELETON)]
        points[:, :2] += place - points[:, :2].mean(axis=0)
        found.append(points)
    return np.array(found)


def rig_of(cameras: int = 5) -> CameraRig:
    return build_rig("ring", cameras, "pinhole", radius_m=5.0, target_m=(0.0, 0.0, 0.9))


def noise_of(rig: CameraRig, scale_px: float = 4.0) -> NoiseModel:
    return NoiseModel(np.full(len(rig), scale_px))


def seen(
    rig: CameraRig, points_m: np.ndarray, sigma_px: float = 4.0, seed: int = 0, hidden: tuple[tuple[int, int], ...] = ()
) -> tuple[Frame, np.ndarray]:
    """Return a frame of people in random order, and each row's person; ``hidden`` (person, view) are not detected."""
    rng = np.random.default_rng(seed)
    pixels = rig.project(points_m) + sigma_px * rng.standard_normal((len(rig), *points_m.shape[:2], 2))
    order = [[p for p in rng.permutation(len(points_m)) if (p, v) not in hidden] for v in range(len(rig))]
    frame = Frame.of_people(
        [pixels[v, order[v]] for v in range(len(rig))], [np.ones((len(each), len(SKELETON))) for each in order], 0.0
    )
    return frame, np.array([p for each in order for p in each])


def found_in(frame: Frame, rig: CameraRig, options: AssociationOptions = GROUPS, **more) -> Proposals:
    free = more.pop("free", np.ones(len(frame.view), dtype=bool))
    return propose(rig, frame, noise_of(rig), SKELETON, free, options, **more)


def who_is_who(proposals: Proposals, who: np.ndarray) -> list[set[int]]:
    """Return the people whose detections each proposal holds."""
    return [{int(who[row]) for row in rows if row >= 0} for rows in proposals.rows]


class TestGroups:
    @examples(15)
    @given(n=st.integers(1, 6), cameras=st.integers(3, 8), seed=st.integers(0, 1000))
    def test_every_person_is_one_group_of_all_their_detections(self, n, cameras, seed):
        rig, truth = rig_of(cameras), people(n, seed)
        frame, who = seen(rig, truth, seed=seed)
        proposals = found_in(frame, rig)
        assert sorted(who_is_who(proposals, who), key=min) == [{p} for p in range(n)]
        assert (proposals.rows >= 0).sum() >= 0.97 * len(who)
        assert (frame.view[proposals.rows] == np.arange(cameras))[proposals.rows >= 0].all()
        for rows, points in zip(proposals.rows, proposals.points_m, strict=True):
            person = who[rows[rows >= 0][0]]
            assert np.nanmedian(np.linalg.norm(points - truth[person], axis=-1)) < 0.05

    def test_no_detection_is_in_two_proposals_even_where_people_cross(self):
        rig, truth = rig_of(), people(4)
        truth[1] = truth[0] + [0.25, 0.0, 0.0]
        frame, _ = seen(rig, truth)
        rows = found_in(frame, rig).rows
        assert len(np.unique(rows[rows >= 0])) == (rows >= 0).sum()

    def test_people_an_arm_apart_are_two(self):
        rig, truth = rig_of(), people(2)
        truth[1] = truth[0] + [0.4, 0.3, 0.0]
        frame, who = seen(rig, truth)
        assert sorted(who_is_who(found_in(frame, rig), who), key=min) == [{0}, {1}]

    def test_the_order_of_detections_changes_nothing(self):
        rig, truth = rig_of(), people(4)
        results = []
        for seed in (0, 1):
            frame, who = seen(rig, truth, sigma_px=0.0, seed=seed)
            found = found_in(frame, rig)
            both = zip(found.rows, found.points_m, strict=True)
            results.append([(who[rows[rows >= 0]].tolist(), points) for rows, points in both])
        first, second = (sorted(each, key=lambda p: p[0]) for each in results)
        for a, b in zip(first, second, strict=True):
            assert a[0] == b[0]
            np.testing.assert_allclose(a[1], b[1], atol=1e-6)

    def test_where_the_world_is_changes_nothing(self):
        rig, truth = rig_of(), people(3)
        frame, _ = seen(rig, truth)
        here = found_in(frame, rig)
        turn = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, [3.0, -7.0, 2.0]
        moved = CameraRig(
            tuple(replace(c, camera_from_world=c.camera_from_world @ np.linalg.inv(pose)) for c in rig.cameras)
        )
        there = found_in(frame, moved)
        np.testing.assert_array_equal(here.rows, there.rows)
        np.testing.assert_allclose(here.log_odds, there.log_odds, rtol=1e-6)
        np.testing.assert_allclose(here.torso_m @ turn.T + pose[:3, 3], there.torso_m, atol=1e-6)

    def test_the_same_frame_gives_the_same_bytes(self):
        rig, truth = rig_of(), people(4)
        frame, _ = seen(rig, truth)
        assert found_in(frame, rig) == found_in(frame, rig)

    def test_only_free_detections_are_used(self):
        rig, truth = rig_of(), people(3)
        frame, who = seen(rig, truth)
        proposals = found_in(frame, rig, free=who != 1)
        assert sorted(who_is_who(proposals, who), key=min) == [{0}, {2}]

    def test_two_views_suffice(self):
        rig, truth = rig_of(), people(1)
        frame, _ = seen(rig, truth, hidden=((0, 0), (0, 2), (0, 3)))
        proposals = found_in(frame, rig)
        assert proposals.n_views.tolist() == [2]
        assert proposals.n_pairs.tolist() == [1]
        everywhere = found_in(seen(rig, truth)[0], rig)
        assert everywhere.n_views.tolist() == [5]
        assert everywhere.n_pairs.tolist() == [10]
        assert everywhere.log_odds[0] > proposals.log_odds[0] + 10.0

    def test_false_detection_is_in_no_group(self):
        rig, truth = rig_of(), people(2)
        frame, who = seen(rig, truth)
        odd = frame.keypoints_px[0] * [0.4, 0.5] + [5.0, 300.0]
        frame = replace(
            frame,
            keypoints_px=np.concatenate([odd[None], frame.keypoints_px]),
            confidence=np.concatenate([frame.confidence[:1], frame.confidence]),
            view=np.concatenate([[0], frame.view]),
            track_ids=np.concatenate([[-1], frame.track_ids]),
        )
        assert 0 not in found_in(frame, rig).rows
        assert sorted(who_is_who(found_in(frame, rig), np.concatenate([[9], who])), key=min) == [{0}, {1}]

    def test_a_detection_given_twice_is_a_duplicate(self):
        rig, truth = rig_of(), people(2)
        frame, who = seen(rig, truth)
        twice = np.repeat(np.arange(len(frame.view)), np.where(np.isin(np.arange(len(who)), [0, 3]), 2, 1))
        again = replace(
            frame,
            keypoints_px=frame.keypoints_px[twice] + np.random.default_rng(1).normal(0.0, 1.0, (len(twice), 17, 2)),
            confidence=frame.confidence[twice],
            view=frame.view[twice],
            track_ids=frame.track_ids[twice],
        )
        proposals = found_in(again, rig)
        assert len(proposals) == 2
        for row, person in proposals.duplicates:
            assert who[twice[row]] in who_is_who(proposals, who[twice])[person]
        assert len(proposals.duplicates) == 2

    def test_a_view_with_its_sides_mixed_up_is_named(self):
        rig, truth = rig_of(), people(1)
        frame, _ = seen(rig, truth, sigma_px=1.0)
        pixels = frame.keypoints_px.copy()
        pixels[2] = pixels[2, SKELETON.mirror]
        proposals = found_in(replace(frame, keypoints_px=pixels), rig)
        assert proposals.rows.tolist() == [[0, 1, 2, 3, 4]]
        assert proposals.swapped.tolist() == [[False, False, True, False, False]]
        assert proposals.used.all()
        assert np.linalg.norm(proposals.points_m[0] - truth[0], axis=-1).max() < 0.03

    def test_known_people_exclude_contradicting_pairs(self):
        rig, truth = rig_of(), people(2)
        frame, who = seen(rig, truth)
        pairs = found_in(frame, rig, known_m=truth)
        assert sorted(who_is_who(pairs, who), key=min) == [{0}, {1}]
        # Said to show different people, two views of one person are no pair.
        lone, _ = seen(rig, truth[:1], hidden=((0, 2), (0, 3), (0, 4)))
        assert len(found_in(lone, rig)) == 1
        pixels = rig.project(truth[:1])
        far = rig.cameras[0].center_m + 0.5 * (truth[0] - rig.cameras[0].center_m)
        assert np.abs(rig.project(far)[0] - pixels[0, 0]).max() < 1e-6
        assert len(found_in(lone, rig, known_m=far[None])) == 0

    def test_no_person_is_proposed_outside_the_volume(self):
        rig, truth = rig_of(), people(3)
        frame, who = seen(rig, truth)
        box = (-0.5, -3.0, -1.0, 3.0, 3.0, 3.0)
        proposals = found_in(frame, rig, replace(GROUPS, volume_m=box))
        assert who_is_who(proposals, who) == [{1}]

    def test_covariances_cover_the_truth(self):
        rig, truth = rig_of(), people(4)
        inside = total = 0
        for seed in range(8):
            frame, who = seen(rig, truth, seed=seed)
            found = found_in(frame, rig, replace(GROUPS, sigma_factor=1.0))
            for rows, points, own in zip(found.rows, found.points_m, found.covariance_m2, strict=True):
                off = points - truth[who[rows[rows >= 0][0]]]
                spread = own[..., [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
                squared = np.einsum("ki,ki->k", off, np.linalg.solve(spread, off[..., None])[..., 0])
                inside += int((squared < 7.815).sum())
                total += len(squared)
        assert 0.92 < inside / total < 0.98

    def test_the_error_is_in_sigmas(self):
        rig, truth = rig_of(), people(4)
        frame, _ = seen(rig, truth)
        # 1.18 per axis, less what the points absorb: 3 of 10 numbers.
        assert np.median(found_in(frame, rig).error_sigma) == pytest.approx(1.18 * np.sqrt(0.7), rel=0.12)


class TestNothing:
    def test_no_detections_give_no_proposals(self):
        rig, truth = rig_of(), people(2)
        frame, _ = seen(rig, truth)
        assert len(found_in(frame, rig, free=np.zeros(len(frame.view), dtype=bool))) == 0
        assert len(found_in(frame, rig, free=frame.view == 1)) == 0
        nobody = np.empty(0, dtype=np.int64)
        empty = Frame(np.empty((0, 17, 2)), np.empty((0, 17)), nobody, nobody, np.zeros(5), np.ones(5, dtype=bool))
        assert found_in(empty, rig).points_m.shape == (0, 17, 3)

    def test_detections_without_keypoints_are_passed_over(self):
        rig, truth = rig_of(), people(1)
        frame, _ = seen(rig, truth)
        pixels = frame.keypoints_px.copy()
        pixels[1] = np.nan
        proposals = found_in(replace(frame, keypoints_px=pixels), rig)
        assert proposals.rows.tolist() == [[0, -1, 2, 3, 4]]

    def test_arrays_of_another_recording_are_refused(self):
        rig, truth = rig_of(), people(1)
        frame, _ = seen(rig, truth)
        with pytest.raises(
            DetectionsError, match=r"has 5 detections in 5 views, but the rig has 5 cameras .* 3 entries"
        ):
            found_in(frame, rig, free=np.ones(3, dtype=bool))
        with pytest.raises(DetectionsError, match="has 17 keypoints per person, but the skeleton 'body_25' has 25"):
            propose(rig, frame, noise_of(rig), find_skeleton("body_25"), np.ones(5, dtype=bool), GROUPS)


class TestBaseline:
    def test_baseline_proposes_people_far_apart(self):
        rig, truth = rig_of(), people(3)
        frame, who = seen(rig, truth, sigma_px=2.0)
        proposals = found_in(frame, rig, AssociationOptions(method="rpt", rpt=RptOptions(min_pairs=4)))
        assert sorted(who_is_who(proposals, who), key=min) == [{0}, {1}, {2}]
        for rows, points in zip(proposals.rows, proposals.points_m, strict=True):
            assert np.nanmedian(np.linalg.norm(points - truth[who[rows[0]]], axis=-1)) < 0.03

    def test_the_mean_of_pairs_is_worse_than_one_solve(self):
        rig, truth = rig_of(), people(3)
        errors = {"groups": [], "rpt": []}
        for seed in range(6):
            frame, who = seen(rig, truth, seed=seed)
            for method, own in errors.items():
                found = found_in(frame, rig, AssociationOptions(method=method, rpt=RptOptions(min_pairs=4)))
                for rows, points in zip(found.rows, found.points_m, strict=True):
                    own.append(np.linalg.norm(points - truth[who[rows[rows >= 0][0]]], axis=-1))
        assert np.nanmedian(errors["groups"]) < 0.95 * np.nanmedian(errors["rpt"])


class TestOptions:
    @pytest.mark.parametrize(
        ("wrong", "message"),
        [
            ({"method": "best"}, "method must be one of groups, rpt, got 'best'"),
            ({"sigma_factor": 0.0}, "sigma_factor must be a finite number above 0, got 0"),
            ({"min_confidence": 2.0}, "min_confidence must be a finite number from 0 to 1"),
            ({"miss_log_odds": 1.0}, "miss_log_odds must be a finite number of at most 0"),
            ({"min_common": 0}, "min_common must be an integer of at least 1"),
            ({"outlier_share": 1.0}, "outlier_share must be a finite number between 0 and 1"),
            ({"full_weight_sigma": 5.0}, "full_weight_sigma must be below zero_weight_sigma"),
            ({"volume_m": (0.0, 0.0, 0.0, 1.0, -1.0, 1.0)}, "each minimum below its maximum"),
        ],
    )
    def test_options_that_mean_nothing_are_refused(self, wrong, message):
        with pytest.raises(OptionsError, match=message):
            AssociationOptions(**wrong)

    def test_those_of_the_baseline_too(self):
        with pytest.raises(OptionsError, match=r"rpt\.min_score must be a finite number from 0 to 1"):
            RptOptions(min_score=1.5)
        with pytest.raises(OptionsError, match=r"rpt\.merged_pairs must be an integer of at least 1"):
            RptOptions(merged_pairs=0)
