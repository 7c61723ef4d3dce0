"""The simulated detector of several people."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.synthetic.crowd_options import NO_FAULTS, CrowdFaults, CrowdOptions
from posefuse.synthetic.crowds import Kind, crowd_of_points, simulate_crowd
from posefuse.synthetic.options import CLEAN, DetectorOptions
from posefuse.synthetic.rigs import build_rig
from tests.unit.synthetic.test_crowds import cells_of, errors_of, has_detection, points_of

EXACT = replace(CLEAN, sigma_px=0.0)


@pytest.fixture(scope="module")
def crowd():
    return simulate_crowd(CrowdOptions(duration_s=30.0))


class TestDetector:
    def of_still_people(self, law=CLEAN, faults=NO_FAULTS, n_frames=3000, apart_m=1.5, **options):
        """Return two people who stand side by side in five views."""
        one = simulate_crowd(CrowdOptions(people=1, duration_s=0.1)).truth
        pose = np.asarray(one.layers["measured"].points_m)[0, 0]
        pose = pose - np.append(pose[:, :2].mean(axis=0), 0.0)
        aside = np.array([apart_m / 2, 0.0, 0.0])
        points = np.stack([pose - aside, pose + aside])
        rig = build_rig("ring", 5)
        still = np.broadcast_to(points, (n_frames, *points.shape))
        return crowd_of_points(still, rig, one.skeleton, 25.0, detector=law, faults=faults, **options)

    def test_without_faults_every_person_is_detected_once_in_order(self):
        scene = self.of_still_people(EXACT, n_frames=20)
        assert (scene.detections.people_counts == 2).all()
        np.testing.assert_array_equal(scene.owner, np.tile([0, 1], 100))
        assert (scene.kind == Kind.PERSON).all()
        assert np.max(errors_of(scene)) < 1e-9

    def test_errors_have_their_scale_and_correlation_time_and_are_independent(self):
        scene = self.of_still_people(DetectorOptions(outlier_share=0, miss_share=0, swap_share=0))
        frame, view = cells_of(scene)
        exact = scene.rig.project(points_of(scene))[frame, view, scene.owner]
        unit = (np.asarray(scene.detections.keypoints_px) - exact) * np.asarray(scene.detections.confidence)[..., None]
        unit = (unit / (4.5 * 1.92)).reshape(3000, 5, 2, 20, 2)
        assert np.nanmedian(np.abs(unit)) == pytest.approx(0.769, rel=0.05)  # of Student's t with 2.7 degrees
        bounded = np.nan_to_num(np.clip(unit, -4, 4))
        assert 0.78 < (bounded[1:] * bounded[:-1]).mean() / (bounded**2).mean() < 0.9
        flat = bounded[..., 0].reshape(3000, -1)
        assert np.abs(np.corrcoef(flat.T) - np.eye(flat.shape[1])).mean() < 0.06

    @pytest.mark.parametrize(("share", "kind"), [("duplicate_share", Kind.DUPLICATE), ("false_share", Kind.FALSE)])
    def test_false_and_duplicate_detections_have_the_requested_frequency(self, share, kind):
        scene = self.of_still_people(faults=replace(NO_FAULTS, **{share: 0.1}))
        frame, view = cells_of(scene)
        where = np.zeros((3000, 5), dtype=int)
        np.add.at(where, (frame[scene.kind == kind], view[scene.kind == kind]), 1)
        actual = (where > 0).mean() if kind == Kind.FALSE else where.mean() / 2
        assert actual == pytest.approx(0.1, abs=0.04 if kind == Kind.FALSE else 0.015)

    def test_occluded_limbs_are_taken_from_the_person_in_front(self):
        """In the requested share of the time, whole limbs; the rest of the scene stays the same."""
        own, mixed = (
            self.of_still_people(EXACT, replace(NO_FAULTS, taken_share=share), apart_m=0.3) for share in (0.0, 0.5)
        )
        np.testing.assert_array_equal(own.owner, mixed.owner)
        before, after = (np.asarray(scene.detections.keypoints_px).reshape(3000, 5, 2, -1, 2) for scene in (own, mixed))
        changed = (before != after).any(axis=-1)
        np.testing.assert_array_equal(after[changed], before[:, :, ::-1][changed])
        share = changed.mean(axis=0)
        assert share.max() < 0.6
        assert share[share > 0].mean() == pytest.approx(0.5, abs=0.05)
        wrist, elbow = (own.detections.skeleton.index(f"left_{name}") for name in ("wrist", "elbow"))
        np.testing.assert_array_equal(changed[..., wrist], changed[..., elbow])

    def test_missed_detections_have_the_requested_frequency_and_duration(self):
        scene = self.of_still_people(faults=replace(NO_FAULTS, miss_share=0.1))
        observed = has_detection(scene).reshape(3000, -1)
        assert (~observed).mean() == pytest.approx(0.1, abs=0.02)
        assert (~observed).sum() / (~observed[1:] & observed[:-1]).sum() == pytest.approx(7.5, rel=0.2)

    def test_overlapping_people_merge_for_the_requested_share(self):
        scene = self.of_still_people(EXACT, replace(NO_FAULTS, merge_share=0.4), apart_m=0.3)
        merged = scene.kind == Kind.MERGED
        assert merged.sum() / (3000 * 5) == pytest.approx(0.4, abs=0.03)
        assert (has_detection(scene)).all()
        assert set(np.unique(scene.owner[merged])) == {0, 1}
        np.testing.assert_array_equal(scene.other[merged], 1 - scene.owner[merged])
        # Every keypoint is of either, most are of the owner.
        first = errors_of(scene)[merged] < 1e-9
        second = errors_of(replace(scene, owner=np.where(merged, scene.other, scene.owner)))[merged] < 1e-9
        assert (first | second).all()
        assert (first.sum(axis=1) >= second.sum(axis=1)).all()
        assert 0.05 < second.mean() < 0.5

    def test_only_overlapping_people_merge(self):
        scene = self.of_still_people(EXACT, replace(NO_FAULTS, merge_share=1.0), n_frames=5)
        # Along the x axis they stand one behind the other, 1.5 m apart; from the side they do not overlap.
        np.testing.assert_array_equal(np.unique(cells_of(scene)[1][scene.kind == Kind.MERGED]), [0])

    def test_person_behind_is_occluded(self):
        scene = self.of_still_people(EXACT, replace(NO_FAULTS, hidden_miss_share=1.0), n_frames=2)
        # Camera 0 looks along x from +5 m: the second person stands before the first. Cameras 1 and 4 look across.
        missing = np.isnan(np.asarray(scene.detections.confidence))
        _, view = cells_of(scene)
        torso = [scene.truth.skeleton.index(name) for name in ("mid_hip", "neck", "left_hip", "right_hip")]
        behind = missing[(view == 0) & (scene.owner == 0)]
        assert behind[:, torso].all()
        assert not missing[(view == 0) & (scene.owner == 1)].any()
        assert not missing[(view == 1)].any()
        dropped = self.of_still_people(EXACT, replace(NO_FAULTS, visible_share=0.9), n_frames=2)
        assert not has_detection(dropped)[:, 0, 0].any()
        assert has_detection(dropped)[:, 1].all()

    def test_detected_occluded_keypoints_have_less_confidence_and_larger_errors(self):
        law = DetectorOptions(outlier_share=0, miss_share=0, swap_share=0)
        half = replace(NO_FAULTS, hidden_confidence=0.5, hidden_error=2.0)
        hidden, open_ = (self.of_still_people(law, faults, 500) for faults in (half, NO_FAULTS))
        torso = hidden.truth.skeleton.index("mid_hip")
        behind = (cells_of(hidden)[1] == 0) & (hidden.owner == 0)
        confidence = [np.asarray(scene.detections.confidence)[behind, torso] for scene in (hidden, open_)]
        error = [errors_of(scene)[behind, torso] for scene in (hidden, open_)]
        inside = np.isfinite(confidence[0])
        assert inside.mean() > 0.95
        np.testing.assert_allclose(confidence[0][inside], 0.5 * confidence[1][inside])
        np.testing.assert_allclose(error[0][inside], 4.0 * error[1][inside])

    def test_owner_is_close_to_its_detection(self, crowd):
        error = np.full(len(crowd.owner), np.nan)
        error[crowd.owner >= 0] = np.nanmedian(errors_of(crowd)[crowd.owner >= 0], axis=1)
        assert np.median(error[crowd.kind == Kind.PERSON]) < 25
        assert np.quantile(error[crowd.kind == Kind.PERSON], 0.99) < 60
        assert np.quantile(error[crowd.kind == Kind.DUPLICATE], 0.95) < 60
        assert (crowd.owner[crowd.kind == Kind.FALSE] == -1).all()
        assert ((crowd.other >= 0) == (crowd.kind == Kind.MERGED)).all()

    def test_most_people_are_detected_most_of_the_time(self, crowd):
        present = np.isfinite(points_of(crowd)[..., 0]).all(axis=-1)
        observed = has_detection(crowd)[present]
        assert observed.mean() > 0.9
        assert (observed.sum(axis=1) >= 2).mean() > 0.999
        assert 0.003 < (crowd.kind == Kind.DUPLICATE).mean() < 0.04
        assert 0.005 < (crowd.kind == Kind.MERGED).mean() < 0.06

    def test_only_duplicates_give_a_person_two_detections(self, crowd):
        frame, view = cells_of(crowd)
        single = crowd.kind != Kind.DUPLICATE
        for who in (crowd.owner, crowd.other):
            real = single & (who >= 0)
            keys = np.stack([frame, view, who])[:, real]
            assert len(np.unique(keys, axis=1).T) == real.sum()

    def test_detections_are_shuffled(self, crowd):
        frame, view = cells_of(crowd)
        followers = (np.diff(frame) == 0) & (np.diff(view) == 0)
        assert 0.4 < (np.diff(crowd.owner)[followers] > 0).mean() < 0.6

    def test_track_ids_are_optional_and_persistent(self, crowd):
        assert (np.asarray(crowd.detections.track_ids) == -1).all()
        steady = replace(NO_FAULTS, track_ids=True, id_change_hz=0.0, duplicate_share=0.1, false_share=0.1)
        scene = self.of_still_people(faults=steady, n_frames=500)
        frame, view = cells_of(scene)
        ids = np.asarray(scene.detections.track_ids)
        real = scene.kind == Kind.PERSON
        for v in range(5):
            here = real & (view == v)
            pairs = np.unique(np.stack([scene.owner[here], ids[here]]), axis=1)
            assert pairs.shape[1] == 2
            assert len(set(pairs[1])) == 2
        cells = np.stack([frame, view, ids])
        assert len(np.unique(cells, axis=1).T) == len(ids)

    def test_track_ids_change_at_the_requested_rate(self):
        faults = replace(NO_FAULTS, track_ids=True, id_change_hz=0.5)
        scene = self.of_still_people(faults=faults)
        ids = np.asarray(scene.detections.track_ids).reshape(3000, 10)
        assert (np.diff(ids, axis=0) != 0).mean() * 25 == pytest.approx(0.5, rel=0.15)

    def test_track_ids_swap_after_overlaps(self):
        faults = CrowdFaults(track_ids=True, id_change_hz=0.0, id_swap_share=1.0, merge_share=0.0)
        scene = simulate_crowd(CrowdOptions(duration_s=20, faults=faults, people=3))
        _, view = cells_of(scene)
        ids = np.asarray(scene.detections.track_ids)
        owners = [len(set(scene.owner[(view == v) & (ids == i)])) for v in range(5) for i in range(3)]
        assert max(owners) > 1
