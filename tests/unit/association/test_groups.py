"""Groups of detections: proposals for any order, rig and detector errors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.model.cameras import CameraRig
from tests.properties import examples
from tests.unit.association.single_frames import (
    GROUPS,
    SKELETON,
    detect,
    people_of_proposals,
    people_rig,
    propose_in,
    separated_people,
)


class TestGroups:
    @examples(15)
    @given(n=st.integers(1, 6), cameras=st.integers(3, 8), seed=st.integers(0, 1000))
    def test_every_person_is_one_group_of_all_detections(self, n, cameras, seed):
        rig, truth = people_rig(cameras), separated_people(n, seed)
        frame, owner = detect(rig, truth, seed=seed)
        proposals = propose_in(frame, rig)
        assert sorted(people_of_proposals(proposals, owner), key=min) == [{p} for p in range(n)]
        assert (proposals.rows >= 0).sum() >= 0.97 * len(owner)
        assert (frame.view[proposals.rows] == np.arange(cameras))[proposals.rows >= 0].all()
        for rows, points in zip(proposals.rows, proposals.points_m, strict=True):
            person = owner[rows[rows >= 0][0]]
            assert np.nanmedian(np.linalg.norm(points - truth[person], axis=-1)) < 0.05

    def test_no_detection_is_in_two_proposals_even_where_people_cross(self):
        rig, truth = people_rig(), separated_people(4)
        truth[1] = truth[0] + [0.25, 0.0, 0.0]
        frame, _ = detect(rig, truth)
        rows = propose_in(frame, rig).rows
        assert len(np.unique(rows[rows >= 0])) == (rows >= 0).sum()

    def test_close_people_are_separate_groups(self):
        rig, truth = people_rig(), separated_people(2)
        truth[1] = truth[0] + [0.4, 0.3, 0.0]
        frame, owner = detect(rig, truth)
        assert sorted(people_of_proposals(propose_in(frame, rig), owner), key=min) == [{0}, {1}]

    def test_result_is_independent_of_the_detection_order(self):
        rig, truth = people_rig(), separated_people(4)
        results = []
        for seed in (0, 1):
            frame, owner = detect(rig, truth, sigma_px=0.0, seed=seed)
            actual = propose_in(frame, rig)
            both = zip(actual.rows, actual.points_m, strict=True)
            results.append([(owner[rows[rows >= 0]].tolist(), points) for rows, points in both])
        first, second = (sorted(each, key=lambda p: p[0]) for each in results)
        for a, b in zip(first, second, strict=True):
            assert a[0] == b[0]
            np.testing.assert_allclose(a[1], b[1], atol=1e-6)

    def test_result_is_independent_of_world_coordinates(self):
        rig, truth = people_rig(), separated_people(3)
        frame, _ = detect(rig, truth)
        here = propose_in(frame, rig)
        turn = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, [3.0, -7.0, 2.0]
        moved = CameraRig(
            tuple(replace(c, camera_from_world=c.camera_from_world @ np.linalg.inv(pose)) for c in rig.cameras)
        )
        other = propose_in(frame, moved)
        np.testing.assert_array_equal(here.rows, other.rows)
        np.testing.assert_allclose(here.log_odds, other.log_odds, rtol=1e-6)
        np.testing.assert_allclose(here.torso_m @ turn.T + pose[:3, 3], other.torso_m, atol=1e-6)

    def test_same_frame_gives_the_same_bytes(self):
        rig, truth = people_rig(), separated_people(4)
        frame, _ = detect(rig, truth)
        assert propose_in(frame, rig) == propose_in(frame, rig)

    def test_only_free_detections_are_used(self):
        rig, truth = people_rig(), separated_people(3)
        frame, owner = detect(rig, truth)
        proposals = propose_in(frame, rig, free=owner != 1)
        assert sorted(people_of_proposals(proposals, owner), key=min) == [{0}, {2}]

    def test_two_views_suffice(self):
        rig, truth = people_rig(), separated_people(1)
        frame, _ = detect(rig, truth, hidden=((0, 0), (0, 2), (0, 3)))
        proposals = propose_in(frame, rig)
        assert proposals.n_views.tolist() == [2]
        assert proposals.n_pairs.tolist() == [1]
        everywhere = propose_in(detect(rig, truth)[0], rig)
        assert everywhere.n_views.tolist() == [5]
        assert everywhere.n_pairs.tolist() == [10]
        assert everywhere.log_odds[0] > proposals.log_odds[0] + 10.0

    def test_false_detection_is_in_no_group(self):
        rig, truth = people_rig(), separated_people(2)
        frame, owner = detect(rig, truth)
        odd = frame.keypoints_px[0] * [0.4, 0.5] + [5.0, 300.0]
        frame = replace(
            frame,
            keypoints_px=np.concatenate([odd[None], frame.keypoints_px]),
            confidence=np.concatenate([frame.confidence[:1], frame.confidence]),
            view=np.concatenate([[0], frame.view]),
            track_ids=np.concatenate([[-1], frame.track_ids]),
        )
        assert 0 not in propose_in(frame, rig).rows
        assert sorted(people_of_proposals(propose_in(frame, rig), np.concatenate([[9], owner])), key=min) == [{0}, {1}]

    def test_repeated_detection_is_a_duplicate(self):
        rig, truth = people_rig(), separated_people(2)
        frame, owner = detect(rig, truth)
        twice = np.repeat(np.arange(len(frame.view)), np.where(np.isin(np.arange(len(owner)), [0, 3]), 2, 1))
        again = replace(
            frame,
            keypoints_px=frame.keypoints_px[twice] + np.random.default_rng(1).normal(0.0, 1.0, (len(twice), 17, 2)),
            confidence=frame.confidence[twice],
            view=frame.view[twice],
            track_ids=frame.track_ids[twice],
        )
        proposals = propose_in(again, rig)
        assert len(proposals) == 2
        for row, person in proposals.duplicates:
            assert owner[twice[row]] in people_of_proposals(proposals, owner[twice])[person]
        assert len(proposals.duplicates) == 2

    def test_left_right_swap_of_a_view_is_reported(self):
        rig, truth = people_rig(), separated_people(1)
        frame, _ = detect(rig, truth, sigma_px=1.0)
        pixels = frame.keypoints_px.copy()
        pixels[2] = pixels[2, SKELETON.mirror]
        proposals = propose_in(replace(frame, keypoints_px=pixels), rig)
        assert proposals.rows.tolist() == [[0, 1, 2, 3, 4]]
        assert proposals.swapped.tolist() == [[False, False, True, False, False]]
        assert proposals.used.all()
        assert np.linalg.norm(proposals.points_m[0] - truth[0], axis=-1).max() < 0.03

    def test_known_people_exclude_contradicting_pairs(self):
        rig, truth = people_rig(), separated_people(2)
        frame, owner = detect(rig, truth)
        pairs = propose_in(frame, rig, known_m=truth)
        assert sorted(people_of_proposals(pairs, owner), key=min) == [{0}, {1}]
        # Detections known to show different people are not paired.
        lone, _ = detect(rig, truth[:1], hidden=((0, 2), (0, 3), (0, 4)))
        assert len(propose_in(lone, rig)) == 1
        pixels = rig.project(truth[:1])
        far = rig.cameras[0].center_m + 0.5 * (truth[0] - rig.cameras[0].center_m)
        assert np.abs(rig.project(far)[:, 0] - pixels[0, 0]).max() < 1e-6
        assert len(propose_in(lone, rig, known_m=far[None])) == 0

    def test_no_person_is_proposed_outside_the_volume(self):
        rig, truth = people_rig(), separated_people(3)
        frame, owner = detect(rig, truth)
        box = (-0.5, -3.0, -1.0, 3.0, 3.0, 3.0)
        proposals = propose_in(frame, rig, replace(GROUPS, volume_m=box))
        assert people_of_proposals(proposals, owner) == [{1}]

    def test_covariances_cover_the_truth(self):
        rig, truth = people_rig(), separated_people(4)
        inside = total = 0
        for seed in range(8):
            frame, owner = detect(rig, truth, seed=seed)
            actual = propose_in(frame, rig, replace(GROUPS, sigma_factor=1.0))
            for rows, points, own in zip(actual.rows, actual.points_m, actual.covariance_m2, strict=True):
                off = points - truth[owner[rows[rows >= 0][0]]]
                spread = own[..., [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
                squared = np.einsum("ki,ki->k", off, np.linalg.solve(spread, off[..., None])[..., 0])
                inside += int((squared < 7.815).sum())
                total += len(squared)
        assert 0.92 < inside / total < 0.98

    def test_error_is_in_standard_deviations(self):
        rig, truth = people_rig(), separated_people(4)
        frame, _ = detect(rig, truth)
        # 1.18 per axis, reduced by the 3 of 10 degrees of freedom of each point.
        assert np.median(propose_in(frame, rig).error_sigma) == pytest.approx(1.18 * np.sqrt(0.7), rel=0.12)
