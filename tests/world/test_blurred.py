"""Means of functions of an uncertain distance: closed forms, the distribution of a distance, and symbols."""

from functools import cache

import casadi
import numpy as np
import pytest
from scipy.stats import ncx2

from hpop.motions.symbolic import lift
from hpop.world.content.proxemics import Blurred

WIDTH = 0.8  # m, of a Gaussian
DISTANCES = np.array([0.0, 0.1, 0.3, 0.8, 1.7, 3.0, 5.0])


def bell(r):
    return np.exp(-0.5 * (r / WIDTH) ** 2)


@cache
def tables():
    """The mean of the Gaussian, and of the distance times it times a cosine."""
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
