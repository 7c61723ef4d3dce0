"""Centers of mass: positions, velocities, standard deviations, and windows of frames."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

import posefuse
from posefuse.biomechanics import center_of_mass as module
from posefuse.biomechanics.tables import CENTERS_FILE, MASSES_FILE, body_tables
from posefuse.errors import SkeletonError
from posefuse.model.options.subject import MassTable, Sex
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import Source
from posefuse.skeleton.masses import default_table
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.scenes import truth_of

SHIFT = np.array([1.0, 2.0, 3.0])
RATE_HZ = 60.0
SD_M = 0.01


TABLES = [name for name in get_args(MassTable) if name not in ("auto", "none")]


def with_subject(result: Reconstruction, **subject: object) -> Reconstruction:
    """Return a result with options of the subject."""
    return replace(result, options=replace(result.options, subject=posefuse.SubjectOptions(**subject)))  # type: ignore[arg-type]


def with_layer(result: Reconstruction, **arrays: np.ndarray) -> Reconstruction:
    """Return a result with other arrays in its only layer."""
    name, layer = result.best_layer()
    return replace(result, layers={name: replace(layer, **arrays)})


@pytest.fixture(scope="module")
def moving(truth) -> Reconstruction:
    """Return a person who moves on a parabola, with standard deviations of 10 mm."""
    time_s = np.arange(600) / RATE_HZ
    away = np.stack([0.3 * time_s**2, -1.2 * time_s, np.zeros(len(time_s))], axis=1)
    pose = np.asarray(truth.best_layer()[1].points_m)[0, 0]
    result = truth_of(build_rig("ring", 3), truth.skeleton, pose + away[:, None], RATE_HZ)
    covariance = np.broadcast_to(SD_M**2 * np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0]), (600, 1, len(pose), 6))
    return with_layer(result, covariance_m2=covariance.copy())


@pytest.mark.parametrize(("sex", "thigh"), [("F", 0.1478), ("M", 0.1416), ("U", 0.1447), (None, 0.1447)])
def test_the_default_table_is_that_of_the_sex(truth, sex: Sex | None, thigh):
    actual = posefuse.center_of_mass(with_subject(truth, sex=sex)).masses
    assert actual == default_table(sex)
    assert next(s.mass for s in actual.segments if s.name == "left_thigh") == pytest.approx(thigh)


@pytest.mark.parametrize("name", TABLES)
def test_center_of_mass_of_a_standing_person_is_above_the_hips(name, truth, layer):
    actual = posefuse.center_of_mass(with_subject(truth, mass_table=name))
    points = np.asarray(layer.points_m)[:, 0]
    height = np.nanmax(points[..., 2], axis=1)
    assert actual.xyz_m.shape == (15, 1, 3)
    # 55 to 57 % of the height in the literature; in walking a little less.
    assert ((actual.xyz_m[:, 0, 2] / height > 0.5) & (actual.xyz_m[:, 0, 2] / height < 0.62)).all()
    np.testing.assert_allclose(actual.known_share, 1.0)
    np.testing.assert_allclose(actual.filled_share, 0.0)


def test_center_of_mass_moves_with_the_body(truth, layer):
    moved = with_layer(truth, points_m=np.asarray(layer.points_m) + SHIFT)
    before, after = (posefuse.center_of_mass(each).xyz_m for each in (truth, moved))
    np.testing.assert_allclose(after, before + SHIFT, atol=1e-9)


def test_missing_mass_and_filled_share(truth, layer):
    wrist, hip = truth.skeleton.index("left_wrist"), truth.skeleton.index("left_hip")
    points, source = np.array(layer.points_m), np.array(layer.source)
    points[0, 0, wrist] = np.nan
    points[1, 0, hip] = np.nan
    source[2, 0, wrist] = Source.FILLED
    actual = posefuse.center_of_mass(
        with_subject(with_layer(truth, points_m=points, source=source), mass_table="winter")
    )
    assert actual.known_share[0, 0] == pytest.approx(1 - 0.022)
    assert np.isfinite(actual.xyz_m[0, 0]).all()
    assert actual.known_share[1, 0] == pytest.approx(1 - 0.497 - 0.1)
    assert np.isnan(actual.xyz_m[1, 0]).all()
    assert actual.filled_share[2, 0] == pytest.approx(0.022)
    # Frames with other segments would show a jump as motion.
    assert np.isnan(actual.velocity_m_s[0, 0]).all()
    assert np.isfinite(actual.velocity_m_s[4, 0]).all()


def test_velocity_of_a_parabola_is_exact(moving):
    actual = posefuse.center_of_mass(moving)
    time_s = moving.time_s
    expected = np.stack([0.6 * time_s, np.full(len(time_s), -1.2), np.zeros(len(time_s))], axis=1)
    np.testing.assert_allclose(actual.velocity_m_s[:, 0], expected, atol=1e-9)


@pytest.mark.parametrize("layer", ["measured", "solved", "model"])
def test_intervals_contain_the_truth_under_errors_that_persist(moving, layer):
    rng, n = np.random.default_rng(5), moving.n_frames
    shape = (n, len(moving.skeleton), 3)
    shared = {"measured": 0.03, "solved": 0.14, "model": 0.1}[layer]
    lag_s = np.abs(moving.time_s[:, None] - moving.time_s)
    memory_s = {"measured": 0.15, "solved": 0.083, "model": 0.115}[layer]
    matrix = (
        np.where(lag_s == 0, 1.0, 0.85 * np.exp(-lag_s / memory_s))
        if layer == "measured" else (1.0 + lag_s / memory_s) * np.exp(-lag_s / memory_s)
    )  # fmt: skip
    root = np.linalg.cholesky(matrix + 1e-9 * np.eye(n))
    own, common = (np.einsum("fg,gki->fki", root, rng.standard_normal(each)) for each in (shape, (n, 1, 3)))
    errors = SD_M * (np.sqrt(1.0 - shared) * own + np.sqrt(shared) * common)
    exact = np.asarray(moving.best_layer()[1].points_m)
    noisy = replace(moving, layers={layer: replace(moving.best_layer()[1], points_m=exact + errors[:, None])})
    actual, truth = posefuse.center_of_mass(noisy), posefuse.center_of_mass(moving)
    assert actual.layer == layer
    position = np.abs(actual.xyz_m - truth.xyz_m) / actual.sd_m
    velocity = np.abs(actual.velocity_m_s - truth.velocity_m_s) / actual.velocity_sd_m_s
    assert 0.91 < (position < 1.96).mean() < 0.985
    assert (velocity < 1.96).mean() > 0.91
    # Smoothed layers also have a share for sudden changes, which this motion lacks.
    assert np.sqrt(np.mean(velocity**2)) > (0.85 if layer == "measured" else 0.4)


def test_windows_do_not_change_a_number(moving, monkeypatch):
    whole = posefuse.center_of_mass(moving)
    monkeypatch.setattr(module, "_WINDOW", 37)
    parts = posefuse.center_of_mass(moving)
    for name in ("xyz_m", "sd_m", "velocity_m_s", "velocity_sd_m_s", "known_share"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))


def test_the_default_writes_a_table_for_people_only(moving, truth):
    tables = body_tables(moving)
    assert MASSES_FILE not in tables
    parts = list(tables[CENTERS_FILE](moving))
    assert [len(part["frame"]) for part in parts] == [512, 88]
    assert list(parts[0]) == [
        "frame", "time_s", "person", "x_m", "y_m", "z_m", "sd_x_m", "sd_y_m", "sd_z_m", "vx_m_s", "vy_m_s", "vz_m_s",
        "sd_vx_m_s", "sd_vy_m_s", "sd_vz_m_s", "known_share", "filled_share", "layer",
    ]  # fmt: skip
    assert np.concatenate([part["frame"] for part in parts]).tolist() == moving.frame_numbers.tolist()
    assert CENTERS_FILE not in body_tables(with_subject(truth, mass_table="none"))
    known = with_subject(truth, mass_kg=60.0)
    masses = next(iter(body_tables(known)[MASSES_FILE](known)))
    assert masses["mass_kg"].sum() == pytest.approx(60.0)
    assert "known_mass_kg" in next(iter(body_tables(known)[CENTERS_FILE](known)))


def test_animals_have_no_center_of_mass(truth):
    mouse = find_skeleton("mouse_22")
    animal = truth_of(build_rig("ring", 3), mouse, np.zeros((5, len(mouse), 3)), RATE_HZ)
    assert CENTERS_FILE not in body_tables(animal)
    with pytest.raises(SkeletonError, match="needs the segment"):
        posefuse.center_of_mass(animal)
    with pytest.raises(SkeletonError, match="needs the segment"):
        body_tables(with_subject(animal, mass_table="winter"))
    with pytest.raises(SkeletonError, match="'none'"):
        posefuse.center_of_mass(with_subject(truth, mass_table="none"))
