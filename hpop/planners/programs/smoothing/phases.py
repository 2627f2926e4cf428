"""Setup of a smoothing program: its phases, an initial guess, targets of costs, options of its solver; and solutions.

A phase is a part of the trajectory in which the robot drives straight or turns. It has several intervals, between
neighbouring nodes, and all of its intervals last equally long.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.math import wrap
from hpop.planners.programs.polyline import Polyline
from hpop.trajectories.trajectory import STRAIGHT, Trajectory

if TYPE_CHECKING:
    from hpop.motions import Wheeled

LEAST_IN = {True: 4, False: 3}  # least number of intervals of a turn, and of straight driving


@dataclass(frozen=True)
class Phases:
    """Sequence of straight and turning phases of a trajectory, and their intervals; a program keeps it fixed.

    turns      number of turns
    leading    whether the robot drives straight before the first turn
    trailing   whether it drives straight after the last turn
    intervals  least number of intervals n in all; more if the phases need them
    """

    turns: int
    leading: bool
    trailing: bool
    intervals: int

    @cached_property
    def turning(self) -> tuple[bool, ...]:
        """Kind of each phase in order: True for a turn, False for straight driving."""
        phases = [False, True] * self.turns
        phases = phases[0 if self.leading else 1 :] + [False] * self.trailing
        return tuple(phases) if self.turns else (False,)

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of intervals of each phase: the least that it needs, and an even share of the remaining ones."""
        counts = [LEAST_IN[turns] for turns in self.turning]
        left = max(0, self.intervals - sum(counts))
        more, remainder = divmod(left, len(counts))
        return tuple(count + more + (i < remainder) for i, count in enumerate(counts))

    @cached_property
    def phase(self) -> IntArray:
        """Index (n,) of the phase to which each interval belongs."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @cached_property
    def variable_indices(self) -> tuple[IntArray, IntArray]:
        """Indices, in the program's vector, of the values at nodes (5, n+1), and of the durations (n,) of intervals.

        All nodes of a straight phase share one yaw, and all intervals of a phase share one duration.
        """
        each = np.arange(n := len(self.phase) + 1)
        yaw = np.searchsorted(self.turning_intervals, each)
        of_nodes = np.cumsum([0, n, n, yaw[-1] + 1, n])[:, None] + [each, each, yaw, each, each]
        return of_nodes, of_nodes[-1, -1] + 1 + self.phase

    @cached_property
    def turning_intervals(self) -> IntArray:
        """Indices of the intervals in turning phases."""
        return np.flatnonzero(np.array(self.turning)[self.phase])

    @cached_property
    def straight_nodes(self) -> IntArray:
        """Indices of the nodes at which the yaw rate is zero: those of straight phases, and both ends."""
        straight = np.setdiff1d(np.arange(len(self.phase)), self.turning_intervals)
        return np.unique(np.concatenate([straight, straight + 1, [0, len(self.phase)]]))

    @cached_property
    def turning_nodes(self) -> IntArray:
        """Indices of the nodes inside turning phases."""
        return np.setdiff1d(np.arange(len(self.phase) + 1), self.straight_nodes)


@dataclass(frozen=True, eq=False)
class Guess:
    """Initial values for a program of P phases and n intervals, with the directions of its turns.

    nodes     (5, n+1)  x, y, yaw, speed and turn rate at the nodes between intervals
    lasts     (P,)      s, duration of each phase
    signs     (P,)      1 for a turn to the left, -1 for one to the right, 0 for straight driving
    goal_yaw  whether the goal fixes the heading at the end
    """

    nodes: FloatArray
    lasts: FloatArray
    signs: FloatArray
    goal_yaw: bool


CORNER = 0.35  # m: largest distance of the ends of a turn from its vertex
SHARE = 0.4  # largest share of a segment that the turn at one of its ends takes
CRUISE = 0.8  # share of the robot's top speed that it has on straight phases, on average
AROUND = 0.5  # share of its top speed and turn rate that it has in turns


def rotations(polyline: Polyline) -> FloatArray:
    """Return the signed angle (n+1,), rad, by which the robot turns at each vertex, start and goal included."""
    headings = polyline.headings
    last = headings[-1] if polyline.goal_yaw is None else polyline.goal_yaw
    return np.asarray(wrap(np.diff([polyline.start_yaw, *headings, last])), dtype=np.float64)


def structure_of(polyline: Polyline, intervals: int) -> Phases:
    """Return the phases for a polyline: a turn at each vertex with an angle, and straight driving between them.

    Turns in place at the start and at the goal count as well. ``intervals`` is the least number of intervals.
    """
    turns = np.abs(rotations(polyline)) > STRAIGHT
    return Phases(int(turns.sum()), not turns[0], not turns[-1], intervals)


def phase_legs(polyline: Polyline) -> tuple[FloatArray, FloatArray]:
    """Cut a polyline into its P phases; return begin, middle and end (P, 3, 2), m, of each, and its angle (P,), rad.

    The middle of a turn is the vertex; it begins and ends at most CORNER before and after that.
    """
    corners, turned = polyline.vertices, rotations(polyline)
    directions = np.diff(corners, axis=0) / polyline.lengths[:, None]
    cuts = np.minimum(CORNER, SHARE * polyline.lengths)[:, None] * directions
    leave, reach = corners[:-1] + cuts, corners[1:] - cuts  # (n, 2) where each segment is straight
    if abs(turned[0]) <= STRAIGHT:
        leave[0] = corners[0]
    if abs(turned[-1]) <= STRAIGHT:
        reach[-1] = corners[-1]
    legs, angles = [], []
    for i, angle in enumerate(turned):
        if abs(angle) > STRAIGHT:
            before, after = (reach[i - 1] if i else corners[0]), (leave[i] if i < len(leave) else corners[-1])
            legs.append((before, corners[i], after))
            angles.append(angle)
        if i < len(leave):
            legs.append((leave[i], 0.5 * (leave[i] + reach[i]), reach[i]))
            angles.append(0.0)
    return np.array(legs), np.array(angles)


def first_guess(polyline: Polyline, structure: Phases, model: Wheeled) -> Guess:
    """Return an initial guess that follows a polyline, with its corners cut by parabolas, at moderate speeds.

    structure  phases of the polyline, of :func:`structure_of`
    """
    legs, angles = phase_legs(polyline)
    yaw, columns, lasts = polyline.start_yaw, [], []
    for (begin, middle, end), angle, count in zip(legs, angles, structure.counts, strict=True):
        span = np.hypot(*(middle - begin)) + np.hypot(*(end - middle))
        share = AROUND if angle else CRUISE
        seconds = max(span / (share * model.speed), abs(angle) / (AROUND * model.turn_rate), 0.1)
        s = np.linspace(0.0, 1.0, count + 1)
        positions = np.outer((1 - s) ** 2, begin) + np.outer(2 * s * (1 - s), middle) + np.outer(s * s, end)
        heading, rate = yaw + angle * s * s * (3 - 2 * s), 6 * s * (1 - s) * angle / seconds
        columns.append(np.stack([*positions.T, heading, np.full(count + 1, span / seconds), rate]))
        lasts.append(seconds)
        yaw += angle
    nodes = np.concatenate([columns[0], *(column[:, 1:] for column in columns[1:])], axis=1)
    nodes[3, [0, -1]] = 0.0
    nodes[4] = np.clip(nodes[4], -model.turn_rate, model.turn_rate)
    return Guess(nodes, np.array(lasts), np.sign(angles), polyline.goal_yaw is not None)


FLAT = "Solved_To_Acceptable_Level"  # IPOPT's status if it stopped because the objective hardly fell any more
SUCCESS = ("Solve_Succeeded", FLAT)

OPTIONS: dict[str, Any] = {
    "print_time": False,
    "show_eval_warnings": False,  # after the deadline, fields read as NaN
    "ipopt.print_level": 0,
    "ipopt.option_file_name": "",  # else IPOPT reads a file in the current folder, which may load a library
    "ipopt.sb": "yes",
    "ipopt.mu_init": 0.01,
    "ipopt.barrier_tol_factor": 100.0,  # intermediate barrier problems need no accurate solution
    "ipopt.max_iter": 150,
    "ipopt.mu_target": 3e-5,  # saves a tenth of the time, for a thousandth of the cost
    "ipopt.tol": 3e-4,
    "ipopt.constr_viol_tol": 1e-3,  # `made_feasible` removes the remaining violation
    # also ends where the objective falls by no more than this in five steps: in a flat valley, or at a kink
    "ipopt.acceptable_obj_change_tol": 1e-4,
    "ipopt.acceptable_iter": 5,
    "ipopt.acceptable_tol": 1e-2,
    "ipopt.acceptable_constr_viol_tol": 1e-3,
    "no_nlp_grad": True,  # the sensitivity to parameters is not needed
    "calc_lam_p": False,
}

REFINING: dict[str, Any] = {
    **{
        f"ipopt.warm_start_{option}": 1e-6
        for option in ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
    },
    "ipopt.warm_start_mult_bound_push": 1e-6,
    "ipopt.warm_start_init_point": "yes",
    "ipopt.mu_init": 1e-5,
    "ipopt.mu_target": 0.0,
    "ipopt.max_iter": 100,
    "ipopt.tol": 1e-4,
    "ipopt.constr_viol_tol": 1e-5,
    "ipopt.acceptable_obj_change_tol": 1e-5,
    "ipopt.acceptable_iter": 4,
    "ipopt.acceptable_tol": 1e-1,
}

QUASI_NEWTON: dict[str, Any] = {
    "ipopt.hessian_approximation": "limited-memory",
    "ipopt.max_iter": 300,
    "ipopt.tol": 1e-3,
    "ipopt.acceptable_obj_change_tol": 1e-3,
}

SOLVER_OPTIONS: dict[str, dict[str, Any]] = {
    "exact": {},  # exact second derivatives
    "quasi-newton": QUASI_NEWTON,  # estimated second derivatives: slower, but not misled by kinks of costs
    "refined": REFINING,  # starts from a solution, more accurate
}


@dataclass(frozen=True, eq=False)
class ProgramSolution:
    """Solution that the solver found for a program.

    point       values of the program's variables
    rates       multipliers of the variables' bounds, and of the constraints
    trajectory  trajectory that ``point`` describes, within the program's limits; None if the solver did not converge,
                or the limits could not be kept
    costs       (k,) as the program computes them
    status      of the solver, or Limits_Not_Kept if its point could not be made feasible
    iterations  number of iterations of the solver
    """

    point: FloatArray
    rates: tuple[FloatArray, FloatArray]
    trajectory: Trajectory | None
    costs: FloatArray
    status: str
    iterations: int

    @property
    def curve(self) -> Trajectory:
        """Trajectory of the solution; there must be one."""
        assert self.trajectory is not None
        return self.trajectory


@dataclass(frozen=True, eq=False)
class CostTargets:
    """Weights, bounds and scales of the k costs of a program.

    weights  (k,) of the scaled costs in the objective
    epsilon  (k,) upper bounds of the costs; inf for none
    scale    (k,) positive: each cost is divided by its scale
    """

    weights: FloatArray
    epsilon: FloatArray
    scale: FloatArray
