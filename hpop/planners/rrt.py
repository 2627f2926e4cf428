"""The RRT planner, the baseline of Becerra et al. 2020: the smoothest one of many random trajectories."""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import InitVar, dataclass, replace
from importlib import import_module
from time import time
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, get_args

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import one_of, set_wholes
from hpop.base.randomness import MaybeRNG, set_seed
from hpop.base.text import set_python_values
from hpop.criteria.base import Criterion, make_criterion
from hpop.criteria.costs import trajectory_costs
from hpop.errors import OptionError, QueryError
from hpop.planners.base import Candidates, planner
from hpop.planners.graphs.roadmap.headings import checked_ends
from hpop.planners.judgement import trusted
from hpop.planners.needs import in_plane, on_wheels, one_goal, start_of
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.rrt_query import NEAR, STEP, Base, TreeQuery, close_gap, of_wheels
from hpop.runtime.limits import Budget, ProgressCallback, Status, Watch
from hpop.runtime.sweep import Sweep

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

# OMPL grows the tree (LaValle and Kuffner 2001, "Randomized kinodynamic planning") by drives with constant, random
# wheel accelerations; :mod:`hpop.planners.rrt_query` defines how the robot moves and when it is free. A state counts as
# at the goal if braking from it ends near the goal. The braking is appended, and the remaining gap is closed.

MOST_STEPS = 5  # wheel accelerations are held for 1 to MOST_STEPS steps
LATE = "were ended by the time limit"
VELOCITIES = 0.5  # weight of differences in speed (m/s, rad/s) beside those in position (m), in the tree's distance

_alone = threading.Lock()  # the seed of OMPL's random numbers is global to the process


class TreeRun(NamedTuple):
    """Result of growing one tree.

    controls    (n, 3)  acceleration, m/s², angular acceleration, rad/s², duration, s, of each drive; empty on failure
    failure     reason of a failure, or ""
    extensions  number of attempts to extend the tree, failed ones included
    missed      m       from the goal to the nearest possible stop; 0 if the goal was reached, inf if unknown
    """

    controls: FloatArray
    failure: str
    extensions: int
    missed: float = 0.0


def run(query: TreeQuery, seed: int) -> TreeRun:
    """Grow one tree from start to goal; the result depends on the arguments alone, unless its failure is LATE."""
    if query.arrived:
        return TreeRun(np.empty((0, 3)), "", 0)
    with _alone:
        controls, extensions, missed = grow(query, seed)
    if controls is None:
        failure = "did not reach the goal" if extensions >= query.extensions else LATE
        return TreeRun(np.empty((0, 3)), failure, extensions, missed)
    closed = close_gap(query, controls)
    if closed is None:
        return TreeRun(np.empty((0, 3)), "ended near the goal, but the last gap could not be closed", extensions)
    return TreeRun(closed, "", extensions)


def load_ompl() -> tuple[Any, Any, Any]:
    """Import OMPL; return its modules base, control and util. Raise OptionError if OMPL is not installed."""
    try:
        return import_module("ompl.base"), import_module("ompl.control"), import_module("ompl.util")
    except ImportError as error:
        raise OptionError(
            f"planner 'rrt' needs OMPL, which fails to load ({error}); pip install 'hpop[rrt]', or use another planner"
        ) from None


def grow(query: TreeQuery, seed: int) -> tuple[FloatArray | None, int, float]:
    """Grow one tree with OMPL until the robot can stop near the goal, or until a limit is reached.

    Returns controls (n, 3) to that stop or None, the number of extensions, and by how much the best node of the tree
    misses the goal, m: NEAR times :meth:`TreeQuery.distance`; 0 if controls were found, inf if OMPL names no best node.
    """
    ob, oc, util = load_ompl()
    level = util.getLogLevel()
    util.setLogLevel(util.LOG_NONE)
    try:
        util.RNG.setSeed(seed)
        space = oc.SpaceInformation(*_spaces(query, ob, oc))
        space.setStatePropagator(lambda *arguments: _propagate(query, *arguments))
        space.setStateValidityChecker(lambda state: state[1][0] >= 0.0)
        space.setPropagationStepSize(STEP)
        space.setMinMaxControlDuration(1, MOST_STEPS)
        space.setup()
        definition = ob.ProblemDefinition(space)
        start = space.allocState()
        _write_base(start, Base(*query.start, 0.0, 0.0))
        definition.addStartState(start)
        definition.setGoal(_goal_region(query, ob, space))
        tree = oc.RRT(space)
        tree.setProblemDefinition(definition)
        tree.setup()
        extensions = 0

        def is_over() -> bool:
            nonlocal extensions
            if query.until is not None and time() >= query.until:
                return True
            extensions += 1
            return extensions > query.extensions

        tree.solve(ob.PlannerTerminationCondition(is_over))
        if not definition.hasExactSolution():
            missed = NEAR * float(definition.getSolutionDifference()) if definition.hasSolution() else math.inf
            return None, min(extensions, query.extensions), missed
        return _controls(query, definition.getSolutionPath()), extensions, 0.0
    finally:
        util.setLogLevel(level)


def _spaces(query: TreeQuery, ob: Any, oc: Any) -> tuple[Any, Any]:
    """Return OMPL's state space (poses with velocities), and its control space (accelerations of both wheels)."""
    limits, (x_min, y_min, x_max, y_max) = query.limits, query.world.bounds

    def bounds(*ranges: tuple[float, float]) -> Any:
        box = ob.RealVectorBounds(len(ranges))
        for i, (low, high) in enumerate(ranges):
            box.setLow(i, low)
            box.setHigh(i, high)
        return box

    poses, velocities, states = ob.SE2StateSpace(), ob.RealVectorStateSpace(2), ob.CompoundStateSpace()
    poses.setBounds(bounds((x_min, x_max), (y_min, y_max)))
    velocities.setBounds(bounds((0.0, limits.speed), (-limits.turn_rate, limits.turn_rate)))
    states.addSubspace(poses, 1.0)
    states.addSubspace(velocities, VELOCITIES)
    controls = oc.RealVectorControlSpace(states, 2)
    wheel = (-limits.wheel_acceleration, limits.wheel_acceleration)
    controls.setBounds(bounds(wheel, wheel))
    return states, controls


def _goal_region(query: TreeQuery, ob: Any, space: Any) -> Any:
    """Return OMPL's goal region, from which braking ends near the goal; one sample in 20 is the goal."""

    class RestNearGoal(ob.GoalSampleableRegion):  # type: ignore[misc]
        def distanceGoal(self, state: Any) -> float:  # noqa: N802  (OMPL's name)
            return query.distance(_base_of(state))

        def sampleGoal(self, state: Any) -> None:  # noqa: N802
            x, y, yaw = query.goal
            bearing = math.atan2(y - query.start[1], x - query.start[0])
            _write_base(state, Base(x, y, bearing if yaw is None else yaw, 0.0, 0.0))

        def maxSampleCount(self) -> int:  # noqa: N802
            return 1

    goal = RestNearGoal(space)
    goal.setThreshold(1.0)
    return goal


def _propagate(query: TreeQuery, state: Any, control: Any, duration: float, result: Any) -> None:
    """Write the end state of a drive to ``result``; an invalid drive gets a negative speed, so that OMPL rejects it."""
    base = _base_of(state)
    end = query.drive(base, *of_wheels(query.model, control[0], control[1]), duration)
    _write_base(result, base._replace(speed=-1.0) if end is None else end)


def _base_of(state: Any) -> Base:
    pose, velocity = state[0], state[1]
    return Base(pose.getX(), pose.getY(), pose.getYaw(), velocity[0], velocity[1])


def _write_base(state: Any, base: Base) -> None:
    pose, velocity = state[0], state[1]
    pose.setXY(base.x, base.y)
    pose.setYaw(math.remainder(base.yaw, 2.0 * math.pi))
    velocity[0], velocity[1] = base.speed, base.turn_rate


def _controls(query: TreeQuery, path: Any) -> FloatArray:
    """Return the controls (n, 3) of an OMPL path, in steps of STEP seconds, followed by those of braking at its end."""
    rows = []
    for i in range(path.getControlCount()):
        wheels = path.getControl(i)
        steps = round(path.getControlDuration(i) / STEP)
        rows += [(*of_wheels(query.model, wheels[0], wheels[1]), STEP)] * steps
    last = _base_of(path.getState(path.getStateCount() - 1))
    return np.concatenate([np.array(rows).reshape(-1, 3), query.braking(last)])


Keep = Literal["selected", "all"]
MOST_RUNS = 100_000


@planner("rrt")
@dataclass(frozen=True)
class RRT:
    """Planner that grows random trees of drives, and selects the trajectory with the fewest curvature sign changes.

    runs            number of trees, each with its own random numbers (the paper: 1000)
    seed            seed of the random numbers; in Python also `rng`: a seed, a Generator that draws one, or None for a
                    fresh one (SPEC 7 of Scientific Python)
    keep            "selected": only the run with the fewest sign changes, the shortest among equals; "all": all runs
                    that reach the goal, from which the front keeps the best
    max_extensions  number of attempts to extend a tree, after which its run gives up
    time_limit      s  for all runs; finished runs are used, unfinished trees are dropped

    This is the baseline of the user study of Becerra et al. 2020 (arXiv 2002.10696), which does not say how its trees
    grow. Here OMPL grows them (Sucan, Moll and Kavraki 2012), by drives with random wheel accelerations
    (:mod:`hpop.planners.rrt_query`). These are bounded so that the base keeps the model's speed, turn rate and
    accelerations; it never goes backwards.

    Accepts any criteria, at least one without memory. The planner treats the robot as the circle that it sweeps in
    turning, so this circle must be free at start and goal. Guarantees no cost, and may miss a path that exists.
    Trajectories begin and end at rest, exactly at start and goal, and are free of collisions. A run takes about half a
    second in a building, and memory for one tree; results are the same with any executor.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move", "rigid", "wheels"})

    runs: int = 100
    seed: int = 0
    keep: Keep = "selected"
    max_extensions: int = 20_000
    time_limit: float | None = None
    rng: InitVar[MaybeRNG] = ...

    def __post_init__(self, rng: MaybeRNG) -> None:
        set_python_values(self)
        set_wholes(self, "runs", least=1, most=MOST_RUNS)
        set_seed(self, rng)
        set_wholes(self, "max_extensions", least=1)
        one_of("keep", self.keep, get_args(Keep))
        Budget(self.time_limit)

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Grow the trees, each as one job for the executor, and select from their trajectories.

        Raises OptionError if OMPL is not installed, and QueryError if start or goal is not free or if people move.
        """
        load_ompl()
        watch = Watch("rrt", self.time_limit, progress)
        until = None if self.time_limit is None else time() + self.time_limit
        query, objectives = self._query(problem, until), edge_objectives(problem.criteria, "rrt")

        def report(done: Mapping[int, TreeRun]) -> None:
            watch.report(len(done), self.runs - len(done), sum(not tree_run.failure for tree_run in done.values()))

        with Sweep(run, query, executor) as sweep:
            results, status = sweep.until(self._seeds(), watch.is_late, report)
        finished = {i: tree_run for i, tree_run in results.items() if tree_run.failure != LATE}
        if status is Status.COMPLETE and len(finished) < self.runs:
            status = Status.TIME_LIMIT
        candidates = _FinishedRuns(
            self, problem, objectives, query, finished, tuple(results.values()), status
        ).candidates()
        return replace(
            candidates, notes=(*candidates.notes, *sweep.notes), stats={**candidates.stats, "seconds": watch.seconds}
        )

    def _seeds(self) -> list[int]:
        """Return a seed for each run, derived from the planner's seed; none is 0, which OMPL does not accept."""
        return [1 + int(np.random.SeedSequence((self.seed, i)).generate_state(1)[0] >> 1) for i in range(self.runs)]

    def _query(self, problem: Problem, until: float | None) -> TreeQuery:
        """Return the query that all runs share; raises QueryError if people move, or if start or goal is not free."""
        moving = [p.name or f"number {i}" for i, p in enumerate(problem.world.content.people) if p.moves]
        if moving:
            raise QueryError(
                f"rrt plans only among people who stand, but {' and '.join(moving)} move{'s' * (len(moving) == 1)}. "
                "Use planner exact, lattice, roadmap or any-angle, which plan for moving people. Or remove their "
                "velocities, to plan round their present positions; or leave them out, and evaluate the result later."
            )
        checked_ends(problem)
        model, start, goal = on_wheels(problem.model), start_of(problem), one_goal(problem, "rrt")
        collision = in_plane(model).collision(problem.world)
        for end, (x, y, _) in (("start", start), ("goal", goal)):
            if not collision.clear(np.array([x]), np.array([y]))[0]:
                content = problem.world.content
                if end == "start" and content.left:
                    names = " and ".join(content.people[i].name or f"number {i}" for i in content.left)
                    raise QueryError(
                        f"rrt needs a start without contact, but the robot touches {names} there. Use planner lattice, "
                        "roadmap, any-angle, epsilon-constraint, weighted-sum-corridor or smoothing, which can start "
                        "in contact, or move the start."
                    )
                raise QueryError(
                    f"rrt needs room at the {end} for the circle that the robot sweeps in turning, but "
                    f"({x:.3f}, {y:.3f}) is too near an obstacle. Move the {end}, or use another planner."
                )
        return TreeQuery(model, problem.world, start, goal, self.max_extensions, until)


@dataclass(frozen=True, eq=False)
class _FinishedRuns:
    """Runs of an RRT planner, from which candidates are selected.

    finished  results by the index of the run, without runs that the time limit ended
    runs      all results, in the order of the seeds
    """

    planner: RRT
    problem: Problem
    objectives: Objectives
    query: TreeQuery
    finished: dict[int, TreeRun]
    runs: tuple[TreeRun, ...]
    status: Status

    def candidates(self) -> Candidates:
        """Check the trajectories of all runs that reached the goal, and return the selected candidates with notes."""
        reached = {i: tree_run for i, tree_run in self.finished.items() if not tree_run.failure}
        trajectories = tuple(self.query.trajectory(tree_run.controls) for tree_run in reached.values())
        optimised, world, seeds = self.objectives.optimised, self.problem.world, self.planner._seeds()
        failed = Counter(tree_run.failure for tree_run in self.finished.values() if tree_run.failure)
        candidates = Candidates(
            objectives=optimised,
            trajectories=trajectories,
            planned=trajectory_costs(optimised, trajectories, world),  # a tree adds up no costs
            tolerance=np.zeros((len(reached), len(optimised))),
            status=self.status,
            certificate="",
            provenance=tuple(
                {"seed": self.planner.seed, "run": i, "run_seed": seeds[i], "extensions": tree_run.extensions}
                for i, tree_run in reached.items()
            ),
            filters=self.objectives.filters,
            stats={
                "planner": "rrt",
                "runs": len(self.finished),
                "reached": len(reached),
                "failed": dict(failed),
                "extensions": sum(tree_run.extensions for tree_run in self.finished.values()),
            },
        )
        candidates = trusted(candidates, self.problem, "rrt")
        count = len(candidates.trajectories)
        sign_changes, lengths = trajectory_costs(self._selection_criteria, candidates.trajectories, world).T
        changes = sign_changes.astype(int).tolist()
        origins = [
            {"planner": "rrt", **origin, "curvature_sign_changes": n}
            for origin, n in zip(candidates.provenance, changes, strict=True)
        ]
        chosen = range(count) if self.planner.keep == "all" else np.lexsort((lengths, sign_changes))[:1]
        return replace(
            replace(candidates, provenance=tuple(origins)).subset(chosen),
            status=Status.RUN_LIMIT if candidates.status is Status.COMPLETE and not count else candidates.status,
            certificate=self._claim(count),
            notes=(*self._run_notes(sign_changes, failed), *candidates.notes),
            stats={**candidates.stats, "curvature_sign_changes": changes},
        )

    @property
    def _selection_criteria(self) -> list[Criterion]:
        """Criteria that select a run: curvature sign changes, then length; with the problem's options for these."""
        return [
            next((c for c in self.problem.criteria if c.name == name), make_criterion(name))
            for name in ("curvature_sign_changes", "length")
        ]

    def _claim(self, count: int) -> str:
        """Return the certificate: a sentence that says what the result is, and how many runs there were."""
        runs = f"{len(self.finished)} random runs (seed {self.planner.seed}), of which {count} reached the goal"
        if self.planner.keep == "all":
            return f"rrt: a baseline, no optimum of any cost: {runs}"
        return f"rrt: a baseline, no optimum of any cost: the fewest curvature sign changes of {runs}"

    def _run_notes(self, sign_changes: FloatArray, failed: Counter[str]) -> tuple[str, ...]:
        """Return notes for the user: why runs failed, the range of sign changes, and advice if nothing was found."""
        runs = len(self.finished)
        least = min((tree_run.missed for tree_run in self.runs if tree_run.missed), default=math.inf)
        notes = [f"rrt: {count} of {runs} runs {failure}" for failure, count in sorted(failed.items())]
        if sign_changes.size:
            least, most = int(sign_changes.min()), int(sign_changes.max())
            times = f"{least}" if least == most else f"{least} to {most}"
            notes.append(f"rrt: the curvature changes its sign {times} times on the {sign_changes.size} paths found")
        else:
            nearest = f" The best tree ended about {least:.1f} m from the goal." if math.isfinite(least) else ""
            helps = "take more runs or max_extensions" if runs else "raise time_limit"
            why = "" if runs else " before the time limit"
            notes.append(
                f"rrt found no path{why}, which does not mean that there is none.{nearest} Trees reach goals some tens "
                f"of metres away: {helps}, or plan with lattice or roadmap, which find longer paths"
            )
        return tuple(notes)
