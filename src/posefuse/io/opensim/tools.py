"""Scale a user's model and run inverse kinematics with OpenSim."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from posefuse.biomechanics.anatomy.scaled import ScaledAnatomy
from posefuse.errors import FileError, ResultError, choices
from posefuse.io.files import must_exist
from posefuse.io.opensim.library import call_opensim

_NEEDED_BODIES = ("pelvis", "femur_r", "femur_l", "tibia_r", "tibia_l", "calcn_r", "calcn_l", "torso")
_FOLLOWS = {"patella_r": "femur_r", "patella_l": "femur_l", "sacrum": "pelvis"}
"""Bodies that the anatomical chain does not have, and the body whose scale factors they get."""
_FULL_MODEL = "The model with muscles that fits: https://simtk.org/projects/full_body (Rajagopal et al. 2016)."


@dataclass(frozen=True)
class UserModel:
    """A model of the user.

    Attributes:
        path: its file.
        bodies: names of its bodies.
        free_coordinates: coordinates that are neither locked nor constrained.
    """

    path: Path
    bodies: tuple[str, ...]
    free_coordinates: frozenset[str]


def open_model(path: Path) -> UserModel:
    """Open a model of the user.

    Raises:
        FileError: if the file does not exist or OpenSim cannot read it.
        ResultError: if OpenSim is not installed, or the model lacks bodies of a full-body model.
    """
    found = call_opensim("describe", path=str(must_exist(path, "model").absolute()))
    if "error" in found:
        raise FileError(f"{path} is not a model that OpenSim can read: {found['error']} {_FULL_MODEL}")
    lacking = [name for name in _NEEDED_BODIES if name not in found["bodies"]]
    if lacking:
        raise ResultError(
            f"{path} lacks the bodies {choices(lacking)}; it has {choices(found['bodies'], 30)}. {_FULL_MODEL}"
        )
    free = frozenset(name for name, is_free in found["free"].items() if is_free)
    return UserModel(path, tuple(found["bodies"]), free)


def scale_model(model: UserModel, person: ScaledAnatomy, path: Path) -> tuple[str, ...]:
    """Scale a user's model, and replace its markers by those of a person.

    The bodies must have the axes and origins of those of Rajagopal et al. 2016. Markers of the head go to the torso if
    the model has no head.

    Returns:
        The names of the markers that the model has.

    Raises:
        ResultError: if OpenSim fails.
    """
    factors = dict(zip(person.anatomy.bodies, person.scales.tolist(), strict=True))
    markers = _places(person, model.bodies)
    defaults = zip(person.anatomy.coordinates, person.defaults.tolist(), strict=True)
    answer = call_opensim(
        "scale",
        source=str(model.path.absolute()),
        output=str(path.absolute()),
        name=person.name,
        mass_kg=person.mass_kg,
        factors={name: factors[own] for name in model.bodies if (own := _FOLLOWS.get(name, name)) in factors},
        markers=markers,
        defaults={name: value for name, value in defaults if name.startswith("pelvis_")},
    )
    if not answer.get("written"):
        raise ResultError(f"OpenSim cannot scale {model.path}: {answer.get('error', 'it cannot write the file')}")
    return tuple(markers)


def _places(person: ScaledAnatomy, bodies: tuple[str, ...]) -> dict[str, tuple[str, list[float]]]:
    """Return the body and the scaled location of each marker whose body the model has."""
    found = {}
    anatomy, chain = person.anatomy, person.anatomy.chain
    for name, b, location in zip(person.marker_names, person.marker_bodies, person.scaled_locations_m, strict=True):
        body, place = anatomy.bodies[b], location
        if body == "head" and body not in bodies:
            # In the neutral pose of the neck, from which the model's head cannot move.
            p = int(chain.parent[b])
            place = place - person.scales[b] * chain.child_offset_m[b] + person.scales[p] * chain.parent_offset_m[b]
            body = anatomy.bodies[p]
        if body in bodies:
            found[name] = (body, place.tolist())
    return found


def run_inverse_kinematics(setup: Path) -> float:
    """Run a setup ``<stem>_ik.xml``, which writes the motion ``<stem>.mot`` beside it.

    Returns:
        The root mean square distance of markers over all frames, in m.

    Raises:
        ResultError: if OpenSim is not installed or the tool fails.
    """
    stem = setup.name.removesuffix("_ik.xml")
    errors = setup.with_name(f"{stem}_ik_marker_errors.sto")
    answer = call_opensim("inverse_kinematics", setup=str(setup.absolute()), errors=str(errors.absolute()))
    if "error" in answer:
        raise ResultError(f"OpenSim's inverse kinematics failed for {stem}: {answer['error']}")
    return float(np.sqrt(np.mean(np.square(answer["rms_m"]))))


def weights_of(sds_m: Mapping[str, float]) -> dict[str, float]:
    """Return the weights of markers from their standard deviations, relative to the largest one."""
    information = {name: sd**-2 for name, sd in sds_m.items() if np.isfinite(sd) and sd > 0}
    largest = max(information.values(), default=1.0)
    return {name: value / largest for name, value in information.items()}
