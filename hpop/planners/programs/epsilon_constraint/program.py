"""The nonlinear program for any-angle polylines with a given number of segments.

Its variables are the inner vertices. The number of straight segments is fixed, and whether the robot turns at the start
and at the goal. Criteria are evaluated by their own ``cost``, on motions of CasADi symbols. Three choices follow from
measurements. The absolute turn angle is smoothed within 0.02 rad. A small penalty on ``Σ L_i²``, the squared lengths of
segments, keeps vertices from sliding along their line and from collapsing. A maximum is a slack variable that is at
least every sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.text import shown
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.errors import OptionError, UnsupportedCriterion
from hpop.motions.symbolic import lift
from hpop.planners.needs import in_plane, one_goal, reaches
from hpop.planners.programs import BUILDING, SOLVING, Deadline
from hpop.planners.programs.epsilon_constraint.descent import PolylineMotions, sparse
from hpop.planners.programs.nlp import SparseWorld, below_hinge, ipopt, moments, on_symbols, vector
from hpop.planners.programs.polyline import Polyline, PolylineStructure
from hpop.runtime.interrupts import interrupts_held
from hpop.runtime.limits import check
from hpop.world import World

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

BUILDS = 6e-6  # s per variable and per constraint, to build a CasADi solver
REGULAR = 0.15  # weight of n Σ (L_i / L)², which keeps vertices from sliding and collapsing
SPREAD = 1e-3  # weight of the bounded costs in the objective: AUGMECON's slack term
REGION = 1.0  # m: largest change of a coordinate from the warm start
KEEP = 0.3  # share of its length that a segment keeps in its old direction, so that it cannot collapse
SHORTEST = 1e-3  # m: least length of a segment that has to keep its direction
FIELD_MARGIN = 0.015  # m: clearance beyond the robot's reach, for the error between two samples
CHECKED = 0.03  # m: distance of the points at which a solution's clearance is checked
SUCCESS = ("Solve_Succeeded", "Solved_To_Acceptable_Level")


@dataclass(frozen=True, eq=False)
class Solution:
    """Solution that the solver found for a program.

    polyline    feasible for the program if ``converged``
    costs       (k,) as the program computes them, without the penalty on lengths
    converged   whether the solver reports convergence
    status      of the solver
    iterations  number of iterations of the solver
    """

    polyline: Polyline
    costs: FloatArray
    converged: bool
    status: str
    iterations: int


@dataclass(frozen=True, eq=False)
class PolylineProgram:
    """Program that minimises one criterion over the inner vertices, with bounds on the others and on the clearance.

    ``min f_p(x) + δ Σ_j f_j(x)  subject to  f_j(x) <= eps_j,  d(sample) >= bound``, with costs divided by their scales.
    With ``s_j = eps_j - f_j`` this is AUGMECON's ``f_p - δ Σ s_j`` (Mavrotas 2009), which returns no weakly efficient
    point. It is built once. Start, goal, bounds, scales and the warm start are parameters. It finds local optima only.

    problem    gives world and model; start and goal come with the warm start
    criteria   k smooth criteria: sums, or maxima over motions
    minimise   index of the minimised criterion
    structure  number of segments and of their pieces, and turns at both ends
    deadline   time at which a solver stops
    """

    problem: Problem
    criteria: tuple[Criterion, ...]
    minimise: int
    structure: PolylineStructure
    deadline: Deadline = Deadline()  # noqa: RUF009  (frozen)

    def __post_init__(self) -> None:
        for criterion in self.criteria:
            refuse_unsmooth(criterion)
        if not 0 <= self.minimise < len(self.criteria):
            raise OptionError(
                f"minimise must be an index from 0 to {len(self.criteria) - 1}, got {shown(self.minimise)}; pass the "
                "index of the criterion to minimise"
            )

    @cached_property
    def _world(self) -> World:
        return self.problem.world.stand_in(SparseWorld)

    # Which vertices are free

    @property
    def _along_first(self) -> bool:
        return not self.structure.first_turn

    @cached_property
    def _along_last(self) -> bool:
        return not self.structure.last_turn and one_goal(self.problem, "a polyline")[2] is not None

    @property
    def freedom(self) -> int:
        """Number of coordinates that the program may change; 0 if fixed headings determine the whole polyline."""
        n = self.structure.segments
        bound = self._along_first + self._along_last
        return 0 if n < 2 or (n == 2 and bound == 2) else 2 * (n - 1) - bound

    def _free(self, polyline: Polyline) -> FloatArray:
        """Return the values, m, of the program's variables for a polyline, as one array.

        First comes the length of the first segment if its heading is fixed, then that of the last one likewise, then
        x and y of each inner vertex that does not bound such a segment.
        """
        inner, lengths = polyline.vertices[1:-1], polyline.lengths
        first, last = int(self._along_first), int(self._along_last)
        fixed = [*lengths[:1][:first], *lengths[-1:][:last]]
        return np.concatenate([fixed, inner[first : len(inner) - last].ravel()])

    def _columns(self, free: Any, ends: Any) -> tuple[Any, Any]:
        """Return x and y (n+1,) of all vertices as symbols, given the free coordinates and both ends (6,)."""
        import casadi

        first, last = int(self._along_first), int(self._along_last)
        start, goal = ends[:3], ends[3:]
        inner = casadi.reshape(free[first + last :], 2, -1)
        out = []
        for axis, projection in ((0, casadi.cos), (1, casadi.sin)):
            parts = [start[axis]]
            if first:
                parts += [start[axis] + free[0] * projection(start[2])]
            parts += [inner[axis, :].T]
            if last:
                parts += [goal[axis] - free[first] * projection(goal[2])]
            out.append(casadi.vertcat(*parts, goal[axis]))
        return out[0], out[1]

    # The program

    @cached_property
    def spaces(self) -> tuple[tuple[tuple[float, float], float], ...]:
        """Height ranges (low, high) with different obstacles, m, each with the robot's largest radius there, m."""
        return reaches(in_plane(self.problem.model), self.problem.world)

    @cached_property
    def motions(self) -> PolylineMotions:
        """Motions along a polyline of this structure, on which criteria are evaluated."""
        return PolylineMotions(self.structure)

    @cached_property
    def _built(self) -> tuple[Any, Any, int, Any]:
        """The program built for CasADi: solver, function of values, number of sample constraints, and stop options.

        The function returns vertices (n+1, 2), costs (k,) and the maxima of each motion. A sample constraint keeps one
        sample of a maximum below its slack. The options stop the solver at the deadline.
        """
        import casadi

        k, n = len(self.criteria), self.structure.segments
        free = casadi.MX.sym("free", self.freedom)
        summed, worst = self._indices
        slack = casadi.MX.sym("slack", len(worst))
        ends, scale, weight = casadi.MX.sym("ends", 6), casadi.MX.sym("scale", k), casadi.MX.sym("weight")
        ahead, corrections = casadi.MX.sym("ahead", n, 2), casadi.MX.sym("corrections", self._motions, len(worst))
        x, y = self._columns(free, ends)
        batches = self.motions.symbols(self.problem, self._world, x, y, ends[[2, 5]])
        costs: list[Any] = [None] * k
        rows, tops, maxima = [], dict[int, Any](), list[Any]()
        for j, criterion in enumerate(self.criteria):
            check(BUILDING)
            if criterion.aggregate != "max":
                costs[j] = sum(casadi.sum1(on_symbols(criterion, batch)) for batch in batches)
                continue
            costs[j], row, largest, first = slack[worst.index(j)], [], [], 0
            for batch in batches:
                samples = [on_symbols(criterion, m) for m in moments(batch)]
                more = corrections[first : first + len(batch), worst.index(j)]
                row += [below_hinge(sample) + more for sample in samples]
                largest.append(reduce(casadi.fmax, samples))
                first += len(batch)
            maxima.append(casadi.vertcat(*largest))
            tops[j] = casadi.fmax(casadi.mmax(maxima[-1] + corrections[:, worst.index(j)]), 0)
            rows.append((casadi.vertcat(*row) - costs[j]) / scale[j])
        cost_column = casadi.vertcat(*costs)
        squares = casadi.sumsqr(x[1:] - x[:-1]) + casadi.sumsqr(y[1:] - y[:-1])
        scaled = cost_column / scale
        objective = scaled[self.minimise] + SPREAD * casadi.sum1(scaled) + weight * n * squares
        clearances = []
        for z, _ in self.spaces:
            at = [lift(casadi.DM(sparse(self.motions.sampled)) @ c, len(self.motions.sampled)) for c in (x, y)]
            clearances.append(vector(self._world.clearance_field(z=z)(*at), len(self.motions.sampled)))
        above = casadi.vertcat(*rows)
        advance = casadi.sum2(casadi.horzcat(x[1:] - x[:-1], y[1:] - y[:-1]) * ahead)
        variables = casadi.vertcat(free, slack)
        parameters = casadi.vertcat(ends, scale, weight, casadi.vec(ahead), casadi.vec(corrections))
        program = {
            "x": variables,
            "p": parameters,
            "f": objective,
            "g": casadi.vertcat(*(scaled[j] for j in summed), above, advance, *clearances),
        }
        size = program["x"].numel() * program["g"].numel()
        self.deadline.check(BUILDING, ahead=BUILDS * size)
        stopping = self.deadline.stopping(program["x"].numel(), program["g"].numel())
        solver = ipopt("polyline", program, _OPTIONS | stopping)
        honest = [tops.get(j, cost) for j, cost in enumerate(costs)]  # the maximum itself, which a slack may exceed
        outputs = [casadi.horzcat(x, y), casadi.vertcat(*honest), casadi.horzcat(*maxima)]
        values = casadi.Function("values", [variables, parameters], outputs)
        return solver, values, int(above.numel()), stopping

    def build(self) -> PolylineProgram:
        """Build the program now instead of at the first solve."""
        if self.freedom:
            _ = self._built
        return self

    @property
    def _indices(self) -> tuple[list[int], list[int]]:
        """Indices of the criteria that are sums, and of those that are maxima."""
        worst = [j for j, criterion in enumerate(self.criteria) if criterion.aggregate == "max"]
        return [j for j in range(len(self.criteria)) if j not in worst], worst

    @property
    def _motions(self) -> int:
        return len(self.motions.pieces.segment) + len(self.structure.turning)

    def _parameters(self, polyline: Polyline, scale: FloatArray, corrections: FloatArray | None) -> FloatArray:
        goal_yaw = 0.0 if polyline.goal_yaw is None else polyline.goal_yaw
        ends = [*polyline.vertices[0], polyline.start_yaw, *polyline.vertices[-1], goal_yaw]
        weight = REGULAR / max(float(polyline.lengths.sum()), SHORTEST) ** 2
        ahead = [*np.cos(polyline.headings), *np.sin(polyline.headings)]
        more = np.zeros((self._motions, len(self._indices[1]))) if corrections is None else corrections
        return np.array([*ends, *scale, weight, *ahead, *more.T.ravel()])

    def _values(self, polyline: Polyline, corrections: FloatArray | None) -> list[FloatArray]:
        point = np.concatenate([self._free(polyline), np.zeros(len(self._indices[1]))])
        parameters = self._parameters(polyline, np.ones(len(self.criteria)), corrections)
        with interrupts_held():
            values = [np.array(value) for value in self._built[1](point, parameters)]
        self.deadline.check(SOLVING)  # after the deadline, fields read as NaN
        return values

    def costs(self, polyline: Polyline, corrections: FloatArray | None = None) -> FloatArray:
        """Return the costs (k,) of a polyline as the program computes them; NaN if no coordinate is free.

        The ``corrections`` of :meth:`corrections` are added to the costs of motions in criteria that are maxima.
        """
        if not self.freedom:
            return np.full(len(self.criteria), np.nan)
        return self._values(polyline, corrections)[1].ravel()

    def corrections(self, polyline: Polyline) -> FloatArray | None:
        """Return the errors of the program: a row for each motion, a column for each criterion that is a maximum.

        An error is the exact value of the motion minus the program's value. Fields are off by a tenth of a cell or more
        midway between two obstacles, where optima of the clearance lie, and by far less elsewhere. So each motion has
        its own correction. The result is None if there is no such criterion or no free coordinate.
        """
        worst = self._indices[1]
        if not self.freedom or not worst:
            return None
        batches = self.motions.of(self.problem, polyline)
        exact = [np.concatenate([motion_costs(self.criteria[j], m) for m in batches]) for j in worst]
        return np.stack(exact, axis=1) - self._values(polyline, None)[2]

    def bounds(self, polyline: Polyline) -> list[FloatArray]:
        """Return clearance bounds: the least values of the distance field at the S samples that avoid collisions.

        There is an array (S,), m, for each height range. A bound is the robot's reach and a margin, but at most the
        exact distance and the field's value at the warm start ``polyline``, so that the warm start is feasible.
        """
        x, y = (self.motions.sampled @ polyline.vertices).T
        world, bounds = self.problem.world, []
        for z, reach in self.spaces:
            exact, field = world.free_space(z).signed_clearance(x, y), world.clearance_field(z=z)(x, y)
            need = np.minimum(reach + FIELD_MARGIN, exact)
            bounds.append(np.minimum(need, field))
        return bounds

    def raised(self, bounds: Sequence[FloatArray], polyline: Polyline) -> list[FloatArray]:
        """Raise clearance bounds where a solution comes too near to an obstacle, and return them.

        Exact distances are computed at points along the solution. At the two samples nearest to a point that is too
        near, the bound rises by the missing distance and a small margin.
        """
        segments = np.repeat(np.arange(self.structure.segments), np.ceil(polyline.lengths / CHECKED).astype(int) + 1)
        first = np.searchsorted(segments, segments)
        count = np.bincount(segments)[segments]
        share = ((np.arange(segments.size) - first) / np.maximum(count - 1, 1))[:, None]
        points = polyline.vertices[segments] * (1.0 - share) + polyline.vertices[segments + 1] * share
        samples = self.motions.sampled @ polyline.vertices
        from scipy.spatial import cKDTree

        nearest = cKDTree(samples).query(points, k=min(2, len(samples)))[1].reshape(len(points), -1)
        out = []
        for (z, reach), bound in zip(self.spaces, bounds, strict=True):
            lacking = reach - self.problem.world.free_space(z).signed_clearance(*points.T)
            more = np.zeros(bound.size)
            for column in nearest.T:
                np.maximum.at(more, column, np.where(lacking > -0.2 * FIELD_MARGIN, lacking + 0.5 * FIELD_MARGIN, 0.0))
            field = self.problem.world.clearance_field(z=z)(*samples.T)
            out.append(np.where(more > 0, np.maximum(bound, field) + more, bound))
        return out

    def solve(
        self,
        warm: Polyline,
        epsilon: FloatArray,
        *,
        scale: FloatArray | None = None,
        bounds: Sequence[FloatArray] | None = None,
        corrections: FloatArray | None = None,
    ) -> Solution:
        """Solve the program from a warm start, which should be feasible; no coordinate changes by more than REGION.

        Parameters
        ----------
        warm : polyline of this structure
        epsilon : (k,) upper bounds of the costs; inf for none
        scale : (k,) positive: each cost is divided by its scale; by default ``epsilon``, or 1 where that is inf or 0
        bounds : clearance bounds, see :meth:`bounds`, which are the default
        corrections : corrections of the maxima, see :meth:`corrections`; none by default
        """
        epsilon = np.asarray(epsilon, float)
        if scale is None:
            scale = np.where(np.isfinite(epsilon) & (epsilon > 0), epsilon, 1.0)
        if not self.freedom:
            return Solution(warm, self.costs(warm), True, "nothing is free", 0)
        solver, values, above, stopping = self._built
        summed, worst = self._indices
        parameters = self._parameters(warm, scale, corrections)
        bounded = np.concatenate(self.bounds(warm) if bounds is None else list(bounds))
        free = self._free(warm)
        fixed = int(self._along_first) + int(self._along_last)
        x_min, y_min, x_max, y_max = self.problem.world.bounds
        corners = (free.size - fixed) // 2
        least = [*[SHORTEST] * fixed, *[x_min, y_min] * corners]
        most = [*[np.inf] * fixed, *[x_max, y_max] * corners]
        tops = self.costs(warm, corrections)[worst]
        floor = np.minimum(epsilon[worst], 0.0)  # costs are not negative: a slack below 0 would lower the objective
        most_g = [
            epsilon[summed] / scale[summed],
            np.zeros(above),
            np.full(warm.lengths.size + bounded.size, np.inf),
        ]
        for stop in stopping.values():
            stop.begin()
        with interrupts_held():
            result = solver(
                x0=np.concatenate([free, tops]),
                p=parameters,
                lbx=np.concatenate([np.maximum(least, free - REGION), floor]),
                ubx=np.concatenate([np.minimum(most, free + REGION), epsilon[worst]]),
                lbg=np.concatenate([np.full(len(summed) + above, -np.inf), KEEP * warm.lengths, bounded]),
                ubg=np.concatenate(most_g),
            )
        stats = solver.stats()
        self.deadline.check_solver(str(stats["return_status"]))
        with interrupts_held():
            vertices, costs, _ = (np.array(value) for value in values(result["x"], parameters))
        vertices[0], vertices[-1] = warm.vertices[0], warm.vertices[-1]
        return Solution(
            Polyline(vertices, warm.start_yaw, warm.goal_yaw),
            costs.ravel(),
            stats["return_status"] in SUCCESS,
            str(stats["return_status"]),
            int(stats["iter_count"]),
        )


_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "show_eval_warnings": False,  # after the deadline, fields read as NaN
    "ipopt.print_level": 0,
    "ipopt.option_file_name": "",  # else IPOPT reads a file in the current folder, which may load a library
    "ipopt.mu_init": 0.01,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 150,
    "ipopt.tol": 1e-4,
    "ipopt.constr_viol_tol": 1e-6,
}


def refuse_unsmooth(criterion: Criterion) -> None:
    """Raise UnsupportedCriterion unless a criterion has a gradient and is a sum or a maximum over motions."""
    if criterion.smooth and criterion.aggregate in ("sum", "max"):
        return
    why = "has no gradient (smooth=False)" if not criterion.smooth else f"is a {criterion.aggregate}"
    raise UnsupportedCriterion(
        f"the program for polylines needs smooth criteria that are sums or maxima; {criterion.name!r} {why}. Compute "
        "it for the result only, or use planner 'lattice'."
    )
