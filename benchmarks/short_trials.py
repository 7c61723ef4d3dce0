"""Compare layers on simulated trials of one to three seconds, the length of a gait pass or a jump.

``python -m benchmarks.short_trials [--seeds N] [--cameras 3,4,5]``. Detections have the measured errors, correlated for
0.22 s. ``Butterworth`` filters the points of ``consensus`` with the cutoff that is best on the truth. ``known bodies``
is the solve with the true bone lengths, and with motion and noise estimated from 20 s of the same person: a bound for
what a short trial can reach with this estimator.
"""

import argparse
import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks import motions
from benchmarks.trajectory import filtered
from benchmarks.walking import Walk, observe
from posefuse.model.options.options import Options
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.pipeline.reconstruct import triangulate
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.options import Activity
from posefuse.synthetic.rigs import build_rig
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.observations import MeasuredRange
from posefuse.trajectory.priors import RecordingPriors, estimate_priors
from posefuse.trajectory.solve import solve

ACTIVITIES: tuple[Activity, ...] = ("walk", "jump", "reach")
DURATIONS_S = (0.8, 1.7, 3.0)
RATE_HZ, LONG_S = 60.0, 20.0
_OPTIONS = TrajectoryOptions()


def trial(activity: Activity, duration_s: float, cameras: int, seed: int) -> Walk:
    """Simulate a trial: its motion starts at another time for every seed."""
    times = 0.37 * seed + np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    points = motions.figure_at(times, (activity,), seed)
    data = observe(build_rig("ring", cameras), points, np.random.default_rng(seed))
    return motions.with_lasting_noise(replace(data, rate_hz=RATE_HZ), seed)


def recording_layers(data: Walk) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the points of the methods that know nothing but the recording, shape (frame, keypoint, 3)."""
    measured = _measured(data)
    yield "consensus", np.asarray(measured.layer.points_m)[:, 0]
    yield "solved", _solved(measured, estimate_priors([measured], measured.detections.skeleton, _OPTIONS))


def layers(data: Walk, long: Walk) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the points of each method, shape (frame, keypoint, 3)."""
    found = dict(recording_layers(data))
    measured = _measured(data)
    yield "consensus", found["consensus"]
    yield "Butterworth", filtered(data, found["consensus"]).points_m
    yield "solved", found["solved"]
    priors = estimate_priors([_measured(long)], measured.detections.skeleton, _OPTIONS)
    ends = Bones.of(measured.detections.skeleton).ends
    length = np.median(np.linalg.norm(data.points_m[:, ends[:, 0]] - data.points_m[:, ends[:, 1]], axis=-1), axis=0)
    known = replace(priors, length_m=length[None], length_sd_m=_OPTIONS.min_bone_variation * length[None])
    yield "known bodies", _solved(measured, known)


def _measured(data: Walk) -> MeasuredRange:
    result = triangulate(data.rig, data.detections, Options())
    assert result.tracks is not None
    assert result.noise is not None
    return MeasuredRange(
        result.rig, data.detections, result.tracks, result.layers["measured"], result.swaps, result.noise
    )


def _solved(measured: MeasuredRange, priors: RecordingPriors) -> np.ndarray:
    return np.asarray(solve(measured, priors, _OPTIONS).points_m)[:, 0]


def knee_angles_deg(points_m: np.ndarray) -> np.ndarray:
    """Return the angle between thigh and shank of both legs, shape (frame, side)."""
    skeleton = find_skeleton("halpe_26")
    sides = []
    for side in ("left", "right"):
        hip, knee, ankle = (points_m[:, skeleton.index(f"{side}_{part}")] for part in ("hip", "knee", "ankle"))
        thigh, shank = knee - hip, ankle - knee
        cross = np.linalg.norm(np.cross(thigh, shank), axis=-1)
        sides.append(np.degrees(np.arctan2(cross, (thigh * shank).sum(axis=-1))))
    return np.stack(sides, axis=1)


def scores(data: Walk, long: Walk) -> dict[str, tuple[float, float]]:
    """Return the median error in mm and the error of the knee angle in degrees (RMS) of each method."""
    true_deg = knee_angles_deg(data.points_m)
    return {
        name: (
            1000.0 * float(np.nanmedian(np.linalg.norm(points - data.points_m, axis=-1))),
            float(np.sqrt(np.nanmean(np.square(knee_angles_deg(points) - true_deg)))),
        )
        for name, points in layers(data, long)
    }


def main() -> None:
    """Print the mean scores of each kind of trial."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--cameras", default="3,4,5")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| trial | cameras | method | median mm | relative to consensus | knee, degrees RMS |")
    print("|---|---|---|---|---|---|")
    for activity in ACTIVITIES:
        for duration_s in DURATIONS_S:
            for cameras in map(int, given.cameras.split(",")):
                runs = [
                    scores(trial(activity, duration_s, cameras, seed), trial(activity, LONG_S, cameras, seed))
                    for seed in range(100, 100 + given.seeds)
                ]
                usual = float(np.mean([run["consensus"][0] for run in runs]))
                for name in runs[0]:
                    median, knee = np.mean([run[name] for run in runs], axis=0)
                    print(
                        f"| {activity} {duration_s} s | {cameras} | {name} | {median:.1f} | {median / usual:.2f} | "
                        f"{knee:.1f} |",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
