"""Masses and inertia of scaled bodies."""

import numpy as np
import pytest

from posefuse.biomechanics.anatomy.anatomy import read_anatomy
from posefuse.biomechanics.anatomy.scaled import ScaledAnatomy


def person(factor: float, mass_kg: float | None) -> ScaledAnatomy:
    anatomy = read_anatomy()
    none = np.empty(0, dtype=np.int64)
    scales = factor * anatomy.unscaled()
    return ScaledAnatomy("anna", anatomy, scales, (), none, np.empty((0, 3)), anatomy.defaults, mass_kg)


def test_bodies_keep_their_shares_of_the_mass() -> None:
    anatomy = read_anatomy()
    scaled = person(1.1, 60.0)
    assert scaled.masses_kg.sum() == pytest.approx(60.0)
    np.testing.assert_allclose(scaled.masses_kg / 60.0, anatomy.masses_kg / anatomy.masses_kg.sum())
    np.testing.assert_array_equal(person(1.1, None).masses_kg, anatomy.masses_kg)


def test_inertia_grows_with_mass_and_the_square_of_size() -> None:
    anatomy = read_anatomy()
    total = anatomy.masses_kg.sum()
    np.testing.assert_allclose(person(1.2, 0.5 * total).inertia_kg_m2, 0.5 * 1.2**2 * anatomy.inertia_kg_m2)
