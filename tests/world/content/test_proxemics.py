"""Positions relative to people, effects of many people, and means over an uncertain position."""

from __future__ import annotations

import math
from functools import cache

import casadi
import numpy as np
import pytest
from scipy.stats import ncx2

from hpop.motions.symbolic import lift
from hpop.world.content.content import Person
from hpop.world.content.proxemics import BLOCK, Blurred, in_frame, offset, over, position


def test_who_walks_faces_where_they_go_and_who_stands_where_the_body_does():
    for person, heading in ((Person(0, 0, 1.0, velocity=(0.0, -2.0)), -math.pi / 2), (Person(0, 0, 1.0), 1.0)):
        t = np.zeros(1) if person.moves else None
        assert in_frame(person, math.cos(heading), math.sin(heading), t) == (pytest.approx(1.0), pytest.approx(0.0))


def test_who_stands_is_there_without_a_time():
    assert position(Person(1, 2), None) == (1, 2)


def test_the_frame_of_a_person_against_complex_numbers():
    person, t = Person(1.0, -2.0, 0.4, velocity=(0.3, 0.8)), np.array([0.0, 2.0])
    x, y = np.array([3.0, -1.0]), np.array([0.5, 0.7])
    way = x + 1j * y - (complex(1, -2) + complex(0.3, 0.8) * t)
    dx, dy = offset(person, x, y, t)
    assert dx + 1j * dy == pytest.approx(way)
    ahead, left = in_frame(person, x, y, t)
    assert ahead + 1j * left == pytest.approx(way / complex(0.3, 0.8) * abs(complex(0.3, 0.8)))


@pytest.mark.parametrize("size", [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 5])
@pytest.mark.parametrize("distinct", [1, 7, 10**9])
@pytest.mark.parametrize("combine", [np.add, np.maximum])
def test_blocks_and_runs_of_equal_samples_change_nothing(size, distinct, combine):
    rng = np.random.default_rng(size)
    x, y = np.sort(rng.integers(0, distinct, size)) / 7.0, np.sort(rng.integers(0, min(distinct, 3), size)) * 1.0

    def effect(item, x, y, t):
        assert t is None
        return np.sin(item * x) + y

    found = over([1.0, 2.0, 3.0], effect, combine, x, y, None)
    assert found.shape == (size,)
    np.testing.assert_allclose(found, combine.reduce([np.sin(item * x) + y for item in (1.0, 2.0, 3.0)]), 1e-6, 1e-12)


def test_runs_of_equal_samples_are_asked_once():
    asked = []

    def effect(item, x):
        asked.append(x.size)
        return item * x

    assert (
        over([2.0], effect, np.add, np.repeat(np.arange(10.0), 56)).tolist()
        == np.repeat(np.arange(0.0, 20.0, 2.0), 56).tolist()
    )
    assert asked == [10]


def test_symbols_pass_through_whole():
    casadi = pytest.importorskip("casadi")
    vector = casadi.MX.sym("x", 3)
    column = over([1.0, 2.0], lambda item, x, t: item * x * x, np.add, lift(vector, 3), None)
    values = casadi.Function("f", [vector], [casadi.MX(column)])([1.0, 2.0, 3.0])
    assert np.array(values).ravel().tolist() == [3.0, 12.0, 27.0]


WIDTH = 0.8  # m, of a Gaussian
DISTANCES = np.array([0.0, 0.1, 0.3, 0.8, 1.7, 3.0, 5.0])


def bell(r):
    return np.exp(-0.5 * (r / WIDTH) ** 2)


@cache
def tables():
    """Return the mean of the Gaussian, and of the distance times it times a cosine."""
    ahead = Blurred(lambda r: r * bell(r), 7 * WIDTH, detail=WIDTH, harmonic=1)
    return Blurred(bell, 7 * WIDTH, detail=WIDTH), ahead


@pytest.mark.parametrize("deviation", [1e-4, 0.03, 0.2, 0.7, 2.0, 30.0])
def test_a_gaussian_blurred_is_one_whose_variances_are_sums(deviation):
    share = WIDTH**2 / (WIDTH**2 + deviation**2)
    wide = np.sqrt(WIDTH**2 + deviation**2)
    expected = share * np.exp(-0.5 * (DISTANCES / wide) ** 2)
    blurred, ahead = tables()
    assert np.abs(blurred(DISTANCES, np.full(DISTANCES.size, deviation)) - expected).max() < 3e-5
    # x exp(-|p|²/2s²) is the distance times the Gaussian times a cosine; its mean is that of a product of Gaussians
    assert np.abs(ahead(DISTANCES, np.full(DISTANCES.size, deviation)) - DISTANCES * share * expected).max() < 3e-5


@pytest.mark.parametrize("deviation", [0.01, 0.08, 0.3, 1.0])
def test_a_border_against_the_distribution_of_the_distance(deviation):
    """-f' says how much of f is lost at each distance, so the mean of f is that of who is nearer than those."""
    near, soft = 1.0, 0.2
    nodes, weights = np.polynomial.legendre.leggauss(40)
    u = 0.5 + 0.5 * nodes  # f falls from 1 to 0 by 10 u³ - 15 u⁴ + 6 u⁵ from near on
    lost = 0.5 * weights * 30 * u**2 * (1 - u) ** 2
    reached = ((near + soft * u) / deviation) ** 2
    expected = [lost @ ncx2.cdf(reached, 2, (d / deviation) ** 2 + 1e-12) for d in DISTANCES]

    def border(r):
        v = np.clip((near + soft - r) / soft, 0, 1)
        return v**3 * (10 - 15 * v + 6 * v * v)

    found = Blurred(border, near + soft, detail=soft)(DISTANCES, np.full(DISTANCES.size, deviation))
    assert np.abs(found - expected).max() < 1e-4


def test_symbols_give_the_numbers_and_their_slopes():
    blurred, _ = tables()
    deviations = 0.1 + 0.2 * DISTANCES
    symbols = casadi.MX.sym("d", 2 * DISTANCES.size)
    columns = [lift(part, DISTANCES.size) for part in casadi.vertsplit(symbols, DISTANCES.size)]
    mean = casadi.MX(blurred(*columns))
    values = casadi.Function("mean", [symbols], [mean, casadi.jacobian(casadi.sum1(mean), symbols)])
    found, slopes = (np.array(part).ravel() for part in values(np.concatenate([DISTANCES, deviations])))
    assert found == pytest.approx(blurred(DISTANCES, deviations), abs=1e-12)
    step = 1e-6
    for i, moved in enumerate(np.eye(2) * step):
        above, below = (blurred(DISTANCES + s * moved[0], deviations + s * moved[1]) for s in (1, -1))
        inside = slice(1, None)  # a distance is not below 0
        numeric = (above - below) / (2 * step)
        assert slopes.reshape(2, -1)[i][inside] == pytest.approx(numeric[inside], abs=1e-5)
