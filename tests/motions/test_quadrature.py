"""The adaptive rule: exact for polynomials, over time as over the share done, and near enough elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from hpop.models.laws import rest_to_rest
from hpop.motions import Phase
from hpop.motions.quadrature import HALVINGS, NODES, adaptive_integrals, evenly, timed

SOME = np.array([0, 2, 3])  # of four motions


def of(function, nodes=None):
    """Values of a function of the fraction, those of motion i times i + 1."""

    def values(fractions, owner):
        if nodes is not None:
            nodes.append(fractions.size)
        return (owner + 1) * function(fractions)

    return values


@pytest.mark.parametrize("degree", range(5))
def test_means_of_polynomials_are_exact(degree):
    found = adaptive_integrals(of(lambda u: u**degree), evenly, SOME, 4)
    np.testing.assert_allclose(found, np.array([1, 0, 3, 4]) / (degree + 1), rtol=1e-12)


@pytest.mark.parametrize("degree", range(5))
def test_time_integrals_of_polynomials_of_the_share_are_exact_for_any_profile(degree):
    """Against sums over 20,000 moments of each phase; a triangle, a trapezoid, one that hardly speeds up."""
    phases = rest_to_rest(np.array([0.05, 1.0, 3.0, 50.0]), 1.0, 2.0)
    found = adaptive_integrals(of(lambda share: share**degree), timed(phases), SOME, 4)
    u = (np.arange(20_000) + 0.5) / 20_000
    wide = [phase._replace(begin=phase.begin[:, None], end=phase.end[:, None]) for phase in phases]
    expected = sum(phase.duration * (phase.share(u) ** degree).mean(axis=1) for phase in wide)
    np.testing.assert_allclose(found, expected * [1, 0, 3, 4], rtol=1e-6)


def test_a_smooth_rate_takes_five_nodes_and_a_kink_some_more():
    smooth, kinked = [], []
    adaptive_integrals(of(lambda u: 2.0 + np.cos(u), smooth), evenly, np.arange(1), 1)
    found = adaptive_integrals(of(lambda u: np.abs(u - 0.3), kinked), evenly, np.arange(1), 1)
    assert sum(smooth) == NODES.size
    assert sum(kinked) <= NODES.size * (2 * HALVINGS + 1)  # one piece with the kink at each halving, and its twin
    assert found[0] == pytest.approx((0.3**2 + 0.7**2) / 2, rel=1e-3)


def test_a_jump_is_placed_within_the_smallest_piece():
    found = adaptive_integrals(of(lambda u: 1.0 * (u > 0.3)), evenly, np.arange(1), 1)
    assert found[0] == pytest.approx(0.7, abs=2.0**-HALVINGS)


def test_no_motions_and_no_time_make_no_integral():
    nothing = np.zeros(2)
    phases = (
        Phase(nothing, nothing, nothing + 0.5, "speed-up"),
        Phase(nothing, nothing + 0.5, nothing + 1.0, "slow-down"),
    )
    assert not adaptive_integrals(of(np.cos), evenly, np.arange(0), 2).any()
    assert not adaptive_integrals(of(np.cos), timed(phases), np.arange(2), 2).any()
