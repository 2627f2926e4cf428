"""Splines as knots: as quick as their limits allow, no quicker, and straight where their path is."""

import numpy as np
import pytest

from hpop.models.serial_arm.laws import JointSpline
from hpop.planners.programs.spline.knots import Knots

LAW = JointSpline(("a", "b"), (2.0, 1.0), (3.0, 4.0))


def a_spline(rng, pieces=5):
    values, slopes = rng.normal(size=(2, pieces + 1, 2))
    slopes[[0, -1]] = 0.0
    shares = rng.uniform(0.5, 1.5, pieces)
    return Knots(values, slopes, shares / shares.sum(), 0.0).quickest(LAW)


def extremes(knots):
    clock = np.concatenate([[0.0], np.cumsum(knots.shares)]) * knots.duration
    states = LAW.knots([*knots.values.T], [*knots.slopes.T / knots.duration], clock)
    start, end = states.take(slice(None, -1)), states.take(slice(1, None))
    return [LAW.extremes(name, start, end) for name in LAW.names]


@pytest.mark.parametrize("seed", range(20))
def test_one_limit_is_reached_and_none_broken(seed):
    found = extremes(a_spline(np.random.default_rng(seed)))
    shares = [(one.speed.max() / v, one.acceleration.max() / a) for one, v, a in zip(found, *LAW_LIMITS, strict=True)]
    assert np.max(shares) == pytest.approx(1.0, abs=1e-9)


LAW_LIMITS = (LAW.speeds, LAW.accelerations)


def test_what_is_at_fractions_is_what_the_law_says():
    knots = a_spline(np.random.default_rng(1))
    clock = np.concatenate([[0.0], np.cumsum(knots.shares)]) * knots.duration
    states = LAW.knots([*knots.values.T], [*knots.slopes.T / knots.duration], clock)
    start, end = states.take(slice(None, -1)), states.take(slice(1, None))
    for fraction in (0.0, 0.3, 1.0):
        by_law = np.stack([LAW.interpolate(name, start, end, fraction) for name in LAW.names], axis=1)
        np.testing.assert_allclose(knots.at(fraction), by_law, atol=1e-12)
