"""Places of detected keypoints on the bodies of the anatomical model, with the spread between people and detectors."""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from tomllib import loads

import numpy as np

from posefuse.skeleton.skeletons import Skeleton

SIDES = {"left": "l", "right": "r"}
"""Sides in names of keypoints, and the ends of names of bodies and coordinates."""


@dataclass(frozen=True)
class Placement:
    """Place of a keypoint on a body.

    Attributes:
        keypoint: Name of the keypoint.
        body: Name of the body.
        place_m: Place in the axes of the unscaled body.
        sd_m: Standard deviations of a person's mean deviation from the place, along the body's axes.
    """

    keypoint: str
    body: str
    place_m: tuple[float, float, float]
    sd_m: tuple[float, float, float]


def placements_of(skeleton: Skeleton) -> tuple[Placement, ...]:
    """Return the placements of a skeleton's keypoints, in their order; keypoints without a place are left out."""
    table = _tables()
    entries = {**table["keypoints"], **table["skeletons"].get(skeleton.name, {})}
    found = (_placement(name, entries) for name in skeleton.keypoints)
    return tuple(each for each in found if each is not None)


def arrays_of(placements: tuple[Placement, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return places and standard deviations, each of shape (keypoint, 3), in m."""
    return np.array([each.place_m for each in placements]), np.array([each.sd_m for each in placements])


def mirrored(name: str) -> str:
    """Return the name of the keypoint on the other side; the same name without a side."""
    words = name.split("_")
    other = {"left": "right", "right": "left"}
    return "_".join(other.get(word, word) for word in words)


def _placement(name: str, entries: dict[str, dict]) -> Placement | None:
    words = name.split("_")
    side = next((word for word in words if word in SIDES), "")
    entry = entries.get("_".join(word for word in words if word != side))
    if entry is None:
        return None
    x, y, z = entry["place_m"]
    body = entry["body"]
    paired = body not in ("pelvis", "torso", "head")
    place = (x, y, -z if side == "left" else z)
    return Placement(name, f"{body}_{SIDES[side]}" if paired else body, place, tuple(entry["sd_m"]))


@cache
def _tables() -> dict[str, dict]:
    return loads((files("posefuse.biomechanics") / "placements.toml").read_text("utf-8"))
