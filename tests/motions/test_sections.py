"""Sections of motions: what a motion does from one moment to another, in the time that it takes for it."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.motions import Phase
from hpop.motions.quadrature import _time_of

FIRST, LAST = np.array([0.0, 0.2, 0.5, 0.9, 0.3]), np.array([1.0, 0.7, 0.5, 1.0, 0.30001])
WHOLE = [np.full(5, value) for value in (2.0, 0.1, 0.8)]  # s, and shares of a motion


@pytest.mark.parametrize("shape", ["hold", "cruise", "drive", "speed-up", "slow-down", "ramp"])
@pytest.mark.parametrize("u", [0.0, 0.3, 1.0])
def test_a_part_of_a_phase_is_where_the_phase_is_at_its_times_and_as_fast(shape, u):
    phase = Phase(*WHOLE, shape, np.full(5, -0.4))
    part = phase.part(FIRST, LAST)
    there = FIRST + u * (LAST - FIRST)
    np.testing.assert_allclose(part.share(u), phase.share(there), rtol=1e-12)
    np.testing.assert_allclose(part.duration, 2.0 * (LAST - FIRST))
    lasts = part.duration > 0
    for found, expected in zip(part.share_rates(u), phase.share_rates(there), strict=True):
        if shape != "hold":
            np.testing.assert_allclose(found[lasts], np.broadcast_to(expected, 5)[lasts], rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("shape", ["speed-up", "slow-down", "ramp"])
@pytest.mark.parametrize("change", [-1.0, -0.3, 0.0, 0.7, 1.0])
def test_the_time_by_which_a_share_is_done_is_the_inverse_of_the_share(shape, change):
    u = np.linspace(0.0, 1.0, 11)
    done = Phase(np.ones(11), np.zeros(11), np.ones(11), shape, np.full(11, change)).share(u)
    np.testing.assert_allclose(_time_of(shape, np.full(11, change), done), u, atol=2e-8)
