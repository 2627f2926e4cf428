"""Driven trajectories: the nonlinear program of a differential drive along a given sequence of turns.

Direct collocation in phases. The turns of a polyline are structure: a phase of straight driving (yaw rate exactly
zero) and a phase of turning one way (yaw rate of one sign, at least LEAST_TURN in all) take turns, so that the number
of turns cannot become less. Each phase has its own free duration and a fixed number of intervals of constant wheel
accelerations, which are the controls; what the robot does in an interval is :class:`hpop.models.driven.Drive`, exactly
the law by which the trajectory is then evaluated. The criteria enter by their own ``cost`` on CasADi symbols.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.arrays import FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.models.driven import Drive
from hpop.motions import States
from hpop.planners.driven_interval import CONTROLS, NODES, Interval, accelerations
from hpop.planners.driven_structure import Guess, Structure
from hpop.planners.interrupts import interrupts_held
from hpop.planners.nlp import reaches
from hpop.planners.separable import Separable
from hpop.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problem import Problem

LEAST_TURN = math.radians(1.5)  # a turn counts from one degree on
STRAIGHT = 0.1  # s: straight driving that tells two turns of one sign apart
SHORT = 0.01  # s: any other phase
LONGEST = 600.0  # s: of a phase
STILL = 1e-6  # rad/s: a smaller yaw rate is none
SAMPLES = 240  # places at which the clearance is bounded, at least
DENSE = 0.03  # m: distance of the places at which a solution's clearance is checked
SPARE = 5e-3  # m: by which a bound is raised beyond what was lacking
EFFORT = 0.02  # weight of the squared accelerations against the costs, which are scaled to 1
HASTE = 0.2  # weight of the duration
SUCCESS = ("Solve_Succeeded", "Solved_To_Acceptable_Level")


@dataclass(frozen=True, eq=False)
class Driven:
    """What the solver returned.

    trajectory  feasible for the program within its tolerance; None if the solver did not converge
    costs       (k,) as the program adds them up
    status      the solver's own word
    iterations  of the solver
    """

    trajectory: Trajectory | None
    costs: FloatArray
    status: str
    iterations: int


@dataclass(frozen=True, eq=False)
class _Formulas:
    """The program in CasADi's terms.

    intervals    all that is nonlinear, interval by interval
    program      variables, parameters, objective and constraints
    derivatives  of the program, by the names that solvers have for them
    values       function from variables and parameters to the costs
    sizes        numbers of constraints of each sort
    """

    intervals: Separable
    program: dict[str, Any]
    derivatives: dict[str, Any]
    values: Any
    sizes: tuple[int, ...]

    def solver(self, options: Mapping[str, Any]) -> Any:
        """IPOPT; options that say nothing else take the exact second derivatives."""
        import casadi

        return casadi.nlpsol("driven", "ipopt", self.program, {**self.derivatives, **_OPTIONS, **options})


@dataclass(frozen=True, eq=False)
class DrivenProgram:
    """Minimise a weighted sum of scaled costs over driven trajectories of one structure, all costs bounded.

    ``min Σ_j w_j f_j / s_j + HASTE T/T_0 + EFFORT mean(u²)  subject to  f_j <= eps_j,  d(sample) >= bound``, wheel
    speeds and accelerations within the model's. Built once; ends, weights, scales, bounds and the first guess are
    parameters. Local optima only.
    """

    problem: Problem
    criteria: tuple[Criterion, ...]
    structure: Structure

    @cached_property
    def spaces(self) -> tuple[tuple[tuple[float, float], float], ...]:
        """Height ranges with different obstacles, and how far the robot reaches there, m."""
        return reaches(self.problem)

    @cached_property
    def samples(self) -> tuple[IntArray, FloatArray]:
        """Interval, and share of its time, of each place (S,) at which the clearance is bounded."""
        each = max(2, math.ceil(SAMPLES / len(self.structure.phase)))
        owner = np.repeat(np.arange(len(self.structure.phase)), each)
        return owner, np.tile((np.arange(each) + 0.5) / each, len(self.structure.phase))

    def build(self) -> DrivenProgram:
        """Build the program now; solving does it when it is first needed."""
        _ = self._newton
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

        n, k, model = len(self.structure.phase), len(self.criteria), self.problem.model
        nodes = {name: casadi.MX.sym(name, n + 1) for name in NODES}
        left, right = (casadi.MX.sym(name, n) for name in CONTROLS)
        h, slack = casadi.MX.sym("h", n), casadi.MX.sym("slack", len(self._worst))
        weights, scale = casadi.MX.sym("weights", k), casadi.MX.sym("scale", k)
        signs, usual = casadi.MX.sym("signs", n), casadi.MX.sym("usual")
        variables = casadi.vertcat(*nodes.values(), left, right, h, slack)
        parameters = casadi.vertcat(weights, scale, signs, usual)
        intervals = self._intervals(variables, signs)
        defects, effort, *others = intervals.symbols

        costs, honest, above = [], [], []  # a slack may lie above the worst moment
        for j, values in enumerate(others[:k]):
            if j in self._worst:
                costs.append(slack[self._worst.index(j)])
                honest.append(casadi.mmax(values))
                above.append((casadi.vec(values) - costs[-1]) / scale[j])
            else:
                costs.append(casadi.sum1(values))
                honest.append(costs[-1])
        objective = casadi.dot(weights, casadi.vertcat(*costs) / scale)
        objective += (HASTE * casadi.sum1(h) + EFFORT * casadi.sum1(effort)) / usual
        half, inner = 0.5 * model.wheel_base, slice(1, n)
        speeds = [nodes["speed"][inner] + side * half * nodes["turn_rate"][inner] for side in (-1.0, 1.0)]
        ends = np.cumsum([0, *self.structure.counts])
        turns = np.flatnonzero(self.structure.turning)
        first, last = ends[turns].tolist(), ends[turns + 1].tolist()
        turned = signs[first] * (nodes["yaw"][last] - nodes["yaw"][first])
        even = np.flatnonzero(np.diff(self.structure.phase) == 0)
        groups = [
            casadi.vertcat(*group)
            for group in (
                [h[even.tolist()] - h[(even + 1).tolist()]],
                [casadi.vec(defects)],
                [accelerations(left, right, model)[1]],
                speeds,
                [turned],
                [costs[j] / scale[j] for j in self._summed],
                above,
                [casadi.vec(values.T) for values in others[k:]],
            )
        ]
        program, derivatives = intervals.program(variables, parameters, signs, objective, casadi.vertcat(*groups))
        (told,) = casadi.substitute([casadi.vertcat(*honest)], list(intervals.symbols), list(intervals.values))

        values = casadi.Function("values", [variables, parameters], [told])
        return _Formulas(intervals, program, derivatives, values, tuple(int(group.numel()) for group in groups))

    def _intervals(self, variables: Any, signs: Any) -> Separable:
        """All that is nonlinear, interval by interval."""
        n, nodes = len(self.structure.phase), len(NODES)
        first = np.arange(nodes)[:, None] * (n + 1) + np.arange(n)
        own = nodes * (n + 1) + np.arange(len(CONTROLS) + 1)[:, None] * n + np.arange(n)
        shares = tuple(self.samples[1][: len(self.samples[1]) // n].tolist())
        interval = Interval(self.problem, self.criteria, tuple(z for z, _ in self.spaces), shares)
        return Separable.of(interval.write, np.vstack([first, first + 1, own]), variables, signs)

    @cached_property
    def _newton(self) -> Any:
        """The solver with exact second derivatives."""
        return self._formulas.solver({})

    @cached_property
    def _quasi_newton(self) -> Any:
        """The solver that learns second derivatives on the way: slower, but not misled by kinks of costs."""
        return self._formulas.solver(_QUASI_NEWTON)

    def solve(
        self,
        guess: Guess,
        *,
        weights: FloatArray,
        epsilon: FloatArray,
        scale: FloatArray,
        clearances: Sequence[FloatArray],
        exact: bool = True,
    ) -> Driven:
        """The local optimum near a guess.

        Parameters
        ----------
        guess : of this structure
        weights : (k,) of the scaled costs in the objective
        epsilon : (k,) upper bounds of the costs; inf bounds nothing
        scale : (k,) positive: differences of costs that matter alike
        clearances : least field values (S,) at the samples, one array a height range
        exact : whether second derivatives are the exact ones
        """
        values, sizes = self._formulas.values, self._formulas.sizes
        solver = self._newton if exact else self._quasi_newton
        model, n = self.problem.model, len(self.structure.phase)
        lowest, highest = self._node_bounds(guess)
        least = np.full(len(guess.lasts), SHORT)  # s, of each phase
        for p in range(1, len(least) - 1):
            if not self.structure.turning[p] and guess.signs[p - 1] == guess.signs[p + 1]:
                least[p] = STRAIGHT
        wheel = model.wheel_acceleration
        x0, parameters = self._point(guess, weights, scale)
        counts, phase = np.array(self.structure.counts), self.structure.phase
        below, more = np.full(len(self._worst), -np.inf), epsilon[self._worst]
        spread = np.concatenate(list(clearances))
        lows: list[Any] = [0.0, 0.0, -model.turn_acceleration, -np.inf, LEAST_TURN, -np.inf, -np.inf, spread]
        highs: list[Any] = [
            *(0.0, 0.0, model.turn_acceleration, model.wheel_speed, np.inf),
            *(epsilon[self._summed] / scale[self._summed], 0.0, np.inf),
        ]
        lbg, ubg = (
            np.concatenate([np.broadcast_to(b, (size,)) for b, size in zip(side, sizes, strict=True)])
            for side in (lows, highs)
        )
        with interrupts_held():
            found = solver(
                x0=x0,
                p=parameters,
                lbx=np.concatenate([lowest.ravel(), np.full(2 * n, -wheel), (least / counts)[phase], below]),
                ubx=np.concatenate([highest.ravel(), np.full(2 * n, wheel), (LONGEST / counts)[phase], more]),
                lbg=lbg,
                ubg=ubg,
            )
        stats = solver.stats()
        point = np.array(found["x"]).ravel()
        costs = np.array(values(point, parameters)).ravel()
        return Driven(
            self._trajectory(guess, point) if stats["return_status"] in SUCCESS else None,
            costs,
            str(stats["return_status"]),
            int(stats["iter_count"]),
        )

    def again(self, guess: Guess, trajectory: Trajectory) -> Guess:
        """A guess that begins at a solution."""
        s = trajectory.states
        ends = np.cumsum([0, *self.structure.counts])
        return replace(guess, nodes=np.stack([getattr(s, name) for name in NODES]), lasts=np.diff(s.clock[ends]))

    def raised(self, bounds: Sequence[FloatArray], trajectory: Trajectory) -> list[FloatArray]:
        """Bounds that are higher where a solution comes too near to an obstacle, by exact distances all along it."""
        owner, share = self.samples
        sampled = trajectory.times[owner] + share * trajectory.durations[owner]
        times = np.linspace(
            0.0, trajectory.duration, int(np.ceil(trajectory.duration * self.problem.model.speed / DENSE)) + 2
        )
        at, here = trajectory.at(times), trajectory.at(sampled)
        nearest = np.clip(np.searchsorted(sampled, times), 1, len(sampled) - 1)
        out = []
        for (z, reach), bound in zip(self.spaces, bounds, strict=True):
            lacking = reach - self.problem.world.free_space(z).signed_clearance(at.x, at.y)
            more = np.zeros(len(bound))
            for side in (nearest - 1, nearest):
                np.maximum.at(more, side, np.where(lacking > -SPARE, lacking + SPARE, 0.0))
            field = self.problem.world.clearance_field(z=z)(here.x, here.y)
            out.append(np.where(more > 0, np.maximum(bound, field + more), bound))
        return out

    def _node_bounds(self, guess: Guess) -> tuple[FloatArray, FloatArray]:
        """Least and largest values (5, n+1) at the nodes."""
        model, n = self.problem.model, len(self.structure.phase)
        x_min, y_min, x_max, y_max = self.problem.world.bounds
        lowest = np.repeat(np.array([[x_min], [y_min], [-np.inf], [0.0], [0.0]]), n + 1, axis=1)
        highest = np.repeat(np.array([[x_max], [y_max], [np.inf], [model.speed], [0.0]]), n + 1, axis=1)
        for p, sign in enumerate(guess.signs):
            (inside,) = np.nonzero(self.structure.phase == p)
            lowest[4, inside[1:]] = min(0.0, sign * model.turn_rate)
            highest[4, inside[1:]] = max(0.0, sign * model.turn_rate)
        for bound in (lowest, highest):
            bound[4, self.structure.straight_nodes] = 0.0
            bound[:, 0] = guess.nodes[:, 0]
            bound[:2, -1], bound[3, -1] = guess.nodes[:2, -1], 0.0
            if guess.goal_yaw:
                bound[2, -1] = guess.nodes[2, -1]
        return lowest, highest

    def _point(self, guess: Guess, weights: FloatArray, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Variables and parameters of a guess."""
        model, phase = self.problem.model, self.structure.phase
        h = (guess.lasts / self.structure.counts)[phase]
        gain, bend = np.diff(guess.nodes[3]) / h, np.diff(guess.nodes[4]) / h
        wheels = [gain + side * 0.5 * model.wheel_base * bend for side in (-1.0, 1.0)]
        limit = 0.9 * model.wheel_acceleration
        point = np.concatenate([guess.nodes.ravel(), *np.clip(wheels, -limit, limit), h])
        parameters = np.concatenate([weights, scale, guess.signs[phase], [guess.lasts.sum()]])
        if self._worst:
            tops = np.array(self._formulas.values(np.append(point, np.zeros(len(self._worst))), parameters)).ravel()
            point = np.concatenate([point, tops[self._worst]])
        return point, parameters

    def _trajectory(self, guess: Guess, point: FloatArray) -> Trajectory:
        """The trajectory of the program's variables, on its bounds exactly."""
        n = len(self.structure.phase)
        nodes = np.clip(point[: 5 * (n + 1)].reshape(5, n + 1), *self._node_bounds(guess))
        nodes[4, np.abs(nodes[4]) < STILL] = 0.0
        clock = np.concatenate([[0.0], np.cumsum(point[7 * n + 5 : 8 * n + 5])])
        columns = dict(zip(NODES, nodes, strict=True))
        return Trajectory(self.problem.model, States(**columns, clock=clock), (Drive().kind,) * n)


_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.mu_init": 0.01,
    "ipopt.max_iter": 150,
    "ipopt.mu_target": 3e-5,  # the last digits of a flat valley take a tenth of the time, for a thousandth of a cost
    "ipopt.tol": 3e-4,
    "ipopt.constr_viol_tol": 1e-7,
    "no_nlp_grad": True,  # nobody asks how the optimum depends on parameters
    "calc_lam_p": False,
}

_QUASI_NEWTON: dict[str, Any] = {
    "ipopt.hessian_approximation": "limited-memory",
    "ipopt.max_iter": 300,
    "ipopt.tol": 1e-3,
    "ipopt.acceptable_tol": 1e-2,
    "ipopt.acceptable_iter": 5,
    "ipopt.acceptable_constr_viol_tol": 1e-6,
    "ipopt.acceptable_obj_change_tol": 1e-3,
}
