"""The nonlinear program for trajectories of a differential drive with a given sequence of turns.

This is direct collocation in phases, which the turns of a polyline fix. Phases of straight driving (yaw rate exactly
zero) alternate with phases of turning (yaw rate of one sign, by LEAST_PHASE at least), so the number of turns cannot
decrease. Each phase has a free duration and a fixed number of intervals with constant wheel accelerations, which follow
from the speeds at the nodes between intervals. The motion in an interval is :class:`hpop.models.driven.Drive`, the law
by which the trajectory is evaluated as well. Criteria are evaluated on CasADi symbols.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.criteria.comfort.rotation import LEAST_TURN
from hpop.models.driven import Drive
from hpop.motions import States
from hpop.planners.needs import in_plane, on_wheels, reaches
from hpop.planners.programs import Deadline
from hpop.planners.programs.nlp import ipopt
from hpop.planners.programs.smoothing.interval import NODES, Bounds, Interval, made_feasible
from hpop.planners.programs.smoothing.phases import (
    OPTIONS,
    SOLVER_OPTIONS,
    SUCCESS,
    CostTargets,
    Guess,
    Phases,
    ProgramSolution,
)
from hpop.planners.programs.smoothing.separable import Separable
from hpop.runtime.interrupts import interrupts_held
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from hpop.problems.problem import Problem

LEAST_PHASE = 1.5 * LEAST_TURN  # rad: least rotation of a turning phase, so that it counts as a turn
STRAIGHT = 0.1  # s: least straight driving between two turns of one sign
SHORT = 0.01  # s: least duration of other phases
LONGEST = 600.0  # s: largest duration of a phase
STILL = 1e-6  # rad/s: a smaller yaw rate is 0
SAMPLES = 240  # least number of points at which the clearance is bounded
TURNING = 0.003  # rad/s: least yaw rate inside turns, as a turn could else become two
REFINED = 0.003  # share of EFFORT and HASTE when a solution is refined
EFFORT = 0.02  # weight of the squared accelerations against the costs, which are scaled to 1
HASTE = 0.2  # weight of the duration


@dataclass(frozen=True, eq=False)
class _Formulas:
    """Program as CasADi expressions, from which solvers are made.

    intervals    nonlinear functions of all intervals
    program      variables, parameters, objective and constraints
    derivatives  functions for the derivatives of the program, by their names as options of CasADi's solvers
    values       function from variables and parameters to the costs
    sizes        number of constraints in each group
    stopping     solver options that stop it at the deadline
    """

    intervals: Separable
    program: dict[str, Any]
    derivatives: dict[str, Any]
    values: Any
    sizes: tuple[int, ...]
    stopping: dict[str, Any]

    def limits(self, x: FloatArray, parameters: FloatArray) -> tuple[FloatArray, csr_array]:
        """Return the values of all constraints (m,) and their Jacobian (m, size)."""
        from scipy.sparse import csr_array

        with interrupts_held():
            values, slopes = self.derivatives["jac_g"](x, parameters)
        return np.array(values).ravel(), csr_array(slopes.sparse())

    def solver(self, options: Mapping[str, Any]) -> Any:
        """Return an IPOPT solver for the program; ``options`` may replace its exact second derivatives."""
        return ipopt("driven", self.program, {**self.derivatives, **OPTIONS, **self.stopping, **options})


@dataclass(frozen=True, eq=False)
class DrivenProgram:
    """Program that minimises a weighted sum of bounded costs over the drives with one structure of phases.

    ``min Σ_j w_j f_j / s_j + HASTE T/T_0 + EFFORT mean(u²)  subject to  f_j <= eps_j,  d(sample) >= bound``, and to the
    model's limits of wheel speeds and accelerations. T is the duration, T_0 that of the guess, w and s are weights and
    scales of the costs f, and u² is the sum of the squared accelerations (linear and angular), as shares of the model's
    largest ones. The program is built once. Start and goal, weights, scales, bounds and the initial guess are
    parameters. It finds local optima only.
    """

    problem: Problem
    criteria: tuple[Criterion, ...]
    structure: Phases
    deadline: Deadline = Deadline()  # noqa: RUF009  (frozen)
    solvers: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def spaces(self) -> tuple[tuple[tuple[float, float], float], ...]:
        """Height ranges (low, high) with different obstacles, m, each with the robot's largest radius there, m."""
        return reaches(in_plane(self.problem.model), self.problem.world)

    @cached_property
    def samples(self) -> tuple[IntArray, FloatArray]:
        """Samples (S,) at which the clearance is bounded: interval of each, and share of the interval's time."""
        each = max(2, math.ceil(SAMPLES / len(self.structure.phase)))
        owner = np.repeat(np.arange(len(self.structure.phase)), each)
        return owner, np.tile((np.arange(each) + 0.5) / each, len(self.structure.phase))

    def build(self) -> DrivenProgram:
        """Build the program now instead of at the first solve."""
        self._solver("exact")
        return self

    @property
    def _worst(self) -> list[int]:
        return [j for j, criterion in enumerate(self.criteria) if criterion.aggregate == "max"]

    @property
    def _summed(self) -> list[int]:
        return [j for j, criterion in enumerate(self.criteria) if criterion.aggregate != "max"]

    @cached_property
    def _formulas(self) -> _Formulas:
        import casadi

        n, k, model = len(self.structure.phase), len(self.criteria), on_wheels(self.problem.model)
        of_nodes, of_lasts = self.structure.variable_indices
        moving, slack = casadi.MX.sym("moving", int(of_lasts[-1]) + 1), casadi.MX.sym("slack", len(self._worst))
        of_hinges = casadi.MX.sym("hinges", n * self._interval.hinges)
        weights, scale = casadi.MX.sym("weights", k), casadi.MX.sym("scale", k)
        signs, regular = casadi.MX.sym("signs", n), casadi.MX.sym("regular", 2)
        variables = casadi.vertcat(moving, slack, of_hinges, casadi.MX.sym("filters", self._filters.size))
        parameters = casadi.vertcat(weights, scale, signs, regular)
        intervals = self._intervals(variables, signs)
        defects, effort, *values_of = intervals.symbols
        nodes = {name: variables[indices.tolist()] for name, indices in zip(NODES, of_nodes, strict=True)}
        h = variables[of_lasts.tolist()]

        costs, honest, above = [], [], []  # the maxima themselves, which slacks may exceed
        for j, values in enumerate(values_of[:k]):
            if j in self._worst:
                costs.append(slack[self._worst.index(j)])
                honest.append(casadi.mmax(values))
                above.append((casadi.vec(values) - costs[-1]) / scale[j])
            elif self.criteria[j].dose is not None:  # its square, divided by its scale
                costs.append(casadi.sum1(values) / scale[j])
                honest.append(casadi.sqrt(casadi.sum1(values)))
            else:
                costs.append(casadi.sum1(values))
                honest.append(costs[-1])
        objective = casadi.dot(weights, casadi.vertcat(*costs) / scale)
        objective += regular[0] * casadi.sum1(h) + regular[1] * casadi.sum1(effort)
        half = 0.5 * model.wheel_base
        turns, inner = self.structure.turning_intervals.tolist(), self.structure.turning_nodes.tolist()
        gain, bend = (casadi.diff(nodes[name]) / h for name in ("speed", "turn_rate"))
        wheels = [gain + half * bend, (gain - half * bend)[turns]]  # on straight intervals both wheels are equal
        outer = nodes["speed"][inner] + half * signs[inner] * nodes["turn_rate"][inner]
        ends = np.cumsum([0, *self.structure.counts])
        phases = np.flatnonzero(self.structure.turning)
        first, last = ends[phases].tolist(), ends[phases + 1].tolist()
        turned = signs[first] * (nodes["yaw"][last] - nodes["yaw"][first])
        after = k + len(self.spaces)
        filtered, hinged = (
            values_of[after : after + bool(self._filters.size)],
            values_of[-1:] if of_hinges.numel() else [],
        )
        groups = [
            casadi.vertcat(*group)
            for group in (
                [casadi.vec(defects[:, :2]), defects[turns, 2], *map(casadi.vec, filtered)],
                wheels,
                [bend[turns]],
                [outer],
                [turned],
                [costs[j] / scale[j] for j in self._summed],
                above,
                [casadi.vec(values.T) for values in values_of[k:after]],
                [casadi.vec(values) for values in hinged],
            )
        ]
        program, derivatives = intervals.program(variables, parameters, signs, objective, casadi.vertcat(*groups))
        (honest_values,) = casadi.substitute([casadi.vertcat(*honest)], list(intervals.symbols), list(intervals.values))

        values = casadi.Function("values", [variables, parameters], [honest_values])
        sizes = tuple(int(group.numel()) for group in groups)
        stopping = self.deadline.stopping(variables.numel(), sum(sizes))
        return _Formulas(intervals, program, derivatives, values, sizes, stopping)

    def _intervals(self, variables: Any, signs: Any) -> Separable:
        """Return the nonlinear functions of all intervals, as expressions of the program's variables."""
        of_nodes, of_lasts = self.structure.variable_indices
        slacks = self._hinges.reshape(-1, len(of_lasts))
        filters = self._filters[:, :-1], self._filters[:, 1:]
        where = np.vstack([of_nodes[:, :-1], of_nodes[:, 1:], of_lasts, slacks, *filters])
        return Separable.of(self._interval.write, where, variables, signs, self.deadline)

    @cached_property
    def _interval(self) -> Interval:
        shares = tuple(self.samples[1][: len(self.samples[1]) // len(self.structure.phase)].tolist())
        return Interval(self.problem, self.criteria, tuple(z for z, _ in self.spaces), shares)

    @property
    def _hinges(self) -> IntArray:
        """Indices of the slacks of hinges ``max(x, 0)`` among the variables, for all intervals, hinge by hinge."""
        n, first = len(self.structure.phase), int(self.structure.variable_indices[1][-1]) + 1 + len(self._worst)
        return first + np.arange(n * self._interval.hinges)

    @cached_property
    def _filters(self) -> IntArray:
        """Indices (m, n+1) of the filter states of a dose at all nodes; m is 0 without a dose."""
        n, m = len(self.structure.phase), self._interval.filters
        first = int(self.structure.variable_indices[1][-1]) + 1 + len(self._worst) + n * self._interval.hinges
        return first + np.arange(m * (n + 1)).reshape(m, n + 1)

    def _solver(self, name: str) -> Any:
        """Return the solver with the SOLVER_OPTIONS of a name, built on first use."""
        if name not in self.solvers:
            self.solvers[name] = self._formulas.solver(SOLVER_OPTIONS[name])
        return self.solvers[name]

    def solve(
        self, guess: Guess, targets: CostTargets, clearances: Sequence[FloatArray], *, exact: bool = True
    ) -> ProgramSolution:
        """Solve the program from a guess, and return the local optimum near it.

        Parameters
        ----------
        guess : initial values for this structure of phases
        targets : weights, bounds and scales of the costs
        clearances : least values (S,) of the distance field at the samples, one array for each height range
        exact : whether to use exact second derivatives, else a quasi-Newton estimate
        """
        x0, parameters = self._point(guess, targets)
        solver = self._solver("exact" if exact else "quasi-newton")
        return self._solved(solver, guess, parameters, self._limits(guess, targets, clearances), {"x0": x0})

    def refined(
        self, start: ProgramSolution, guess: Guess, targets: CostTargets, clearances: Sequence[FloatArray]
    ) -> ProgramSolution:
        """Solve the program again from a solution, more accurately and with smaller weights of time and effort.

        Other arguments as for :meth:`solve`.
        """
        parameters = self._parameters(guess, targets, REFINED)
        begin = {"x0": start.point, "lam_x0": start.rates[0], "lam_g0": start.rates[1]}
        return self._solved(self._solver("refined"), guess, parameters, self._limits(guess, targets, clearances), begin)

    def _solved(
        self, solver: Any, guess: Guess, parameters: FloatArray, limits: tuple[Bounds, Bounds], begin: dict[str, Any]
    ) -> ProgramSolution:
        """Run a solver from ``begin``, and return its solution, with its point moved into the limits.

        guess       directions of the turns, and whether the goal fixes the heading
        parameters  values of the program's parameters
        limits      bounds of the variables, and bounds of the constraints
        begin       initial variables and, if known, multipliers, by their names in CasADi
        """
        box, bounds = limits
        for stop in self._formulas.stopping.values():
            stop.begin()
        with interrupts_held():
            result = solver(**begin, p=parameters, lbx=box[0], ubx=box[1], lbg=bounds[0], ubg=bounds[1])
        stats = solver.stats()
        self.deadline.check_solver(str(stats["return_status"]))
        status, point = str(stats["return_status"]), np.array(result["x"]).ravel()
        trajectory = None
        if status in SUCCESS:
            feasible = made_feasible(lambda x: self._formulas.limits(x, parameters), point, box, bounds)
            if feasible is None:
                status = "Limits_Not_Kept"
            else:
                point, trajectory = feasible, self._trajectory(guess, feasible)
        rates = (np.array(result["lam_x"]).ravel(), np.array(result["lam_g"]).ravel())
        return ProgramSolution(
            point, rates, trajectory, self._costs(point, parameters), status, int(stats["iter_count"])
        )

    def _limits(self, guess: Guess, targets: CostTargets, clearances: Sequence[FloatArray]) -> tuple[Bounds, Bounds]:
        """Return the lower and upper bounds of the variables, and those of the constraints."""
        epsilon, scale, sizes = targets.epsilon, targets.scale, self._formulas.sizes
        model, counts = on_wheels(self.problem.model), np.array(self.structure.counts)
        at_nodes, (indices, _) = self._node_bounds(guess), self.structure.variable_indices
        lowest, highest = np.full(indices[-1, -1] + 1, -np.inf), np.full(indices[-1, -1] + 1, np.inf)
        np.maximum.at(lowest, indices, at_nodes[0])  # the tightest bound counts if nodes share a variable
        np.minimum.at(highest, indices, at_nodes[1])
        least = np.full(len(guess.lasts), SHORT)  # s, of each phase
        for p in range(1, len(least) - 1):
            if not self.structure.turning[p] and guess.signs[p - 1] == guess.signs[p + 1]:
                least[p] = STRAIGHT
        below, more = np.full(len(self._worst), -np.inf), epsilon[self._worst]
        spread = np.concatenate(list(clearances))
        wheel, bend = model.wheel_acceleration, model.turn_acceleration
        lows: list[Any] = [0.0, -wheel, -bend, -np.inf, LEAST_PHASE, -np.inf, -np.inf, spread, -np.inf]
        powers = [1 if self.criteria[j].dose is None else 2 for j in self._summed]
        bounded = (epsilon[self._summed] / scale[self._summed]) ** powers
        highs: list[Any] = [0.0, wheel, bend, model.wheel_speed, np.inf, bounded, 0.0, np.inf, 0.0]
        lbg, ubg = (
            np.concatenate([np.broadcast_to(b, (size,)) for b, size in zip(side, sizes, strict=True)])
            for side in (lows, highs)
        )
        filters = np.where(self._filters == self._filters[:, :1], 0.0, np.inf).ravel()  # at rest at the start
        lbx = np.concatenate([lowest, least / counts, below, 0.0 * self._hinges, -filters])
        ubx = np.concatenate([highest, LONGEST / counts, more, np.full(len(self._hinges), np.inf), filters])
        return (lbx, ubx), (lbg, ubg)

    def _costs(self, point: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the costs (k,) at given variables, as the program computes them."""
        placed = self._on_hinges(point, parameters)
        with interrupts_held():
            return np.array(self._formulas.values(placed, parameters)).ravel()

    def guess_at(self, guess: Guess, trajectory: Trajectory) -> Guess:
        """Return the values of a trajectory as the guess of a next solve, with the signs of the given guess."""
        s = trajectory.states
        ends = np.cumsum([0, *self.structure.counts])
        return replace(guess, nodes=np.stack([getattr(s, name) for name in NODES]), lasts=np.diff(s.clock[ends]))

    def _node_bounds(self, guess: Guess) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper bounds (5, n+1) of x, y, yaw, speed and turn rate at the nodes."""
        model, n = on_wheels(self.problem.model), len(self.structure.phase)
        x_min, y_min, x_max, y_max = self.problem.world.bounds
        lowest = np.repeat(np.array([[x_min], [y_min], [-np.inf], [0.0], [0.0]]), n + 1, axis=1)
        highest = np.repeat(np.array([[x_max], [y_max], [np.inf], [model.speed], [0.0]]), n + 1, axis=1)
        for p, sign in enumerate(guess.signs):
            (inside,) = np.nonzero(self.structure.phase == p)
            rates = sorted((sign * TURNING, sign * model.turn_rate))
            lowest[4, inside[1:]], highest[4, inside[1:]] = rates
        for bound in (lowest, highest):
            bound[4, self.structure.straight_nodes] = 0.0
            bound[:, 0] = guess.nodes[:, 0]
            bound[:2, -1], bound[3, -1] = guess.nodes[:2, -1], 0.0
            if guess.goal_yaw:
                bound[2, -1] = guess.nodes[2, -1]
        return lowest, highest

    def _parameters(self, guess: Guess, targets: CostTargets, regular: float = 1.0) -> FloatArray:
        """Return the values of the program's parameters, with HASTE and EFFORT multiplied by ``regular``."""
        regulariser = regular * np.array([HASTE, EFFORT]) / guess.lasts.sum()
        return np.concatenate([targets.weights, targets.scale, guess.signs[self.structure.phase], regulariser])

    def _point(self, guess: Guess, targets: CostTargets) -> tuple[FloatArray, FloatArray]:
        """Return the values of the program's variables and parameters for a guess."""
        of_nodes, of_lasts = self.structure.variable_indices
        point = np.empty(of_lasts[-1] + 1)
        point[of_nodes], point[of_lasts] = guess.nodes, (guess.lasts / self.structure.counts)[self.structure.phase]
        parameters = self._parameters(guess, targets)
        slacks, count = np.zeros(len(self._worst) + len(self._hinges) + self._filters.size), len(point)
        point = self._on_hinges(self._on_filters(np.concatenate([point, slacks]), parameters), parameters)
        if self._worst:
            honest = np.array(self._formulas.values(point, parameters)).ravel()
            point[count : count + len(self._worst)] = honest[self._worst]
        return point, parameters

    def _on_hinges(self, point: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the variables with each slack of a hinge ``max(x, 0)`` at its least feasible value.

        Then the program's costs are those without slacks.
        """
        if not len(self._hinges):
            return point
        point = point.copy()
        point[self._hinges] = 0.0
        excess = self._formulas.limits(point, parameters)[0][-len(self._hinges) :]
        point[self._hinges] = np.maximum(excess, 0.0)
        return point

    def _on_filters(self, point: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the variables with the filter states of a dose that follow from the motion."""
        if not self._filters.size:
            return point
        from scipy.sparse.linalg import spsolve

        n, of_later = len(self.structure.phase), self._filters[:, 1:].ravel()
        values, slopes = self._formulas.limits(point, parameters)
        rows = slice(2 * n + len(self.structure.turning_intervals), self._formulas.sizes[0])
        point = point.copy()
        point[of_later] -= spsolve(slopes[rows][:, of_later].tocsc(), values[rows])
        return point

    def _trajectory(self, guess: Guess, point: FloatArray) -> Trajectory:
        """Return the trajectory that the program's variables describe, with values clipped to their bounds."""
        of_nodes, of_lasts = self.structure.variable_indices
        nodes = np.clip(point[of_nodes], *self._node_bounds(guess))
        nodes[4, np.abs(nodes[4]) < STILL] = 0.0
        clock = np.concatenate([[0.0], np.cumsum(point[of_lasts])])
        columns = dict(zip(NODES, nodes, strict=True))
        return Trajectory(self.problem.model, States(**columns, clock=clock), (Drive().kind,) * len(of_lasts))
