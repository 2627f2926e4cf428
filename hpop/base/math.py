"""Mathematical functions with kinks: exact on NumPy arrays, smoothed on CasADi symbols.

Criteria use these where a plain NumPy function has no gradient (a length at zero, an absolute angle at zero). On
numbers they are exact, so costs in fronts are exact. On symbols they are smoothed within a width that each states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextvars import ContextVar
from functools import reduce
from operator import add

import numpy as np

from hpop.base.arrays import Column
from hpop.base.symbols import Symbols, lift

instead_of_hinges: ContextVar[Callable[[Column], Column] | None] = ContextVar("instead_of_hinges", default=None)
SMOOTHING = 0.02  # rad or m: half-width within which a kink is rounded; without rounding, solvers do not converge
ALIGNED = 1e-4  # rad: half-width for angles between vectors, which may pass through zero in the middle of a motion
CHEBYSHEV = (
    *(0.17087277, -0.82215223, 1.48851587, -1.13520398, 0.27886807),
    *(-0.18628806, 0.09678418, 0.37409196, 1.00002368, -1.26551223),
)
"""Coefficients of a polynomial in 1/(1 + x/2) for log(erfcx(x) (1 + x/2)), that of the highest power first."""


def is_symbolic(column: object) -> bool:
    """Return whether a column consists of CasADi symbols; CasADi is not imported for that."""
    return isinstance(column, Symbols) or type(column).__module__.partition(".")[0] == "casadi"


def hypot(x: Column, y: Column) -> Column:
    """Return sqrt(x² + y²); on CasADi symbols its gradient at the origin is 0 instead of NaN.

    >>> float(hypot(3.0, 4.0))
    5.0
    """
    if not (is_symbolic(x) or is_symbolic(y)):
        return np.hypot(x, y)
    square = x * x + y * y
    return np.where(square > 0, np.sqrt(square), 0.0)


def is_zero(column: Column) -> bool:
    """Return whether a column is the number 0.0, which means that the value is always zero."""
    return isinstance(column, float) and column == 0.0


def norm(vector: Sequence[Column]) -> Column:
    """Return the length of vectors, given by one column for each component.

    Components that are the number 0.0 (always zero) are left out. If one component remains, the length is computed by
    `smooth_abs`, if more remain, by `hypot`; if none remains, it is the number 0.0.

    >>> float(norm((2.0, 3.0, 6.0))), float(norm((0.0, 0.0, -1.5)))
    (7.0, 1.5)
    """
    columns = [column for column in vector if not is_zero(column)]
    if not columns:
        return 0.0
    if len(columns) == 1:
        return smooth_abs(columns[0])
    return reduce(hypot, columns)


def angle_between(unit: tuple[Column, Column, Column], vector: tuple[Column, Column, Column]) -> Column:
    """Return the angle, rad in [0, pi], between unit vectors and other vectors; 0 where a vector is zero.

    On CasADi symbols, if both vectors lie in one coordinate plane, the kink at the angle 0 is rounded within ALIGNED,
    so that vectors that are aligned up to rounding errors have the gradient 0.

    >>> round(float(angle_between((0.0, 1.0, 0.0), (2.0, 0.0, 0.0))), 9)
    1.570796327
    """
    length = norm(vector)
    defined = length > 0
    scale = 1.0 / np.where(defined, length, 1.0)
    normal = [column if is_zero(column) else column * scale for column in cross(unit, vector)]
    cosine = dot(unit, vector) * scale
    return np.arctan2(np.where(defined, sine_of(normal), 0.0), np.where(defined, cosine, 1.0))


def sine_of(normal: Sequence[Column]) -> Column:
    """Return the sine of the angle between two unit vectors, which is the length of their cross product ``normal``.

    If only one component of ``normal`` is not the number 0.0, the kink at 0 is rounded within ALIGNED (on symbols).
    """
    columns = [column for column in normal if not is_zero(column)]
    return smooth_abs(columns[0], ALIGNED) if len(columns) == 1 else norm(normal)


def dot(a: Sequence[Column], b: Sequence[Column]) -> Column:
    """Return the scalar product of vectors, given by columns; the number 0.0 stands for a value that is always zero.

    >>> dot((1.0, 2.0), (3.0, 0.0))
    3.0
    """
    products = [x * y for x, y in zip(a, b, strict=True) if not (is_zero(x) or is_zero(y))]
    return reduce(add, products) if products else 0.0


def cross(a: Sequence[Column], b: Sequence[Column]) -> tuple[Column, Column, Column]:
    """Return the cross product of vectors, given by columns; the number 0.0 stands for a value that is always zero.

    >>> cross((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    (0.0, 0.0, 1.0)
    """

    def component(i: int, j: int) -> Column:
        gain, loss = dot(a[i : i + 1], b[j : j + 1]), dot(a[j : j + 1], b[i : i + 1])
        return 0.0 if is_zero(gain) and is_zero(loss) else gain - loss

    return component(1, 2), component(2, 0), component(0, 1)


def erf(x: Column) -> Column:
    """Return the error function 2/sqrt(π) ∫₀ˣ exp(-s²) ds.

    >>> round(float(erf(1.0)), 6)
    0.842701
    """
    if is_symbolic(x):
        import casadi

        return lift(casadi.erf(x.to_casadi()), x.shape)
    from scipy import special

    return special.erf(x)


def erfcx(x: Column) -> Column:
    """Return the scaled complementary error function exp(x²) (1 - erf(x)), for x >= 0.

    On CasADi symbols it is the Chebyshev fit of Press et al. (Numerical Recipes, section 6.2), whose relative error is
    at most 1.2e-7.

    >>> round(float(erfcx(2.0)), 6)
    0.255396
    """
    if not is_symbolic(x):
        from scipy import special

        return special.erfcx(x)
    t = 1.0 / (1.0 + 0.5 * x)
    return t * np.exp(reduce(lambda total, coefficient: total * t + coefficient, CHEBYSHEV))


def smooth_abs(x: Column, width: float = SMOOTHING) -> Column:
    """Return |x|; on CasADi symbols a smooth polynomial within ``width`` of zero.

    The smoothed function is twice differentiable, and exact at zero and beyond the width.

    With s = x/w the polynomial is w (15 s² - 10 s⁴ + 3 s⁶)/8: the lowest even one that is 0 at 0 and meets |x| at w
    with equal value, slope and curvature.

    >>> float(smooth_abs(-2.0))
    2.0
    """
    if not is_symbolic(x):
        return np.abs(x)
    square = (x / width) ** 2
    inside = width * square * (15.0 - 10.0 * square + 3.0 * square * square) / 8.0
    return np.where(square < 1.0, inside, np.abs(x))


def hinge(x: Column) -> Column:
    """Return max(x, 0) of a quantity whose increase raises a cost; on CasADi symbols it has no kink.

    Nonlinear programs of driven trajectories have a variable instead that is at least x and 0
    (:mod:`hpop.planners.programs.nlp`). Elsewhere, on symbols, it is a convex polynomial within w of zero, where w is
    half of SMOOTHING. It is twice differentiable and exact beyond w. With s = x/w the polynomial is
    w (3 + 8 s + 6 s² - s⁴)/16, which is 3/16 w above the kink.

    >>> float(hinge(-2.0)), float(hinge(0.5))
    (0.0, 0.5)
    """
    if not is_symbolic(x):
        return np.maximum(x, 0.0)
    if (above := instead_of_hinges.get()) is not None:
        return above(x)
    width = 0.5 * SMOOTHING
    s = np.minimum(np.maximum(x / width, -1.0), 1.0)
    square = s * s
    return np.where(s < 1.0, width * (3.0 + 8.0 * s + square * (6.0 - square)) / 16.0, x)


def smooth_step(x: Column) -> Column:
    """Return 1 where x >= 0 and 0 elsewhere; on CasADi symbols a smooth step within SMOOTHING of zero.

    With s = x/w the step is the polynomial 1/2 + (15 s - 10 s³ + 3 s⁵)/16, which rises from 0 to 1 and has neither
    slope nor curvature at its ends.

    >>> float(smooth_step(-0.1)), float(smooth_step(0.0))
    (0.0, 1.0)
    """
    if not is_symbolic(x):
        return np.where(x >= 0.0, 1.0, 0.0)
    s = np.minimum(np.maximum(x / SMOOTHING, -1.0), 1.0)
    square = s * s
    return 0.5 + s * (15.0 - 10.0 * square + 3.0 * square * square) / 16.0


def wrap(angle: Column) -> Column:
    """Return an angle with whole turns removed, in (-pi, pi] rad; a half turn is +pi, counter-clockwise.

    NaN stays NaN.

    >>> float(wrap(-np.pi)) == np.pi and float(wrap(2.5 * np.pi)) == 0.5 * np.pi
    True
    """
    clockwise = np.mod(np.pi - angle, 2 * np.pi)
    return np.pi - np.where(clockwise >= 2 * np.pi, 0.0, clockwise)  # the remainder of -1e-16 rounds to 2 pi


def not_radians(angle: float) -> str:
    """Return the end of a message if an angle is too large to be in radians, so probably in degrees; "" otherwise.

    Angles up to two whole turns are accepted, since users may add up two headings.

    >>> print(not_radians(90.0))
    must be in radians, within two turns of 0, got 90; for degrees write math.radians(90), or '90 deg' in a scenario
    >>> not_radians(-3.2)
    ''
    """
    if abs(angle) <= 4.0 * np.pi:
        return ""
    return (
        f"must be in radians, within two turns of 0, got {angle:g}; for degrees write math.radians({angle:g}), or "
        f"'{angle:g} deg' in a scenario"
    )
