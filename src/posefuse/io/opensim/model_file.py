"""Write an anatomical chain as an OpenSim model (``.osim``) without muscles.

Structure after the documentation of OpenSim 4, "OpenSim Models". Every joint is a CustomJoint; the names of bodies,
joints and coordinates are those of Rajagopal et al. 2016. Coordinates are not clamped: their ranges are for display.
"""

from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from posefuse.biomechanics.anatomy.anatomy import GROUND, Anatomy
from posefuse.biomechanics.anatomy.scaled import ScaledAnatomy
from posefuse.io.opensim.documents import add, add_objects, document, write_document
from posefuse.kernels.biomechanics.chain import MOTIONS

CREDITS = (
    "Joint parameters and masses: Rajagopal A, Dembia CL, DeMers MS, Delp DD, Hicks JL, Delp SL, Full-body "
    "musculoskeletal model for muscle-driven simulation of human gait, IEEE Trans Biomed Eng 63(10), 2016, "
    "https://simtk.org/projects/full_body, licensed under CC BY 3.0 (https://creativecommons.org/licenses/by/3.0/). "
    "Changes: no muscles, no patellae, a neck joint, scaled to a person. The neck joint is that of Pose2Sim (Pagnon et "
    "al. 2021, BSD 3-Clause license)."
)
_ROTATIONS = MOTIONS // 2
_TRANSFORMS = ("rotation1", "rotation2", "rotation3", "translation1", "translation2", "translation3")


def write_model(person: ScaledAnatomy, path: Path) -> None:
    """Write the model of a person.

    Raises:
        FileError: if the file cannot be written.
    """
    root = document()
    model = add(root, "Model", name=person.name)
    add(model, "credits", CREDITS)
    add(model, "length_units", "meters")
    add(model, "force_units", "N")
    add(model, "gravity", "0 -9.80665 0")
    add(model, "Ground", name=GROUND)
    bodies = add_objects(model, "BodySet", name="bodyset")
    for b, name in enumerate(person.anatomy.bodies):
        body = add(bodies, "Body", name=name)
        add(body, "mass", _text(person.masses_kg[b]))
        add(body, "mass_center", _texts(person.centers_m[b]))
        add(body, "inertia", _texts([*person.inertia_kg_m2[b], 0.0, 0.0, 0.0]))
    joints = add_objects(model, "JointSet", name="jointset")
    for b in range(len(person.anatomy.bodies)):
        _add_joint(joints, person, b)
    markers = add_objects(model, "MarkerSet", name="markerset")
    for name, b, location in zip(person.marker_names, person.marker_bodies, person.scaled_locations_m, strict=True):
        marker = add(markers, "Marker", name=name)
        add(marker, "socket_parent_frame", f"/bodyset/{person.anatomy.bodies[b]}")
        add(marker, "location", _texts(location))
        add(marker, "fixed", "true")
    write_document(root, path)


def _add_joint(joints: ElementTree.Element, person: ScaledAnatomy, b: int) -> None:
    """Add the joint of a body."""
    anatomy, chain = person.anatomy, person.anatomy.chain
    body, p = anatomy.bodies[b], int(chain.parent[b])
    parent = GROUND if p < 0 else anatomy.bodies[p]
    factors = person.scales[p] if p >= 0 else np.ones(3)
    joint = add(joints, "CustomJoint", name=anatomy.joints[b])
    add(joint, "socket_parent_frame", f"{parent}_offset")
    add(joint, "socket_child_frame", f"{body}_offset")
    coordinates = add(joint, "coordinates")
    for c in dict.fromkeys(int(c) for c in chain.coordinate[b] if c >= 0):
        _add_coordinate(coordinates, anatomy, c, person.defaults[c])
    frames = add(joint, "frames")
    own = zip(
        (parent, body),
        ("/ground" if p < 0 else f"/bodyset/{parent}", f"/bodyset/{body}"),
        (factors * chain.parent_offset_m[b], person.scales[b] * chain.child_offset_m[b]),
        anatomy.frame_angles_rad[b],
        strict=True,
    )
    for name, socket, offset, angles in own:
        frame = add(frames, "PhysicalOffsetFrame", name=f"{name}_offset")
        add(frame, "socket_parent", socket)
        add(frame, "translation", _texts(offset))
        add(frame, "orientation", _texts(angles))
    transform = add(joint, "SpatialTransform")
    for group in (range(_ROTATIONS), range(_ROTATIONS, MOTIONS)):
        axes = _complete_axes(chain.axes[b, group], chain.coordinate[b, group] >= 0)
        for m, axis in zip(group, axes, strict=True):
            _add_motion(transform, anatomy, (b, m), axis, factors)


def _add_coordinate(coordinates: ElementTree.Element, anatomy: Anatomy, c: int, default: float) -> None:
    coordinate = add(coordinates, "Coordinate", name=anatomy.coordinates[c])
    add(coordinate, "default_value", _text(default))
    add(coordinate, "range", _texts(anatomy.ranges[c]))
    add(coordinate, "clamped", "false")
    add(coordinate, "locked", "false")


def _complete_axes(axes: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Return independent axes: the used ones without their sign, and for the others those farthest from them."""
    out = np.abs(axes) if np.count_nonzero(axes, axis=1).max() <= 1 else axes.copy()
    chosen = [out[i] for i in np.flatnonzero(used)]
    for i in np.flatnonzero(~used):
        nearness = [max((abs(axis @ unit) for axis in chosen), default=0.0) for unit in np.eye(3)]
        out[i] = np.eye(3)[int(np.argmin(nearness))]
        chosen.append(out[i])
    return out


def _add_motion(
    transform: ElementTree.Element, anatomy: Anatomy, motion: tuple[int, int], axis: np.ndarray, factors: np.ndarray
) -> None:
    """Add an axis of a joint and the function along it; translations by splines have the scale of the parent."""
    chain, (b, m) = anatomy.chain, motion
    c, spline = int(chain.coordinate[b, m]), int(chain.spline[b, m])
    element = add(transform, "TransformAxis", name=_TRANSFORMS[m])
    add(element, "coordinates", anatomy.coordinates[c] if c >= 0 else None)
    add(element, "axis", _texts(axis))
    sign = float(np.sign(axis @ chain.axes[b, m]))
    if c < 0:
        add(add(element, "Constant", name="function"), "value", "0")
    elif spline < 0:
        add(add(element, "LinearFunction", name="function"), "coefficients", f"{_text(sign)} 0")
    else:
        function = add(element, "SimmSpline", name="function")
        size = float(np.abs(axis) @ factors) if m >= _ROTATIONS else 1.0
        add(function, "x", _texts(chain.knots))
        add(function, "y", _texts(sign * size * anatomy.spline_values[spline]))


def _texts(values: Iterable[float]) -> str:
    return " ".join(_text(value) for value in values)


def _text(value: float) -> str:
    """Return a number with all its digits."""
    return f"{float(value) + 0.0:.17g}"
