"""Small sets of 2D detections for tests of file formats."""

import numpy as np

from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.scenes import skeleton_of

SKELETONS = {"mediapipe_json": "mediapipe_33", "mediapipe_wide": "mediapipe_33", "mediapipe_long": "mediapipe_33"}
"""Skeletons of formats that represent no other."""


def example_detections(n_people: int = 2, seed: int = 0, body: str | None = None) -> Detections:
    """Return two views of six frames with missing keypoints, all people in the first frame and one in the last."""
    rng = np.random.default_rng(seed)
    skeleton = shipped_skeleton(body or ("mouse_22" if n_people == 1 else "coco_17"))
    rows, offsets, tracks = [], [0], []
    for f in range(6):
        for v in range(2):
            for i in range(n_people):
                if 0 < f < 5 and rng.random() < 0.3:
                    continue
                values = rng.uniform([5, 5, 0.2], [1900, 1000, 0.99], (len(skeleton), 3))
                values[rng.random(len(skeleton)) < 0.2] = np.nan
                values[0] = 40.0 + v, 50.0 + i, 0.5
                rows.append(values)
                tracks.append(i)
            offsets.append(len(rows))
    values = np.array(rows)
    return Detections(
        skeleton=skeleton,
        view_names=("left", "right"),
        frame_numbers=np.arange(6),
        time_s=np.full((6, 2), np.nan),
        offsets=np.array(offsets),
        keypoints_px=values[..., :2],
        confidence=values[..., 2],
        recorded=np.ones((6, 2), dtype=bool),
        track_ids=np.array(tracks),
    )


def ragged_detections(rng: np.random.Generator, frames: int = 6, views: int = 3, keypoints: int = 4) -> Detections:
    """0 to 3 people per view and frame."""
    counts = rng.integers(0, 4, frames * views)
    rows = int(counts.sum())
    return Detections(
        skeleton=skeleton_of(keypoints),
        view_names=tuple(f"view_{v}" for v in range(views)),
        frame_numbers=np.arange(10, 10 + frames),
        time_s=np.repeat(np.arange(frames)[:, None] / 30.0, views, axis=1),
        offsets=np.concatenate([[0], np.cumsum(counts)]),
        keypoints_px=rng.uniform(0, 1000, (rows, keypoints, 2)),
        confidence=rng.uniform(0, 1, (rows, keypoints)),
        recorded=np.ones((frames, views), dtype=bool),
        track_ids=rng.integers(-1, 3, rows),
        depth=rng.normal(size=(rows, keypoints)),
        rate_hz=30.0,
    )
