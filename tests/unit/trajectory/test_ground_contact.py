"""Resting keypoints stay in place, and landings keep their speed."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.skeleton.skeletons import Skeleton
from posefuse.trajectory.ground_contact import GroundContact
from posefuse.trajectory.priors import estimate_priors
from posefuse.trajectory.smoothness import Smoothness
from posefuse.trajectory.solve import solve
from tests.unit.trajectory.path_problems import RATE_HZ, measured

POINT = Skeleton("point", ("heel",), ())
FRAMES, LANDS = 120, 60
TIME_S = np.arange(FRAMES) / RATE_HZ
DROP_M_S = 1.0


def landing(ground_m_s=(0.0, 0.0, 0.0)):
    """A keypoint that falls at constant speed and then rests on the ground."""
    path = np.zeros((FRAMES, 1, 3))
    since = TIME_S - TIME_S[LANDS]
    path[:, 0, 2] = np.maximum(-DROP_M_S * since, 0.0)
    path[:, 0] += np.maximum(since, 0.0)[:, None] * np.array(ground_m_s)
    return path


def contact(ground_m_s=(0.0, 0.0, 0.0), resting=None):
    touching = (np.arange(FRAMES) >= LANDS).astype(np.float64)[None]
    resting = touching if resting is None else resting
    return GroundContact(
        [0], touching, resting, np.array(ground_m_s), np.array([0.0, 0.0, 1.0]), np.zeros((1, FRAMES)), 0.01
    )


def solved(points_m, found, sigma_px=8.0, seed=0):
    """The path without and with contact, shape (frame, 3), and its layers."""
    part = measured(points_m, sigma_px, seed, skeleton=POINT)
    options = TrajectoryOptions(correlation_s=0.0)
    priors = estimate_priors([part], POINT, options)
    layers = [solve(part, priors, options, find) for find in (None, lambda *_: found)]
    return [np.asarray(layer.points_m)[:, 0, 0] for layer in layers], layers


def test_a_resting_keypoint_stays_in_place():
    (free, held), layers = solved(landing(), contact())
    rests = slice(LANDS + 2, FRAMES)
    assert np.ptp(held[rests], axis=0).max() < 0.25 * np.ptp(free[rests], axis=0).max()
    assert np.abs(held[rests, 2]).max() < 0.5 * np.abs(free[rests, 2]).max()
    variance = [np.asarray(layer.covariance_m2)[rests, 0, 0, 0].mean() for layer in layers]
    assert variance[1] < variance[0]


def test_a_landing_keeps_its_speed():
    pairs = [solved(landing(), contact(), 2.0, seed)[0] for seed in range(6)]
    free, held = (
        np.mean([[path[LANDS - 2, 2] - path[LANDS, 2] for path in pair] for pair in pairs], axis=0) * RATE_HZ / 2
    )
    assert held == pytest.approx(DROP_M_S, rel=0.08)
    assert free < 0.75 * DROP_M_S


def test_a_keypoint_on_a_belt_moves_with_it():
    ground = (-1.2, 0.0, 0.0)
    (_, held), _ = solved(landing(ground), contact(ground))
    speed = np.diff(held[LANDS + 2 :, 0]) * RATE_HZ
    np.testing.assert_allclose(speed, -1.2, atol=0.1)


def test_a_sliding_keypoint_moves():
    slid = landing((0.5, 0.0, 0.0))
    (_, held), _ = solved(slid, contact(resting=np.zeros((1, FRAMES))))
    assert np.ptp(held[LANDS:, 0]) == pytest.approx(np.ptp(slid[LANDS:, 0, 0]), rel=0.1)


def test_without_contact_nothing_changes():
    nothing = replace(contact(), touching=np.zeros((1, FRAMES)), resting=np.zeros((1, FRAMES)))
    terms = nothing.terms(TIME_S)
    assert not terms.rest.any()
    assert not terms.support.any()
    smoothness = Smoothness.of("jerk", TIME_S)
    density = np.full((1, len(smoothness.time_s)), 7.0)
    np.testing.assert_array_equal(nothing.density(density, smoothness, TIME_S), density)


def test_only_rows_across_the_touchdown_are_freed():
    for prior in ("jerk", "acceleration"):
        smoothness = Smoothness.of(prior, TIME_S)
        density = np.ones((1, len(smoothness.time_s)))
        freed = np.flatnonzero(contact().density(density, smoothness, TIME_S)[0] > 1.0)
        np.testing.assert_array_equal(freed, np.arange(LANDS - smoothness.order, LANDS))
