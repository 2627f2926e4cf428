"""The law of splines: what it says of itself against its own values, densely sampled."""

import numpy as np
import pytest

from hpop.models.serial_arm.laws import JointSpline
from hpop.motions import States

LAW = JointSpline(("a", "b"), (2.0, 1.0), (3.0, 4.0))
SHARES = np.linspace(0.0, 1.0, 4001)


@pytest.fixture
def pieces():
    rng = np.random.default_rng(4)

    def knots(clock):
        return LAW.knots([*rng.normal(size=(2, 200))], [*rng.normal(size=(2, 200))], clock)

    return knots(np.zeros(200)), knots(rng.uniform(0.1, 3.0, 200))


def test_it_leads_through_its_knots_at_their_speeds(pieces):
    start, end = pieces
    for name in ("a", "b", "a_rate", "b_rate", "clock"):
        np.testing.assert_allclose(LAW.interpolate(name, start, end, 0.0), getattr(start, name), atol=1e-12)
        np.testing.assert_allclose(LAW.interpolate(name, start, end, 1.0), getattr(end, name), atol=1e-12)


@pytest.mark.parametrize("name", ["a", "b_rate", "clock"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.93])
def test_slopes_are_those_of_its_values(pieces, name, share):
    start, end = pieces
    step = 1e-4
    before, at, after = (LAW.interpolate(name, start, end, share + off) for off in (-step, 0.0, step))
    first, second = LAW.slopes(name, start, end, share)
    np.testing.assert_allclose(first, (after - before) / (2 * step), atol=1e-5)
    np.testing.assert_allclose(second, (after - 2 * at + before) / step**2, atol=1e-4)


def test_extremes_and_ways_are_those_of_its_values(pieces):
    start, end = pieces
    found = LAW.extremes("a", start, end)
    values = np.array([LAW.interpolate("a", start, end, share) for share in SHARES])
    rates = np.array([LAW.interpolate("a_rate", start, end, share) for share in SHARES])
    np.testing.assert_allclose(found.low, values.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(found.high, values.max(axis=0), atol=1e-6)
    np.testing.assert_allclose(found.speed, np.abs(rates).max(axis=0), rtol=1e-5)
    accelerations = np.abs(np.diff(rates, axis=0)).max(axis=0) / (end.clock * SHARES[1])
    np.testing.assert_allclose(found.acceleration, accelerations, rtol=2e-3)
    assert (LAW.ways("a", start, end) >= np.abs(np.diff(values, axis=0)).sum(axis=0) - 1e-9).all()


def test_time_that_runs_backwards_leads_nowhere():
    at, later = (LAW.knots([np.zeros(1)] * 2, [np.zeros(1)] * 2, np.array([t])) for t in (0.0, 1.0))
    assert LAW.strays(at, later) == [0.0]
    assert LAW.strays(later, at) == [np.inf]
    assert isinstance(at, States)


@pytest.mark.parametrize("jumps", ["a", "b_rate"])
def test_nothing_jumps_in_no_time(jumps):
    """It would cost nothing, and no limit would know of it."""
    at = LAW.knots([np.zeros(1)] * 2, [np.zeros(1)] * 2, np.zeros(1))
    there = States(**at.__dict__ | {jumps: np.array([0.1])})
    assert LAW.strays(at, at) == [0.0]
    assert LAW.strays(at, there) == [0.1]
    later = States(**there.__dict__ | {"clock": np.ones(1)})
    assert LAW.strays(at, later) == [0.0]
