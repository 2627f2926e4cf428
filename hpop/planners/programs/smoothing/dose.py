r"""Dose of a body's weighted acceleration in a smoothing program, with the modes of the weighting filter as states.

The filter is a sum of modes, one for each pair of conjugate poles λ of its transfer function, with residue r:

    z' = λ z + u,    y = Σ 2 Re(r z),    dose² = ∫ y² dt,

where u is the acceleration of the body in its own frame, ahead or to the left. In an interval of a smoothing program,
the accelerations a of the base and α of its rotation are constant, so that u is a polynomial of time of degree 2:

    ahead  a - α l - ω² d,    left  v ω + α d - ω² l

at d metres ahead and l metres to the left of the axis. A frame that does not turn with the base, as that of an unwound
view, has these accelerations turned by the yaw; there u is the polynomial through their values at KNOTS moments of the
interval. So z at the end of the interval has a closed form, for any duration. y² is integrated by Gauss-Legendre
quadrature.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any, NamedTuple

import numpy as np

from hpop.criteria.comfort.sickness import Weighting
from hpop.models.driven import gauss

POINTS = 5  # of the quadrature in an interval
KNOTS = 5  # moments of an interval at which accelerations in a frame that does not turn with the base are exact


_Polynomial = tuple[Any, ...]
"""Polynomial of time: its coefficients, from the constant on."""


class Mode(NamedTuple):
    """Mode of a filter: its pole, 1/s, and the residue, 1/s, of its transfer function there."""

    pole: complex
    residue: complex


@dataclass(frozen=True)
class Dose:
    """Square of a dose in one interval, and the defects of the filter's states, as formulas of CasADi symbols.

    The states are real and imaginary parts of z, mode by mode, first for the acceleration ahead, then to the left.

    weighting   frequency weighting of the acceleration
    ahead, left  m, position of the body on the base
    turns       rotation of the body's frame divided by that of the base: 1 for a rigid body, 0 for an unwound view
    """

    weighting: Weighting
    ahead: float
    left: float
    turns: float = 1.0

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """Modes of the weighting, whose transfer function must be strictly proper and have distinct complex poles."""
        sections = self.weighting.sections
        numerator, denominator = (reduce(np.polymul, factors) for factors in zip(*sections, strict=True))
        slope, poles = np.polyder(denominator), np.concatenate([np.roots(below) for _, below in sections])
        return tuple(
            Mode(complex(pole), complex(np.polyval(numerator, pole) / np.polyval(slope, pole)))
            for pole in poles
            if pole.imag > 0
        )

    @property
    def size(self) -> int:
        """Number of states of the filters."""
        return 4 * len(self.modes)

    def formulas(
        self, before: Any, after: Any, ends: tuple[Any, Any, Any, Any, Any], lasts: Any
    ) -> tuple[list[Any], Any]:
        """Return the defects of the states, and the integral of y² over the interval.

        Parameters
        ----------
        before, after : states (size,) of the filters at the start and the end, symbols
        ends : speed at the start and at the end, m/s, turn rate at the start and at the end, rad/s, and yaw at the
            start, rad
        lasts : s, duration of the interval
        """
        import casadi

        moments = [(share * lasts, weight) for share, weight in gauss(POINTS)]
        fades = [[_exponential(mode.pole, t) for mode in self.modes] for t, _ in [*moments, (lasts, 1.0)]]
        defects, squares = list[Any](), [casadi.SX(0) for _ in moments]
        for k, polynomial in enumerate(self._inputs(*ends, lasts)):
            outputs = [casadi.SX(0) for _ in moments]
            for i, mode in enumerate(self.modes):
                place = 2 * (k * len(self.modes) + i)
                steady = [_forced(mode.pole, polynomial, t) for t in (0.0 * lasts, *(t for t, _ in moments), lasts)]
                off = before[place] - steady[0][0], before[place + 1] - steady[0][1]
                for j, forced in enumerate(steady[1:]):
                    real, imaginary = fades[j][i]
                    z = (
                        real * off[0] - imaginary * off[1] + forced[0],
                        real * off[1] + imaginary * off[0] + forced[1],
                    )
                    if j < len(moments):
                        outputs[j] += 2.0 * (mode.residue.real * z[0] - mode.residue.imag * z[1])
                    else:
                        defects += [after[place] - z[0], after[place + 1] - z[1]]
            squares = [square + y * y for square, y in zip(squares, outputs, strict=True)]
        return defects, lasts * sum(w * square for (_, w), square in zip(moments, squares, strict=True))

    def _inputs(self, v0: Any, v1: Any, w0: Any, w1: Any, yaw: Any, lasts: Any) -> tuple[_Polynomial, _Polynomial]:
        """Return the coefficients of the accelerations ahead and to the left as polynomials."""
        a, bend = (v1 - v0) / lasts, (w1 - w0) / lasts
        turn = w0 * w0, 2.0 * w0 * bend, bend * bend  # of ω²
        cross = v0 * w0, a * w0 + v0 * bend, a * bend  # of v ω
        ahead = a - bend * self.left - turn[0] * self.ahead, -turn[1] * self.ahead, -turn[2] * self.ahead
        first, second, third = (c - s * self.left for c, s in zip(cross, turn, strict=True))
        left = first + bend * self.ahead, second, third
        if self.turns == 1.0:
            return ahead, left
        import casadi

        shares, values = np.linspace(0.0, 1.0, KNOTS), list[tuple[Any, Any]]()
        for t in (float(share) * lasts for share in shares):
            angle = (1.0 - self.turns) * (yaw + t * (w0 + 0.5 * t * bend))
            cos, sin, x, y = casadi.cos(angle), casadi.sin(angle), _value(ahead, t), _value(left, t)
            values.append((cos * x - sin * y, sin * x + cos * y))
        weights = np.linalg.inv(np.vander(shares, increasing=True)).tolist()
        along, across = (
            tuple(sum(w * v for w, v in zip(row, own, strict=True)) / lasts**k for k, row in enumerate(weights))
            for own in zip(*values, strict=True)
        )
        return along, across


def _exponential(pole: complex, t: Any) -> tuple[Any, Any]:
    """Return the real and imaginary part of e^(λt)."""
    import casadi

    size, angle = casadi.exp(pole.real * t), pole.imag * t
    return size * casadi.cos(angle), size * casadi.sin(angle)


def _value(polynomial: _Polynomial, t: Any, order: int = 0) -> Any:
    """Return the value of a polynomial, or of its derivative of some order, at t, by Horner's rule."""
    value = polynomial[-1]
    for k in reversed(range(order, len(polynomial) - 1)):
        value = polynomial[k] + (k + 1) / (k + 1 - order) * t * value
    return math.factorial(order) * value


def _forced(pole: complex, polynomial: _Polynomial, t: Any) -> tuple[Any, Any]:
    """Return the real and imaginary part of the polynomial solution of z' = λz + u, for a polynomial u."""
    terms = [(1.0 / pole ** (order + 1), _value(polynomial, t, order)) for order in range(len(polynomial))]
    return -sum(factor.real * value for factor, value in terms), -sum(factor.imag * value for factor, value in terms)
