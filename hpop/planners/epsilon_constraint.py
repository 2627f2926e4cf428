"""The epsilon-constraint planner: any-angle polylines, one cost minimised, the others bounded by what is known."""

from __future__ import annotations

import dataclasses
import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.arrays import FloatArray
from hpop.criteria.base import Criterion
from hpop.errors import OptionError, UnsupportedCriterion
from hpop.planners.base import Candidates, Objectives, Planner, edge_objectives, make_planner, planner
from hpop.planners.nlp import settled
from hpop.planners.polyline import PolylineProgram, Solution
from hpop.planners.trust import exceeds, judge
from hpop.planners.vertices import PIECE, Polyline, Structure
from hpop.registry import planners
from hpop.status import Budget, Progress, ProgressCallback, Status

if TYPE_CHECKING:
    from hpop.problem import Problem

LOOSE = 2e-4  # relative: a bound is loosened by this, so that a warm start on it has somewhere to go
QUADRATURE = 5e-3  # relative: a program's sums over pieces of 0.6 m against sums over field cells
REPAIRS = 3  # solves with corrected bounds after a solution that collides or exceeds its bounds
GAIN = 1e-3  # relative: a round that gains less is the last
LEAST_TURN = math.radians(1.0)  # a vertex that turns by less is left out, and with it the stop for the turn
NUDGE = 0.05  # m: a warm start that did not converge is displaced by about this


@planner("epsilon-constraint")
@dataclass(frozen=True)
class EpsilonConstraint:
    """Polylines of any angles that minimise one cost while the others are bounded, from each known trade-off.

    step        m      of the lattice whose paths are the warm starts
    headings    4, 8 or 16 of that lattice
    minimise    name of the cost that is minimised; None takes the length, or the first smooth one
    divisions   count  of further bounds between a known cost and the next better one
    rounds      count  of programs a bound, each from the last solution: every one moves vertices by at most 1 m
    epsilon     bounds that hold throughout, by the name of a cost
    warm_start  planner that gives the warm starts: a name, or ``{name: {option: value}}``
    max_points  count  of bounds that are tried
    time_limit  s      warm starts included

    Accepts smooth criteria that add up or take the worst moment, and counts that the number of moves and turns settles;
    others are refused by name. Guarantees that every candidate keeps its bounds within 1e-3 and is free of collisions
    on the exact geometry; each is a local optimum for its number of turns, near its warm start. The warm starts
    themselves are not among the candidates. The grid of bounds is AUGMECON's (Mavrotas 2009; Mavrotas and Florios
    2013), but spans only what the warm starts know: a bound is skipped if a looser one was answered within it, and
    tighter ones than one that was infeasible are left out. Cost: a program is built once a structure, in 30 to 200 ms,
    and solved in 20 to 100 ms.
    """

    step: float = 0.25
    headings: int = 8
    minimise: str | None = None
    divisions: int = 0
    rounds: int = 2
    epsilon: Mapping[str, float] | None = None
    warm_start: str | Mapping[str, Mapping[str, Any]] = "lattice"
    max_points: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        for name, least in (("divisions", 0), ("rounds", 1), ("max_points", 1)):
            value = getattr(self, name)
            if not (value is None and name == "max_points") and not (isinstance(value, int) and value >= least):
                raise OptionError(f"{name} must be a whole number of at least {least}, got {value!r}")
        if self.epsilon is not None:
            wrong = not isinstance(self.epsilon, Mapping) or any(
                not isinstance(v, int | float) or math.isnan(v) for v in self.epsilon.values()
            )
            if wrong:
                raise OptionError(
                    f"epsilon gives bounds by the name of a cost, such as {{'length': 30}}, got {self.epsilon!r}"
                )
        Budget(self.time_limit)
        self._warm_planner(None)

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        """Plan warm starts, then minimise from each of them.

        Raises UnsupportedCriterion for a criterion that no nonlinear program can treat, OptionError for a cost to
        minimise or to bound that is not among the objectives, and what the planner of the warm starts raises.
        """
        began = time.perf_counter()
        objectives = edge_objectives(problem.criteria, "epsilon-constraint")
        sweep = _Sweep(problem, objectives, self, _place(self.minimise, objectives.optimised), began)
        sweep.split()
        first = self._warm_planner(self.time_limit).solve(problem, progress)
        if not first.trajectories:
            notes = (*objectives.notes, f"no warm start: {first.status}", *first.notes)
            return sweep.candidates(first.status, notes)
        sweep.learn(first)
        status = first.status
        try:
            status = sweep.run(progress)
        except KeyboardInterrupt:  # what is finished is kept
            status = Status.INTERRUPTED
        return sweep.candidates(status, objectives.notes)

    def _warm_planner(self, seconds: float | None) -> Planner:
        """The planner of the warm starts, with the options that it shares with this one."""
        spec = self.warm_start
        if isinstance(spec, Mapping):
            if len(spec) != 1:
                raise OptionError(f"warm_start is one planner with its options, got {spec!r}")
            ((name, given),) = spec.items()
            return make_planner(name, dict(given or {}))
        if not isinstance(spec, str):
            raise OptionError(f"warm_start is the name of a planner, or {{name: options}}, got {spec!r}")
        known = {option.name for option in dataclasses.fields(planners[spec])}
        shared = {"step": self.step, "headings": self.headings, "time_limit": seconds}
        return make_planner(spec, {name: value for name, value in shared.items() if name in known})


@dataclass(frozen=True, eq=False)
class _Known:
    """A trajectory that is free, with its exact costs (k,)."""

    polyline: Polyline
    costs: FloatArray


@dataclass(frozen=True, eq=False)
class _Cell:
    """Bounds (k,) that are tried; ``of`` is the warm start they come from, ``level`` 0 for its own costs."""

    epsilon: FloatArray
    of: int
    column: int
    level: int


@dataclass(frozen=True, eq=False)
class _Found:
    """A candidate: what was returned, its exact costs, and how it came about."""

    cell: _Cell
    known: _Known
    planned: FloatArray
    provenance: dict[str, Any]


@dataclass(eq=False)
class _Sweep:
    """One run of the planner: what is known, what is answered, and what went wrong."""

    problem: Problem
    objectives: Objectives
    options: EpsilonConstraint
    minimise: int
    began: float
    smooth: list[int] = field(default_factory=list)
    warm: list[_Known] = field(default_factory=list)
    found: list[_Found] = field(default_factory=list)
    infeasible: list[_Cell] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    failures: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    programs: dict[Structure, PolylineProgram] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=lambda: {"build": 0.0, "solve": 0.0})

    @property
    def criteria(self) -> tuple[Criterion, ...]:
        return self.objectives.optimised

    def split(self) -> None:
        """Tell smooth criteria from counts that a structure settles; refuse all others by name."""
        for j, criterion in enumerate(self.criteria):
            if criterion.smooth:
                self.smooth.append(j)
            elif not settled(criterion, self.problem):
                raise UnsupportedCriterion(
                    f"epsilon-constraint needs smooth criteria, or counts that the number of moves and turns settles; "
                    f"{criterion.name!r} has no gradient and depends on where the motions are. Leave it out, or use "
                    "planner 'lattice'."
                )
        if self.minimise not in self.smooth:
            name = self.criteria[self.minimise].name
            raise OptionError(f"{name!r} is settled by the number of moves and turns; minimise a smooth cost")

    def learn(self, candidates: Candidates) -> None:
        """Warm starts: the front of another planner, ends put on start and goal, those that are free."""
        front = self.problem.front(candidates)
        polylines = [Polyline.of(trajectory, self.problem) for trajectory in front.trajectories]
        judged = judge(self.problem, self.criteria, [p.trajectory(self.problem.model) for p in polylines])
        self.warm = [_Known(polylines[i], judged.costs[i]) for i in judged.kept]
        self.notes += judged.notes("epsilon-constraint, warm starts")

    @cached_property
    def _limits(self) -> FloatArray:
        """Bounds (k,) that hold throughout."""
        asked, names = dict(self.options.epsilon or {}), [c.name for c in self.criteria]
        unknown = sorted(set(asked) - set(names))
        if unknown:
            raise OptionError(f"epsilon bounds {', '.join(unknown)}, but the objectives are {', '.join(names)}")
        return np.array([asked.get(name, np.inf) for name in names])

    def cells(self) -> list[_Cell]:
        """The grid of bounds, loosest first: each warm start's own costs, then levels down to the next better ones."""
        costs, cells = np.array([known.costs for known in self.warm]), []
        for i, row in enumerate(costs):
            cells.append(_Cell(np.minimum(row, self._limits), i, -1, 0))
            for j in (j for j in self.smooth if j != self.minimise and self.options.divisions):
                below = costs[costs[:, j] < row[j] - LOOSE * abs(row[j]), j]
                for level in range(1, self.options.divisions + 1 if below.size else 1):
                    bound = row.copy()
                    bound[j] += (below.max() - row[j]) * level / (self.options.divisions + 1)
                    bound[self.minimise] = np.inf
                    cells.append(_Cell(np.minimum(bound, self._limits), i, j, level))
        others = [j for j in range(costs.shape[1]) if j != self.minimise]
        span = np.maximum(np.ptp(costs, axis=0), 1e-9)
        return sorted(cells, key=lambda c: (c.level > 0, -float((c.epsilon / span)[others].sum())))

    def run(self, progress: ProgressCallback | None) -> Status:
        """Try all bounds; the status says whether any were left."""
        cells = self.cells()
        for tried, cell in enumerate(cells):
            spent = time.perf_counter() - self.began
            if progress:
                progress(Progress("epsilon-constraint", tried, len(cells) - tried, len(self.found), seconds=spent))
            if self.options.time_limit is not None and spent > self.options.time_limit:
                self.notes.append(f"time limit: {len(cells) - tried} of {len(cells)} bounds were not tried")
                return Status.TIME_LIMIT
            if self._answered(cell):
                self.counts["skipped"] += 1
                continue
            if self.options.max_points is not None and self.counts["tried"] >= self.options.max_points:
                self.notes.append(f"max_points: {len(cells) - tried} of {len(cells)} bounds were not tried")
                return Status.LABEL_LIMIT
            self.counts["tried"] += 1
            self._try(cell)
        return Status.COMPLETE

    def _answered(self, cell: _Cell) -> bool:
        """Whether a looser bound has an answer within this one, or none at all."""
        others = [j for j in range(len(self.criteria)) if j != self.minimise]
        for answer in self.found:
            looser = (answer.cell.epsilon[others] >= cell.epsilon[others]).all()
            if looser and not (answer.known.costs > cell.epsilon).any():
                return True
        return any(
            cell.level > 0 and (cell.epsilon <= failed.epsilon).all() and cell.of == failed.of
            for failed in self.infeasible
        )

    def _start(self, cell: _Cell) -> _Known:
        """The nearest known trajectory: the least beyond the bounds, then the least in the cost to minimise."""
        if not exceeds(self.warm[cell.of].costs, cell.epsilon, self.criteria).any():
            return self.warm[cell.of]
        known = [*self.warm, *(answer.known for answer in self.found)]
        costs = np.array([one.costs for one in known])
        over = np.maximum(costs - cell.epsilon, 0.0) / np.maximum(np.ptp(costs, axis=0), 1e-9)
        counted = [j for j in range(len(self.criteria)) if j not in self.smooth]
        settled = (over[:, counted] > 0).any(axis=1)
        return known[int(np.lexsort((costs[:, self.minimise], over.sum(axis=1), settled))[0])]

    def _try(self, cell: _Cell) -> None:
        """Solve from the nearest known trajectory, again from the solution while that gains something."""
        known = self._start(cell)
        counted = [j for j in range(len(self.criteria)) if j not in self.smooth]
        if exceeds(known.costs, cell.epsilon, self.criteria)[counted].any():
            self._fail(
                cell, "infeasible: no known trajectory has so few " + ", ".join(self.criteria[j].name for j in counted)
            )
            return
        best: _Found | None = None
        for number in range(self.options.rounds):
            found = self._solve(cell, known, number)
            if isinstance(found, str):
                if best is None:
                    self._fail(cell, found)
                break
            gain = known.costs[self.minimise] - found.known.costs[self.minimise]
            better = best is None or gain > 0
            best = found if better else best
            if gain <= GAIN * abs(known.costs[self.minimise]) or not found.planned.size:
                break
            known = found.known
        if best is not None:
            self.found.append(self._tidied(best))

    def _tidied(self, found: _Found) -> _Found:
        """Without stops for turns that are none; where pieces have grown too long, added up again in finer ones."""
        polyline = found.known.polyline.simplified(LEAST_TURN)
        if len(polyline.vertices) < len(found.known.polyline.vertices):
            trajectory = polyline.trajectory(self.problem.model)
            judged = judge(self.problem, self.criteria, [trajectory], epsilon=found.cell.epsilon[None])
            if not judged.reasons[0] and (judged.costs[0] <= found.known.costs * (1 + LOOSE)).all():
                self.counts["simplified"] += 1
                known = _Known(polyline, judged.costs[0])
                told = {**found.provenance, "segments": len(polyline.lengths)}
                return dataclasses.replace(found, known=known, planned=self._planned(known, 1), provenance=told)
        if (np.abs(found.planned - found.known.costs) > self._tolerance(found.planned)).any():
            self.counts["recounted"] += 1
            found = dataclasses.replace(found, planned=self._planned(found.known, 4))
        return found

    def _planned(self, known: _Known, finer: int) -> FloatArray:
        """Costs (k,) as the program of a polyline adds them up, in pieces so many times finer."""
        structure, planned = known.polyline.structure, known.costs.copy()
        pieces = tuple(finer * count for count in structure.pieces)
        costs = self._program(dataclasses.replace(structure, pieces=pieces)).costs(known.polyline)
        planned[self.smooth] = np.where(np.isfinite(costs), costs, planned[self.smooth])
        return planned

    def _fail(self, cell: _Cell, reason: str) -> None:
        self.failures[reason] += 1
        if reason.startswith("infeasible"):
            self.infeasible.append(cell)

    def _program(self, structure: Structure) -> PolylineProgram:
        if structure not in self.programs:
            began = time.perf_counter()
            smooth = tuple(self.criteria[j] for j in self.smooth)
            program = PolylineProgram(self.problem, smooth, self.smooth.index(self.minimise), structure)
            self.programs[structure] = program.build()
            self.seconds["build"] += time.perf_counter() - began
        return self.programs[structure]

    def _solve(self, cell: _Cell, known: _Known, number: int) -> _Found | str:
        """One program from one warm start: a candidate that is trusted, or why there is none."""
        program, warm = self._program(known.polyline.structure), known.polyline
        epsilon, began = cell.epsilon[self.smooth], time.perf_counter()
        # What the program's coarser sum is off at the warm start is added to the bounds.
        drift = np.nan_to_num(program.costs(warm) - known.costs[self.smooth])
        quanta = np.array([self.criteria[j].quantum for j in self.smooth])
        aim = epsilon + np.maximum(LOOSE * np.abs(epsilon), 0.2 * quanta) + drift
        bounds = program.bounds(warm)
        scale = np.maximum(np.abs(known.costs[self.smooth]), 1e-6)
        scale = np.where(known.costs[self.smooth] > 1e-6, scale, 1.0)
        solution = program.solve(warm, aim, scale=scale, bounds=bounds)
        perturbed = not solution.converged
        if perturbed:
            self.counts["perturbed"] += 1
            again = program.solve(warm.moved(np.random.default_rng(cell.of), NUDGE), aim, scale=scale, bounds=bounds)
            solution = again if again.converged else solution
            self.counts["saved by perturbation"] += again.converged
        repairs = 0
        while solution.converged:
            trajectory = solution.polyline.trajectory(self.problem.model)
            judged = judge(self.problem, self.criteria, [trajectory], epsilon=cell.epsilon[None])
            reason, costs = judged.reasons[0], judged.costs[0]
            if not reason:
                self.seconds["solve"] += time.perf_counter() - began
                return self._candidate(cell, _Known(solution.polyline, costs), solution, number, perturbed, repairs)
            if repairs == REPAIRS or not program.freedom:
                break
            repairs += 1
            self.counts["repairs"] += 1
            if reason == "collides":
                bounds = program.raised(bounds, solution.polyline)
            over = np.maximum(costs - cell.epsilon, 0.0)[self.smooth]
            aim = aim - 1.2 * np.nan_to_num(over)
            last, solution = solution, program.solve(solution.polyline, aim, scale=scale, bounds=bounds)
            if not solution.converged:
                solution = dataclasses.replace(last, converged=False, status=f"{reason}; {solution.status}")
        self.seconds["solve"] += time.perf_counter() - began
        if not solution.converged:
            word = "infeasible" if solution.status == "Infeasible_Problem_Detected" else "not converged"
            return f"{word} ({solution.status})"
        return reason

    def _candidate(
        self, cell: _Cell, known: _Known, solution: Solution, number: int, perturbed: bool, repairs: int
    ) -> _Found:
        planned = known.costs.copy()
        if np.isfinite(solution.costs).all():
            planned[self.smooth] = solution.costs
        bounded = zip(self.criteria, cell.epsilon.tolist(), strict=True)
        provenance = {
            "planner": "epsilon-constraint",
            "minimise": self.criteria[self.minimise].name,
            "epsilon": {c.name: bound for c, bound in bounded if math.isfinite(bound)},
            "warm_start": cell.of,
            "level": cell.level,
            "segments": len(known.polyline.lengths),
            "round": number,
            "status": solution.status,
            "iterations": solution.iterations,
            "perturbed": perturbed,
            "repairs": repairs,
        }
        return _Found(cell, known, planned, provenance)

    def candidates(self, status: Status, notes: Sequence[str]) -> Candidates:
        """What was found, judged once more, with everything that went wrong."""
        trajectories = [one.known.polyline.trajectory(self.problem.model) for one in self.found]
        size = (len(trajectories), len(self.criteria))
        planned = np.array([one.planned for one in self.found]).reshape(size)
        tolerance = self._tolerance(planned)
        epsilon = np.array([one.cell.epsilon for one in self.found]).reshape(size)
        judged = judge(self.problem, self.criteria, trajectories, epsilon=epsilon, planned=planned, tolerance=tolerance)
        failed = [f"{count} bounds without a candidate: {why}" for why, count in sorted(self.failures.items())]
        if not judged.kept.size and self.failures and self.options.epsilon:
            failed.append(f"no polyline was found within epsilon {dict(self.options.epsilon)}: {self._nearest()}")
        kept = judged.kept
        names = ", ".join(self.criteria[j].name for j in self.smooth)
        return Candidates(
            objectives=self.criteria,
            trajectories=tuple(trajectories[i] for i in kept),
            planned=planned[kept],
            tolerance=tolerance[kept],
            status=status,
            certificate=(
                f"epsilon-constraint: local optima for their number of turns in ({names}), near their warm starts"
                f"{self.objectives.certificate}"
            ),
            provenance=tuple(self.found[i].provenance for i in kept),
            notes=(*notes, *self.notes, *failed, *judged.notes("epsilon-constraint")),
            filters=self.objectives.filters,
            stats={
                "planner": "epsilon-constraint",
                "warm_starts": len(self.warm),
                "programs": len(self.programs),
                **{
                    name: self.counts[name]
                    for name in (
                        "tried",
                        "skipped",
                        "perturbed",
                        "saved by perturbation",
                        "repairs",
                        "simplified",
                        "recounted",
                    )
                },
                "failed": dict(self.failures),
                "dropped": judged.dropped,
                "build_seconds": self.seconds["build"],
                "solve_seconds": self.seconds["solve"],
                "seconds": time.perf_counter() - self.began,
            },
        )

    def _nearest(self) -> str:
        """The least known cost in each of what is bounded."""
        least = np.min([known.costs for known in self.warm], axis=0)
        return "the warm starts have at least " + ", ".join(
            f"{c.name} {value:.4g} {c.unit}"
            for c, value, limit in zip(self.criteria, least, self._limits, strict=True)
            if math.isfinite(limit)
        )

    def _tolerance(self, planned: FloatArray) -> FloatArray:
        """Sums within QUADRATURE; maxima within what one unit a metre changes between samples and in the field."""
        between = self.problem.world.cell + PIECE / 4
        worst = np.array([c.aggregate == "max" for c in self.criteria])
        quanta = np.array([c.quantum for c in self.criteria])
        tolerance: FloatArray = np.where(worst, between, QUADRATURE * np.abs(planned)) + quanta
        return tolerance


def _place(name: str | None, criteria: Sequence[Criterion]) -> int:
    """Place of the cost to minimise."""
    names = [criterion.name for criterion in criteria]
    if name is not None:
        if name not in names:
            raise OptionError(f"minimise is one of {', '.join(names)}, got {name!r}")
        return names.index(name)
    if "length" in names:
        return names.index("length")
    smooth = [j for j, criterion in enumerate(criteria) if criterion.smooth]
    if not smooth:
        raise UnsupportedCriterion(
            f"epsilon-constraint needs a smooth criterion to minimise; {', '.join(names)} have no gradient. Add one, "
            "such as 'length'."
        )
    return smooth[0]
