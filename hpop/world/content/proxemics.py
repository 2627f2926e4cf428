"""Proxemics: positions and directions of people relative to points, and effects of many people on many points.

An effect is any number that a person causes at a point, such as discomfort. All functions take columns (N,): NumPy
arrays or CasADi symbols. Times are only needed for moving people.

Possible futures enter in two ways. :func:`expected` averages over a person's futures at each moment. By linearity, the
integral of this mean over time is the mean of the integrals, so effects that add up along motions still add up.
:func:`worst` is the maximum over people and futures, for criteria of the worst moment; it uses no weights.
:class:`Blurred` averages an effect over an uncertain position.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Literal

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.math import is_symbolic
from hpop.world.content.content import Person
from hpop.world.fields.field import Field

HALL = {"intimate": 0.45, "personal": 1.2, "social": 3.6}
"""Outer limits of Hall's zones, m, between surfaces (Hall 1966); farther off is public."""
BLOCK = 8192  # samples evaluated together: few enough that their intermediate columns stay in the processor's cache
FAR = 160, 640  # least and most table steps from distance 0 to infinity: 11 per detail, at the end of the effect
SHARES = 96  # table steps from distance 0 to deviation 0
MARGIN = 6  # steps beyond the needed range, in which end effects of the interpolating spline die away
STRETCH = 2.0  # weight of a deviation relative to a distance
NODES = 32, 96  # least and most Gauss-Legendre nodes per integral: 7 per detail
WINDOW = 6.5  # standard deviations to integrate over; 1e-9 of a normal distribution lies beyond
AT_ONCE = 4096  # integrals computed together: each array over their nodes takes 3 MB
TINY = 1e-9  # m: least distance and deviation, which avoids 0/0


def any_moves(people: Iterable[Person]) -> bool:
    """Return whether any person moves, so that effects depend on time."""
    return any(person.moves for person in people)


def position(person: Person, t: Column | None) -> tuple[Column, Column]:
    """Return the position of a person, m: at times t (N,), s, or constant for a standing person."""
    return person.at(t) if person.moves else (person.x, person.y)


def offset(person: Person, x: Column, y: Column, t: Column | None) -> tuple[Column, Column]:
    """Return the offset (x, y), m, from a person to points (N,), in the world frame."""
    at_x, at_y = position(person, t)
    return x - at_x, y - at_y


def in_frame(person: Person, x: Column, y: Column, t: Column | None) -> tuple[Column, Column]:
    """Return coordinates (N,), m, of points in the frame of a person: ahead (where it walks or faces) and left."""
    dx, dy = offset(person, x, y, t)
    cos, sin = person.ahead_at(t)
    return dx * cos + dy * sin, dy * cos - dx * sin


def expected(people: Iterable[Person], effect: Callable[..., Column], *columns: Column | None) -> Column:
    """Sum an effect over all people (N,): for each person, take the mean of the effect over the person's futures.

    ``effect(person, *columns)`` is called with people who have one future; it must handle the uncertainty of their
    position itself. A person counts only while present. The last column is the time, or None if all people stand.
    """

    def share(hypothesis: tuple[float, Person], *part: Column | None) -> Column:
        weight, person = hypothesis
        value = _while_there(person, effect(person, *part), part[-1])
        return value if weight == 1.0 else weight * value

    return over([pair for person in people for pair in person.hypotheses], share, np.add, *columns)


def worst(people: Iterable[Person], effect: Callable[..., Column], *columns: Column | None) -> Column:
    """Return the largest ``effect(person, *columns)`` (N,) over all people and all their futures.

    Each future counts, however unlikely. An absent person counts as 0, so effects should not be negative. For the
    arguments see :func:`expected`.
    """

    def alone(person: Person, *part: Column | None) -> Column:
        return _while_there(person, effect(person, *part), part[-1])

    return over([single for person in people for _, single in person.hypotheses], alone, np.maximum, *columns)


def _while_there(person: Person, value: Column, t: Column | None) -> Column:
    there = person.there(t)
    return value if isinstance(there, float) and there == 1.0 else there * value


def over(
    items: Iterable[Any],
    effect: Callable[..., Column],
    combine: Callable[[Column, Column], Column],
    *columns: Column | None,
) -> Column:
    """Combine the effects (N,) of one or more items, ``effect(item, *columns)``, by np.add (sum) or np.maximum.

    Columns are (N,), or None where an effect does not need them. Arrays are evaluated in blocks, which is several times
    faster. Equal consecutive samples are evaluated only once.
    """
    items = tuple(items)

    def combined(*part: Column | None) -> Column:
        total = effect(items[0], *part)
        for item in items[1:]:
            total = combine(total, effect(item, *part))
        return total

    if any(is_symbolic(column) for column in columns):
        return combined(*columns)
    size = next(column.size for column in columns if column is not None)
    blocks = [slice(begin, begin + BLOCK) for begin in range(0, size, BLOCK)]
    parts = [[None if column is None else column[block] for column in columns] for block in blocks]
    return np.concatenate([_once_a_run(combined, part) for part in parts]) if parts else combined(*columns)


def _once_a_run(function: Callable[..., Column], columns: list[Column | None]) -> Column:
    """Return the values (N,) of a function of columns (N,) or None; equal consecutive samples are evaluated once."""
    given = [column for column in columns if column is not None]
    changes = np.ones(given[0].size, dtype=bool)
    changes[1:] = np.any([column[1:] != column[:-1] for column in given], axis=0)
    first = np.flatnonzero(changes)
    if 2 * first.size > changes.size:
        return function(*columns)
    values = function(*(None if column is None else column[first] for column in columns))
    return np.repeat(values, np.diff(first, append=changes.size))


class Blurred:
    """Mean of a function of the distance to a person whose position is uncertain.

    The position is normally distributed about the predicted one, with standard deviation σ along both axes. Let f be a
    function of the distance that is 0 beyond ``end``. At distance ν from the predicted position, the mean of f is an
    integral over Rice's density::

        F₀(ν, σ) = ∫ f(r) r/σ² exp(-(r² + ν²)/2σ²) I₀(rν/σ²) dr

    Let α be the angle between the offset from the person and a fixed direction. The mean of f(r) cos α is cos α at the
    predicted position times F₁, the same integral with the Bessel function I₁ in place of I₀. Neither integral has a
    closed form, and CasADi has no Bessel functions. So they are sampled once and interpolated by cubic splines. One
    table then serves numbers and symbols, and is twice differentiable.

    The table's axes are h = sqrt(ν² + (2σ)²), mapped to a finite range, and the share ν/(ν + 2σ). Near the person a
    function of the direction depends on the share alone, and the table covers all distances and deviations.

    function  >= 0 of distances (N,), m, a NumPy array; continuous
    end       m      beyond which it is 0
    detail    m      length over which it changes; much less than a twentieth of the end is not resolved
    harmonic  0; or 1 for F₁, the mean of the function times a cosine, relative to the cosine at the predicted position

    If the function is smooth on the scale of the detail, and the detail is at least a twentieth of the end, the error
    is below 1e-4 of the function's change; with a fiftieth, 2e-3. (Within 2 cm of a person of certain position the mean
    of a cosine is not resolved; no robot's axis comes so near.)

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
        from scipy.ndimage import spline_filter  # slow to import

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
            values *= np.sign(share)  # continued to negative distances as an odd function
        self._table = Field(spline_filter(values, order=3, mode="mirror"), 1.0)

    def __call__(self, distance: Column, deviation: Column) -> Column:
        """Return the mean (N,) at distances (N,), m, from the predicted position, with deviations (N,), m."""
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
    """Compute the integrals F₀, or F₁ if ``harmonic`` is 1, of `Blurred` (N,), each with ``count`` quadrature nodes.

    ``function`` is f, which is 0 beyond ``end``, m. ``nu`` and ``sigma`` (N,) are the distance from the predicted
    position and the standard deviation, m.
    """
    from scipy.special import i0e, i1e  # slow to import

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
