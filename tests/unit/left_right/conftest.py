"""Walking people with swapped labels, shared by the tests of all left/right methods."""

from dataclasses import dataclass, fields, replace

import numpy as np
import pytest

from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.left_right.registry import assign_sides
from posefuse.left_right.results import PairSequence, SideAssignment
from posefuse.model.options.left_right import SideOptions
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.detector import detect
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import HumanMotion
from posefuse.synthetic.options import DetectorOptions, SwapLaw
from posefuse.synthetic.rigs import build_rig
from tests.pairs import simulate_pairs

RATE_HZ = 30.0


@dataclass(frozen=True)
class Scene:
    """Hold a person with swapped labels, and the truth."""

    given: PairSequence
    truth_m: np.ndarray
    swapped: np.ndarray

    def wrong(self, sides: SideAssignment) -> np.ndarray:
        """Return wrongly assigned pairs, shape (frame, pair), bool; pairs closer than 5 cm do not count."""
        points = sides.applied(self.given.pairs).points_m
        own = np.linalg.norm(points - self.truth_m, axis=-1).sum(axis=-1)
        other = np.linalg.norm(points - self.truth_m[:, :, ::-1], axis=-1).sum(axis=-1)
        apart = np.linalg.norm(self.truth_m[:, :, 0] - self.truth_m[:, :, 1], axis=-1)
        return (other < own) & (apart > 0.05)


def simulate_walk(
    law: SwapLaw = "chain",
    cameras: int = 5,
    share: float = 0.25,
    seconds: float = 5.0,
    skeleton: str = "coco_17",
    missing: float = 0.0,
    seed: int = 0,
) -> Scene:
    """Simulate a figure that walks in a circle."""
    rng = np.random.default_rng(seed)
    keypoints, figure = find_skeleton(skeleton), human(1.75)
    times = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    truth = HumanMotion.random(("walk",), rng).positions(figure, times)[:, figure.columns(keypoints)]
    rig = build_rig("ring", cameras, radius_m=4.5, focal_px=1500.0)
    errors = DetectorOptions("gaussian", 5.0, 0.0, (0.0, 0.0), missing, share, 0.0, law)
    observed = np.repeat(truth[:, None], cameras, axis=1)
    detections = detect(rig, observed, keypoints, RATE_HZ, errors, rng)
    columns = keypoints.pair_indices
    pixels = rig.project(truth)
    off = np.linalg.norm(detections.dense()[0][:, :, columns] - pixels[:, :, columns][..., ::-1, :], axis=-1).sum(-1)
    as_is = np.linalg.norm(detections.dense()[0][:, :, columns] - pixels[:, :, columns], axis=-1).sum(axis=-1)
    pairs = simulate_pairs(rig, truth, detections, 5.0, rng)
    midline = truth[:, None] + 0.01 * rng.standard_normal(truth[:, None].shape)
    confidence = np.full((len(times), 1, len(columns), cameras, 2), 0.8)
    sequence = PairSequence(pairs, keypoints, rig, times, confidence, midline)
    return Scene(sequence, truth[:, columns], off < as_is)


def assign(sequence: PairSequence, method: str = "chains", **options: object) -> SideAssignment:
    """Assign left and right by one method."""
    return assign_sides(sequence, method, SideOptions(**options))  # type: ignore[arg-type]


def replace_pairs(sequence: PairSequence, **arrays: np.ndarray) -> PairSequence:
    """Replace arrays of the solved pairs."""
    return replace(sequence, pairs=replace(sequence.pairs, **arrays))


def exchange_points(sequence: PairSequence, which: np.ndarray) -> PairSequence:
    """Exchange the two points of some pairs (frame, pair)."""
    order = SideAssignment(which[:, None], np.zeros((len(which), 1, 0, 0), np.int8), ())
    return replace(sequence, pairs=order.applied(sequence.pairs))


def select_frame(sequence: PairSequence, t: int) -> PairSequence:
    """Return one frame."""
    now = slice(t, t + 1)
    pairs = SolvedPairs(*(getattr(sequence.pairs, field.name)[now] for field in fields(SolvedPairs)))
    midline = None if sequence.midline_m is None else sequence.midline_m[now]
    return replace(sequence, pairs=pairs, time_s=sequence.time_s[now], midline_m=midline, confidence=None)


@pytest.fixture(scope="module")
def swapped() -> Scene:
    """Return a walk with swapped labels."""
    return simulate_walk()
