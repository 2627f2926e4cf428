"""The planner weighted-sum-corridor: convex programs for polylines through corridors of convex free regions."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from hpop.base.text import set_python_values
from hpop.criteria.base import Criterion
from hpop.criteria.costs import trajectory_costs
from hpop.errors import UnsupportedCriterion
from hpop.planners.base import Candidates, planner
from hpop.planners.graph_planners import Weights, check_count, checked_weights
from hpop.planners.judgement import trusted
from hpop.planners.needs import in_plane
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.programs import Deadline
from hpop.planners.programs.corridor.corridor import Corridor, corridors
from hpop.planners.programs.corridor.program import solvers_from
from hpop.planners.programs.corridor.weights import SMALL, CorridorPoints, Shared, solve_corridor
from hpop.planners.programs.nlp import is_counted
from hpop.planners.programs.warm_starts import WarmStart, WarmStarts, check_warm_start, warm_starts
from hpop.runtime.limits import Budget, LimitPassed, ProgressCallback, Status, Watch
from hpop.runtime.sweep import Sweep
from hpop.search.supported import checked_divisions, simplex_lattice

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

NAME = "weighted-sum-corridor"
SOLVER = "CLARABEL"
LOADS = 1.0  # s that loading cvxpy takes
DIVISIONS = 6  # default number of divisions for more than two costs


@planner(NAME)
@dataclass(frozen=True)
class WeightedSumCorridor:
    """Planner of polylines with the least weighted sum of convex costs, in corridors of convex free regions.

    step        m  distance between positions of the lattice that gives the warm starts
    headings    number of headings of that lattice: 4, 8 or 16
    divisions   makes the vectors of weights: all those of multiples of 1 / divisions that add up to 1; default
                6 for more than two convex costs; for two, weights are added where the front has a gap
    weights     vectors of weights, each with one number for each convex cost, in the order of the criteria; instead of
                divisions
    solver      cvxpy's name of the solver; if it fails, other installed solvers are tried
    warm_start  source of the warm starts: a planner's name, ``{name: {option: value}}``, a front, or trajectories
    time_limit  s  for everything, warm starts included

    Around each segment of each warm start, a convex region is grown in which the robot is free of collisions. The
    sequence of regions is a corridor; warm starts through the same regions share it. A polyline in the corridor has a
    vertex in each overlap of neighbouring regions, so all of it is free of collisions. A convex program finds the
    polyline with the least weighted sum. Costs are normalised with the corridor's optima of single costs: the least of
    each cost is 0, the greatest 1. Without ``divisions`` or ``weights``, vectors of weights of two convex costs are
    added where the front has a gap, until no gap exceeds 1 %; more costs get six divisions. 1e-4 is added to every
    weight, so that a zero weight still breaks ties.

    Accepts criteria that declare a convex form (:mod:`hpop.criteria.base`), and counts of moves and turns; others are
    refused by name. Guarantees that each candidate is the optimum for its weights in its corridor, to the solver's
    tolerance: a supported point of the corridor's convex problem. If the convex form is an upper bound of the cost
    (distances to obstacles), the bound is optimised; reported costs are exact. Other corridors may have better points.
    Cost: one compilation per corridor, 20 to 100 ms, and 3 to 10 ms per vector of weights.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move", "rigid"})

    step: float = 0.25
    headings: int = 8
    divisions: int | None = None
    weights: Weights | None = None
    solver: str = SOLVER
    warm_start: WarmStart = "lattice"
    time_limit: float | None = None

    def __post_init__(self) -> None:
        set_python_values(self)
        Budget(self.time_limit)
        check_warm_start(self)
        if not (isinstance(self.solver, str) and self.solver == SOLVER):
            solvers_from(self.solver)
        object.__setattr__(self, "weights", checked_weights(self.divisions, self.weights))

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Plan warm starts, then solve the convex program of each corridor; each corridor is one job for the executor.

        Raises UnsupportedCriterion for a criterion that is neither convex nor a count of moves and turns, OptionError
        if the solver is not installed or a vector of weights does not have one number for each convex cost, and the
        errors of the planner of the warm starts.
        """
        watch = Watch("corridors", self.time_limit, progress)
        objectives = edge_objectives(problem.criteria, NAME)
        run = _CorridorRun(problem, objectives, self, _convex(objectives, problem))
        warm = warm_starts(self, problem, progress, executor, watch.left)
        if warm.interrupted is not None:
            return warm.interrupted
        run.notes += warm.notes
        deadline = Deadline.after(watch.left)
        run.grow_corridors(warm, deadline)
        count = len(run.corridors)

        def report(done: Mapping[int, CorridorPoints]) -> None:
            watch.report(len(done), count - len(done), sum(len(points.polylines) for points in done.values()))

        status, notes = Status.TIME_LIMIT, list[str]()
        with suppress(LimitPassed), Sweep(solve_corridor, run.shared(deadline), executor) as sweep:
            notes = sweep.notes
            run.points, status = sweep.until(run.corridors, watch.is_late, report)
        cut_short = sum(points.is_cut_short for points in run.points.values())
        if status is Status.COMPLETE and (cut_short or run.left):
            status = Status.TIME_LIMIT
        for number, omission in (
            (run.left, "warm starts got no corridor"),
            (count - len(run.points), f"of {count} corridors were not tried"),
            (cut_short, f"of {count} corridors were not solved for all weights"),
        ):
            if number:
                run.notes.append(f"{status}: {number} {omission}")
        run.notes += notes
        candidates = run.candidates(warm.ended(status))
        improved = {i for c, points in run.points.items() if points.polylines for i in run.corridors[c].warm_starts}
        stats = {**candidates.stats, "seconds": watch.seconds}
        return run.warm.with_unimproved(replace(candidates, stats=stats), improved)


def _convex(objectives: Objectives, problem: Problem) -> list[int]:
    """Return the indices of the criteria with a convex form.

    Raises UnsupportedCriterion if there is none, or if another criterion does not just count moves and turns.
    """
    indices = []
    for j, criterion in enumerate(objectives.optimised):
        if criterion.convex is not None:
            indices.append(j)
        elif criterion.smooth or not is_counted(criterion, problem):
            instead = "epsilon-constraint" if criterion.smooth else "lattice"
            raise UnsupportedCriterion(
                f"{NAME} needs criteria that declare a convex form, or that only count moves and "
                f"turns; {criterion.name!r} is not declared convex. Leave it out, or use planner {instead!r}."
            )
    if not indices:
        names = ", ".join(criterion.name for criterion in objectives.optimised)
        raise UnsupportedCriterion(
            f"{NAME} needs a convex criterion to minimise, got only counts of moves and turns: {names}. Add a convex "
            "one, such as 'length'."
        )
    return indices


@dataclass(eq=False)
class _CorridorRun:
    """One run of the planner: its warm starts, corridors, and the optima found in each corridor.

    convex   indices of the convex criteria
    left     number of warm starts for which no corridor was grown before the deadline
    points   optima of each corridor, by its index
    notes    lines for the user
    """

    problem: Problem
    objectives: Objectives
    options: WeightedSumCorridor
    convex: list[int]
    warm: WarmStarts = field(default_factory=lambda: WarmStarts((), Status.COMPLETE, ()))
    left: int = 0
    corridors: list[Corridor] = field(default_factory=list)
    points: dict[int, CorridorPoints] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def criteria(self) -> tuple[Criterion, ...]:
        return self.objectives.optimised

    def __post_init__(self) -> None:
        _ = self.weights  # checks their number before anything is planned

    def shared(self, deadline: Deadline) -> Shared:
        """Return the data that all workers need; raises LimitPassed if there is not enough time left to load cvxpy."""
        if "cvxpy" not in sys.modules:
            deadline.check("cvxpy was loaded", ahead=LOADS)
        criteria = tuple(self.criteria[j] for j in self.convex)
        solvers = solvers_from(self.options.solver)
        return Shared(self.problem.world, in_plane(self.problem.model), criteria, self.weights, solvers, deadline)

    @cached_property
    def weights(self) -> Weights | None:
        """Vectors of weights, with one number for each convex cost; None to choose weights by dichotomy.

        They are used in addition to each cost alone; without the option ``weights``, one cost needs none: ().

        Raises OptionError if a vector in the option ``weights`` has another length.
        """
        k = len(self.convex)
        if self.options.weights is not None:
            check_count(self.options.weights, [self.criteria[j] for j in self.convex])
            return self.options.weights
        divisions = self.options.divisions
        if k == 1:
            return ()
        if divisions is None and k == 2:
            return None
        divisions = DIVISIONS if divisions is None else divisions
        divisions = checked_divisions(divisions, k)
        return tuple(tuple(float(w) for w in row) for row in simplex_lattice(divisions, k))

    def grow_corridors(self, warm: WarmStarts, deadline: Deadline) -> None:
        """Fill ``corridors``: drop the warm starts that collide, then grow a corridor around each other one.

        Warm starts through the same regions share a corridor. ``left`` counts those not reached before the deadline.
        Notes count warm starts that were dropped, and those that touch an obstacle.
        """
        self.warm, free, _, dropped = warm.polylines(self.problem, self.criteria)
        self.corridors, refused = corridors(free, self.problem, deadline)
        self.left = len(free) - refused - sum(len(corridor.warm_starts) for corridor in self.corridors)
        self.notes += dropped
        if refused:
            self.notes.append(
                f"{refused} of {len(free)} warm starts touch an obstacle, so no free region could be grown around them"
            )

    def candidates(self, status: Status) -> Candidates:
        """Return the optima found so far (`points`, several in a corridor), without those that the final check rejects.

        The check is :func:`hpop.planners.judgement.judge`: collisions, costs and bounds. Notes name solvers that failed
        and the number of rejected optima.
        """
        rows = [(c, points, i) for c, points in self.points.items() for i in range(len(points.polylines))]
        trajectories = tuple(points.polylines[i].trajectory(self.problem.model) for _, points, i in rows)
        planned = np.zeros((len(rows), len(self.criteria)))
        counted = [j for j in range(len(self.criteria)) if j not in self.convex]
        counts = [self.criteria[j] for j in counted]
        planned[:, counted] = trajectory_costs(counts, trajectories, self.problem.world)
        planned[:, self.convex] = np.array([points.costs[i] for _, points, i in rows]).reshape(-1, len(self.convex))
        exact = [all(points.exact[j] for points in self.points.values()) for j in range(len(self.convex))]
        tolerance = np.tile([c.quantum for c in self.criteria], (len(rows), 1))
        above = np.full(planned.shape, np.inf)
        for j in (j for j, is_exact in zip(self.convex, exact, strict=True) if not is_exact):
            tolerance[:, j] += planned[:, j]  # the cost lies between 0 and its upper bound
            above[:, j] = planned[:, j]
        candidates = Candidates(
            objectives=self.criteria,
            trajectories=trajectories,
            planned=planned,
            tolerance=tolerance,
            status=status,
            certificate=self._claim(exact),
            provenance=tuple(self._provenance(*row) for row in rows),
            notes=(*self.objectives.notes, *self.notes, *self._faults()),
            filters=self.objectives.filters,
            stats=self._stats(),
        )
        return trusted(candidates, self.problem, NAME, epsilon=above)

    def _claim(self, exact: list[bool]) -> str:
        """Return the certificate: a sentence that says of which problems the candidates are optima."""
        names = [self.criteria[j].name for j in self.convex]
        bounded = [name for name, is_exact in zip(names, exact, strict=True) if not is_exact]
        bound = f", {', '.join(bounded)} represented by an upper bound" if bounded else ""
        part = "" if len(self.points) == len(self.corridors) else f" (of {len(self.corridors)})"
        return (
            f"{NAME}: supported points, to solver tolerance, of the convex problems in ({', '.join(names)}){bound} "
            f"through {len(self.points)} corridors{part} round the warm starts, not across corridors"
            f"{self.objectives.certificate}"
        )

    def _provenance(self, corridor: int, points: CorridorPoints, i: int) -> dict[str, Any]:
        return {
            "planner": NAME,
            "corridor": corridor,
            "warm_starts": list(self.corridors[corridor].warm_starts),
            "segments": len(points.polylines[i].lengths),
            "criteria": [self.criteria[j].name for j in self.convex],
            "weights": [list(row) for row in points.weights[i]],
        }

    def _faults(self) -> list[str]:
        """Return notes on solvers that failed, and on programs that no solver solved."""
        failed, solved = self._sum("failed"), self._sum("solved")
        by_others = {name: count for name, count in solved.items() if name != self.options.solver}
        notes = []
        if failed:
            why = ", ".join(f"{reason} ({count} times)" for reason, count in sorted(failed.items()))
            instead = ", ".join(f"{name} solved {count}" for name, count in sorted(by_others.items()))
            notes.append(f"a solver failed: {why}; {instead or 'no other solver succeeded'}")
        unsolved = sum(points.unsolved for points in self.points.values())
        if unsolved:
            notes.append(f"{unsolved} convex programs were solved by none of the installed solvers")
        return notes

    def _sum(self, name: str) -> Counter[str]:
        return sum((getattr(points, name) for points in self.points.values()), Counter())

    def _stats(self) -> dict[str, Any]:
        solved = self._sum("solved")
        points_by_corridor = list(self.points.values())
        seconds = sum(points.solve_seconds for points in points_by_corridor)
        return {
            "planner": NAME,
            "warm_starts": len(self.warm.trajectories),
            "corridors": len(self.corridors),
            "regions": len({id(region) for corridor in self.corridors for region in corridor.regions}),
            "unsafe_regions": len({id(r) for corridor in self.corridors for r in corridor.regions if not r.safe}),
            "convex": [self.criteria[j].name for j in self.convex],
            "ideal": [points.ideal.tolist() for points in points_by_corridor],
            "nadir": [points.nadir.tolist() for points in points_by_corridor],
            "added_to_each_weight": SMALL,
            "weights_solved": solved.total(),
            "solvers": dict(solved),
            "failed": dict(self._sum("failed")),
            "build_seconds": sum(points.build_seconds for points in points_by_corridor),
            "solve_seconds": seconds,
            "seconds_per_weight": seconds / max(1, solved.total()),
        }
