"""Measure how soon bone lengths recover after views have shown thighs 20 % too short for 5 s.

``python -m benchmarks.shortened_bones [--seeds 8] [--starts 0,10]``. One person walks in front of five cameras. From
each start on, for 5 s, all views show the knees at 80 % of the thigh. Prints the mean error of the knees over 0.8 s by
time after that, in mm, with and without the shortening, causal and smoothed, and the events without the shortening.
"""

import argparse

import numpy as np

from benchmarks.people import tracker_for
from benchmarks.reacquisition import room
from posefuse.model.frames import Frame
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.synthetic.crowds import CrowdScene, crowd_of_points
from posefuse.tracking.history import History
from posefuse.tracking.smoothing import PeopleSmoother

_SHORT_S, _RATE_HZ, _FRAMES, _MEAN_FRAMES = 5.0, 25.0, 750, 20
_AFTER_S = (-1.0, 0.0, 1.0, 2.0, 3.0, 5.0, 10.0)


def shortened(seed: int, start_s: float, share: float) -> tuple[CrowdScene, np.ndarray]:
    """Return a scene whose thighs appear shorter by a share for 5 s, and the true points (frame, keypoint, 3)."""
    scene = room(1, seed)
    skeleton, truth = scene.detections.skeleton, np.array(scene.truth.layers["measured"].points_m)[:_FRAMES]
    shown, during = truth.copy(), slice(round(start_s * _RATE_HZ), round((start_s + _SHORT_S) * _RATE_HZ))
    for side in ("left", "right"):
        hip, knee = (truth[during, 0, skeleton.index(f"{side}_{name}")] for name in ("hip", "knee"))
        shown[during, 0, skeleton.index(f"{side}_knee")] += share * (hip - knee)
    return crowd_of_points(shown, scene.rig, skeleton, _RATE_HZ, seed=seed), truth[:, 0]


def errors_mm(seed: int, start_s: float, share: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the errors of the knees, causal and smoothed, shape (frame,), NaN where unknown, and the reestimations."""
    scene, truth = shortened(seed, start_s, share)
    knees = [scene.detections.skeleton.index(f"{side}_knee") for side in ("left", "right")]
    tracker = tracker_for(scene, TrackerOptions())
    history, causal, smoothed, events = History(tracker.settings), *np.full((2, _FRAMES), np.nan), 0
    for f in range(_FRAMES):
        tracked = tracker.process(Frame.of(scene.detections, f))
        history.add(tracker, tracked)
        events += sum(event.what == "lengths_reestimated" for event in tracked.people.events)
        for person in tracked.people.people:
            if person.state == TrackState.ACTIVE:
                causal[f] = 1e3 * np.linalg.norm(person.points_m[knees] - truth[f, knees], axis=-1).mean()
    for part in PeopleSmoother(history).take(_FRAMES):
        away_m = part.body.points_m[:, knees] - truth[part.places][:, knees]
        smoothed[part.places] = 1e3 * np.linalg.norm(away_m, axis=-1).mean(axis=1)
    return causal, smoothed, events


def main() -> None:
    """Print one line per recording, and the means."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--starts", default="0,10")
    chosen = parser.parse_args()
    print(f"| recording | {' | '.join(f'{each:g} s' for each in _AFTER_S)} |\n" + "|---" * (len(_AFTER_S) + 1) + "|")
    for name, share in (("not shortened", 0.0), ("shortened", 0.2)):
        rows: dict[str, list[list[float]]] = {"causal": [], "smoothed": []}
        events = 0
        for start_s in map(float, chosen.starts.split(",")):
            at = [round((start_s + _SHORT_S + each) * _RATE_HZ) for each in _AFTER_S]
            for seed in range(chosen.seeds):
                *errors, found = errors_mm(seed, start_s, share)
                events += found
                for kind, each in zip(rows, errors, strict=True):
                    rows[kind].append([float(np.nanmean(each[i : i + _MEAN_FRAMES])) for i in at])
                    _say(f"{name}, from {start_s:g} s, seed {seed}, {kind}", rows[kind][-1])
        for kind, found_rows in rows.items():
            _say(f"**{name}, mean, {kind}**", np.mean(found_rows, axis=0).tolist())
        print(f"{name}: lengths estimated again {events} times")


def _say(name: str, cells: list[float]) -> None:
    print(f"| {name} | {' | '.join(f'{each:.0f}' for each in cells)} |", flush=True)


if __name__ == "__main__":
    main()
