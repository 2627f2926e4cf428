"""The weighted-sum planner in the continuum: convex programs through corridors of convex free regions."""

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

from hpop.base.scalars import set_python_values
from hpop.criteria.base import Criterion
from hpop.criteria.costs import trajectory_costs
from hpop.errors import UnsupportedCriterion
from hpop.planners.base import Candidates, planner
from hpop.planners.judgement import trusted
from hpop.planners.needs import in_plane
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.programs.corridor.corridor import Corridor, corridors
from hpop.planners.programs.corridor.program import solvers_from
from hpop.planners.programs.corridor.weights import SMALL, CorridorPoints, Shared, solve_corridor
from hpop.planners.programs.criteria import is_counted
from hpop.planners.programs.outcome import Deadline
from hpop.planners.programs.warm_starts import WarmStart, WarmStarts, check_warm_start, warm_starts
from hpop.planners.weighted_sum import Weights, asked_weights, check_count
from hpop.runtime.limits import LimitPassed
from hpop.runtime.status import Budget, ProgressCallback, Status, Watch
from hpop.runtime.sweep import Sweep
from hpop.search.supported.weights import checked_divisions, simplex_lattice

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

NAME = "weighted-sum-corridor"
SOLVER = "CLARABEL"
LOADS = 1.0  # s, that cvxpy takes to load
DIVISIONS = 6  # of the weights of more than two costs, unless said otherwise


@planner(NAME)
@dataclass(frozen=True)
class WeightedSumCorridor:
    """Polylines of least weighted cost through corridors of convex free regions, for convex costs.

    step        m      of the lattice whose paths are the warm starts
    headings    4, 8 or 16 of that lattice
    divisions   count  steps of the simplex lattice of weights
    weights     rows of one weight a convex cost, in the order of the criteria, in place of the simplex lattice
    solver      of the convex programs, by cvxpy's name; where it fails, others that are installed are tried
    warm_start  what gives the warm starts: a planner's name, ``{name: {option: value}}``, a front, or trajectories
    time_limit  s      warm starts included

    Around each segment of each warm start a convex region is grown in which the robot is free; paths through the same
    regions share a corridor. Its polylines have a vertex in each overlap of neighbouring regions, so they are free of
    collisions all along. Costs are normalised from ideal to nadir of the corridor's own individual optima. Without
    ``divisions`` or ``weights``, two convex costs are weighted by dichotomy until less than 1 % lies between the points
    and the front, more by six divisions. 1e-4 is added to every weight, so a zero weight still breaks ties.

    Accepts criteria that declare a convex form (:mod:`hpop.criteria.convex`), and counts that the number of moves and
    turns settles; others are refused by name. Guarantees that each candidate is the optimum of its weights over its
    corridor, to the solver's tolerance: a supported point of the corridor's convex problem. Where the convex form is
    an upper bound (distances to obstacles), that bound is what is optimised and planned, within itself; reported costs
    are exact as always. Other corridors may have better points. Cost: one compilation a corridor, 20 to 100 ms, and
    3 to 10 ms a weight.
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
        object.__setattr__(self, "weights", asked_weights(self.divisions, self.weights))

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Plan warm starts, then solve the convex programs of their corridors; one job of the executor is a corridor.

        Raises UnsupportedCriterion for a criterion that is neither convex nor settled, OptionError for a solver that is
        not installed or weights that are not one a convex cost, and what the planner of the warm starts raises.
        """
        watch = Watch("corridors", self.time_limit, progress)
        objectives = edge_objectives(problem.criteria, NAME)
        run = _CorridorRun(problem, objectives, self, _convex(objectives, problem))
        warm = warm_starts(self, problem, progress, executor, watch.left)
        if warm.interrupted is not None:
            return warm.interrupted
        run.notes += warm.notes
        deadline = Deadline.after(watch.left)
        run.learn(warm, deadline)
        count = len(run.corridors)

        def report(done: Mapping[int, CorridorPoints]) -> None:
            watch.report(len(done), count - len(done), sum(len(found.polylines) for found in done.values()))

        ended, notes = Status.TIME_LIMIT, list[str]()
        with suppress(LimitPassed), Sweep(solve_corridor, run.shared(deadline), executor) as sweep:
            notes = sweep.notes
            run.found, ended = sweep.until(run.corridors, watch.is_late, report)
        cut_short = sum(found.is_cut_short for found in run.found.values())
        if ended is Status.COMPLETE and (cut_short or run.left):
            ended = Status.TIME_LIMIT
        for number, what in (
            (run.left, "warm starts are in no corridor yet"),
            (count - len(run.found), f"of {count} corridors were not tried"),
            (cut_short, f"of {count} corridors were not solved for all weights"),
        ):
            if number:
                run.notes.append(f"{ended}: {number} {what}")
        run.notes += notes
        found = run.candidates(warm.ended(ended))
        improved = {
            i for place, points in run.found.items() if points.polylines for i in run.corridors[place].warm_starts
        }
        return run.warm.kept(replace(found, stats={**found.stats, "seconds": watch.seconds}), improved)


def _convex(objectives: Objectives, problem: Problem) -> list[int]:
    """Places of the criteria that declare a convex form; refuses all that no structure settles, by name."""
    places = []
    for j, criterion in enumerate(objectives.optimised):
        if criterion.convex is not None:
            places.append(j)
        elif criterion.smooth or not is_counted(criterion, problem):
            instead = "epsilon-constraint" if criterion.smooth else "lattice"
            raise UnsupportedCriterion(
                f"{NAME} needs criteria that declare a convex form, or counts that the number of moves and turns "
                f"settles; {criterion.name!r} is not declared convex. Leave it out, or use planner {instead!r}."
            )
    if not places:
        names = ", ".join(criterion.name for criterion in objectives.optimised)
        raise UnsupportedCriterion(
            f"{NAME} needs a convex criterion to minimise; {names} are settled by the number of moves and turns. Add "
            "one, such as 'length'."
        )
    return places


@dataclass(eq=False)
class _CorridorRun:
    """One run of the planner: its corridors and what was found in them."""

    problem: Problem
    objectives: Objectives
    options: WeightedSumCorridor
    convex: list[int]
    warm: WarmStarts = field(default_factory=lambda: WarmStarts((), Status.COMPLETE, ()))
    left: int = 0
    corridors: list[Corridor] = field(default_factory=list)
    found: dict[int, CorridorPoints] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def criteria(self) -> tuple[Criterion, ...]:
        return self.objectives.optimised

    def __post_init__(self) -> None:
        _ = self.weights  # checks their number before anything is planned

    def shared(self, deadline: Deadline) -> Shared:
        """Return what workers need; raises LimitPassed where the time left does not suffice to load cvxpy."""
        if "cvxpy" not in sys.modules:
            deadline.check("cvxpy was loaded", ahead=LOADS)
        criteria = tuple(self.criteria[j] for j in self.convex)
        solvers = solvers_from(self.options.solver)
        return Shared(self.problem.world, in_plane(self.problem.model), criteria, self.weights, solvers, deadline)

    @cached_property
    def weights(self) -> Weights | None:
        """Rows of one weight a convex cost; None where dichotomy finds them. Raises OptionError for other numbers."""
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

    def learn(self, warm: WarmStarts, deadline: Deadline) -> None:
        """Corridors of the warm starts that are free; some are left where time is over."""
        self.warm, kept, _, dropped = warm.polylines(self.problem, self.criteria)
        self.corridors, refused = corridors(kept, self.problem, deadline)
        self.left = len(kept) - refused - sum(len(corridor.warm_starts) for corridor in self.corridors)
        self.notes += dropped
        if refused:
            self.notes.append(f"{refused} of {len(kept)} warm starts touch an obstacle: no region can be grown there")

    def candidates(self, status: Status) -> Candidates:
        """What was found, judged on the exact geometry, with everything that went wrong."""
        each = [(place, found, i) for place, found in self.found.items() for i in range(len(found.polylines))]
        trajectories = tuple(found.polylines[i].trajectory(self.problem.model) for _, found, i in each)
        planned = np.zeros((len(each), len(self.criteria)))
        counted = [j for j in range(len(self.criteria)) if j not in self.convex]
        counts = [self.criteria[j] for j in counted]
        planned[:, counted] = trajectory_costs(counts, trajectories, self.problem.world)
        planned[:, self.convex] = np.array([found.costs[i] for _, found, i in each]).reshape(-1, len(self.convex))
        exact = [all(found.exact[j] for found in self.found.values()) for j in range(len(self.convex))]
        tolerance = np.tile([c.quantum for c in self.criteria], (len(each), 1))
        above = np.full(planned.shape, np.inf)
        for j in (j for j, whole in zip(self.convex, exact, strict=True) if not whole):
            tolerance[:, j] += planned[:, j]  # the cost lies between 0 and its upper bound
            above[:, j] = planned[:, j]
        found = Candidates(
            objectives=self.criteria,
            trajectories=trajectories,
            planned=planned,
            tolerance=tolerance,
            status=status,
            certificate=self._claim(exact),
            provenance=tuple(self._provenance(*one) for one in each),
            notes=(*self.objectives.notes, *self.notes, *self._faults()),
            filters=self.objectives.filters,
            stats=self._stats(),
        )
        return trusted(found, self.problem, NAME, epsilon=above)

    def _claim(self, exact: list[bool]) -> str:
        """What is claimed, in words."""
        names = [self.criteria[j].name for j in self.convex]
        bounded = [name for name, whole in zip(names, exact, strict=True) if not whole]
        bound = f", {', '.join(bounded)} represented by an upper bound" if bounded else ""
        part = "" if len(self.found) == len(self.corridors) else f" (of {len(self.corridors)})"
        return (
            f"{NAME}: supported points, to solver tolerance, of the convex problems in ({', '.join(names)}){bound} "
            f"through {len(self.found)} corridors{part} round the warm starts, not across corridors"
            f"{self.objectives.certificate}"
        )

    def _provenance(self, place: int, found: CorridorPoints, i: int) -> dict[str, Any]:
        return {
            "planner": NAME,
            "corridor": place,
            "warm_starts": list(self.corridors[place].warm_starts),
            "segments": len(found.polylines[i].lengths),
            "criteria": [self.criteria[j].name for j in self.convex],
            "weights": [list(row) for row in found.weights[i]],
        }

    def _faults(self) -> list[str]:
        """Notes on solvers that failed, and on what no solver solved."""
        failed, solved = self._sum("failed"), self._sum("solved")
        others = {name: count for name, count in solved.items() if name != self.options.solver}
        notes = []
        if failed:
            why = ", ".join(f"{reason} ({count} times)" for reason, count in sorted(failed.items()))
            instead = ", ".join(f"{name} solved {count}" for name, count in sorted(others.items()))
            notes.append(f"a solver failed: {why}; {instead or 'no other solved them'}")
        unsolved = sum(found.unsolved for found in self.found.values())
        if unsolved:
            notes.append(f"{unsolved} convex programs were solved by no solver that is installed")
        return notes

    def _sum(self, name: str) -> Counter[str]:
        return sum((getattr(found, name) for found in self.found.values()), Counter())

    def _stats(self) -> dict[str, Any]:
        solved = self._sum("solved")
        every = list(self.found.values())
        seconds = sum(found.solve_seconds for found in every)
        return {
            "planner": NAME,
            "warm_starts": len(self.warm.trajectories),
            "corridors": len(self.corridors),
            "regions": len({id(region) for corridor in self.corridors for region in corridor.regions}),
            "unsafe_regions": len({id(r) for corridor in self.corridors for r in corridor.regions if not r.safe}),
            "convex": [self.criteria[j].name for j in self.convex],
            "ideal": [found.ideal.tolist() for found in every],
            "nadir": [found.nadir.tolist() for found in every],
            "added_to_each_weight": SMALL,
            "weights_solved": solved.total(),
            "solvers": dict(solved),
            "failed": dict(self._sum("failed")),
            "build_seconds": sum(found.build_seconds for found in every),
            "solve_seconds": seconds,
            "seconds_per_weight": seconds / max(1, solved.total()),
        }
