"""Several people: the truth of each scenario, and a detector for crowds that follows its law."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from posefuse.errors import OptionsError, SkeletonError
from posefuse.model.status import PointStatus
from posefuse.synthetic.crowd_options import NO_FAULTS, SCENARIOS, CrowdFaults, CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, Kind, crowd_of_points, simulate_crowd
from posefuse.synthetic.options import CLEAN, DetectorOptions
from posefuse.synthetic.rigs import build_rig
from tests.scenes import skeleton_of

EXACT = replace(CLEAN, sigma_px=0.0)
SOME = {"crowd": 12.0, "ten": 5.0}


def points_of(scene: CrowdScene) -> np.ndarray:
    """Shape (frame, person, keypoint, 3)."""
    return np.asarray(scene.truth.layers["measured"].points_m)


def cells_of(scene: CrowdScene) -> tuple[np.ndarray, np.ndarray]:
    """Frame and view of each row."""
    found = scene.detections
    cell = np.repeat(np.arange(found.n_frames * found.n_views), found.people_counts.ravel())
    return cell // found.n_views, cell % found.n_views


def seen_by(scene: CrowdScene) -> np.ndarray:
    """Shape (frame, person, view), bool: whether a person has a part in a detection."""
    frame, view = cells_of(scene)
    seen = np.zeros((scene.detections.n_frames, points_of(scene).shape[1], scene.detections.n_views), dtype=bool)
    for who in (scene.owner, scene.other):
        real = who >= 0
        seen[frame[real], who[real], view[real]] = True
    return seen


def errors_of(scene: CrowdScene, rig=None) -> np.ndarray:
    """Shape (row, keypoint), px: from the owner's true projection; NaN where there is none."""
    frame, view = cells_of(scene)
    exact = (rig or scene.rig).project(points_of(scene))
    error = np.linalg.norm(np.asarray(scene.detections.keypoints_px) - exact[view, frame, scene.owner], axis=-1)
    error[scene.owner < 0] = np.nan
    return error


def gaps_of(scene: CrowdScene) -> np.ndarray:
    """Shape (frame,): the least distance of two torso axes, m; infinite where fewer than two are there."""
    skeleton, points = scene.truth.skeleton, points_of(scene)
    low, high = (points[:, :, skeleton.index(name)] for name in ("mid_hip", "neck"))
    axes = low[:, :, None] + np.linspace(0, 1, 6)[:, None] * (high - low)[:, :, None]
    n = points.shape[1]
    pairs = [(p, q) for p in range(n) for q in range(p)]
    apart = [np.linalg.norm(axes[:, p, :, None] - axes[:, q, None], axis=-1).min(axis=(1, 2)) for p, q in pairs]
    return np.nan_to_num(np.array(apart), nan=np.inf).min(axis=0)


def span_of(scene: CrowdScene, what: str):
    return next(span for span in scene.spans if span.what == what)


def during(scene: CrowdScene, span) -> np.ndarray:
    time_s = scene.truth.time_s
    return (time_s >= span.from_s) & (time_s < span.to_s)


@pytest.fixture(scope="module", params=SCENARIOS)
def any_scene(request):
    return simulate_crowd(CrowdOptions(request.param, duration_s=SOME.get(request.param), seed=1))


@pytest.fixture(scope="module")
def crowd():
    return simulate_crowd(CrowdOptions(duration_s=30.0))


class TestTruth:
    def test_bones_keep_their_length(self, any_scene):
        points, skeleton = points_of(any_scene), any_scene.truth.skeleton
        for limb in ("arm", "leg"):
            for inner, outer in pairwise(skeleton.chains[limb]):
                for upper, lower in zip(inner, outer, strict=True):
                    bone = points[:, :, skeleton.index(upper)] - points[:, :, skeleton.index(lower)]
                    assert (
                        np.ptp(np.linalg.norm(bone[np.isfinite(bone).all(axis=(1, 2))], axis=-1), axis=0).max() < 1e-9
                    )

    def test_people_are_there_when_said_and_nothing_in_between(self, any_scene):
        points = points_of(any_scene)
        there = np.isfinite(points).all(axis=(2, 3))
        for p in range(points.shape[1]):
            said = [during(any_scene, s) for s in any_scene.spans if s.what == "present" and s.person == p]
            np.testing.assert_array_equal(there[:, p], np.any(said, axis=0))
        status = any_scene.truth.layers["measured"].status
        assert (status[~there] == PointStatus.NOT_SEEN).all()
        assert (status[there] == PointStatus.OK).all()
        assert any_scene.truth.person_ids == tuple(f"person_{p + 1}" for p in range(points.shape[1]))

    def test_nobody_walks_through_anybody(self, any_scene):
        hugging = any(span.what == "hug" for span in any_scene.spans)
        assert gaps_of(any_scene).min() > (0.2 if hugging else 0.35)

    def test_people_walk_on_the_floor_at_a_walk(self, any_scene):
        points, rate_hz = points_of(any_scene), any_scene.detections.rate_hz
        hips = points[:, :, any_scene.truth.skeleton.index("mid_hip")]
        pace = np.linalg.norm(np.diff(hips, axis=0), axis=-1) * rate_hz
        assert np.nanmax(pace) < 2.2
        assert 0.02 < np.nanmin(points[..., 2]) < 0.25
        ankles = points[:, :, any_scene.truth.skeleton.index("left_ankle")]
        assert np.nanmax(np.linalg.norm(np.diff(ankles, axis=0), axis=-1)) * rate_hz < 6.0

    def test_paths_cross(self, crowd):
        middle = points_of(crowd)[:, :2, crowd.truth.skeleton.index("mid_hip"), :2]
        bearing = np.unwrap(np.arctan2(*(middle[:, 0] - middle[:, 1]).T[::-1]))
        assert (gaps_of(crowd) < 1.0).mean() > 0.1
        assert np.ptp(bearing) > np.pi

    def test_the_same_walk_at_any_rate(self):
        slow, fast = (simulate_crowd(CrowdOptions("crowd", duration_s=8.0, rate_hz=hz)) for hz in (25.0, 100.0))
        np.testing.assert_allclose(points_of(slow), points_of(fast)[::4], atol=1e-9)

    def test_statures(self):
        options = CrowdOptions("hug", statures_m=(1.5, 1.8), detector=EXACT, faults=NO_FAULTS)
        scene = simulate_crowd(options)
        skeleton = scene.truth.skeleton
        thigh = [skeleton.index("left_hip"), skeleton.index("left_knee")]
        lengths = np.linalg.norm(np.subtract(*(points_of(scene)[0, :, k] for k in thigh)), axis=-1)
        np.testing.assert_allclose(lengths, 0.43 * np.array([1.5, 1.8]) / 1.75)


class TestScenarios:
    @pytest.mark.parametrize("seed", range(3))
    def test_a_hug_is_merged_everywhere_for_at_most_one_and_a_half_seconds(self, seed):
        scene = simulate_crowd(CrowdOptions("hug", seed=seed))
        frame, view = cells_of(scene)
        merged = np.zeros((scene.detections.n_frames, len(scene.rig)), dtype=bool)
        merged[frame[scene.other >= 0], view[scene.other >= 0]] = True
        everywhere = merged.all(axis=1).sum() / 25.0
        assert 0.7 < everywhere <= 1.5
        hug = span_of(scene, "hug")
        assert 1.0 <= hug.to_s - hug.from_s <= 2.0
        assert gaps_of(scene)[during(scene, hug)].max() < 0.45

    @pytest.mark.parametrize("equal", [False, True])
    def test_huggers_swap_places_and_differ_by_8_percent_or_not(self, equal):
        scene = simulate_crowd(CrowdOptions("hug", seed=4, equal_statures=equal))
        skeleton, points = scene.truth.skeleton, points_of(scene)
        apart = np.subtract(*(points[:, p, skeleton.index("mid_hip")] for p in (0, 1)))
        before = apart[during(scene, span_of(scene, "hug"))][0]
        assert np.dot(before, apart[-1]) / np.linalg.norm(before) / np.linalg.norm(apart[-1]) < -0.95
        thigh = np.linalg.norm(
            points[0, :, skeleton.index("left_hip")] - points[0, :, skeleton.index("left_knee")], axis=-1
        )
        assert thigh.max() / thigh.min() == pytest.approx(1.0 if equal else 1.08)

    def test_one_leaves_for_five_seconds_and_another_stays(self):
        scene = simulate_crowd(CrowdOptions("leave", seed=2))
        there = np.isfinite(points_of(scene)[..., 0]).all(axis=-1)
        assert there[:, 0].all()
        assert (~there[:, 1]).sum() == pytest.approx(125, abs=1)
        assert there[[0, -1], 1].all()

    @pytest.mark.parametrize("cameras", [5, 8])
    def test_one_camera_alone_sees_a_person_for_two_seconds(self, cameras):
        scene = simulate_crowd(CrowdOptions("one_camera", cameras=cameras, seed=3))
        span = span_of(scene, "hidden")
        seen = seen_by(scene)[during(scene, span), span.person]
        assert len(seen) == pytest.approx(50, abs=1)
        assert not np.delete(seen, span.view, axis=1).any()
        assert seen[:, span.view].mean() > 0.9
        assert seen_by(scene)[during(scene, span), 1 - span.person].sum(axis=1).mean() > 0.6 * cameras

    def test_a_dark_camera_shows_nothing_for_ten_seconds(self):
        scene = simulate_crowd(CrowdOptions("dark"))
        span = span_of(scene, "dark")
        assert span.to_s - span.from_s == pytest.approx(10.0)
        counts = scene.detections.people_counts
        assert not counts[during(scene, span), span.view].any()
        assert counts[~during(scene, span), span.view].mean() > 2
        assert np.delete(counts[during(scene, span)], span.view, axis=1).mean() > 2

    def test_a_bumped_camera_has_turned_by_twenty_degrees(self):
        scene = simulate_crowd(CrowdOptions("bumped", detector=EXACT, faults=NO_FAULTS))
        span = span_of(scene, "bumped")
        old, new = scene.rig.cameras[span.view], scene.true_rig.cameras[span.view]
        np.testing.assert_allclose(old.center_m, new.center_m, atol=1e-12)
        turn = np.degrees(np.arccos((np.trace(old.rotation @ new.rotation.T) - 1) / 2))
        assert turn == pytest.approx(20.0)
        frame, view = cells_of(scene)
        after = during(scene, span)[frame] & (view == span.view)
        assert np.nanmax(errors_of(scene)[~after]) < 1e-6
        assert np.nanmin(errors_of(scene)[after]) > 100
        assert np.nanmax(errors_of(scene, scene.true_rig)[after]) < 1e-6


class TestDetector:
    def of_still_people(self, law=CLEAN, faults=NO_FAULTS, n_frames=3000, apart_m=1.5, **options):
        """Two people who stand still side by side, as five cameras see them."""
        one = simulate_crowd(CrowdOptions(people=1, duration_s=0.1)).truth
        pose = np.asarray(one.layers["measured"].points_m)[0, 0]
        pose = pose - np.append(pose[:, :2].mean(axis=0), 0.0)
        aside = np.array([apart_m / 2, 0.0, 0.0])
        points = np.stack([pose - aside, pose + aside])
        rig = build_rig("ring", 5)
        still = np.broadcast_to(points, (n_frames, *points.shape))
        return crowd_of_points(still, rig, one.skeleton, 25.0, detector=law, faults=faults, **options)

    def test_without_faults_everybody_is_seen_once_in_order_where_they_are(self):
        scene = self.of_still_people(EXACT, n_frames=20)
        assert (scene.detections.people_counts == 2).all()
        np.testing.assert_array_equal(scene.owner, np.tile([0, 1], 100))
        assert (scene.kind == Kind.PERSON).all()
        assert np.max(errors_of(scene)) < 1e-9

    def test_errors_have_their_scale_last_and_are_everybodys_own(self):
        scene = self.of_still_people(DetectorOptions(outlier_share=0, miss_share=0, swap_share=0))
        frame, view = cells_of(scene)
        exact = scene.rig.project(points_of(scene))[view, frame, scene.owner]
        unit = (np.asarray(scene.detections.keypoints_px) - exact) * np.asarray(scene.detections.confidence)[..., None]
        unit = (unit / (4.5 * 1.92)).reshape(3000, 5, 2, 20, 2)
        assert np.nanmedian(np.abs(unit)) == pytest.approx(0.769, rel=0.05)  # of Student's t with 2.7 degrees
        bounded = np.nan_to_num(np.clip(unit, -4, 4))
        assert 0.78 < (bounded[1:] * bounded[:-1]).mean() / (bounded**2).mean() < 0.9
        flat = bounded[..., 0].reshape(3000, -1)
        assert np.abs(np.corrcoef(flat.T) - np.eye(flat.shape[1])).mean() < 0.06

    @pytest.mark.parametrize(("share", "kind"), [("duplicate_share", Kind.DUPLICATE), ("false_share", Kind.FALSE)])
    def test_too_many_people_come_as_often_as_asked(self, share, kind):
        scene = self.of_still_people(faults=replace(NO_FAULTS, **{share: 0.1}))
        frame, view = cells_of(scene)
        where = np.zeros((3000, 5), dtype=int)
        np.add.at(where, (frame[scene.kind == kind], view[scene.kind == kind]), 1)
        found = (where > 0).mean() if kind == Kind.FALSE else where.mean() / 2
        assert found == pytest.approx(0.1, abs=0.04 if kind == Kind.FALSE else 0.015)

    def test_people_are_missed_as_often_as_asked_in_spells(self):
        scene = self.of_still_people(faults=replace(NO_FAULTS, miss_share=0.1))
        seen = seen_by(scene).reshape(3000, -1)
        assert (~seen).mean() == pytest.approx(0.1, abs=0.02)
        assert (~seen).sum() / (~seen[1:] & seen[:-1]).sum() == pytest.approx(7.5, rel=0.2)

    def test_those_who_overlap_melt_for_the_share_asked(self):
        scene = self.of_still_people(EXACT, replace(NO_FAULTS, merge_share=0.4), apart_m=0.3)
        merged = scene.kind == Kind.MERGED
        assert merged.sum() / (3000 * 5) == pytest.approx(0.4, abs=0.03)
        assert (seen_by(scene)).all()
        assert set(np.unique(scene.owner[merged])) == {0, 1}
        np.testing.assert_array_equal(scene.other[merged], 1 - scene.owner[merged])
        # Every keypoint is of either, most are of the owner.
        mine = errors_of(scene)[merged] < 1e-9
        theirs = errors_of(replace(scene, owner=np.where(merged, scene.other, scene.owner)))[merged] < 1e-9
        assert (mine | theirs).all()
        assert (mine.sum(axis=1) >= theirs.sum(axis=1)).all()
        assert 0.05 < theirs.mean() < 0.5

    def test_only_those_who_overlap_melt(self):
        scene = self.of_still_people(EXACT, replace(NO_FAULTS, merge_share=1.0), n_frames=5)
        # Along the x axis they stand one behind the other, 1.5 m apart; from the side they do not overlap.
        np.testing.assert_array_equal(np.unique(cells_of(scene)[1][scene.kind == Kind.MERGED]), [0])

    def test_the_one_behind_is_hidden(self):
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
        assert not seen_by(dropped)[:, 0, 0].any()
        assert seen_by(dropped)[:, 1].all()

    def test_what_is_hidden_and_seen_all_the_same_is_less_sure_and_less_exact(self):
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

    def test_the_owner_is_near(self, crowd):
        error = np.full(len(crowd.owner), np.nan)
        error[crowd.owner >= 0] = np.nanmedian(errors_of(crowd)[crowd.owner >= 0], axis=1)
        assert np.median(error[crowd.kind == Kind.PERSON]) < 25
        assert np.quantile(error[crowd.kind == Kind.PERSON], 0.99) < 60
        assert np.quantile(error[crowd.kind == Kind.DUPLICATE], 0.95) < 60
        assert (crowd.owner[crowd.kind == Kind.FALSE] == -1).all()
        assert ((crowd.other >= 0) == (crowd.kind == Kind.MERGED)).all()

    def test_most_people_are_seen_most_of_the_time(self, crowd):
        there = np.isfinite(points_of(crowd)[..., 0]).all(axis=-1)
        seen = seen_by(crowd)[there]
        assert seen.mean() > 0.9
        assert (seen.sum(axis=1) >= 2).mean() > 0.999
        assert 0.003 < (crowd.kind == Kind.DUPLICATE).mean() < 0.04
        assert 0.005 < (crowd.kind == Kind.MERGED).mean() < 0.06

    def test_no_person_has_two_detections_but_duplicates(self, crowd):
        frame, view = cells_of(crowd)
        single = crowd.kind != Kind.DUPLICATE
        for who in (crowd.owner, crowd.other):
            real = single & (who >= 0)
            keys = np.stack([frame, view, who])[:, real]
            assert len(np.unique(keys, axis=1).T) == real.sum()

    def test_people_come_in_any_order(self, crowd):
        frame, view = cells_of(crowd)
        followers = (np.diff(frame) == 0) & (np.diff(view) == 0)
        assert 0.4 < (np.diff(crowd.owner)[followers] > 0).mean() < 0.6

    def test_identities_are_told_only_when_asked_and_last(self, crowd):
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

    def test_identities_change_as_often_as_asked(self):
        faults = replace(NO_FAULTS, track_ids=True, id_change_hz=0.5)
        scene = self.of_still_people(faults=faults)
        ids = np.asarray(scene.detections.track_ids).reshape(3000, 10)
        assert (np.diff(ids, axis=0) != 0).mean() * 25 == pytest.approx(0.5, rel=0.15)

    def test_identities_swap_where_people_part(self):
        faults = CrowdFaults(track_ids=True, id_change_hz=0.0, id_swap_share=1.0, merge_share=0.0)
        scene = simulate_crowd(CrowdOptions(duration_s=20, faults=faults, people=3))
        _, view = cells_of(scene)
        ids = np.asarray(scene.detections.track_ids)
        owners = [len(set(scene.owner[(view == v) & (ids == i)])) for v in range(5) for i in range(3)]
        assert max(owners) > 1


class TestSceneOptions:
    def test_the_seed_decides(self):
        one, same, other = (simulate_crowd(CrowdOptions(duration_s=2, seed=seed)) for seed in (4, 4, 5))
        assert one.detections == same.detections
        assert one.truth == same.truth
        np.testing.assert_array_equal(one.owner, same.owner)
        assert one.detections != other.detections

    def test_the_walks_do_not_depend_on_the_detector(self):
        one, other = (simulate_crowd(CrowdOptions(duration_s=2, detector=law)) for law in (CLEAN, DetectorOptions()))
        np.testing.assert_array_equal(points_of(one), points_of(other))

    @pytest.mark.parametrize("skeleton", ["coco_17", "halpe_26", "coco_wholebody_133"])
    def test_any_human_skeleton(self, skeleton):
        scene = simulate_crowd(CrowdOptions(skeleton=skeleton, duration_s=0.5))
        assert scene.detections.skeleton.name == skeleton

    def test_views_may_swap_differently(self):
        law = replace(EXACT, swap_law="pair", swap_shares=(0.3, 0.0, 0.0))
        scene = simulate_crowd(CrowdOptions(duration_s=4, cameras=3, detector=law, faults=NO_FAULTS))
        wrong = errors_of(scene) > 1
        _, view = cells_of(scene)
        assert wrong[view == 0].mean() > 0.1
        assert not wrong[view > 0].any()

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            ({"scenario": "dance"}, "scenario must be one of crowd.* got 'dance'"),
            ({"people": 0}, "from 1 to 30, got 0"),
            ({"scenario": "hug", "people": 3}, "hug has 2 people, got 3"),
            ({"scenario": "leave", "people": 1}, "2 to 30 people"),
            ({"scenario": "hug", "duration_s": 5.0}, "at least 16 s"),
            ({"cameras": 1}, "from 2 to 32, got 1"),
            ({"rate_hz": 0.0}, "rate_hz must be a finite number above 0 Hz"),
            ({"statures_m": (1.7,)}, "one value for each of 4 people, got 1"),
            ({"statures_m": (1.7, 1.7, 1.7, 17.0)}, "from 0.5 to 2.5 m"),
            ({"detector": DetectorOptions(max_offset_s=0.1)}, "one clock"),
        ],
    )
    def test_impossible_scenes(self, change, words):
        with pytest.raises(OptionsError, match=words):
            CrowdOptions(**change)

    @pytest.mark.parametrize(
        "change",
        [{"merge_share": 1.5}, {"hidden_confidence": 0.0}, {"smallest_px": -1.0}, {"visible_share": float("nan")}],
    )
    def test_impossible_faults(self, change):
        with pytest.raises(OptionsError, match=next(iter(change))):
            CrowdFaults(**change)

    def test_only_humans(self, tmp_path):
        (tmp_path / "fly.toml").write_text('name = "fly"\nkeypoints = ["antenna"]')
        with pytest.raises(SkeletonError, match="is not human: the human figure has no antenna"):
            simulate_crowd(CrowdOptions(skeleton=str(tmp_path / "fly.toml")))

    def test_points_of_another_shape(self):
        with pytest.raises(OptionsError, match=r"expected \(frame, person, 17"):
            crowd_of_points(np.zeros((5, 17, 3)), build_rig("ring", 3), skeleton_of(17), 25.0)

    def test_points_of_a_skeleton_without_a_body(self):
        points = np.random.default_rng(0).normal(0, 0.3, (10, 2, 5, 3)) + np.array([0.0, 0.0, 1.0])
        scene = crowd_of_points(points, build_rig("ring", 3), skeleton_of(5), 25.0, faults=NO_FAULTS)
        assert seen_by(scene).all()
