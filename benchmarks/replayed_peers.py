"""Compare joint angles with those of Pose2Sim's triangulation, filter and inverse kinematics on the same detections.

``python -m benchmarks.replayed_peers [--people 2] [--first 0] [--cameras 5,2] [--motions walk] [--noise rtmpose]``.
Motions are those of :mod:`benchmarks.replayed_angles`. Pose2Sim gets the true stature and has the options that it comes
with, without the neural network that adds markers. The table has the mean absolute error of each group of angles, over
the frames that both have.
"""

import argparse
import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.replayed_angles import GROUPS, RATE_HZ, Replay, detect_replay, estimate, replay
from benchmarks.replayed_motions import MOTIONS
from benchmarks.speed import run_peer
from posefuse.io.calibration import pose2sim
from posefuse.io.keypoints import openpose
from posefuse.io.motion_tables import read_joint_angles
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.joint_angles import OPENSIM, JointAngles
from posefuse.pipeline.opensim import level_pelvis

Errors = Mapping[str, np.ndarray]
"""Errors in degrees by angle, shape (frame,), NaN where missing."""


def peer_errors(data: Replay, rig: CameraRig, detections: Detections) -> Errors:
    """Return the errors of Pose2Sim's angles in the frames of a replay."""
    with tempfile.TemporaryDirectory() as folder:
        project = Path(folder) / "trial"
        (project / "calibration").mkdir(parents=True)
        pose2sim.write(rig, project / "calibration" / "Calib.toml")
        openpose.write(detections, project / "pose")
        for camera in [each for each in (project / "pose").iterdir() if each.is_dir()]:
            camera.rename(camera.with_name(f"{camera.name}_json"))
        stature_m = np.nanmax(data.points_m[..., 2]) - np.nanmin(data.points_m[..., 2])
        run_peer("pose2sim_angles", project, "--rate", str(RATE_HZ), "--height", f"{stature_m:.3f}")
        found = level_pelvis(read_joint_angles(project / "angles.mot"))
    time_s = np.arange(len(data.points_m)) / RATE_HZ
    out = {}
    for i, name in enumerate(found.angles):
        if name in data.degrees:
            values = np.interp(time_s, found.time_s, found.degrees[:, i], left=np.nan, right=np.nan)
            out[name] = _wrapped(values - data.degrees[name])
    return _without_heading(out)


def own_errors(data: Replay, angles: JointAngles) -> Errors:
    """Return the errors of the angles of a reconstruction."""
    own = [i for i, convention in enumerate(angles.conventions) if convention == OPENSIM]
    return _without_heading(
        {angles.names[i]: _wrapped(angles.degrees[:, 0, i] - data.degrees[angles.names[i]]) for i in own}
    )


def _without_heading(errors: Errors) -> Errors:
    """Return errors without the mean error of the heading of the pelvis, which depends on the axes of the world."""
    name = "pelvis_rotation"
    turn = np.exp(1j * np.radians(errors[name]))
    return {**errors, name: _wrapped(errors[name] - np.degrees(np.angle(np.nanmean(turn))))}


def _wrapped(degrees: np.ndarray) -> np.ndarray:
    return (degrees + 180.0) % 360.0 - 180.0


def compared(pairs: list[tuple[Errors, Errors]]) -> dict[str, tuple[float, float]]:
    """Return the mean absolute errors of both by group, over the frames that both have."""
    out = {}
    for group, names in GROUPS.items():
        rows = [
            np.abs(np.stack([own[name], peer[name]]))
            for own, peer in pairs
            for name in names
            if {name} <= own.keys() & peer.keys()
        ]
        if rows:
            both = np.concatenate(rows, axis=1)
            both = both[:, np.isfinite(both).all(axis=0)]
            out[group] = (float(both[0].mean()), float(both[1].mean()))
    return out


def main() -> None:
    """Print a row for each number of cameras and motion, and one for all motions."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--people", type=int, default=2)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cameras", default="5,2")
    parser.add_argument("--motions", default=",".join(MOTIONS))
    parser.add_argument("--noise", default="measured", choices=("measured", "rtmpose"))
    parser.add_argument("--seconds", type=float, default=4.0)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| cameras | motion | " + " | ".join(GROUPS) + " |")
    print("|" + "---|" * (2 + len(GROUPS)))
    for cameras in map(int, given.cameras.split(",")):
        every = []
        for motion in given.motions.split(","):
            pairs = []
            for seed in range(given.first, given.first + given.people):
                data = replay(motion, given.seconds, 100 + seed)
                rig, detections = detect_replay(data, cameras, 200 + seed, given.noise)
                pairs.append((own_errors(data, estimate(rig, detections)), peer_errors(data, rig, detections)))
            every += pairs
            _print_row(cameras, motion, compared(pairs))
        _print_row(cameras, "all", compared(every))


def _print_row(cameras: int, motion: str, found: Mapping[str, tuple[float, float]]) -> None:
    cells = ("{:.1f}, {:.1f}".format(*found[group]) if group in found else "" for group in GROUPS)
    print(f"| {cameras} | {motion} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
