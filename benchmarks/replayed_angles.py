"""Replay known joint angles: from an anatomical model over simulated cameras to the angles of a reconstruction.

``python -m benchmarks.replayed_angles [--people N] [--cameras 5,2] [--motions walk,squat] [--noise rtmpose]
[--known-bodies]``. People have sizes, places of keypoints and habits sampled from their spread. The table has the mean
absolute error and the share of the truth inside the 95 % intervals, by group of angles. With known bodies, sizes and
places of keypoints are the true ones: what remains is due to the detections.
"""

import argparse
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from benchmarks.replayed_motions import MOTIONS
from posefuse.biomechanics.angle_definitions import angle_set, angles_of
from posefuse.biomechanics.body_scales import scale_basis, scale_factors
from posefuse.biomechanics.coordinate_priors import moving_prior
from posefuse.biomechanics.inverse_kinematics import person_points, posterior_means, solve
from posefuse.biomechanics.isb_angles import successive_angles
from posefuse.biomechanics.marker_model import MarkerModel, marker_model
from posefuse.biomechanics.person_frames import about_y, model_world
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.joint_angles import OPENSIM, WITHIN_95, JointAngles
from posefuse.model.options.options import Options
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.detector import detect
from posefuse.synthetic.options import DetectorOptions
from posefuse.synthetic.rigs import build_rig

RATE_HZ = 60.0
GROUPS: Mapping[str, tuple[str, ...]] = {
    "pelvis tilt": ("pelvis_tilt",),
    "pelvis list, rotation": ("pelvis_list", "pelvis_rotation"),
    "hip flexion": ("hip_flexion_r", "hip_flexion_l"),
    "hip adduction": ("hip_adduction_r", "hip_adduction_l"),
    "hip rotation": ("hip_rotation_r", "hip_rotation_l"),
    "knee": ("knee_angle_r", "knee_angle_l"),
    "ankle": ("ankle_angle_r", "ankle_angle_l"),
    "subtalar": ("subtalar_angle_r", "subtalar_angle_l"),
    "lumbar": ("lumbar_extension", "lumbar_bending", "lumbar_rotation"),
    "shoulder": ("arm_flex_r", "arm_flex_l", "arm_add_r", "arm_add_l"),
    "elbow": ("elbow_flex_r", "elbow_flex_l"),
}
_TILT_HABIT_DEG, _SIDE_CORRELATION = 4.0, 0.7
_MEAN_FOOT_ROTATION_DEG = 5.0


@dataclass(frozen=True)
class Replay:
    """Points of a replayed motion, and its truth.

    Attributes:
        points_m: shape (frame, keypoint, 3): keypoints, z up; NaN for those that the model does not place.
        degrees: true angles by name, each of shape (frame,).
        subject: model of the person.
    """

    points_m: np.ndarray
    degrees: Mapping[str, np.ndarray]
    subject: MarkerModel


def person(model: MarkerModel, rng: np.random.Generator) -> MarkerModel:
    """Sample the sizes of a person and where the detector places keypoints."""
    basis, sds = scale_basis(model.anatomy)
    deviation = model.sd_m * rng.standard_normal(model.sd_m.shape)
    for k, twin in enumerate(model.twins):
        if twin < k:
            own = np.sqrt(1.0 - _SIDE_CORRELATION**2) * deviation[k]
            deviation[k] = _SIDE_CORRELATION * deviation[twin] * [1.0, 1.0, -1.0] + own
    scales = scale_factors(basis, sds * rng.standard_normal(len(sds)))
    return model.with_parameters(scales, model.markers.locations_m + deviation)


def replay(motion: str, seconds: float, seed: int, skeleton_name: str = "halpe_26") -> Replay:
    """Replay a motion with a sampled person who faces a sampled direction."""
    rng = np.random.default_rng(seed)
    skeleton = find_skeleton(skeleton_name)
    model = marker_model(skeleton)
    assert model is not None
    subject = person(model, rng)
    time_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    curves = {name: np.array(values) for name, values in MOTIONS[motion](time_s + rng.uniform(0.0, 2.0)).items()}
    habit = rng.normal(0.0, _TILT_HABIT_DEG)
    _shift(curves, "pelvis_tilt", habit)
    _shift(curves, "lumbar_extension", -habit)
    for side in "rl":
        _shift(curves, f"hip_flexion_{side}", -habit)
        _shift(curves, f"hip_rotation_{side}", rng.normal(0.0, _MEAN_FOOT_ROTATION_DEG))
    anatomy = model.anatomy
    coordinates = np.zeros((len(time_s), len(anatomy.coordinates)))
    coordinates[:, anatomy.coordinate_index("pelvis_ty")] = 0.93
    for name, values in curves.items():
        c = anatomy.coordinate_index(name)
        coordinates[:, c] = values if anatomy.is_translation[c] else np.radians(values)
    positions = anatomy.marker_positions(
        subject.scales, coordinates, subject.markers.bodies, subject.markers.locations_m
    )
    heading = about_y(np.array(rng.uniform(-np.pi, np.pi)))
    to_world = model_world(np.array([0.0, 0.0, 1.0])).T
    points = np.full((len(time_s), len(skeleton), 3), np.nan)
    points[:, model.columns] = positions @ (to_world @ heading).T
    derived = skeleton.derived.items()
    for name, ends in derived:
        if np.isnan(points[:, skeleton.index(name)]).all():
            points[:, skeleton.index(name)] = points[:, [skeleton.index(end) for end in ends]].mean(axis=1)
    rotations, _ = anatomy.body_poses(subject.scales, coordinates)
    pelvis = successive_angles(heading @ rotations[:, 0], "YXZ")[:, ::-1]
    degrees = {name: np.degrees(coordinates[:, c]) for c, name in enumerate(anatomy.coordinates)}
    degrees |= dict(zip(("pelvis_tilt", "pelvis_list", "pelvis_rotation"), pelvis.T, strict=True))
    return Replay(points, degrees, subject)


def _shift(curves: dict[str, np.ndarray], name: str, by: float) -> None:
    some = next(iter(curves.values()))
    curves[name] = curves.get(name, np.zeros_like(some)) + by


def detect_replay(
    data: Replay, cameras: int, seed: int, noise: Literal["measured", "rtmpose"] = "measured"
) -> tuple[CameraRig, Detections]:
    """Return cameras around the person, and simulated detections; two cameras film from directions 90 degrees apart."""
    rig = build_rig("ring", max(cameras, 4))
    rig = replace(rig, cameras=rig.cameras[:cameras])
    skeleton = find_skeleton("halpe_26")
    points = np.repeat(data.points_m[:, None], cameras, axis=1)
    detector = DetectorOptions(noise=noise, swap_share=0.0)
    return rig, detect(rig, points, skeleton, RATE_HZ, detector, np.random.default_rng(seed))


def estimate(rig: CameraRig, detections: Detections) -> JointAngles:
    """Return the joint angles of a reconstruction."""
    # Joint angles alone do not keep feet on the floor: those of replayed walks slide and drag.
    result = reconstruct(rig, detections, Options(contact="off"))
    assert result.joint_angles is not None
    return result.joint_angles


def estimate_known_body(rig: CameraRig, detections: Detections, subject: MarkerModel) -> JointAngles:
    """Return the joint angles of a reconstruction, with the true model of the person."""
    result = reconstruct(rig, detections, Options(contact="off"))
    _, layer = result.best_layer()
    assert result.joint_angles is not None
    assert rig.up is not None
    points = person_points(subject, layer.points_m[:, 0], layer.covariance_m2[:, 0], model_world(np.array(rig.up)))
    prior = moving_prior()
    solution = solve(subject, points, prior.with_habits(np.zeros(len(prior.row_sd))))
    angles = angle_set(subject)
    degrees, sds, _ = angles_of(angles, subject, points, posterior_means(subject, points, solution), True)
    found = {"degrees": degrees[:, None], "sd_deg": sds[:, None]}
    return replace(result.joint_angles, names=angles.names, conventions=angles.conventions, **found)


def errors(data: Replay, found: JointAngles) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return errors and standard deviations of each angle with values, each of shape (frame,), in degrees."""
    out = {}
    for i, name in enumerate(found.names):
        if found.conventions[i] == OPENSIM:
            error = (found.degrees[:, 0, i] - data.degrees[name] + 180.0) % 360.0 - 180.0
            known = np.isfinite(error)
            out[name] = (error[known], np.asarray(found.sd_deg[:, 0, i])[known])
    return out


def scores(runs: Sequence[Mapping[str, tuple[np.ndarray, np.ndarray]]]) -> dict[str, tuple[float, float, float]]:
    """Return, by group, the mean absolute error, the share inside 95 % intervals, and the mean standard deviation."""
    out = {}
    for group, names in GROUPS.items():
        pieces = [run[name] for run in runs for name in names if name in run and len(run[name][0])]
        if pieces:
            error, sd = (np.concatenate([piece[i] for piece in pieces]) for i in (0, 1))
            inside = np.abs(error) <= WITHIN_95 * sd
            out[group] = (float(np.abs(error).mean()), float(inside.mean()), float(sd.mean()))
    return out


def main() -> None:
    """Print the scores of each number of cameras, by motion and of all motions."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--people", type=int, default=6)
    parser.add_argument("--cameras", default="5,2")
    parser.add_argument("--motions", default=",".join(MOTIONS))
    parser.add_argument("--noise", default="measured", choices=("measured", "rtmpose"))
    parser.add_argument("--known-bodies", action="store_true")
    parser.add_argument("--seconds", type=float, default=5.0)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    motions = given.motions.split(",")
    print("| cameras | motion | " + " | ".join(GROUPS) + " |")
    print("|" + "---|" * (2 + len(GROUPS)))
    for cameras in map(int, given.cameras.split(",")):
        every = []
        for motion in motions:
            runs = []
            for seed in range(given.people):
                data = replay(motion, given.seconds, 100 + seed)
                rig, detections = detect_replay(data, cameras, 200 + seed, given.noise)
                known = estimate_known_body(rig, detections, data.subject) if given.known_bodies else None
                runs.append(errors(data, known or estimate(rig, detections)))
            every += runs
            _print_row(cameras, motion, scores(runs))
        _print_row(cameras, "all", scores(every))


def _print_row(cameras: int, motion: str, found: Mapping[str, tuple[float, float, float]]) -> None:
    cells = (f"{found[g][0]:.1f}, {100.0 * found[g][1]:.0f} %" if g in found else "" for g in GROUPS)
    print(f"| {cameras} | {motion} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
