"""Anatomical chain of one person: scale factors, masses and markers."""

from dataclasses import dataclass

import numpy as np

from posefuse.biomechanics.anatomy.anatomy import Anatomy


@dataclass(frozen=True, eq=False)
class ScaledAnatomy:
    """Hold an anatomical chain with a person's sizes and markers.

    Attributes:
        name: name of the person.
        anatomy: unscaled chain.
        scales: shape (body, 3): scale factors of the bodies.
        marker_names: names of the markers.
        marker_bodies: shape (marker,), int64: indices of bodies.
        marker_locations_m: shape (marker, 3): locations in the unscaled bodies.
        defaults: shape (coordinate,): coordinates of the initial pose, rad or m.
        mass_kg: mass of the person, or None for that of the unscaled chain.
    """

    name: str
    anatomy: Anatomy
    scales: np.ndarray
    marker_names: tuple[str, ...]
    marker_bodies: np.ndarray
    marker_locations_m: np.ndarray
    defaults: np.ndarray
    mass_kg: float | None = None

    @property
    def masses_kg(self) -> np.ndarray:
        """Masses of the bodies, which keep their shares of the total; shape (body,)."""
        masses = self.anatomy.masses_kg
        return masses if self.mass_kg is None else masses * (self.mass_kg / masses.sum())

    @property
    def centers_m(self) -> np.ndarray:
        """Centers of mass of the scaled bodies, shape (body, 3)."""
        return self.scales * self.anatomy.centers_m

    @property
    def inertia_kg_m2(self) -> np.ndarray:
        """Moments of inertia of the scaled bodies about their centers of mass, shape (body, 3).

        The second moments of mass along the axes grow with the squares of the scale factors. OpenSim's ScaleTool
        approximates bodies by cylinders instead.
        """
        moments = self.anatomy.inertia_kg_m2
        along = 0.5 * moments.sum(axis=1, keepdims=True) - moments
        along = along * self.scales**2 * (self.masses_kg / self.anatomy.masses_kg)[:, None]
        return along.sum(axis=1, keepdims=True) - along

    @property
    def scaled_locations_m(self) -> np.ndarray:
        """Locations of the markers in the scaled bodies, shape (marker, 3)."""
        return self.scales[self.marker_bodies] * self.marker_locations_m
