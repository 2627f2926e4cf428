"""The adaptive rule: exact for polynomials, over time as over the share done, and near enough elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpop.models.laws import rest_to_rest
from hpop.motions import Phase
from hpop.motions.quadrature import HALVINGS, NODES, adaptive_integrals, evenly, pieces_of, timed

SOME = np.array([0, 2, 3])  # of four motions
PIECES = np.array([1, 1, 3, 7])  # of each, to begin with
ONE, ALONE = np.arange(1), np.ones(1, dtype=np.int64)  # one motion, in one piece


def of(function, nodes=None):
    """Values of a function of the fraction, those of motion i times i + 1."""

    def values(fractions, owner):
        if nodes is not None:
            nodes.extend(fractions.tolist())
        return (owner + 1) * function(fractions)

    return values


@pytest.mark.parametrize("degree", range(5))
def test_means_of_polynomials_are_exact(degree):
    found = adaptive_integrals(of(lambda u: u**degree), evenly, SOME, PIECES)
    np.testing.assert_allclose(found, np.array([1, 0, 3, 4]) / (degree + 1), rtol=1e-12)


@pytest.mark.parametrize("degree", range(5))
def test_time_integrals_of_polynomials_of_the_share_are_exact_for_any_profile(degree):
    """Against sums over 20,000 moments of each phase; a triangle, a trapezoid, one that hardly speeds up."""
    phases = rest_to_rest(np.array([0.05, 1.0, 3.0, 50.0]), 1.0, 2.0)
    found = adaptive_integrals(of(lambda share: share**degree), timed(phases), SOME, PIECES)
    u = (np.arange(20_000) + 0.5) / 20_000
    wide = [phase._replace(begin=phase.begin[:, None], end=phase.end[:, None]) for phase in phases]
    expected = sum(phase.duration * (phase.share(u) ** degree).mean(axis=1) for phase in wide)
    np.testing.assert_allclose(found, expected * [1, 0, 3, 4], rtol=1e-6)


def test_the_time_of_all_pieces_is_that_of_the_motion_whatever_their_number():
    """A piece that ends by rounding ends under a root too: to 1e-12, where a fraction off by 1e-16 costs 1e-8."""
    pieces, duration = np.arange(1, 60), np.linspace(0.1, 9.0, 59)
    lasts = adaptive_integrals(of(np.ones_like), timed(rest_to_rest(duration, 1.0, 2.0)), np.arange(59), pieces)
    expected = sum(phase.duration for phase in rest_to_rest(duration, 1.0, 2.0))
    np.testing.assert_allclose(lasts, expected * (np.arange(59) + 1), rtol=1e-12)


def test_a_smooth_rate_takes_five_nodes_and_a_kink_some_more():
    smooth, kinked = [], []
    adaptive_integrals(of(lambda u: 2.0 + 0.1 * np.cos(u), smooth), evenly, ONE, ALONE)
    found = adaptive_integrals(of(lambda u: np.abs(u - 0.3), kinked), evenly, ONE, ALONE)
    assert len(smooth) == NODES.size
    assert len(kinked) <= NODES.size + 4 * 2 * HALVINGS  # one piece with the kink at each halving, and its twin
    assert found[0] == pytest.approx((0.3**2 + 0.7**2) / 2, rel=1e-3)


def test_no_place_is_looked_at_twice():
    nodes = []
    adaptive_integrals(of(lambda u: np.abs(u - 0.3), nodes), evenly, ONE, ALONE)
    assert len(set(nodes)) == len(nodes)


@given(st.floats(0.0, 1.0), st.floats(0.1, 10.0), st.booleans())
def test_a_kink_anywhere_is_integrated_to_a_thousandth(place, duration, at_rest):
    """At the ends of the motion as well, where a profile from rest to rest spends more of its time."""
    phases = rest_to_rest(np.array([duration]), 1.0, 2.0 if at_rest else 1e6)
    found = adaptive_integrals(of(lambda share: np.abs(share - place)), timed(phases), ONE, ALONE)
    u = (np.arange(4000) + 0.5) / 4000
    expected = sum(float(phase.duration[0]) * np.abs(phase.share(u) - place).mean() for phase in phases)
    assert found[0] == pytest.approx(expected, rel=1.5e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_deviations_that_cancel_in_the_integral_are_seen(sign):
    """Both integrals of interpolants of a full wave are equal: the deviations of two nodes cancel."""
    nodes = []
    adaptive_integrals(of(lambda u: 1.0 + sign * np.sin(2 * np.pi * u), nodes), evenly, ONE, ALONE)
    assert len(nodes) > NODES.size


@given(st.floats(0.0, 1.0))
def test_a_jump_is_placed_within_a_hundredth_of_the_motion(place):
    found = adaptive_integrals(of(lambda u: 1.0 * (u > place)), evenly, ONE, 8 * ALONE, jumps=True)
    assert found[0] == pytest.approx(1.0 - place, abs=0.01)


@given(st.floats(0.1, 0.9), st.floats(0.04, 0.5))
def test_what_shows_for_longer_than_a_quarter_of_a_piece_is_not_missed(middle, width):
    pieces = 8 * ALONE
    found = adaptive_integrals(of(lambda u: 1.0 * (np.abs(u - middle) < width / 2)), evenly, ONE, pieces, jumps=True)
    expected = min(1.0, middle + width / 2) - max(0.0, middle - width / 2)
    assert found[0] == pytest.approx(expected, abs=0.02)


def test_a_motion_that_turns_far_begins_with_more_pieces_and_with_more_again_where_rates_jump():
    turned = np.array([0.0, 1.0, 20.0])
    assert pieces_of(turned)[:2].tolist() == [1, 1]
    assert (np.diff(pieces_of(turned)[1:]) > 0).all()
    assert (pieces_of(turned, jumps=True)[1:] > pieces_of(turned)[1:]).all()


def test_no_motions_and_no_time_make_no_integral():
    nothing, pieces = np.zeros(2), np.ones(2, dtype=np.int64)
    phases = (
        Phase(nothing, nothing, nothing + 0.5, "speed-up"),
        Phase(nothing, nothing + 0.5, nothing + 1.0, "slow-down"),
    )
    assert not adaptive_integrals(of(np.cos), evenly, np.arange(0), pieces).any()
    assert not adaptive_integrals(of(np.cos), timed(phases), np.arange(2), pieces).any()
