"""Anatomical chain of a person: bodies, joints, coordinates, read from ``full_body.toml`` beside this module."""

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from posefuse.biomechanics.anatomy.simm_spline import simm_spline
from posefuse.kernels.biomechanics.chain import MOTIONS, Chain, ChainState, body_poses, marker_positions

GROUND = "ground"
_NO_VECTOR = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Anatomy:
    """Hold a chain of bodies; the joint at index ``i`` connects body ``i`` to its parent.

    Lengths are in m, masses in kg. Axes of bodies in the neutral pose: x forward, y up, z to the right.

    Attributes:
        name: name of the model.
        bodies: names of the bodies, parents first.
        joints: names of the joints, one per body.
        coordinates: names of the coordinates, in the order of the joints.
        is_translation: shape (coordinate,), bool: the coordinate is a length in m, not an angle in rad.
        ranges: shape (coordinate, 2): published lower and upper limit, rad or m.
        defaults: shape (coordinate,): rad or m.
        masses_kg: shape (body,).
        centers_m: shape (body, 3): centers of mass.
        inertia_kg_m2: shape (body, 3): moments about the center of mass along the axes of the body.
        frame_angles_rad: shape (body, 2, 3): body-fixed XYZ angles of the axes of the joint in the parent, then in the
            body.
        spline_values: shape (spline, knot): values at ``chain.knots``, rad or m.
        chain: joints as arrays.
    """

    name: str
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    coordinates: tuple[str, ...]
    is_translation: np.ndarray
    ranges: np.ndarray
    defaults: np.ndarray
    masses_kg: np.ndarray
    centers_m: np.ndarray
    inertia_kg_m2: np.ndarray
    frame_angles_rad: np.ndarray
    spline_values: np.ndarray
    chain: Chain

    def body_index(self, name: str) -> int:
        """Return the index of a body."""
        return self.bodies.index(name)

    def coordinate_index(self, name: str) -> int:
        """Return the index of a coordinate."""
        return self.coordinates.index(name)

    def unscaled(self) -> np.ndarray:
        """Return scale factors of one, shape (body, 3)."""
        return np.ones((len(self.bodies), 3))

    def new_state(self) -> ChainState:
        """Return scratch arrays for the kernels."""
        return ChainState.allocate(len(self.bodies), len(self.coordinates))

    def body_poses(self, scales: np.ndarray, coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute ``world_from_body`` of all bodies.

        Args:
            scales: shape (body, 3): scale factors.
            coordinates: shape (frame, coordinate), rad or m.

        Returns:
            Rotations, shape (frame, body, 3, 3), and origins, shape (frame, body, 3), in m.
        """
        frames, bodies = len(coordinates), len(self.bodies)
        rotations, origins = np.empty((frames, bodies, 3, 3)), np.empty((frames, bodies, 3))
        q = np.ascontiguousarray(coordinates, dtype=np.float64)
        body_poses(self.chain, np.ascontiguousarray(scales, dtype=np.float64), q, self.new_state(), rotations, origins)
        return rotations, origins

    def marker_positions(
        self, scales: np.ndarray, coordinates: np.ndarray, marker_body: np.ndarray, locations_m: np.ndarray
    ) -> np.ndarray:
        """Compute the positions of markers, shape (frame, marker, 3), in m.

        Args:
            scales: shape (body, 3): scale factors.
            coordinates: shape (frame, coordinate), rad or m.
            marker_body: shape (marker,): indices of bodies.
            locations_m: shape (marker, 3): locations in the unscaled bodies.
        """
        positions = np.empty((len(coordinates), len(marker_body), 3))
        q = np.ascontiguousarray(coordinates, dtype=np.float64)
        factors, places = (np.ascontiguousarray(x, dtype=np.float64) for x in (scales, locations_m))
        bodies = np.ascontiguousarray(marker_body, dtype=np.int64)
        marker_positions(self.chain, factors, q, self.new_state(), bodies, places, positions)
        return positions


@cache
def read_anatomy() -> Anatomy:
    """Return the full-body model of Rajagopal et al. 2016 without muscles, with a neck joint."""
    text = (files("posefuse.biomechanics.anatomy") / "full_body.toml").read_text(encoding="utf-8")
    table = tomllib.loads(text)
    bodies = table["bodies"]
    names = tuple(body["name"] for body in bodies)
    coordinates = tuple(dict.fromkeys(motion["coordinate"] for body in bodies for motion in body["joint"]["motion"]))
    facts = [table["coordinates"][name] for name in coordinates]
    frame_angles = np.array(
        [[body["joint"].get(f"{side}_rotation_rad", _NO_VECTOR) for side in ("parent", "child")] for body in bodies]
    )
    splines = {name: np.array(values) for name, values in table["splines"].items()}
    knots = splines.pop("x_rad")
    values = np.array(list(splines.values()))
    return Anatomy(
        name=table["name"],
        bodies=names,
        joints=tuple(body["joint"]["name"] for body in bodies),
        coordinates=coordinates,
        is_translation=np.array(["range_m" in fact for fact in facts]),
        ranges=np.array([fact.get("range_m") or np.radians(fact["range_deg"]) for fact in facts]),
        defaults=np.array([fact.get("default_m", 0.0) for fact in facts]),
        masses_kg=np.array([body["mass_kg"] for body in bodies]),
        centers_m=np.array([body["center_m"] for body in bodies]),
        inertia_kg_m2=np.array([body["inertia_kg_m2"] for body in bodies]),
        frame_angles_rad=frame_angles,
        spline_values=values,
        chain=_chain(bodies, names, coordinates, frame_angles, (tuple(splines), knots, values)),
    )


def _chain(
    bodies: list[dict[str, Any]],
    names: tuple[str, ...],
    coordinates: tuple[str, ...],
    frame_angles: np.ndarray,
    splines: tuple[tuple[str, ...], np.ndarray, np.ndarray],
) -> Chain:
    """Pack the joints into arrays."""
    spline_names, knots, values = splines
    shape = (len(bodies), MOTIONS)
    axes, coordinate, spline = np.zeros((*shape, 3)), np.full(shape, -1), np.full(shape, -1)
    for b, body in enumerate(bodies):
        filled = {False: 0, True: MOTIONS // 2}
        for motion in body["joint"]["motion"]:
            kind = motion.get("translation", False)
            m, filled[kind] = filled[kind], filled[kind] + 1
            axes[b, m] = motion.get("factor", 1.0) * np.array(motion["axis"]) / np.linalg.norm(motion["axis"])
            coordinate[b, m] = coordinates.index(motion["coordinate"])
            spline[b, m] = spline_names.index(motion["spline"]) if "spline" in motion else -1
    joints = [body["joint"] for body in bodies]
    return Chain(
        parent=np.array([-1 if j["parent"] == GROUND else names.index(j["parent"]) for j in joints], dtype=np.int64),
        parent_offset_m=np.array([j.get("parent_offset_m", _NO_VECTOR) for j in joints]),
        parent_rotation=Rotation.from_euler("XYZ", frame_angles[:, 0]).as_matrix(),
        child_offset_m=np.array([j.get("child_offset_m", _NO_VECTOR) for j in joints]),
        child_rotation=Rotation.from_euler("XYZ", frame_angles[:, 1]).as_matrix(),
        axes=axes,
        coordinate=coordinate.astype(np.int64),
        spline=spline.astype(np.int64),
        knots=knots,
        pieces=np.array([simm_spline(knots, row) for row in values]),
    )
