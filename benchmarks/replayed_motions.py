"""Coordinates of the anatomical model over time: walking, running, squatting, jumping and reaching.

Curves are sums of a few harmonics with the means and amplitudes of published averages: walking and running after
Novacheck 1998, Gait and Posture 7(1), figures 5 and 6; squats after Schoenfeld 2010, J Strength Cond Res 24(12).
"""

from collections.abc import Callable, Mapping

import numpy as np

Coordinates = Mapping[str, np.ndarray]
"""Degrees, or m for the position of the pelvis, by coordinate, each of shape (frame,)."""


def _smooth(x: np.ndarray) -> np.ndarray:
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def _bell(t: np.ndarray, center: float, width: float) -> np.ndarray:
    return np.exp(-(((t - center) / width) ** 2))


def _gait(time_s: np.ndarray, cadence_hz: float, speed: float, run: float) -> dict[str, np.ndarray]:
    """Return walking (run = 0) or running (run = 1)."""
    phase = 2.0 * np.pi * cadence_hz * time_s
    out: dict[str, np.ndarray] = {}
    for side, shift in (("r", 0.0), ("l", np.pi)):
        p = phase + shift
        out[f"hip_flexion_{side}"] = 10.0 + 8.0 * run + (22.0 + 6.0 * run) * np.cos(p) + 3.0 * np.cos(2.0 * p + 0.8)
        out[f"hip_adduction_{side}"] = 5.0 * np.cos(p - 0.9) - 1.0
        out[f"hip_rotation_{side}"] = 4.0 * np.cos(p + 2.0)
        knee = 26.0 + 16.0 * run + (24.0 + 14.0 * run) * np.cos(p + 1.25) + (14.0 + 4.0 * run) * np.cos(2.0 * p - 0.3)
        out[f"knee_angle_{side}"] = np.logaddexp(knee / 3.0, 0.0) * 3.0
        out[f"ankle_angle_{side}"] = 8.0 * np.cos(2.0 * p + 2.4) - (4.0 + 6.0 * run) * np.cos(p + 1.2)
        out[f"subtalar_angle_{side}"] = 4.0 * np.cos(p + 0.5)
        out[f"mtp_angle_{side}"] = 12.0 * _bell((p / (2.0 * np.pi) + 0.4) % 1.0, 0.5, 0.12)
        out[f"arm_flex_{side}"] = -(15.0 + 10.0 * run) * np.cos(p)
        out[f"arm_add_{side}"] = -10.0 + 0.0 * p
        out[f"arm_rot_{side}"] = 5.0 * np.cos(p)
        out[f"elbow_flex_{side}"] = 25.0 + 55.0 * run + 10.0 * np.cos(p + 2.0)
    out["pelvis_tilt"] = -4.0 - 5.0 * run + 2.0 * np.cos(2.0 * phase)
    out["pelvis_list"] = 4.0 * np.cos(phase - 0.9)
    out["pelvis_rotation"] = -4.0 * np.cos(phase)
    out["lumbar_extension"] = 1.0 + 2.0 * run - 2.0 * np.cos(2.0 * phase)
    out["lumbar_bending"] = -4.0 * np.cos(phase - 0.9)
    out["lumbar_rotation"] = 9.0 * np.cos(phase)
    out["neck_extension"] = 3.0 + 4.0 * run + 0.0 * phase
    out["pelvis_tx"] = speed * (time_s - time_s.mean())
    out["pelvis_ty"] = 0.93 + (0.02 + 0.03 * run) * np.cos(2.0 * phase)
    return out


def walk(time_s: np.ndarray) -> Coordinates:
    """Return walking at 1 m/s."""
    return _gait(time_s, 0.9, 1.0, 0.0)


def run(time_s: np.ndarray) -> Coordinates:
    """Return running on a treadmill."""
    return _gait(time_s, 1.35, 0.0, 1.0)


def _legs(down: np.ndarray, hip: float, knee: float, ankle: float) -> dict[str, np.ndarray]:
    out: dict[str, np.ndarray] = {}
    for side in "rl":
        out[f"hip_flexion_{side}"] = 3.0 + hip * down
        out[f"hip_adduction_{side}"] = -4.0 - 6.0 * down
        out[f"hip_rotation_{side}"] = -4.0 * down
        out[f"knee_angle_{side}"] = 4.0 + knee * down
        out[f"ankle_angle_{side}"] = ankle * down
        out[f"arm_flex_{side}"] = 5.0 + 55.0 * down
        out[f"arm_add_{side}"] = -8.0 + 0.0 * down
        out[f"elbow_flex_{side}"] = 15.0 + 10.0 * down
    return out


def squat(time_s: np.ndarray) -> Coordinates:
    """Return squats to 100 degrees of knee flexion."""
    down = 0.5 - 0.5 * np.cos(2.0 * np.pi * time_s / 2.4)
    out = _legs(down, 92.0, 98.0, 24.0)
    out["pelvis_tilt"] = -1.0 - 14.0 * down + 5.0 * down**3
    out["lumbar_extension"] = -16.0 * down
    out["neck_extension"] = 15.0 * down
    out["pelvis_ty"] = 0.93 - 0.33 * down
    out["pelvis_tx"] = -0.08 * down
    return out


def jump(time_s: np.ndarray) -> Coordinates:
    """Return countermovement jumps, one every two seconds."""
    t = time_s % 2.0
    down = _bell(t, 0.6, 0.2) + 0.75 * _bell(t, 1.5, 0.2)
    out = _legs(down, 72.0, 85.0, 24.0)
    air = _bell(t, 1.05, 0.22)
    for side in "rl":
        out[f"ankle_angle_{side}"] = out[f"ankle_angle_{side}"] - 28.0 * air
        out[f"arm_flex_{side}"] = 100.0 * air - 35.0 * down
        out[f"mtp_angle_{side}"] = 8.0 * air
    out["pelvis_tilt"] = -1.0 - 16.0 * down
    out["lumbar_extension"] = -15.0 * down + 4.0 * air
    out["pelvis_ty"] = 0.93 - 0.26 * down + 0.32 * air
    return out


def reach(time_s: np.ndarray) -> Coordinates:
    """Return standing and reaching forward and down with both arms in turn."""
    out: dict[str, np.ndarray] = {}
    for side, shift in (("r", 0.0), ("l", 1.6)):
        t = (time_s + shift) % 3.2
        out_of_rest = _smooth(t / 0.7) - _smooth((t - 0.9) / 0.7)
        out[f"arm_flex_{side}"] = 8.0 + 78.0 * out_of_rest
        out[f"arm_add_{side}"] = -8.0 - 12.0 * out_of_rest
        out[f"arm_rot_{side}"] = 15.0 * out_of_rest
        out[f"elbow_flex_{side}"] = 20.0 + 45.0 * _bell(t, 0.4, 0.3) - 10.0 * out_of_rest
        out[f"hip_flexion_{side}"] = 4.0 + 20.0 * out_of_rest
        out[f"knee_angle_{side}"] = 5.0 + 4.0 * out_of_rest
        out[f"ankle_angle_{side}"] = 1.0 + 2.0 * out_of_rest
        out[f"hip_adduction_{side}"] = -3.0 + 0.0 * t
    bend = _bell(time_s % 1.6, 0.8, 0.4)
    out["pelvis_tilt"] = -2.0 - 9.0 * bend
    out["lumbar_extension"] = -12.0 * bend
    out["lumbar_rotation"] = 8.0 * np.sin(2.0 * np.pi * time_s / 3.2)
    return out


MOTIONS: Mapping[str, Callable[[np.ndarray], Coordinates]] = {
    "walk": walk, "squat": squat, "jump": jump, "run": run, "reach": reach,
}  # fmt: skip
"""Motions by name."""
