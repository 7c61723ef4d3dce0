"""Left and right: what every method must and must not do, and that chains gets it right."""

from dataclasses import dataclass, fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.errors import OptionsError, PosefuseWarning
from posefuse.left_right.layout import Layout
from posefuse.left_right.online import OnlineSides, advance
from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.left_right.registry import decide_sides
from posefuse.left_right.results import PairsInTime, Sides
from posefuse.model.options.left_right import SideOptions
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.synthetic.detector import detect
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import HumanMotion
from posefuse.synthetic.options import DetectorOptions, SwapLaw
from posefuse.synthetic.rigs import build_rig
from tests.pairs import solved

RATE_HZ = 30.0


@dataclass(frozen=True)
class Scene:
    """A person whose labels were swapped, and the truth."""

    given: PairsInTime
    truth_m: np.ndarray
    swapped: np.ndarray

    def wrong(self, sides: Sides) -> np.ndarray:
        """Shape (frame, pair), bool; joints less than 5 cm apart cannot be."""
        points = sides.applied(self.given.pairs).points_m
        own = np.linalg.norm(points - self.truth_m, axis=-1).sum(axis=-1)
        other = np.linalg.norm(points - self.truth_m[:, :, ::-1], axis=-1).sum(axis=-1)
        apart = np.linalg.norm(self.truth_m[:, :, 0] - self.truth_m[:, :, 1], axis=-1)
        return (other < own) & (apart > 0.05)


def scene(
    law: SwapLaw = "chain",
    cameras: int = 5,
    share: float = 0.25,
    seconds: float = 5.0,
    skeleton: str = "coco_17",
    missing: float = 0.0,
    seed: int = 0,
) -> Scene:
    """A figure that walks in a circle."""
    rng = np.random.default_rng(seed)
    keypoints, figure = find_skeleton(skeleton), human(1.75)
    times = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    truth = HumanMotion.random(("walk",), rng).positions(figure, times)[:, figure.columns(keypoints)]
    rig = build_rig("ring", cameras, radius_m=4.5, focal_px=1500.0)
    errors = DetectorOptions("gaussian", 5.0, 0.0, (0.0, 0.0), missing, share, 0.0, law)
    seen = np.repeat(truth[:, None], cameras, axis=1)
    detections = detect(rig, seen, keypoints, RATE_HZ, errors, rng)
    columns = keypoints.pair_indices
    pixels = np.moveaxis(rig.project(truth), 0, 1)
    off = np.linalg.norm(detections.dense()[0][:, :, columns] - pixels[:, :, columns][..., ::-1, :], axis=-1).sum(-1)
    as_is = np.linalg.norm(detections.dense()[0][:, :, columns] - pixels[:, :, columns], axis=-1).sum(axis=-1)
    pairs = solved(rig, truth, detections, 5.0, rng)
    midline = truth[:, None] + 0.01 * rng.standard_normal(truth[:, None].shape)
    confidence = np.full((len(times), 1, len(columns), cameras, 2), 0.8)
    given = PairsInTime(pairs, keypoints, rig, times, confidence, midline)
    return Scene(given, truth[:, columns], off < as_is)


def sides_of(given: PairsInTime, method: str = "chains", **options: object) -> Sides:
    return decide_sides(given, method, SideOptions(**options))  # type: ignore[arg-type]


def changed(given: PairsInTime, **arrays: np.ndarray) -> PairsInTime:
    return replace(given, pairs=replace(given.pairs, **arrays))


def exchanged(given: PairsInTime, which: np.ndarray) -> PairsInTime:
    """The same with the two points of some pairs (frame, pair) in the other order."""
    order = Sides(which[:, None], np.zeros((len(which), 1, 0, 0), np.int8), ())
    return replace(given, pairs=order.applied(given.pairs))


def online(given: PairsInTime, options: SideOptions | None = None) -> Sides:
    state, decided = OnlineSides.start(given.skeleton, options), []
    for t in range(given.n_frames):
        state, sides = advance(state, frame_of(given, t))
        decided.append(sides)
    flipped, swapped = (np.concatenate([getattr(s, n) for s in decided]) for n in ("flipped", "chain_swapped"))
    return Sides(flipped, swapped, decided[0].chains)


def frame_of(given: PairsInTime, t: int) -> PairsInTime:
    now = slice(t, t + 1)
    pairs = SolvedPairs(*(getattr(given.pairs, field.name)[now] for field in fields(SolvedPairs)))
    midline = None if given.midline_m is None else given.midline_m[now]
    return replace(given, pairs=pairs, time_s=given.time_s[now], midline_m=midline, confidence=None)


@pytest.fixture(scope="module")
def swapped() -> Scene:
    return scene()


class TestChains:
    @pytest.mark.parametrize(("cameras", "most"), [(8, 0.005), (5, 0.01), (3, 0.02)])
    @pytest.mark.parametrize("law", ["chain", "pair", "body"])
    def test_sides_are_right(self, law, cameras, most):
        data = scene(law, cameras, skeleton="halpe_26")
        assert data.wrong(sides_of(data.given)).mean() <= most
        assert data.wrong(online(data.given)).mean() <= 2 * most
        votes = data.wrong(sides_of(data.given, "votes")).mean()
        assert votes > 0.03

    def test_views_that_swap_half_of_the_time_count_little(self):
        data = scene("chain", 8)
        rng = np.random.default_rng(3)
        evidence = np.array(data.given.pairs.evidence)
        flips = rng.random((len(evidence), 1, 4)) < 0.5
        evidence[..., :4] = np.where(flips, -evidence[..., :4], evidence[..., :4])
        assert data.wrong(sides_of(changed(data.given, evidence=evidence))).mean() < 0.01

    def test_nothing_is_flipped_where_nothing_was_swapped(self):
        data = scene(share=0.0)
        for sides in (sides_of(data.given), online(data.given)):
            assert not sides.flipped.any()
            assert (sides.chain_swapped[..., 1:] <= 0).all()
            # Eyes that a view sees one above the other are swapped by the noise itself.
            assert (sides.chain_swapped[..., 0] == 1).mean() < 0.01

    def test_no_single_frame_flips(self):
        data = scene("pair", 3)
        wrong = data.wrong(sides_of(data.given))
        assert not ((wrong[1:-1] != wrong[:-2]) & (wrong[1:-1] != wrong[2:])).any()

    def test_whose_labels_were_swapped(self, swapped):
        sides = sides_of(swapped.given)
        assert sides.chains == ("face", "arm", "leg")
        for chain, first in (("arm", "left_shoulder"), ("leg", "left_hip")):
            pair = [left for left, _ in swapped.given.skeleton.pairs].index(first)
            found = sides.chain_swapped[:, 0, :, sides.chains.index(chain)]
            known = found >= 0
            assert known.mean() > 0.95
            assert ((found == 1) == swapped.swapped[:, :, pair])[known].mean() > 0.98

    def test_the_order_of_points_does_not_matter(self, swapped, rng):
        which = rng.random((swapped.given.n_frames, 8)) < 0.3
        one, other = sides_of(swapped.given), sides_of(exchanged(swapped.given, which))
        np.testing.assert_array_equal(one.flipped[:, 0], other.flipped[:, 0] ^ which)
        np.testing.assert_array_equal(one.chain_swapped, other.chain_swapped)

    def test_the_order_of_views_does_not_matter(self, swapped):
        order = np.array([3, 0, 4, 2, 1])
        given, pairs = swapped.given, swapped.given.pairs
        other = changed(
            replace(given, rig=given.rig.select([given.rig.names[v] for v in order])),
            used=pairs.used[:, :, order], evidence=pairs.evidence[..., order],
        )  # fmt: skip
        one, two = sides_of(given), sides_of(other)
        np.testing.assert_array_equal(one.flipped, two.flipped)
        np.testing.assert_array_equal(one.chain_swapped[:, :, order], two.chain_swapped)

    def test_the_world_may_be_moved(self, swapped):
        turn, shift = Rotation.random(random_state=1).as_matrix(), np.array([3.0, -7.0, 2.0])
        pairs = swapped.given.pairs
        full = turn @ pairs.covariance_m2[..., [[0, 1, 2], [1, 3, 4], [2, 4, 5]]] @ turn.T
        moved = changed(
            replace(swapped.given, midline_m=swapped.given.midline_m @ turn.T + shift),
            points_m=pairs.points_m @ turn.T + shift,
            covariance_m2=full[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]],
        )
        np.testing.assert_array_equal(sides_of(swapped.given).flipped, sides_of(moved).flipped)

    def test_the_world_may_be_scaled(self, swapped):
        given, pairs = swapped.given, swapped.given.pairs
        small = changed(
            replace(given, midline_m=0.05 * given.midline_m),
            points_m=0.05 * pairs.points_m, covariance_m2=0.05**2 * pairs.covariance_m2,
        )  # fmt: skip
        assert (sides_of(given).flipped == sides_of(small).flipped).mean() > 0.999

    def test_other_labels_in_all_views_mirror_the_person(self, swapped):
        """Nothing but labels tells which of two mirror images it is, where the nose is not seen."""
        given = replace(swapped.given, midline_m=None)
        mirrored = changed(given, evidence=-given.pairs.evidence)
        np.testing.assert_array_equal(sides_of(given).flipped, ~sides_of(mirrored).flipped)

    def test_the_nose_decides_where_labels_do_not(self, swapped):
        given = changed(swapped.given, evidence=np.zeros_like(swapped.given.pairs.evidence))
        trunk = [[left for left, _ in given.skeleton.pairs].index(f"left_{name}") for name in ("shoulder", "hip")]
        assert swapped.wrong(sides_of(given))[:, trunk].mean() == 0.0

    def test_same_input_same_bytes(self, swapped):
        one, other = sides_of(swapped.given), sides_of(swapped.given)
        assert one.flipped.tobytes() == other.flipped.tobytes()
        assert one.chain_swapped.tobytes() == other.chain_swapped.tobytes()

    def test_people_are_decided_each_alone(self):
        first, second = scene(seed=1, seconds=2), scene(seed=2, seconds=2)
        both = SolvedPairs(
            *(
                np.stack([getattr(s.given.pairs, field.name) for s in (first, second)], axis=1).reshape(
                    -1, *getattr(first.given.pairs, field.name).shape[1:]
                )
                for field in fields(SolvedPairs)
            )
        )
        midline = np.concatenate([first.given.midline_m, second.given.midline_m], axis=1)
        given = replace(first.given, pairs=both, midline_m=midline, confidence=None, n_people=2)
        together = sides_of(given)
        for person, alone in enumerate((first, second)):
            sides = sides_of(alone.given)
            np.testing.assert_array_equal(together.flipped[:, person], sides.flipped[:, 0])
            np.testing.assert_array_equal(together.chain_swapped[:, person], sides.chain_swapped[:, 0])


class TestMissing:
    def gone(self, data: Scene, which: np.ndarray) -> PairsInTime:
        """Without some points (frame, pair, 2)."""
        pairs = data.given.pairs
        lost = which.any(axis=-1)[..., None]
        return changed(
            data.given,
            points_m=np.where(which[..., None], np.nan, pairs.points_m),
            covariance_m2=np.where(which[..., None], np.nan, pairs.covariance_m2),
            used=np.where(which[:, :, None], -1, pairs.used).astype(np.int8),
            evidence=np.where(lost, 0.0, pairs.evidence),
        )

    def test_single_points_are_decided_too(self, rng):
        data = scene()
        given = self.gone(data, rng.random((data.given.n_frames, 8, 2)) < 0.15)
        points = np.isfinite(given.pairs.points_m).all(axis=-1)
        for sides in (sides_of(given), online(given)):
            assert data.wrong(sides)[points.all(axis=-1)].mean() < 0.01
            ordered = sides.applied(given.pairs).points_m
            own = np.linalg.norm(ordered - data.truth_m, axis=-1)
            other = np.linalg.norm(ordered - data.truth_m[:, :, ::-1], axis=-1)
            alone = np.isfinite(own) & (points.sum(axis=-1) == 1)[..., None]
            assert (other < own)[alone].mean() < 0.03

    def test_gaps_in_time(self):
        data = scene()
        which = np.zeros((data.given.n_frames, 8, 2), dtype=bool)
        which[40:70] = True
        given = self.gone(data, which)
        there = ~which.any(axis=(1, 2))
        assert data.wrong(sides_of(given))[there].mean() == 0.0
        assert data.wrong(online(given))[there].mean() < 0.01

    def test_views_that_come_and_go(self, rng):
        data = scene(missing=0.3)
        assert data.wrong(sides_of(data.given)).mean() < 0.01

    @pytest.mark.parametrize("frames", [1, 2, 7])
    @pytest.mark.parametrize("method", ["chains", "votes", "plane"])
    def test_few_frames(self, swapped, frames, method):
        few = swapped.given
        pairs = SolvedPairs(*(getattr(few.pairs, field.name)[:frames] for field in fields(SolvedPairs)))
        given = replace(
            few, pairs=pairs, time_s=few.time_s[:frames], confidence=few.confidence[:frames],
            midline_m=few.midline_m[:frames],
        )  # fmt: skip
        assert sides_of(given, method).flipped.shape == (frames, 1, 8)

    @pytest.mark.parametrize("method", ["chains", "votes", "plane"])
    def test_nothing_at_all(self, swapped, method):
        given = self.gone(swapped, np.ones((swapped.given.n_frames, 8, 2), dtype=bool))
        given = replace(given, midline_m=None)
        sides = sides_of(given, method)
        assert not sides.flipped.any()
        assert (sides.chain_swapped == -1).all()
        assert not online(replace(given)).flipped.any()

    def test_skeletons_without_chains_or_bones(self, swapped):
        bare = Skeleton("bare", swapped.given.skeleton.keypoints, pairs=swapped.given.skeleton.pairs)
        given = replace(swapped.given, skeleton=bare)
        sides = sides_of(given)
        assert len(sides.chains) == 8
        assert swapped.wrong(sides).mean() < 0.01
        # Without bones a swapped joint is found out by its own labels alone, which takes them a second.
        assert swapped.wrong(online(given)).mean() < 0.05

    def test_a_skeleton_without_pairs(self, swapped):
        lone = Skeleton("lone", ("head", "tail"))
        none = {f.name: getattr(swapped.given.pairs, f.name)[:, :0] for f in fields(SolvedPairs)}
        given = replace(swapped.given, skeleton=lone, pairs=SolvedPairs(**none), midline_m=None, confidence=None)
        for method in ("chains", "votes", "plane"):
            assert sides_of(given, method).flipped.shape == (swapped.given.n_frames, 1, 0)


class TestOnline:
    def test_a_state_is_never_written_to(self, swapped):
        state = OnlineSides.start(swapped.given.skeleton)
        for t in range(12):
            after, one = advance(state, frame_of(swapped.given, t))
            _, again = advance(state, frame_of(swapped.given, t))
            assert one.flipped.tobytes() == again.flipped.tobytes()
            assert one.chain_swapped.tobytes() == again.chain_swapped.tobytes()
            state = after

    def test_memory_is_bounded(self, swapped):
        state = OnlineSides.start(swapped.given.skeleton, SideOptions(learn_every=5, memory=20))
        for t in range(60):
            state, _ = advance(state, frame_of(swapped.given, t))
        assert len(state.recent.time_s) == 20


class TestVotes:
    def test_each_frame_by_itself(self, swapped):
        whole = sides_of(swapped.given, "votes")
        for t in (0, 17):
            one = frame_of(swapped.given, t)
            one = replace(one, confidence=swapped.given.confidence[t : t + 1])
            np.testing.assert_array_equal(sides_of(one, "votes").flipped[0], whole.flipped[t])

    def test_other_labels_in_all_views_mirror_the_person(self, swapped):
        pairs = swapped.given.pairs
        mirrored = changed(swapped.given, used=np.where(pairs.used >= 0, 1 - pairs.used, -1).astype(np.int8))
        np.testing.assert_array_equal(sides_of(swapped.given, "votes").flipped, ~sides_of(mirrored, "votes").flipped)

    def test_confidence_and_direction_weigh(self):
        """A confident view that sees them side by side outvotes two that see one point behind the other."""
        rig = build_rig("ring", 4)
        points = np.array([[[[0.2, 0.0, 1.0], [-0.2, 0.0, 1.0]]]])
        used = np.array([[[[0, 1], [1, 0], [0, 1], [-1, -1]]]], dtype=np.int8)
        pairs = SolvedPairs(
            points, np.zeros((1, 1, 2, 6)), np.zeros((1, 1, 2)), used, np.zeros(used.shape), np.zeros(used.shape),
            np.zeros((1, 1, 4)), np.zeros((1, 1)),
        )  # fmt: skip
        skeleton = Skeleton("two", ("left_a", "right_a"), pairs=(("left_a", "right_a"),))
        given = PairsInTime(pairs, skeleton, rig, np.zeros(1), np.full((1, 1, 1, 4, 2), 0.8))
        assert sides_of(given, "votes").flipped.all()
        unsure = np.array(given.confidence)
        unsure[..., 1, :] = 0.001
        assert not sides_of(replace(given, confidence=unsure), "votes").flipped.any()


class TestPlane:
    DIRECTIONS = ("+x", "-x", "+y", "-y", "1,1,0")

    def walker(self, facing: str, share: float = 0.0) -> Scene:
        """A figure on a treadmill that faces somewhere."""
        heading = {"+x": 0.0, "+y": 90.0, "-x": 180.0, "-y": -90.0, "1,1,0": 45.0}[facing]
        data = scene(share=share, seconds=2.0)
        figure, times = human(1.75), data.given.time_s
        motion = HumanMotion.random(("walk",), np.random.default_rng(0))
        motion = replace(motion, stride_m=0.0, heading=np.radians(heading))
        truth = motion.positions(figure, times)[:, figure.columns(data.given.skeleton)]
        # The heading is where the figure faces: shoulders to nose points there.
        ahead = (truth[:, 0] - truth[:, [5, 6]].mean(axis=1)).mean(axis=0)
        assert ahead[:2] @ [np.cos(motion.heading), np.sin(motion.heading)] > 0.05
        columns = data.given.skeleton.pair_indices
        return replace(data, given=changed(data.given, points_m=truth[:, columns]), truth_m=truth[:, columns])

    @pytest.mark.parametrize("facing", DIRECTIONS)
    def test_a_figure_along_each_direction(self, facing, rng):
        data = self.walker(facing)
        which = rng.random((data.given.n_frames, 8)) < 0.5
        data = replace(data, given=exchanged(data.given, which))
        trunk = [2, 5]
        assert not data.wrong(sides_of(data.given, "plane", facing=facing))[:, trunk].any()

    def test_facing_the_other_way_mirrors(self):
        data = self.walker("+x")
        one, other = (sides_of(data.given, "plane", facing=facing).flipped for facing in ("+x", "-x"))
        np.testing.assert_array_equal(one, ~other)

    def test_another_axis_may_be_up(self):
        data = self.walker("+x")
        # x, y, z become z, x, y: what was +x is +z, what was up, z, is y.
        y_up = changed(
            replace(data.given, rig=replace(data.given.rig, up_axis="y")),
            points_m=data.given.pairs.points_m[..., [1, 2, 0]],
        )
        one, other = sides_of(data.given, "plane", facing="+x"), sides_of(y_up, "plane", facing="+z")
        np.testing.assert_array_equal(one.flipped, other.flipped)

    def test_twisted_bodies_are_warned_of_once(self):
        data = self.walker("+x")
        points = np.array(data.given.pairs.points_m)
        turn = Rotation.from_euler("z", 70, degrees=True).as_matrix()
        middle = points[:, 2].mean(axis=1, keepdims=True)
        points[:, 2] = (points[:, 2] - middle) @ turn.T + middle
        with pytest.warns(PosefuseWarning, match="more than 45 degrees") as said:
            sides_of(changed(data.given, points_m=points), "plane")
        assert len(said) == 1

    def test_up_must_be_known_and_facing_level(self):
        data = self.walker("+x")
        with pytest.raises(OptionsError, match="does not say which way is up"):
            sides_of(replace(data.given, rig=replace(data.given.rig, up_axis=None)), "plane")
        with pytest.raises(OptionsError, match="'\\+z', which is up or down"):
            sides_of(data.given, "plane", facing="+z")


class TestLayout:
    def test_limbs_and_bones_of_a_human(self):
        skeleton = find_skeleton("halpe_26")
        layout = Layout.of(skeleton)
        names = [left[5:] for left, _ in skeleton.pairs]
        assert layout.chains == ("face", "arm", "leg")
        assert [len(block) for block in layout.blocks] == [2, 3, 6]
        bones = {(names[a], names[b]) for a, b in layout.links}
        assert {("hip", "knee"), ("knee", "ankle"), ("shoulder", "hip")} <= bones
        assert [names[p] for p in np.flatnonzero(layout.trunk)] == ["eye", "shoulder", "hip"]
        assert len(layout.facing) == 3

    def test_long_chains_are_cut(self):
        layout = Layout.of(find_skeleton("coco_wholebody_133"))
        assert max(len(block) for block in layout.blocks) == 6
        assert sorted(np.concatenate(layout.blocks)) == list(range(len(layout.chain_of)))
        assert len(layout.chains) == len(set(layout.chains))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"facing": "north"}, "must be \\+x, -x"),
        ({"facing": "0,0,0"}, "three numbers"),
        ({"swap_share": 0.5}, "between 0 and 0.5, got 0.5"),
        ({"swap_duration_s": 0.0}, "swap_duration_s must be a finite number above 0"),
        ({"iterations": 0}, "iterations must be an integer of at least 1"),
        ({"memory": 0}, "memory must be an integer of at least 1"),
    ],
)
def test_impossible_choices_are_refused(options, words):
    with pytest.raises(OptionsError, match=words):
        SideOptions(**options)
