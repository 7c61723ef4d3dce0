"""Measure the errors of side assignment for a walking, a turning and a side-on figure with swapped labels.

``python -m benchmarks.side_assignment [--seconds N] [--seeds N] [--only NAME,...]``. Cameras form a ring of 4.5 m at
heights of 1.5 and 2.5 m (f 1500 px, 5 px noise, 30 Hz; keypoints of Halpe and COCO). Labels are swapped a quarter of
the time: (a) per limb and view, for 0.4 s; (b) per pair, view and frame; (c) whole bodies in one view, for 1 s. Pairs
are solved without labels (``enumerate``) with the true noise. A joint-frame is scored if the two joints are over 5 cm
apart. It is wrong if its point is closer to the other joint than to its own; if a pair has two points, both are
compared together. A single-frame flip is a pair that is wrong in one frame and right in the two neighboring ones, or
the reverse. Flips are counted only where the order is clear, that is, not where points are about equally far from both
joints, such as eyes in front of three cameras.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from time import process_time

import numpy as np

from posefuse.left_right.pairs import enumerated
from posefuse.left_right.registry import assign_sides
from posefuse.left_right.results import PairSequence
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.left_right import SideOptions
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.tracks import Tracks, TrackState
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.detector import detect
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import HumanMotion
from posefuse.synthetic.options import DetectorOptions, SwapLaw
from posefuse.synthetic.rigs import build_rig
from posefuse.triangulation import consensus

RATE_HZ = 30.0
SIGMA_PX = 5.0
APART_M = 0.05
SEQUENCES = ("walking", "turning", "side-on")
LAWS: dict[str, SwapLaw] = {"a": "chain", "b": "pair", "c": "body"}
LIMITS_PERCENT = {8: 0.5, 5: 1.0, 3: 2.0}


@dataclass(frozen=True)
class Recording:
    """Solved pairs and their truth.

    Attributes:
        pairs: the solved pairs.
        truth_m: shape (frame, pair, 2, 3): left and right.
    """

    pairs: PairSequence
    truth_m: np.ndarray

    @property
    def scored(self) -> np.ndarray:
        """Whether a joint has a point and the joints are far enough apart, shape (frame, pair, 2), bool."""
        apart = np.linalg.norm(self.truth_m[:, :, 0] - self.truth_m[:, :, 1], axis=-1) > APART_M
        return np.isfinite(self.pairs.pairs.points_m).all(axis=-1) & apart[..., None]

    def distances_m(self, flipped: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the summed distances of a pair's points from their own and the other joints, (frame, pair) each."""
        points = np.where(flipped[..., None, None], self.pairs.pairs.points_m[:, :, ::-1], self.pairs.pairs.points_m)
        own = np.nansum(np.linalg.norm(points - self.truth_m, axis=-1), axis=-1)
        other = np.nansum(np.linalg.norm(points - self.truth_m[:, :, ::-1], axis=-1), axis=-1)
        return own, other


@dataclass(frozen=True)
class Score:
    """Counts that are summed over recordings.

    Attributes:
        scored: number of joint-frames.
        wrong: number of joint-frames with the wrong side.
        flips: pair-frames that differ from both neighbors in being wrong.
        spent_s: CPU time of the decisions.
        frames: number of frames.
    """

    scored: int = 0
    wrong: int = 0
    flips: int = 0
    spent_s: float = 0.0
    frames: int = 0

    def __add__(self, other: "Score") -> "Score":
        return Score(*(getattr(self, field.name) + getattr(other, field.name) for field in fields(self)))

    @property
    def percent(self) -> float:
        """Share of wrong joint-frames in percent."""
        return 100.0 * self.wrong / max(self.scored, 1)


def body(sequence: str, seconds: float, skeleton: str, rng: np.random.Generator) -> np.ndarray:
    """Return a figure that walks in a circle, turns on the spot, or walks on a treadmill, shape (frame, keypoint, 3).

    On the treadmill it faces y, so that the first camera of the ring always sees it from the side.
    """
    figure = human(1.75)
    motion = HumanMotion.random(("turn",) if sequence == "turning" else ("walk",), rng)
    if sequence == "side-on":
        motion = replace(motion, stride_m=0.0, heading=np.pi / 2)
    times = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    return motion.positions(figure, times)[:, figure.columns(find_skeleton(skeleton))]


def recording(
    sequence: str,
    cameras: int,
    law: SwapLaw,
    skeleton: str = "halpe_26",
    *,
    shares: tuple[float, ...] = (),
    faults: bool = False,
    seconds: float = 20.0,
    seed: int = 0,
) -> Recording:
    """Simulate a figure in a ring of cameras and solve its pairs.

    Args:
        sequence: one of SEQUENCES.
        cameras: number of cameras.
        law: model of the swaps.
        skeleton: name of the skeleton.
        shares: share of swaps per camera; a quarter by default.
        faults: also omit a tenth of the keypoints for periods, and displace a twentieth by 30 to 200 px.
        seconds: duration.
        seed: random seed.
    """
    rng = np.random.default_rng(seed)
    keypoints = find_skeleton(skeleton)
    rig = build_rig("ring", cameras, radius_m=4.5, focal_px=1500.0)
    truth = body(sequence, seconds, skeleton, rng)
    errors = DetectorOptions(
        "gaussian", SIGMA_PX, outlier_share=0.05 * faults, outlier_px=(30.0, 200.0), miss_share=0.1 * faults,
        swap_share=0.25, swap_law=law, swap_shares=shares,
    )  # fmt: skip
    seen = np.repeat(truth[:, None], cameras, axis=1)
    pairs = solved(rig, detect(rig, seen, keypoints, RATE_HZ, errors, rng))
    columns = [[keypoints.index(name) for name in pair] for pair in keypoints.pairs]
    return Recording(pairs, truth[:, columns])


def solved(rig: CameraRig, detections: Detections) -> PairSequence:
    """Solve pairs without labels, and unpaired keypoints by consensus, both with the true noise."""
    skeleton = detections.skeleton
    detection = np.where(detections.people_counts > 0, 0, -1)[:, None].astype(np.int32)
    tracks = Tracks(("person_1",), detection, np.full((detections.n_frames, 1), TrackState.ACTIVE, dtype=np.int8))
    noise, options = NoiseModel(np.full(len(rig), SIGMA_PX)), TriangulationOptions(min_views=2)
    columns = skeleton.pair_indices
    pairs = enumerated.solve(rig, detections, tracks, noise, options, columns)
    points = np.array(consensus.solve(rig, detections, tracks, noise, options).points_m)
    points[:, :, columns.ravel()] = np.nan
    return PairSequence.of(pairs, rig, detections, tracks, points)


DECISIONS: dict[str, Callable[[PairSequence], np.ndarray]] = {
    "votes": lambda pairs: assign_sides(pairs, "votes", SideOptions()).flipped[:, 0],
    "chains": lambda pairs: assign_sides(pairs, "chains", SideOptions()).flipped[:, 0],
}


def score(data: Recording, decision: str) -> Score:
    """Score an assignment method on a recording."""
    start = process_time()
    flipped = DECISIONS[decision](data.pairs)
    spent = process_time() - start
    own, other = data.distances_m(flipped)
    wrong, scored = other < own, data.scored
    apart = np.linalg.norm(data.truth_m[:, :, 0] - data.truth_m[:, :, 1], axis=-1)
    clear = scored.any(axis=-1) & (np.abs(own - other) > apart)
    changed = (wrong[1:-1] != wrong[:-2]) & (wrong[1:-1] != wrong[2:])
    flips = changed & clear[1:-1] & clear[:-2] & clear[2:]
    return Score(
        int(scored.sum()), int((scored & wrong[..., None]).sum()), int(flips.sum()), spent, data.pairs.n_frames
    )


def lines(name: str, limit_percent: float, recordings: Sequence[Recording]) -> str:
    """Format the share of wrong joint-frames, flips, and time of each method for one set."""
    cells = []
    for decision in DECISIONS:
        total = sum((score(data, decision) for data in recordings), Score())
        ms = 1000.0 * total.spent_s / total.frames
        cells.append(f"{total.percent:9.3f}{total.flips:7d}{ms:8.2f}")
    return f"{name:34}{sum(len(data.pairs.time_s) for data in recordings):7d}{limit_percent:7.1f}" + "".join(cells)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--only", default="rates,half,faults,none")
    chosen = parser.parse_args(arguments)
    only = chosen.only.split(",")
    print("Wrong joint-frames %, single-frame flips, CPU ms per frame")
    print(f"{'':34}{'frames':>7}{'limit':>7}" + "".join(f"{name:>9}{'flips':>7}{'ms':>8}" for name in DECISIONS))

    def show(
        name: str, limit_percent: float, cameras: int, law: str, sequences: Sequence[str], **options: object
    ) -> None:
        data = [
            recording(sequence, cameras, LAWS[law], skeleton, seconds=chosen.seconds, seed=seed, **options)  # type: ignore[arg-type]
            for sequence in sequences
            for skeleton in ("halpe_26", "coco_17")
            for seed in range(chosen.seeds)
        ]
        print(lines(name, limit_percent, data), flush=True)

    if "rates" in only:
        for cameras, limit_percent in LIMITS_PERCENT.items():
            for law in LAWS:
                for sequence in SEQUENCES:
                    show(f"{cameras} cameras, ({law}) {sequence}", limit_percent, cameras, law, [sequence])
    if "half" in only:
        for law in LAWS:
            show(f"8 cameras, ({law}) 50 % in half", 1.0, 8, law, SEQUENCES, shares=(0.5, 0.25) * 4)
    if "faults" in only:
        for cameras in LIMITS_PERCENT:
            show(f"{cameras} cameras, (a) and faults", np.nan, cameras, "a", SEQUENCES, faults=True)
    if "none" in only:
        for cameras in LIMITS_PERCENT:
            show(f"{cameras} cameras, no swaps", 0.0, cameras, "a", SEQUENCES, shares=(0.0,) * cameras)


if __name__ == "__main__":
    main()
