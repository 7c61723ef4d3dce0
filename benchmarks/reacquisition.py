"""Measure how soon lost people are tracked again, in simulated rooms with five cameras.

``python -m benchmarks.reacquisition [--seeds 20] [--first 0] [--people 1,2,3,4] [--modes all,three,back,new]``.
People walk for 44 s; one of them at a time is not detected for 0.4, 0.5, 1, 2 and 4 s. In mode ``all`` no view detects
the person in the gap; in mode ``three``, three of the five views do not; in mode ``back``, no view does in the gap, and
three do not for another 4 s; mode ``new`` is ``all`` with one further person, who appears in the middle of the first
gap.

A person counts as detected again in the first frame in which two views show a detection of that person alone with at
least half of the keypoints. The tracker must report the person under the same name in this frame or the next. In false
frames, in the gap or later, the lost person's name is more than 0.5 m from that person. In missing frames, two views
detect the person after the gap and no active person is within 0.5 m; the first frame does not count.
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.people import tracker_for
from posefuse.model.frames import Frame
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.crowds import CrowdScene, Kind, crowd_of_points
from posefuse.synthetic.figures import human
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.walkers import Attendance, stroll
from posefuse.tracking.records import People

GAPS_S = (0.4, 0.5, 1.0, 2.0, 4.0)
MODES = ("all", "three", "back", "new")
_RATE_HZ, _HALF_ROOM_M, _RADIUS_M, _VIEWS = 25.0, 2.0, 5.0, 5
_FIRST_GAP_S, _BETWEEN_S, _BACK_S = 6.0, 6.0, 4.0
_WITHIN_M, _LATE_FRAMES = 0.5, 1


@dataclass(frozen=True)
class Gap:
    """A time in which views do not detect a person.

    Attributes:
        person: index of the person.
        start: first frame.
        stop: frame after the last one.
        end: last frame of the evaluation, excluded.
        length_s: duration, in seconds.
    """

    person: int
    start: int
    stop: int
    end: int
    length_s: float


@dataclass(frozen=True)
class Outcome:
    """What the tracker reported after a gap.

    Attributes:
        in_time: whether the person was reported under the same name in time.
        late_s: time from the detection in two views to the first report within reach, in seconds; inf for none.
        false: number of frames in which the person's name was elsewhere.
        missing: number of frames in which two views detect the person and no active person is near.
        frames: number of frames in which two views detect the person.
    """

    in_time: bool
    late_s: float
    false: int
    missing: int
    frames: int


def room(people: int, seed: int) -> CrowdScene:
    """Return people who walk in a room, all always present."""
    rng = np.random.default_rng(seed)
    skeleton, duration_s = find_skeleton("body_20"), _FIRST_GAP_S + sum(GAPS_S) + _BETWEEN_S * len(GAPS_S)
    time_s = np.arange(round(duration_s * _RATE_HZ)) / _RATE_HZ
    walks = stroll((Attendance(),) * people, _HALF_ROOM_M, duration_s, rng)
    figures = [human(float(stature)) for stature in rng.uniform(1.55, 1.9, people)]
    points = [
        walk.positions(figure, time_s)[:, figure.columns(skeleton)] for walk, figure in zip(walks, figures, strict=True)
    ]
    rig = build_rig("ring", _VIEWS, "pinhole", radius_m=_RADIUS_M)
    return crowd_of_points(np.stack(points, axis=1), rig, skeleton, _RATE_HZ, seed=seed)


def with_gaps(scene: CrowdScene, mode: str, seed: int) -> tuple[CrowdScene, list[Gap]]:
    """Return the scene without the detections of one person at a time, and the gaps."""
    rng, n_people = np.random.default_rng([seed, MODES.index(mode)]), scene.truth.layers["measured"].points_m.shape[1]
    n_people -= mode == "new"
    frame, view = row_cells(scene)
    keep, gaps, start_s = np.ones(len(frame), dtype=bool), [], _FIRST_GAP_S
    for length_s in rng.permutation(GAPS_S).tolist():
        person, views = int(rng.integers(n_people)), rng.permutation(_VIEWS)[:3]
        start, stop = round(start_s * _RATE_HZ), round((start_s + length_s) * _RATE_HZ)
        shown = (scene.owner == person) | (scene.other == person)
        if mode == "new" and not gaps:
            keep &= ~(((scene.owner == n_people) | (scene.other == n_people)) & (frame < (start + stop) // 2))
        if mode != "three":
            keep &= ~(shown & (frame >= start) & (frame < stop))
        if mode in ("three", "back"):
            last = stop + (round(_BACK_S * _RATE_HZ) if mode == "back" else 0)
            keep &= ~(shown & (frame >= start) & (frame < last) & np.isin(view, views))
        start_s += length_s + _BETWEEN_S
        gaps.append(Gap(person, start, stop, min(round(start_s * _RATE_HZ) - 1, frame[-1]), length_s))
    return _rows(scene, keep), gaps


def row_cells(scene: CrowdScene) -> tuple[np.ndarray, np.ndarray]:
    """Return frame and view of each detection, shape (row,) each."""
    offsets = np.asarray(scene.detections.offsets)
    return np.divmod(np.repeat(np.arange(len(offsets) - 1), np.diff(offsets)), _VIEWS)


def _rows(scene: CrowdScene, keep: np.ndarray) -> CrowdScene:
    whole = scene.detections
    detections = replace(
        whole,
        offsets=np.concatenate([[0], np.cumsum(keep)])[np.asarray(whole.offsets)],
        keypoints_px=np.asarray(whole.keypoints_px)[keep],
        confidence=np.asarray(whole.confidence)[keep],
        track_ids=np.asarray(whole.track_ids)[keep],
    )
    return replace(
        scene, detections=detections, owner=scene.owner[keep], other=scene.other[keep], kind=scene.kind[keep]
    )


def evaluate(scene: CrowdScene, gaps: list[Gap], told: list[People]) -> list[Outcome]:
    """Return the outcome of every gap."""
    truth = np.asarray(scene.truth.layers["measured"].points_m)
    frame, view = row_cells(scene)
    full = np.isfinite(np.asarray(scene.detections.keypoints_px)[..., 0]).mean(axis=1) >= 0.5
    outcomes = []
    for gap in gaps:
        own = full & (scene.owner == gap.person) & (scene.kind == Kind.PERSON)
        seen = np.zeros((len(told), _VIEWS), dtype=bool)
        seen[frame[own], view[own]] = True
        twice = seen.sum(axis=1) >= 2
        there = [_distances_m(people, truth[f, gap.person]) for f, people in enumerate(told)]
        name = next((_nearest(there[f]) for f in range(gap.start - 1, 0, -1) if _nearest(there[f])), "")
        first = gap.stop + int(twice[gap.stop :].argmax()) if gap.length_s else gap.start
        found = [f for f in range(first, gap.end) if there[f].get(name, np.inf) < _WITHIN_M]
        false = sum(there[f].get(name, 0.0) > _WITHIN_M for f in range(gap.start, gap.end))
        frames = [f for f in range(first + _LATE_FRAMES, gap.end) if twice[f]]
        missing = sum(not _nearest(there[f]) for f in frames)
        late = found[0] - first if found else np.inf
        outcomes.append(Outcome(late <= _LATE_FRAMES, late / _RATE_HZ, false, missing, len(frames)))
    return outcomes


def _distances_m(people: People, truth_m: np.ndarray) -> dict[str, float]:
    """Return the mean distance of every active person's keypoints from the truth, by name."""
    return {
        each.name: float(np.nanmean(np.linalg.norm(each.points_m - truth_m, axis=-1)))
        for each in people.people
        if each.state == TrackState.ACTIVE
    }


def _nearest(distances_m: dict[str, float]) -> str:
    """Return the name of the nearest person within reach; empty for none."""
    best = min(distances_m, key=lambda name: distances_m[name], default="")
    return best if best and distances_m[best] < _WITHIN_M else ""


def run(people: int, mode: str, seed: int) -> list[tuple[Gap, Outcome]]:
    """Track one scene and return its gaps with their outcomes."""
    scene, gaps = with_gaps(room(people + (mode == "new"), seed), mode, seed)
    tracker = tracker_for(scene, TrackerOptions())
    told = [tracker.update(Frame.of(scene.detections, i)) for i in range(scene.detections.n_frames)]
    return list(zip(gaps, evaluate(scene, gaps, told), strict=True))


def main() -> None:
    """Print one line per mode and duration, and the gaps that fail."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--people", default="1,2,3,4")
    parser.add_argument("--modes", default=",".join(MODES))
    chosen = parser.parse_args()
    counts, failed = [int(each) for each in chosen.people.split(",")], []
    print("| gap | in time | median delay, ms | false frames | missing frames |\n|---|---|---|---|---|")
    for mode in chosen.modes.split(","):
        results = [
            (people, seed, *each)
            for people in counts
            for seed in range(chosen.first, chosen.first + chosen.seeds)
            for each in run(people, mode, seed)
        ]
        for length_s in GAPS_S:
            of = [outcome for _, _, gap, outcome in results if gap.length_s == length_s]
            missing, frames = sum(each.missing for each in of), sum(each.frames for each in of)
            print(
                f"| {mode}, {length_s:g} s | {sum(each.in_time for each in of)} of {len(of)} "
                f"| {1e3 * np.median([each.late_s for each in of]):.0f} | {sum(each.false for each in of)} "
                f"| {missing} of {frames} |",
                flush=True,
            )
        failed += [
            f"{mode}: {people} people, seed {seed}, {gap}: {outcome}"
            for people, seed, gap, outcome in results
            if not outcome.in_time or outcome.false or outcome.missing
        ]
    print("\n".join(failed))


if __name__ == "__main__":
    main()
