"""OpenSim loads written models, and places their bodies and markers where the kernels do."""

from pathlib import Path

import numpy as np
import pytest

from posefuse.biomechanics.anatomy.anatomy import read_anatomy
from posefuse.biomechanics.anatomy.scaled import ScaledAnatomy
from posefuse.io.opensim.model_file import write_model

opensim = pytest.importorskip("opensim", reason="the package opensim is not installed: pip install 'posefuse[opensim]'")
opensim.Logger.removeFileSink()


def scaled_person(seed: int = 0, mass_kg: float | None = 60.0) -> ScaledAnatomy:
    """Return a person of random sizes with one marker on every body."""
    anatomy, rng = read_anatomy(), np.random.default_rng(seed)
    bodies = len(anatomy.bodies)
    return ScaledAnatomy(
        "anna",
        anatomy,
        rng.uniform(0.8, 1.2, (bodies, 3)),
        tuple(f"m_{body}" for body in anatomy.bodies),
        np.arange(bodies),
        rng.normal(0.0, 0.1, (bodies, 3)),
        anatomy.defaults,
        mass_kg,
    )


def opened(path: Path):
    """Return a model and its state, whose parts live as long as the model."""
    model = opensim.Model(str(path))
    return model, model.initSystem()


def vector(value) -> list[float]:
    return [value.get(i) for i in range(3)]


def test_bodies_and_markers_are_where_the_kernels_place_them(tmp_path: Path) -> None:
    person = scaled_person()
    anatomy = person.anatomy
    write_model(person, tmp_path / "model.osim")
    model, state = opened(tmp_path / "model.osim")
    rng = np.random.default_rng(1)
    # Also beyond the ends of the knee splines and of the published ranges.
    low, high = anatomy.ranges.T
    q = rng.uniform(low - 0.2, high + 0.2, (5, len(anatomy.coordinates)))
    rotations, origins = anatomy.body_poses(person.scales, q)
    markers = anatomy.marker_positions(person.scales, q, person.marker_bodies, person.marker_locations_m)
    for t in range(len(q)):
        for name, value in zip(anatomy.coordinates, q[t], strict=True):
            model.getCoordinateSet().get(name).setValue(state, value, False)
        model.realizePosition(state)
        for b, body in enumerate(anatomy.bodies):
            pose = model.getBodySet().get(body).getTransformInGround(state)
            theirs = [[pose.R().get(i, j) for j in range(3)] for i in range(3)]
            np.testing.assert_allclose(rotations[t, b], theirs, atol=1e-9)
            np.testing.assert_allclose(origins[t, b], vector(pose.p()), atol=1e-9)
            place = model.getMarkerSet().get(f"m_{body}").getLocationInGround(state)
            np.testing.assert_allclose(markers[t, b], vector(place), atol=1e-9)


def test_scaling_equals_that_of_opensim(tmp_path: Path) -> None:
    person = scaled_person()
    unscaled = ScaledAnatomy(
        "model", person.anatomy, person.anatomy.unscaled(), person.marker_names, person.marker_bodies,
        person.marker_locations_m, person.defaults,
    )  # fmt: skip
    write_model(person, tmp_path / "scaled.osim")
    write_model(unscaled, tmp_path / "unscaled.osim")
    ours, our_state = opened(tmp_path / "scaled.osim")
    theirs, their_state = opened(tmp_path / "unscaled.osim")
    scale_set = opensim.ScaleSet()
    for body, factors in zip(person.anatomy.bodies, person.scales, strict=True):
        scale = opensim.Scale()
        scale.setSegmentName(body)
        scale.setScaleFactors(opensim.Vec3(*factors))
        scale_set.cloneAndAppend(scale)
    theirs.scale(their_state, scale_set, True, 60.0)
    their_state = theirs.initSystem()
    for model, state in ((ours, our_state), (theirs, their_state)):
        model.getCoordinateSet().get("knee_angle_r").setValue(state, 1.0, False)
        model.realizePosition(state)
    assert ours.getTotalMass(our_state) == pytest.approx(60.0)
    for body in person.anatomy.bodies:
        a, b = (model.getBodySet().get(body) for model in (ours, theirs))
        places = [vector(each.getTransformInGround(state).p()) for each, state in ((a, our_state), (b, their_state))]
        np.testing.assert_allclose(*places, atol=1e-9)
        assert a.getMass() == pytest.approx(b.getMass())
        np.testing.assert_allclose(vector(a.getMassCenter()), vector(b.getMassCenter()), atol=1e-12)


def test_the_same_person_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.osim", "b.osim"):
        write_model(scaled_person(), tmp_path / name)
    assert (tmp_path / "a.osim").read_bytes() == (tmp_path / "b.osim").read_bytes()
    assert "CC BY 3.0" in (tmp_path / "a.osim").read_text("utf-8")
