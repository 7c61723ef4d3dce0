"""Measure tracking of people who cross in a small room, with OpenPose-like and partial detections of five cameras.

``python -m benchmarks.crossing [--seeds 5] [--rate 25] [--pieces 0.3]``. BODY_25, no identities in 2D, 1032 x 776 px,
four people for 30 s; missed, merged, duplicate and false detections are more frequent than by default. For a
share of the time, for 0.5 s at a time, a view splits a person into two detections: the legs and the rest. Results are
causal: each frame as reported when it was the latest. PCP is the mean over people by the Campus head rule, from the
    first frame
of each person's presence.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.people import follow, tracker_for
from posefuse.evaluation.people import ScoringOptions
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.synthetic.crowd_options import CrowdFaults
from posefuse.synthetic.crowds import CrowdScene, Kind, crowd_of_points
from posefuse.synthetic.detector import on_intervals
from posefuse.synthetic.figures import human
from posefuse.synthetic.options import DetectorOptions
from posefuse.synthetic.rigs import look_at
from posefuse.synthetic.walkers import Attendance, stroll

_SIZE_PX, _FOCAL_PX = (1032, 776), 1060.0
_PLACES_M = ((3.2, 2.6, 2.1), (-3.2, 2.6, 2.3), (-3.4, -2.5, 2.0), (3.1, -2.7, 2.2), (0.2, 3.9, 1.9))
_HALF_ROOM_M, _LASTS_S, _PIECE_S = 1.3, 30.0, 0.5
_FAULTS = CrowdFaults(
    hidden_miss_share=0.6, hidden_confidence=0.4, hidden_error=1.8, visible_share=0.25, miss_share=0.08,
    merge_share=0.8, merge_distance=0.25, duplicate_share=0.05, false_share=0.12,
)  # fmt: skip
_LAW = DetectorOptions(outlier_share=0.04, miss_share=0.1, swap_share=0.012)


def room() -> CameraRig:
    """Return five cameras at the corners and one wall, 2 m above the floor."""
    matrix = np.array([[_FOCAL_PX, 0.0, 515.5], [0.0, _FOCAL_PX, 387.5], [0.0, 0.0, 1.0]])
    poses = [look_at(np.array(place), np.array([0.0, 0.0, 0.95])) for place in _PLACES_M]
    return CameraRig(
        tuple(Camera(f"cam_{i}", _SIZE_PX, matrix, pose) for i, pose in enumerate(poses)), "z", "simulated"
    )


def crossing(seed: int, rate_hz: float, pieces: float) -> CrowdScene:
    """Return the motion of four people; two are always present."""
    rng = np.random.default_rng(seed)
    skeleton = find_skeleton("body_25")
    comes, goes = rng.uniform(1.0, 6.0, 2), rng.uniform(18.0, 26.0, 2)
    plans = (Attendance(), Attendance(), *(Attendance(float(a), float(b)) for a, b in zip(comes, goes, strict=True)))
    walks = stroll(plans, _HALF_ROOM_M, _LASTS_S, rng)
    time_s = np.arange(round(_LASTS_S * rate_hz)) / rate_hz
    figures = [human(float(stature)) for stature in rng.uniform(1.6, 1.9, len(plans))]
    points = [
        walk.positions(figure, time_s)[:, figure.columns(skeleton)] for walk, figure in zip(walks, figures, strict=True)
    ]
    scene = crowd_of_points(
        np.stack(points, axis=1), room(), skeleton, rate_hz, detector=_LAW, faults=_FAULTS, seed=seed
    )
    return in_pieces(scene, pieces, rng)


def in_pieces(scene: CrowdScene, share: float, rng: np.random.Generator) -> CrowdScene:
    """Return the scene with people split into two detections per view for a share of the time."""
    whole, legs = scene.detections, _legs(scene.detections.skeleton)
    cells = np.repeat(np.arange(len(whole.offsets) - 1), np.diff(whole.offsets))
    views, people = whole.n_views, scene.truth.layers["measured"].points_m.shape[1]
    apart = on_intervals((whole.n_frames, views, people), share, _PIECE_S, whole.rate_hz or 25.0, rng)
    split = (scene.kind == Kind.PERSON) & apart[cells // views, cells % views, scene.owner]
    there = np.isfinite(np.asarray(whole.keypoints_px)[..., 0])
    split &= there[:, legs].any(axis=1) & there[:, ~legs].any(axis=1)
    rows = np.repeat(np.arange(len(cells)), 1 + split)
    second = np.concatenate([[False], rows[1:] == rows[:-1]])
    gone = split[rows][:, None] & np.where(second[:, None], ~legs, legs)
    pixels, confidence = np.asarray(whole.keypoints_px)[rows], np.asarray(whole.confidence)[rows]
    detections: Detections = replace(
        whole,
        offsets=np.concatenate([[0], np.cumsum(np.bincount(cells[rows], minlength=len(whole.offsets) - 1))]),
        keypoints_px=np.where(gone[..., None], np.nan, pixels),
        confidence=np.where(gone, np.nan, confidence),
        track_ids=np.full(len(rows), -1),
    )
    return replace(
        scene, detections=detections, owner=scene.owner[rows], other=scene.other[rows], kind=scene.kind[rows]
    )


def _legs(skeleton: Skeleton) -> np.ndarray:
    parts = ("knee", "ankle", "heel", "toe")
    return np.array([any(part in name for part in parts) for name in skeleton.keypoints])


def main() -> None:
    """Print one line per recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--rate", type=float, default=25.0)
    parser.add_argument("--pieces", type=float, default=0.3)
    chosen = parser.parse_args()
    print("| seed | PCP, % | MPJPE, mm | switches | fragments | recall, % | longest ghost | inside 68 / 95 % region |")
    print("|---|---|---|---|---|---|---|---|")
    for seed in range(chosen.seeds):
        scene = crossing(seed, chosen.rate, chosen.pieces)
        found = follow(scene, tracker_for(scene, TrackerOptions()), scoring=ScoringOptions(head_rule="campus")).scores
        ghost = max((each.longest for each in found.ghosts), default=0)
        cells: Sequence[object] = (
            seed, f"{100 * found.parts.average:.1f}", f"{found.mpjpe_mm:.1f}", found.clear[0].switches,
            found.clear[0].fragments, f"{100 * found.recall_after_entry:.1f}", ghost,
            f"{100 * found.nees.covered_68:.0f} / {100 * found.nees.covered_95:.0f}",
        )  # fmt: skip
        print(f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    main()
