"""Marker set of OpenSim's full-body model, and the measurements that scale its bodies.

Joint centers are those of the model of Rajagopal et al. 2016, IEEE Trans Biomed Eng 63(10), to the mm; body
axes are OpenSim's: x forward, y up, z to the right.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Marker:
    """A marker on a model.

    Attributes:
        body: name of the body in the model.
        place_m: position in the body's axes.
        weight: weight in inverse kinematics.
    """

    body: str
    place_m: tuple[float, float, float]
    weight: float = 1.0


@dataclass(frozen=True)
class Measurement:
    """A measurement that scales bodies: the mean distance between pairs of markers relative to that in the model.

    Attributes:
        name: name of the measurement.
        pairs: pairs of markers.
        bodies: the bodies that it scales.
        axes: the axes along which it scales them.
    """

    name: str
    pairs: tuple[tuple[str, str], ...]
    bodies: tuple[str, ...]
    axes: str = "X Y Z"


def _both(name: str, body: str, place_m: tuple[float, float, float], weight: float = 1.0) -> dict[str, Marker]:
    """Return a marker on the right body and its mirror image on the left body."""
    x, y, z = place_m
    return {
        f"R{name}": Marker(f"{body}_r", place_m, weight),
        f"L{name}": Marker(f"{body}_l", (x, y, -z), weight),
    }


def _on_trunk(name: str, body: str, place_m: tuple[float, float, float], weight: float = 1.0) -> dict[str, Marker]:
    """Return a right and a left marker on the same body."""
    x, y, z = place_m
    return {f"R{name}": Marker(body, place_m, weight), f"L{name}": Marker(body, (x, y, -z), weight)}


MARKERS: dict[str, Marker] = {
    "Hip": Marker("pelvis", (-0.056, -0.078, 0.0)),
    **_on_trunk("Hip", "pelvis", (-0.056, -0.078, 0.077)),
    **_both("Knee", "femur", (-0.005, -0.410, -0.002)),
    **_both("Ankle", "tibia", (-0.010, -0.400, 0.0)),
    **_both("Heel", "calcn", (0.0, 0.015, 0.0), 0.5),
    **_both("BigToe", "toes", (0.060, 0.005, -0.015), 0.5),
    **_both("SmallToe", "toes", (0.027, 0.005, 0.029), 0.5),
    "Neck": Marker("torso", (0.003, 0.400, 0.0), 0.5),
    **_on_trunk("Shoulder", "torso", (0.003, 0.372, 0.170)),
    **_both("Elbow", "humerus", (0.013, -0.286, -0.010)),
    **_both("Wrist", "radius", (-0.009, -0.236, 0.014)),
}
"""Markers by name, trunk and legs first. The head has none, because it does not move relative to the model's trunk."""

_PARTS = {
    "hip": "Hip", "knee": "Knee", "ankle": "Ankle", "heel": "Heel", "big_toe": "BigToe", "small_toe": "SmallToe",
    "foot_index": "BigToe", "shoulder": "Shoulder", "elbow": "Elbow", "wrist": "Wrist", "eye": "Eye", "ear": "Ear",
}  # fmt: skip
NAMES: dict[str, str] = {
    "mid_hip": "Hip", "pelvis": "Hip", "neck": "Neck", "nose": "Nose", "head": "Head", "head_top": "Head",
    **{f"right_{part}": f"R{marker}" for part, marker in _PARTS.items()},
    **{f"left_{part}": f"L{marker}" for part, marker in _PARTS.items()},
}  # fmt: skip
"""Marker names by keypoint name."""


def _sides(first: str, second: str) -> tuple[tuple[str, str], ...]:
    return tuple((f"{side}{first}", f"{side}{second}") for side in "RL")


MEASUREMENTS: tuple[Measurement, ...] = (
    Measurement("pelvis", (("RHip", "LHip"),), ("pelvis",)),
    Measurement("thigh", _sides("Hip", "Knee"), ("femur_r", "femur_l", "patella_r", "patella_l")),
    Measurement("shank", _sides("Knee", "Ankle"), ("tibia_r", "tibia_l")),
    Measurement("foot", _sides("Heel", "BigToe"), ("talus_r", "talus_l", "calcn_r", "calcn_l", "toes_r", "toes_l")),
    Measurement("trunk", (*_sides("Hip", "Shoulder"),), ("torso",), "X Y"),
    Measurement("shoulders", (("RShoulder", "LShoulder"),), ("torso",), "Z"),
    Measurement("upper_arm", _sides("Shoulder", "Elbow"), ("humerus_r", "humerus_l")),
    Measurement("forearm", _sides("Elbow", "Wrist"), ("ulna_r", "ulna_l", "radius_r", "radius_l", "hand_r", "hand_l")),
)
