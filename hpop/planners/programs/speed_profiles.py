r"""Speed profiles of stretches (path parts between standstills) as convex programs.

With b = (ds/dt)² at the grid positions as variable, linear between them, the acceleration d²s/dt² = b'/2 is constant in
each interval (Verscheure et al., "Time-optimal path tracking for robots", IEEE Trans. Automatic Control 54(10), 2009).
An interval of length h between b0 and b1 lasts 2h/(√b0 + √b1), which is convex in b. The limits of the coordinates q,

    \|rows dq/dt\|² = \|rows q'\|² b <= v²,    \|rows d²q/dt²\| = \|rows (q' b'/2 + q'' b)\| <= a,

are linear in b. So are the acceleration of the camera, p' b'/2 + p'' b, and the square of its flow, f² b, where f is
the flow at ds/dt = 1. Hence the duration, the integral of the squared acceleration, and the square of the worst flow
are convex.

A limit J of jerk is not convex. Let two neighbouring intervals last T0 and T1. The program demands that the
accelerations a0 and a1 of their middles differ by at most J (T0 + T1)/2, and replaces T by its tangent at an earlier
profile. T is convex, so it is nowhere below the tangent: this is a restriction, and its solutions keep the limit. The
program is solved again with the tangents at its solution until the gain is small. The result may be slower than the
optimum.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np
import scipy.sparse as sp

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.errors import OptionError
from hpop.planners.programs.stretches import PathStretch
from hpop.planners.programs.weighted_profiles import WeightedMotion, WeightedProgram

ROUNDS = 12  # largest number of programs for one profile with a limit of jerk
GAIN = 1e-4  # share of the cost: a smaller gain of a round ends the rounds
LEAST = 1e-12  # least b between standstills
SLOWER = 1.1  # factor by which a first profile is slowed down until it keeps the limit of jerk


@dataclass(frozen=True, eq=False)
class Discomfort:
    """Discomfort of speed profiles over N intervals of all stretches.

    It is the largest optic flow, the integral of a body's squared acceleration, or the dose of a seat's weighted
    acceleration. The first two are convex.

    flow      (N,)    largest optic flow, rad/s, in each interval at ds/dt = 1; None for the others
    slopes    (N, 3)  p', derivative by s of the body's position p, m, in the middle of each interval
    bends     (N, 3)  p''; with both, the discomfort is the integral of the squared acceleration, m²/s³
    weighted          the weighted acceleration of a seat with these slopes and bends; None for the others
    """

    flow: FloatArray | None = None
    slopes: FloatArray | None = None
    bends: FloatArray | None = None
    weighted: WeightedMotion | None = None


@dataclass(eq=False)
class Profiles:
    """Programs for the speed profiles of all stretches of one path; a profile is b = (ds/dt)² at all grid positions.

    stretches   k stretches
    discomfort  what is minimised for a given duration
    jerk        largest jerk of each limited combination of coordinates, or None
    """

    stretches: Sequence[PathStretch]
    discomfort: Discomfort
    jerk: float | None = None
    _tangents: tuple[Any, Any, Any] | None = field(default=None, init=False)

    # Structure

    @cached_property
    def first(self) -> IntArray:
        """Number (N,) of the grid position at which each interval begins; the next one is its end."""
        sizes = [stretch.steps.size for stretch in self.stretches]
        return np.concatenate([np.arange(n) + n_before for n, n_before in zip(sizes, self._before, strict=True)])

    @cached_property
    def _before(self) -> IntArray:
        """Number (k,) of the first grid position of each stretch."""
        sizes = np.array([stretch.steps.size + 1 for stretch in self.stretches])
        return np.concatenate([[0], np.cumsum(sizes)[:-1]])

    @cached_property
    def steps(self) -> FloatArray:
        """Lengths (N,) of the intervals: differences of the path coordinate s."""
        return np.concatenate([stretch.steps for stretch in self.stretches])

    @cached_property
    def at_rest(self) -> BoolArray:
        """True for the grid positions at which the robot stands: both ends of each stretch."""
        rest = np.zeros(self.first.size + len(self.stretches), dtype=bool)
        rest[self._before] = rest[np.append(self._before[1:] - 1, -1)] = True
        return rest

    @cached_property
    def caps(self) -> FloatArray:
        """Largest b = (ds/dt)² at each grid position that the limits of speed allow; 0 where the robot stands."""
        caps = []
        for one in self.stretches:
            rates = np.abs(one.slopes @ one.rows.T)
            with np.errstate(divide="ignore"):
                caps.append(np.minimum.reduce([(one.speeds / rates).min(axis=1), one.most, one.in_zones]) ** 2)
        return np.where(self.at_rest, 0.0, np.concatenate(caps))

    def _rows(self, share: float) -> tuple[Any, FloatArray]:
        """Return a matrix that gives limited accelerations, divided by their limits, from b; and these limits.

        The matrix has a row for each interval and each limited combination of coordinates; so have the limits.

        share  place in each interval: 0 for its start, 0.5 for its middle, 1 for its end
        """
        blocks, limits = [], []
        for one in self.stretches:
            n = one.steps.size
            places = {0.0: (one.slopes[:-1], one.bends[0]), 0.5: one.in_middle, 1.0: (one.slopes[1:], one.bends[1])}
            rate, bend = (column @ one.rows.T for column in places[share])  # (n, r)
            change = rate / (2.0 * one.steps[:, None])
            before, after = (
                (-change + (1.0 - share) * bend) / one.accelerations,
                (change + share * bend) / one.accelerations,
            )
            r = one.rows.shape[0]
            number = np.arange(n * r)
            place = np.repeat(np.arange(n), r)
            entries = np.concatenate([before.ravel(), after.ravel()])
            where = np.concatenate([number, number]), np.concatenate([place, place + 1])
            blocks.append(sp.csr_matrix((entries, where), shape=(n * r, n + 1)))
            limits.append(np.tile(one.accelerations, n))
        return sp.block_diag(blocks, format="csr"), np.concatenate(limits)

    @cached_property
    def _limited(self) -> Any:
        """Matrix that gives all limited accelerations, as shares of their limits, from b, at both ends of intervals."""
        return sp.vstack([self._rows(share)[0] for share in (0.0, 1.0)], format="csr")

    @cached_property
    def _jumps(self) -> tuple[Any, Any]:
        """Two matrices for limits of jerk: one gives changes of accelerations from b, the other times for them from T.

        The changes are those of each limited acceleration, in its own unit, from the middle of one interval to that of
        the next, and T has the durations of the intervals. Before and after a stretch the acceleration is 0; half of
        the first or the last interval counts.
        """
        middle, limits = self._rows(0.5)
        middle = sp.diags(limits) @ middle
        changes, times = [], []
        row = interval = 0
        for one in self.stretches:
            n, r = one.steps.size, one.rows.shape[0]
            steps: Any = sp.eye(n + 1, n) - sp.eye(n + 1, n, -1)
            changes.append(sp.kron(steps, sp.eye(r)) @ middle[row : row + n * r])
            halves: Any = 0.5 * (sp.eye(n + 1, n) + sp.eye(n + 1, n, -1))
            spread = sp.csr_matrix(
                (np.ones(n), (np.arange(n), np.arange(interval, interval + n))), (n, self.steps.size)
            )
            times.append(sp.kron(halves @ spread, np.ones((r, 1))))
            row, interval = row + n * r, interval + n
        return sp.vstack(changes, format="csr"), sp.vstack(times, format="csr")

    # Numbers

    def durations(self, b: FloatArray) -> FloatArray:
        """Return the duration (N,) of each interval, s, for a profile b."""
        root = np.sqrt(b)
        return np.asarray(2.0 * self.steps / (root[self.first] + root[self.first + 1]))

    def cost(self, b: FloatArray) -> float:
        """Return the discomfort of a profile b."""
        one = self.discomfort
        if one.flow is not None:
            root = np.sqrt(b)
            return float((one.flow * np.maximum(root[self.first], root[self.first + 1])).max())
        if one.weighted is not None:
            return one.weighted.dose(b)
        return float(((self._felt @ b).reshape(3, -1) ** 2).sum(axis=0) @ self.durations(b))

    @cached_property
    def _felt(self) -> Any:
        """Matrix (3 N, positions) that gives the camera's accelerations in the middles of intervals from b.

        Its rows are all x, then all y, then all z.
        """
        slopes, bends = self.discomfort.slopes, self.discomfort.bends
        assert slopes is not None
        assert bends is not None
        n, size = self.steps.size, self.at_rest.size
        parts = []
        for axis in range(3):
            change, bend = slopes[:, axis] / (2.0 * self.steps), 0.5 * bends[:, axis]
            where = np.tile(np.arange(n), 2), np.concatenate([self.first, self.first + 1])
            parts.append(sp.csr_matrix((np.concatenate([bend - change, bend + change]), where), shape=(n, size)))
        return sp.vstack(parts, format="csr")

    def jerk_excess(self, b: FloatArray) -> float:
        """Return the largest ratio of a mean jerk of profile b to its limit; 0 without a limit."""
        if self.jerk is None:
            return 0.0
        changes, times = self._jumps
        return float((np.abs(changes @ b) / (times @ self.durations(b))).max()) / self.jerk

    def within_limits(self, b: FloatArray) -> FloatArray:
        """Return profile b, with each stretch slowed down by what it exceeds the limits of speed and acceleration."""
        b = np.where(self.at_rest, 0.0, np.maximum(b, LEAST))
        excess = np.abs(self._limited @ b)
        rows = [one.steps.size * one.rows.shape[0] for one in self.stretches]
        owner = np.tile(np.repeat(np.arange(len(rows)), rows), 2)
        hardest = np.ones(len(rows))
        np.maximum.at(hardest, owner, excess)
        place = np.repeat(np.arange(len(rows)), [one.steps.size + 1 for one in self.stretches])
        np.maximum.at(hardest, place[~self.at_rest], (b / np.where(self.at_rest, 1.0, self.caps))[~self.at_rest])
        return np.asarray(b / hardest[place])

    # Programs

    @cached_property
    def _scale(self) -> tuple[FloatArray, FloatArray]:
        """Scales of the programs: ds/dt of the given trajectory at each grid position, and in each interval (N,).

        That of an interval is the sum of the values at its two ends.
        """
        pace = np.concatenate([stretch.pace for stretch in self.stretches])
        return pace, pace[self.first] + pace[self.first + 1]

    @cached_property
    def _shared(self) -> tuple[Any, Any, Any, Any, list[Any]]:
        """Variables and expressions of all programs, scaled by the given trajectory (:attr:`_scale`).

        They are b where the robot moves (the variable), b at all positions, √b0 + √b1 of each interval divided by its
        scale, the total duration, and the list of constraints.
        """
        cp = import_module("cvxpy")
        free, (pace, both) = np.flatnonzero(~self.at_rest), self._scale
        shape = self.at_rest.size, free.size
        inner, root = cp.Variable(free.size, nonneg=True, name="b"), cp.Variable(free.size, nonneg=True, name="r")
        b = sp.csr_matrix((pace[free] ** 2, (free, np.arange(free.size))), shape) @ inner
        r = sp.csr_matrix((pace[free], (free, np.arange(free.size))), shape) @ root
        total = sp.diags(1.0 / both) @ (r[self.first] + r[self.first + 1])
        duration = cp.sum(cp.multiply(2.0 * self.steps / both, cp.inv_pos(total)))
        limited = self._limited @ b
        within = [cp.square(root) <= inner, inner <= self.caps[free] / pace[free] ** 2, limited <= 1.0, limited >= -1.0]
        if self.jerk is not None:
            changes, times = self._jumps
            tangents = cp.Parameter(self.steps.size), cp.Parameter(self.steps.size), cp.Parameter(self.steps.size)
            self._tangents = tangents
            lasts = tangents[0] + cp.multiply(tangents[1], b[self.first]) + cp.multiply(tangents[2], b[self.first + 1])
            most = self.jerk * (times @ lasts)
            within += [changes @ b <= most, changes @ b >= -most]
        return inner, b, total, duration, within

    @cached_property
    def _fastest(self) -> Any:
        """Convex program for the profile of least duration."""
        cp = import_module("cvxpy")
        *_, duration, within = self._shared
        return cp.Problem(cp.Minimize(duration), within)

    @cached_property
    def _gentlest(self) -> tuple[Any, Any]:
        """Program for the least discomfort in a given duration, and the parameter for this duration, s."""
        cp = import_module("cvxpy")
        _, b, total, duration, within = self._shared
        most = cp.Parameter(nonneg=True, name="duration")
        one = self.discomfort
        if one.flow is not None:
            square = cp.Variable(nonneg=True, name="flow_squared")
            unit = float(self.cost(self.fastest)) or 1.0
            weights = (one.flow / unit) ** 2
            felt = [cp.multiply(weights, b[at]) <= square for at in (self.first, self.first + 1)]
            return cp.Problem(cp.Minimize(square), [*within, *felt, duration <= most]), most
        n, unit = self.steps.size, np.sqrt(max(self.cost(self.fastest), LEAST))
        each = cp.Variable(n, nonneg=True, name="squared_acceleration")
        rows = cp.reshape(self._felt @ b, (3, n), order="C") @ sp.diags(
            np.sqrt(8.0 * self.steps / self._scale[1]) / unit
        )
        cone = cp.SOC(each + total, cp.vstack([rows, cp.reshape(each - total, (1, n), order="C")]), axis=0)
        return cp.Problem(cp.Minimize(cp.sum(each)), [*within, cone, duration <= most]), most

    @cached_property
    def _weighted(self) -> WeightedProgram | None:
        """Nonlinear program of a weighted discomfort; None for the others."""
        weighted = self.discomfort.weighted
        if weighted is None:
            return None
        return WeightedProgram(weighted, self.caps, self._limited, self.cost(self.fastest))

    def _solved(self, program: Any) -> FloatArray | None:
        """Solve a program and return b at all positions, or None."""
        cp = import_module("cvxpy")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a solution of less accuracy is checked like all
            for scaled in (True, False):  # some programs with joints of very different levers need the second
                try:
                    program.solve(solver="CLARABEL", warm_start=True, equilibrate_enable=scaled)
                    break
                except cp.SolverError:
                    if not scaled:
                        return None
        if program.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
            return None
        b = np.zeros(self.at_rest.size)
        free = ~self.at_rest
        b[free] = self._shared[0].value * self._scale[0][free] ** 2
        return self.within_limits(b)

    def _improved(self, program: Any, b: FloatArray | None, cost: Callable[[FloatArray], float]) -> FloatArray | None:
        """Return the solution of a program; with a limit of jerk, the last one of a series that begins with profile b.

        Each program of the series has the limit linearised at the solution before it. The series ends when a solution
        exceeds the limit, which is then dropped, or lowers ``cost`` (the cost that the program minimises) very little.
        Without a limit of jerk, the result is None if the solver fails.
        """
        if self.jerk is None:
            return self._solved(program)
        best = b
        for _ in range(ROUNDS):
            assert best is not None
            self._set_tangents(best)
            found = self._solved(program)
            if found is None or self.jerk_excess(found) > 1.0 + GAIN:
                return best
            gain, best = cost(best) - cost(found), found
            if gain < GAIN * cost(found):
                break
        return best

    def _set_tangents(self, b: FloatArray) -> None:
        """Set the tangents of the intervals' durations at profile b, by which the limit of jerk becomes convex."""
        assert self._tangents is not None
        root, lasts = np.sqrt(b), self.durations(b)
        total = root[self.first] + root[self.first + 1]
        slopes = []
        for at in (self.first, self.first + 1):
            moves = ~self.at_rest[at]
            slopes.append(np.where(moves, -0.5 * lasts / (total * np.where(moves, root[at], 1.0)), 0.0))
        self._tangents[0].value = lasts - slopes[0] * b[self.first] - slopes[1] * b[self.first + 1]
        self._tangents[1].value, self._tangents[2].value = slopes

    @cached_property
    def _soft(self) -> FloatArray:
        """Profile of least jerk in each stretch (Flash and Hogan 1985), slowed down until it keeps all limits.

        The series of programs with a limit of jerk begins with it.
        """
        pieces = []
        share = np.linspace(0.0, 1.0, 10_001)
        way, rate = share**3 * (10 - 15 * share + 6 * share**2), 30 * share**2 * (1 - share) ** 2
        for one in self.stretches:
            at = np.concatenate([[0.0], np.cumsum(one.steps)])
            pieces.append((at[-1] * np.interp(at / at[-1], way, rate)) ** 2)
        b = self.within_limits(np.concatenate(pieces))
        while self.jerk_excess(b) > 1.0:
            b = b / SLOWER**2
        return b

    @cached_property
    def fastest(self) -> FloatArray:
        """Fastest profile: b = (ds/dt)² at each grid position."""
        found = self._improved(
            self._fastest, None if self.jerk is None else self._soft, lambda b: self.durations(b).sum()
        )
        if found is None:
            raise OptionError(
                "the solver found no speed profile that keeps the limits of the robot on this path; check that the "
                "trajectory keeps them: `hpop show`"
            )
        return found

    def gentlest(self, duration: float, start: FloatArray) -> FloatArray | None:
        """Return the profile (b at each position) of least discomfort within a duration, s; None if no solver finds it.

        start  profile within this duration. With a limit of jerk, programs are solved one after another, and the first
               one begins with it. A weighted discomfort is improved from the profile of least unweighted acceleration,
               and the best of ``start`` and both is returned
        """
        program, most = self._gentlest
        most.value = duration
        found = self._improved(program, start, self.cost)
        if self._weighted is None:
            return found
        gentle = start if found is None else found
        improved = self._weighted.improved(gentle, duration)
        candidates = [start, gentle] if improved is None else [start, gentle, self.within_limits(improved)]
        return min(candidates, key=self.cost)
