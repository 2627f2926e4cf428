"""Driven trajectories: the nonlinear program of a differential drive along a given sequence of turns.

Direct collocation in phases. The turns of a polyline are structure: a phase of straight driving (yaw rate exactly
zero) and a phase of turning one way (yaw rate of one sign, at least LEAST_TURN in all) take turns, so that the number
of turns cannot become less. Each phase has its own free duration and a fixed number of intervals of constant wheel
accelerations, which are the controls; what the robot does in an interval is :class:`hpop.models.driven.Drive`, exactly
the law by which the trajectory is then evaluated. The criteria enter by their own ``cost`` on CasADi symbols.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.arrays import Column, FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.models.driven import Drive, gauss
from hpop.motions import Motions, States
from hpop.planners.driven_structure import Guess, Structure
from hpop.planners.interrupts import interrupts_held
from hpop.planners.nlp import SparseWorld, moments, mx, reaches
from hpop.planners.treatable import on_symbols
from hpop.symbols import lift
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
CONTROLS = ("left", "right")
NODES = ("x", "y", "yaw", "speed", "turn_rate")


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


@dataclass(frozen=True)
class Forward(Drive):
    """The law inside the program, where no speed changes its sign: without the kinks of absolute values.

    sign  (M,) of the yaw rate in each interval
    """

    sign: Column = 1.0

    nodes = gauss(4)  # errs by 1e-6 for turns of a radian in an interval

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        if name not in ("x", "y"):
            return super().interpolate(name, start, end, share)
        # The cubic with the ends' places and velocities: within 0.1 mm for turns of half a radian in half a metre.
        way, span = np.cos if name == "x" else np.sin, getattr(end, name) - getattr(start, name)
        first, last = ((end.clock - start.clock) * at.speed * way(at.yaw) for at in (start, end))
        bend = share * (1.0 - share) * ((1.0 - share) * (first - span) - share * (last - span))
        return getattr(start, name) + span * share + bend

    def travel(self, start: States, end: States, lever: float) -> Column:
        length = 0.5 * (end.clock - start.clock) * (start.speed + end.speed)
        return length + lever * self.swept(start, end) if lever else length

    def swept(self, start: States, end: States) -> Column:
        return self.sign * self.turned(start, end)

    def bends(self, start: States, end: States) -> tuple[Column, Column]:
        turned = self.turned(start, end)
        return turned, 0.0 * turned


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
    def _built(self) -> tuple[Any, Any, tuple[int, ...]]:
        """What makes a solver, the function from variables to costs, and the numbers of constraints of each sort."""
        import casadi

        n, phases, k = len(self.structure.phase), len(self.structure.counts), len(self.criteria)
        model = self.problem.model
        nodes = {name: casadi.MX.sym(name, n + 1) for name in NODES}
        wheels = {name: casadi.MX.sym(name, n) for name in CONTROLS}
        h, slack = casadi.MX.sym("h", n), casadi.MX.sym("slack", len(self._worst))
        weights, scale = casadi.MX.sym("weights", k), casadi.MX.sym("scale", k)
        signs, usual = casadi.MX.sym("signs", phases), casadi.MX.sym("usual")
        each = casadi.sparsify(casadi.DM(np.eye(phases)[self.structure.phase]))  # from phases to intervals
        law = Forward(sign=lift(each @ signs, n))
        start = States(**{m: lift(v[:-1], n) for m, v in nodes.items()}, clock=lift(casadi.MX.zeros(n), n))
        end = States(**{m: lift(v[1:], n) for m, v in nodes.items()}, clock=lift(h, n))
        motions = Motions(SparseWorld.of(self.problem.world), model, law, start, end, panels=2)

        half = 0.5 * model.wheel_base
        gain, bend = 0.5 * (wheels["left"] + wheels["right"]), (wheels["right"] - wheels["left"]) / model.wheel_base
        dynamics = [
            nodes["speed"][1:] - nodes["speed"][:-1] - h * gain,
            nodes["turn_rate"][1:] - nodes["turn_rate"][:-1] - h * bend,
            *(mx(law.defect(name, start, end), n) for name in ("x", "y", "yaw")),
        ]
        inner = slice(1, n)
        speeds = [nodes["speed"][inner] + side * half * nodes["turn_rate"][inner] for side in (-1.0, 1.0)]
        ends = np.cumsum(self.structure.counts)
        turned = [
            signs[p] * (nodes["yaw"][int(ends[p])] - nodes["yaw"][int(ends[p]) - self.structure.counts[p]])
            for p in np.flatnonzero(self.structure.turning).tolist()
        ]

        costs, above = [], []
        for j, criterion in enumerate(self.criteria):
            if criterion.aggregate == "max":
                costs.append(slack[self._worst.index(j)])
                values = casadi.vertcat(*(on_symbols(criterion, m) for m in moments(motions)))
                above.append((values - costs[-1]) / scale[j])
            else:
                costs.append(casadi.sum1(on_symbols(criterion, motions)))
        every = casadi.vertcat(*costs)
        honest = casadi.vertcat(*costs)
        for j, row in zip(self._worst, above, strict=True):  # a slack may lie above the worst sample
            honest[j] = casadi.mmax(row * scale[j] + costs[j])

        owner, share = self.samples
        size, rows = len(owner), owner.tolist()
        first, last = (
            States(**{name: lift(casadi.MX(getattr(s, name))[rows], size) for name in s.names}) for s in (start, end)
        )
        at = [law.interpolate(axis, first, last, share) for axis in ("x", "y")]
        clear = [mx(motions.world.clearance_field(z=z)(*at), size) for z, _ in self.spaces]

        effort = casadi.dot(h, gain**2 / model.acceleration**2 + bend**2 / model.turn_acceleration**2)
        objective = casadi.dot(weights, every / scale) + HASTE * casadi.sum1(h) / usual + EFFORT * effort / usual
        variables = casadi.vertcat(*nodes.values(), *wheels.values(), h, slack)
        parameters = casadi.vertcat(weights, scale, signs, usual)
        even = h[np.flatnonzero(np.diff(self.structure.phase) == 0).tolist()]
        after = h[(np.flatnonzero(np.diff(self.structure.phase) == 0) + 1).tolist()]
        groups = [
            casadi.vertcat(*group)
            for group in (
                [even - after],
                dynamics,
                [bend],
                speeds,
                turned,
                [costs[j] / scale[j] for j in self._summed],
                above,
                clear,
            )
        ]
        limits = casadi.vertcat(*groups)
        # Group by group: costs depend on all variables, and with them CasADi would take the whole for dense.
        slopes = casadi.vertcat(*(casadi.jacobian(group, variables) for group in groups))
        jacobian = casadi.Function("jac_g", [variables, parameters], [limits, slopes], ["x", "p"], ["g", "jac_g_x"])
        program = {"x": variables, "p": parameters, "f": objective, "g": limits}
        values = casadi.Function("values", [variables, parameters], [honest])

        def solver(**options: Any) -> Any:
            return casadi.nlpsol("driven", "ipopt", program, {**_OPTIONS, "jac_g": jacobian, **options})

        return solver, values, tuple(int(group.numel()) for group in groups)

    @cached_property
    def _newton(self) -> Any:
        """The solver with exact second derivatives."""
        return self._built[0]()

    @cached_property
    def _quasi_newton(self) -> Any:
        """The solver that learns second derivatives on the way: slower, but not misled by kinks of costs."""
        return self._built[0](**_QUASI_NEWTON)

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
        _, values, sizes = self._built
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
        parameters = np.concatenate([weights, scale, guess.signs, [guess.lasts.sum()]])
        if self._worst:
            tops = np.array(self._built[1](np.append(point, np.zeros(len(self._worst))), parameters)).ravel()
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
    "ipopt.tol": 1e-4,
    "ipopt.constr_viol_tol": 1e-7,
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
