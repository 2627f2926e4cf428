"""What a function of the distance to somebody is on average, where it is uncertain where that somebody is.

The place is normal about the predicted one, with the same standard deviation σ along both axes. Of a function f of the
distance, 0 beyond an end, the mean at distance ν from the predicted place is an integral over Rice's density::

    F₀(ν, σ) = ∫ f(r) r/σ² exp(-(r² + ν²)/2σ²) I₀(rν/σ²) dr

and the mean of f(r) cos α, α the angle between the way from the person and a fixed direction, is the cosine of that
angle at the predicted place times F₁, the same integral with the Bessel function I₁ in place of I₀. Neither has a
closed form, and CasADi has no Bessel functions; so they are sampled once and interpolated by cubic splines. One table
then serves numbers and symbols, and is twice differentiable.

The table counts by how far both together are, h² = ν² + (2σ)², and by their share, ν/(ν + 2σ): near the person what
depends on the direction is a function of the share alone, and all distances and deviations have a place in it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.world.fields.field import Field

FAR = 160, 640  # steps of the table from no distance to an infinite one, least and most: 11 a detail at the end
SHARES = 96  # steps of the table from no distance to no deviation
MARGIN = 6  # steps beyond what is asked for, in which the ends of an interpolating spline die away
STRETCH = 2.0  # a deviation counts as so much of a distance
NODES = 32, 96  # of Gauss-Legendre an integral, least and most: 7 a detail
WINDOW = 6.5  # deviations about the predicted place: 1e-9 of a normal distribution is beyond
AT_ONCE = 4096  # integrals: the columns of their nodes take 3 MB each
TINY = 1e-9  # m: so far off is who is exactly there


class Blurred:
    """The mean of a function of the distance, where the place that it is measured from is uncertain.

    function  >= 0 of distances (N,), m, a NumPy array; continuous
    end       m      beyond which it is 0
    detail    m      within which it changes; one much smaller than a twentieth of the end is not resolved
    harmonic  0, or 1 for the mean of the function times the cosine of an angle, by that cosine at the predicted place

    Where the function changes smoothly within the detail, a twentieth of the end or more, the table is nearer than 1e-4
    of the change to the integral; with a fiftieth, 2e-3. (Within 2 cm of a person whose place is sure, the mean of a
    cosine is no function of the place; nobody's axis is so near.)

    >>> cone = Blurred(lambda r: np.maximum(0.0, 1.0 - r), 1.0, detail=1.0)
    >>> cone(np.array([0.5, 0.0]), np.array([1e-6, 0.1])).round(3)  # the mean distance is σ sqrt(π/2)
    array([0.5  , 0.875])
    """

    def __init__(
        self,
        function: Callable[[FloatArray], FloatArray],
        end: float,
        *,
        detail: float,
        harmonic: Literal[0, 1] = 0,
    ) -> None:
        from scipy.ndimage import spline_filter

        self.end = end
        self._steps, nodes = (int(np.clip(a * end / detail, *limits)) for a, limits in ((45, FAR), (7, NODES)))
        far = np.arange(self._steps) / self._steps
        share = np.arange(-MARGIN, SHARES + MARGIN + 1) / SHARES
        together = end * far / (1.0 - far)  # (steps,) m
        lean = np.hypot(share, 1.0 - share)
        nu, sigma = (np.outer(together, part / lean) for part in (share, (1.0 - share) / STRETCH))
        values = np.zeros((self._steps + 1, share.size))  # the last row is infinitely far
        means = _means(function, end, harmonic, nodes, np.abs(nu).ravel(), np.abs(sigma).ravel())
        values[:-1] = means.reshape(nu.shape)
        if harmonic:
            values *= np.sign(share)  # beyond no distance it goes on as an odd function
        self._table = Field(spline_filter(values, order=3, mode="mirror"), 1.0)

    def __call__(self, distance: Column, deviation: Column) -> Column:
        """Mean (N,) at distances (N,), m, from the predicted place, which deviates by so much (N,), m."""
        wide = STRETCH * deviation + TINY
        both = distance + wide
        together = np.sqrt(distance * distance + wide * wide)
        far = self._steps * together / (together + self.end)
        return np.maximum(self._table(SHARES * distance / both + MARGIN, far), 0.0)


def _means(
    function: Callable[[FloatArray], FloatArray],
    end: float,
    harmonic: int,
    count: int,
    nu: FloatArray,
    sigma: FloatArray,
) -> FloatArray:
    """The integrals (N,) at distances and deviations (N,), by so many nodes where the density is not 0."""
    from scipy.special import i0e, i1e

    nodes, weights = np.polynomial.legendre.leggauss(count)
    means = np.zeros(nu.size)
    reached = np.flatnonzero(nu - WINDOW * sigma < end)
    for begin in range(0, reached.size, AT_ONCE):
        at = reached[begin : begin + AT_ONCE]
        distance, deviation = nu[at, None], np.maximum(sigma[at, None], TINY)
        low = np.maximum(distance - WINDOW * deviation, 0.0)
        half = 0.5 * np.maximum(np.minimum(distance + WINDOW * deviation, end) - low, 0.0)  # 0 just beyond the end
        r = low + half * (1.0 + nodes)  # (N, count)
        scaled = r / deviation
        bessel = (i1e if harmonic else i0e)(scaled * (distance / deviation))
        density = scaled / deviation * np.exp(-0.5 * ((r - distance) / deviation) ** 2) * bessel
        means[at] = np.einsum("ij,ij,j->i", function(r), density, weights) * half[:, 0]
    return means
