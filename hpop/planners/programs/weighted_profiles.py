r"""Speed profiles of least weighted acceleration of a seat: nonlinear programs with the states of the weighting filter.

With v = ds/dt at the grid positions and b = v² linear between them, an interval of length h lasts T = 2h/(v0 + v1). The
acceleration of the seat, in its own frame, is taken to be that of the middle of the interval:

    u = p' (v1² - v0²)/(2h) + p'' (v0² + v1²)/2

The filter is x' = A x + B u, y = C x + D u. Its states at the grid positions are variables, and

    (1 - A T/2 + A² T²/12) x1 = (1 + A T/2 + A² T²/12) x0 + T B u

joins them (a Padé approximation, of order 4 in T). Simpson's rule integrates y². While the robot stands, u is 0, and
the filter's response has a closed form. The program is not convex: solvers find local optima.

The filter hardly passes fast changes, so that profiles with and without them have nearly equal doses. A small term
selects those without: the mean squared change of the acceleration along the path from interval to interval.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from hpop.base.arrays import FloatArray, IntArray
from hpop.criteria.comfort.sickness import Weighting
from hpop.planners.programs.nlp import ipopt
from hpop.runtime.interrupts import interrupts_held

STILL = 1e-9  # m/s², m/s: smaller derivatives of the seat's position are none
SLOWEST = 1e-3  # least ds/dt between standstills
EVENNESS = 0.03  # share of the dose's square that uneven acceleration adds to what a program minimises
IPOPT = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "ipopt.max_iter": 300, "ipopt.tol": 1e-7}


class FilterMatrices(NamedTuple):
    """Filter x' = a x + b u, y = c x + d u, with n states: a (n, n) and b (n,), 1/s; c (n,) and d have no unit."""

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: float

    @classmethod
    def of(cls, weighting: Weighting) -> FilterMatrices:
        """Return the filter of a weighting: its sections of second order, one after the other."""
        a, b, c, d = np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0
        for numerator, (_, damping, square) in weighting.sections:
            w, gains = np.sqrt(square), np.concatenate([np.zeros(3 - len(numerator)), numerator])
            own = np.array([[0.0, w], [-w, -damping]])  # of q and q'/w, where q'' + damping q' + w² q = w² u
            read = np.array([gains[2] / square - gains[0], gains[1] / w - gains[0] * damping / w])
            a = np.block([[a, np.zeros((len(a), 2))], [np.outer([0.0, w], c), own]])
            b, c, d = np.append(b, [0.0, w * d]), np.concatenate([gains[0] * c, read]), gains[0] * d
        return cls(a, b, c, float(d))

    def response(self, seconds: float) -> tuple[FloatArray, FloatArray]:
        """Return e^(a t) and Q (n, n) for a time t without input; x Q x is the integral of y² in it, from state x."""
        from scipy.linalg import expm, solve_continuous_lyapunov

        whole = solve_continuous_lyapunov(self.a.T, -np.outer(self.c, self.c))
        after = expm(self.a * seconds)
        return after, whole - after.T @ whole @ after


@dataclass(frozen=True, eq=False)
class WeightedMotion:
    """Weighted acceleration of a seat along a path of N intervals, as a function of its speed profile.

    slopes     (N, 3)  p', derivative of the seat's position by s, in the seat's frame (ahead, left, up)
    bends      (N, 3)  p''
    steps      (N,)    lengths h of the intervals
    first      (N,)    number of the grid position at which each interval begins; the next one is its end
    pauses     (N,)    s, for which the robot stands before each interval
    weighting          filter of the acceleration
    stays              s, for which the robot stands after the last interval
    """

    slopes: FloatArray
    bends: FloatArray
    steps: FloatArray
    first: IntArray
    pauses: FloatArray
    weighting: Weighting
    stays: float = 0.0

    @cached_property
    def filter(self) -> FilterMatrices:
        """Matrices of the weighting."""
        return FilterMatrices.of(self.weighting)

    @cached_property
    def directions(self) -> list[int]:
        """Directions (0 ahead, 1 left, 2 up) in which the seat accelerates at all."""
        moves = np.maximum(np.abs(self.slopes), np.abs(self.bends)).max(axis=0) > STILL
        return np.flatnonzero(moves).tolist()

    @cached_property
    def responses(self) -> dict[int, tuple[FloatArray, FloatArray]]:
        """Response of the filter to each pause, by the number of the interval after it."""
        return {k: self.filter.response(float(self.pauses[k])) for k in np.flatnonzero(self.pauses).tolist()}

    @cached_property
    def ringing(self) -> FloatArray:
        """Matrix Q (n, n): x Q x is the integral of y² after the last interval, from the state x at its end."""
        return self.filter.response(self.stays)[1]

    def inputs(self, v0: Any, v1: Any, direction: int) -> Any:
        """Return the acceleration (N,), m/s², in one direction in each interval, from the speeds at its ends."""
        before, after = v0**2, v1**2
        change = self.slopes[:, direction] / (2.0 * self.steps)
        return change * (after - before) + 0.5 * self.bends[:, direction] * (before + after)

    def states(self, b: FloatArray) -> tuple[list[FloatArray], float]:
        """Return the filter's states (n, N + 1) at grid positions for each direction, and the integral of y², m²/s³.

        b  profile: squared speed along the path at all grid positions
        """
        root, f = np.sqrt(b), self.filter
        v0, v1 = root[self.first], root[self.first + 1]
        lasts = (2.0 * self.steps / (v0 + v1))[:, None, None]
        one, half, square = np.eye(len(f.a)), 0.5 * lasts * f.a, lasts**2 * (f.a @ f.a) / 12.0
        before = np.linalg.solve(one - half + square, one + half + square)
        gain = np.linalg.solve(one - half + square, lasts * f.b[:, None])[..., 0]
        every, total = list[FloatArray](), 0.0
        for direction in self.directions:
            u = self.inputs(v0, v1, direction)
            x = np.zeros((len(f.a), u.size + 1))
            for k in range(u.size):
                start = x[:, k]
                if k in self.responses:
                    after, integral = self.responses[k]
                    total += float(start @ integral @ start)
                    start = after @ start
                x[:, k + 1] = before[k] @ start + gain[k] * u[k]
                y = self.outputs(start, x[:, k + 1], float(lasts[k, 0, 0]), float(u[k]))
                total += float(lasts[k, 0, 0]) * y
            total += float(x[:, -1] @ self.ringing @ x[:, -1])
            every.append(x)
        return every, total

    def outputs(self, x0: Any, x1: Any, lasts: Any, u: Any) -> Any:
        """Return the mean of y² in intervals, by Simpson's rule, from the states (n, ...) at their ends."""
        f = self.filter
        c = f.c.reshape(1, -1)
        middle = 0.5 * (c @ (x0 + x1)) + 0.125 * lasts * ((c @ f.a) @ (x0 - x1)) + f.d * u
        ends = [(c @ x + f.d * u) ** 2 for x in (x0, x1)]
        mean = (ends[0] + 4.0 * middle**2 + ends[1]) / 6.0
        return float(mean[0]) if isinstance(mean, np.ndarray) else mean

    def dose(self, b: FloatArray) -> float:
        """Return the dose of a profile b, sqrt(∫ y² dt) until the robot arrives; m/s^1.5."""
        return float(np.sqrt(self.states(b)[1]))


@dataclass(frozen=True, eq=False)
class WeightedProgram:
    """Nonlinear program for speed profiles of least dose in a given duration.

    motion   the weighted acceleration
    caps     largest b at each grid position; 0 where the robot stands
    limited  sparse matrix that gives limited accelerations, as shares of their limits, from b
    scale    dose of some profile, m/s^1.5, by which costs are scaled
    """

    motion: WeightedMotion
    caps: FloatArray
    limited: Any
    scale: float

    @cached_property
    def _free(self) -> IntArray:
        """Numbers of the grid positions at which the robot moves."""
        return np.flatnonzero(self.caps > 0.0)

    @cached_property
    def _solver(self) -> tuple[Any, int]:
        """Solver of CasADi, and the number of its constraints that join filter states."""
        import casadi

        m, n, free = self.motion, len(self.motion.filter.a), self._free
        a, b = casadi.DM(m.filter.a), casadi.DM(m.filter.b)
        squared = casadi.DM(m.filter.a @ m.filter.a / 12.0)
        inner = casadi.SX.sym("v", free.size)
        spread = sp.csc_matrix((np.ones(free.size), (free, np.arange(free.size))), (self.caps.size, free.size))
        v = casadi.DM(spread) @ inner
        v0, v1 = v[m.first.tolist()], v[(m.first + 1).tolist()]
        lasts = (casadi.DM(2.0 * m.steps) / (v0 + v1)).T
        row = casadi.repmat(lasts, n, 1)
        variables, equal, integral = [inner], list[Any](), casadi.SX(0)
        for direction in m.directions:
            later = casadi.SX.sym(f"x{direction}", n, m.steps.size)
            start = casadi.horzcat(casadi.SX(n, 1), later[:, :-1])
            for k, (after, squares) in m.responses.items():
                integral += casadi.bilin(casadi.DM(squares), start[:, k])
                start[:, k] = casadi.DM(after) @ start[:, k]
            u = m.inputs(v0, v1, direction).T
            change = 0.5 * row * (a @ (later + start)) - row**2 * (squared @ (later - start))
            equal.append(casadi.vec(later - start - change - row * (b @ u)))
            integral += casadi.dot(lasts, m.outputs(start, later, lasts, u))
            integral += casadi.bilin(casadi.DM(m.ringing), later[:, -1])
            variables.append(casadi.vec(later))
        uneven = casadi.diff((v1**2 - v0**2) / casadi.DM(2.0 * m.steps))[np.flatnonzero(np.diff(m.first) == 1).tolist()]
        weight = casadi.SX.sym("evenness")
        joined = casadi.vertcat(*equal)
        shares = casadi.DM(sp.csc_matrix(self.limited)) @ v**2
        program = {
            "x": casadi.vertcat(*variables),
            "p": weight,
            "f": integral / self.scale**2 + weight * casadi.dot(uneven, uneven),
            "g": casadi.vertcat(joined, shares, casadi.sum2(lasts)),
        }
        return ipopt("weighted_profile", program, dict(IPOPT)), int(joined.numel())

    def improved(self, b: FloatArray, duration: float) -> FloatArray | None:
        """Return a profile at a local minimum of the dose within a duration, s, without pauses; None if none is found.

        b  profile at which the solver begins
        """
        solver, size = self._solver
        free, (states, square) = self._free, self.motion.states(b)
        m = self.motion
        acceleration = (b[m.first + 1] - b[m.first]) / (2.0 * m.steps)
        weight = EVENNESS * square / self.scale**2 / (m.steps.size * float((acceleration**2).max()) or 1.0)
        first = np.concatenate([np.sqrt(b[free]), *(x[:, 1:].ravel(order="F") for x in states)])
        least = np.concatenate([np.minimum(SLOWEST, first[: free.size]), np.full(size, -np.inf)])
        largest = np.concatenate([np.sqrt(self.caps[free]), np.full(size, np.inf)])
        shares = np.ones(self.limited.shape[0])
        low, high = np.zeros(size), np.zeros(size)
        with interrupts_held():
            found = solver(
                x0=first,
                p=weight,
                lbx=least,
                ubx=largest,
                lbg=np.concatenate([low, -shares, [0.0]]),
                ubg=np.concatenate([high, shares, [duration]]),
            )
        if not solver.stats()["success"]:
            return None
        profile = np.zeros(b.size)
        profile[free] = np.asarray(found["x"]).ravel()[: free.size] ** 2
        return profile
