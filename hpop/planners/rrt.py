"""The RRT planner: the baseline of Becerra et al. 2020, of many random trajectories the one that wiggles least."""

from __future__ import annotations

import time
from collections import Counter
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, get_args

import numpy as np

from hpop.arrays import FloatArray
from hpop.criteria.base import Criterion, make_criterion, trajectory_costs
from hpop.errors import OptionError, QueryError
from hpop.options import MOST_SEED, set_wholes
from hpop.planners.base import Candidates, Objectives, edge_objectives, planner
from hpop.planners.goals import goal_of, start_of
from hpop.planners.needs import on_wheels
from hpop.planners.roadmap import checked_ends
from hpop.planners.rrt_query import Query
from hpop.planners.rrt_run import Run, load_ompl, run
from hpop.planners.trust import judge
from hpop.status import Budget, Progress, ProgressCallback, Status
from hpop.sweep import Sweep
from hpop.text import shown

if TYPE_CHECKING:
    from hpop.problem import Problem

Keep = Literal["selected", "all"]
MOST_RUNS = 100_000


@planner("rrt")
@dataclass(frozen=True)
class RRT:
    """Random trajectories under wheel accelerations; of all runs, the one with the fewest curvature sign changes.

    runs            count  of trees, each with its own random numbers (the paper: 1000)
    seed                   of the random numbers
    keep                   "selected": that one alone, ties by length; "all": every run's, for the front to filter
    max_extensions  count  of a tree before its run gives up
    time_limit      s      of all runs, looked at between them; those finished until then are selected from

    The reference of the study in Becerra et al. 2020 (arXiv 2002.10696); how its trees grow is our choice. They are
    OMPL's (Sucan, Moll and Kavraki 2012), their drives those of :mod:`hpop.planners.rrt_query`. Wheel accelerations are
    bounded so that the base keeps the model's speed, turn rate and accelerations; it never goes back.

    Accepts any criteria, not all of them with memory; start and goal where the circle that the robot sweeps is clear,
    since it plans for that circle. Guarantees nothing of any cost, nor that a path that exists is found; trajectories
    begin and end at rest, exactly at start and goal, and are free of collisions. Costs about half a second a run in a
    building, memory for one tree; the results are the same with any executor.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move", "rigid", "wheels"})

    runs: int = 100
    seed: int = 0
    keep: Keep = "selected"
    max_extensions: int = 20_000
    time_limit: float | None = None

    def __post_init__(self) -> None:
        set_wholes(self, "runs", least=1, most=MOST_RUNS)
        set_wholes(self, "seed", least=0, most=MOST_SEED)
        set_wholes(self, "max_extensions", least=1)
        if not isinstance(self.keep, str) or self.keep not in get_args(Keep):
            raise OptionError(f"keep of rrt is 'selected' or 'all', got {shown(self.keep)}")
        Budget(self.time_limit)

    def solve(
        self, problem: Problem, progress: ProgressCallback | None = None, executor: Executor | None = None
    ) -> Candidates:
        """Run the trees, one job of the executor each, and select.

        Raises OptionError without OMPL, QueryError when start or goal is blocked, or when people move.
        """
        load_ompl()
        query, objectives = self._query(problem), edge_objectives(problem.criteria, "rrt")
        began = time.perf_counter()
        finished: dict[int, Run] = {}

        def late() -> bool:
            return self.time_limit is not None and time.perf_counter() - began > self.time_limit

        def report() -> None:
            if progress:
                found = sum(not one.failure for one in finished.values())
                seconds = time.perf_counter() - began
                progress(Progress("rrt", len(finished), self.runs - len(finished), found, seconds=seconds))

        status = Status.COMPLETE
        with Sweep(run, query, executor) as sweep:
            try:
                report()
                for i, one in sweep.run(self._seeds(), late):
                    finished[i] = one
                    report()
                if len(finished) < self.runs:
                    status = Status.TIME_LIMIT
            except KeyboardInterrupt:
                status = Status.INTERRUPTED
        ended = _Ended(self, problem, objectives, query, dict(sorted(finished.items())), status, tuple(sweep.notes))
        return ended.candidates(time.perf_counter() - began)

    def _seeds(self) -> list[int]:
        """Seeds of the runs; OMPL takes no 0."""
        return [1 + int(np.random.SeedSequence((self.seed, i)).generate_state(1)[0] >> 1) for i in range(self.runs)]

    def _query(self, problem: Problem) -> Query:
        moving = [p.name or f"number {i}" for i, p in enumerate(problem.world.content.people) if p.moves]
        if moving:
            raise QueryError(
                f"rrt plans round people who stand; {', '.join(moving)} move. Give them no velocity to plan round "
                "where they are now, or leave them out and evaluate the criteria on the trajectory in the world with "
                "them."
            )
        checked_ends(problem)
        model, start, goal = on_wheels(problem.model), start_of(problem), goal_of(problem, "rrt")
        collision = model.collision(problem.world)
        for what, (x, y, _) in (("start", start), ("goal", goal)):
            if not collision.clear(np.array([x]), np.array([y]))[0]:
                raise QueryError(
                    f"the {what} ({x:.3f}, {y:.3f}) leaves rrt no room: it plans for the circle that the robot sweeps "
                    "in turning, and that meets an obstacle there. Move it, or use another planner."
                )
        return Query(model, problem.world, start, goal, self.max_extensions)


@dataclass(frozen=True, eq=False)
class _Ended:
    """Runs that are over, and what is made of them."""

    planner: RRT
    problem: Problem
    objectives: Objectives
    query: Query
    finished: dict[int, Run]
    status: Status
    notes: tuple[str, ...]

    def candidates(self, seconds: float) -> Candidates:
        """Judge the runs' trajectories, and select."""
        reached = [i for i, one in self.finished.items() if not one.failure]
        trajectories = [self.query.trajectory(self.finished[i].controls) for i in reached]
        optimised = self.objectives.optimised
        judged = judge(self.problem, optimised, trajectories)
        trusted = judged.kept.tolist()
        both = trajectory_costs(self._selecting, [trajectories[j] for j in trusted], self.problem.world)
        chosen = trusted
        if self.planner.keep == "selected" and trusted:
            chosen = [trusted[np.lexsort((both[:, 1], both[:, 0]))[0]]]
        sign_changes = dict(zip(trusted, both[:, 0].astype(int).tolist(), strict=True))
        failed = Counter(one.failure for one in self.finished.values() if one.failure)
        seeds = self.planner._seeds()
        return Candidates(
            objectives=optimised,
            trajectories=tuple(trajectories[j] for j in chosen),
            # A tree adds up no costs; these are what its trajectories were judged by.
            planned=judged.costs[chosen],
            tolerance=np.zeros((len(chosen), len(optimised))),
            status=Status.RUN_LIMIT if self.status is Status.COMPLETE and not chosen else self.status,
            certificate=self._claim(len(trusted)),
            provenance=tuple(
                {
                    "planner": "rrt",
                    "seed": self.planner.seed,
                    "run": reached[j],
                    "run_seed": seeds[reached[j]],
                    "extensions": self.finished[reached[j]].extensions,
                    "curvature_sign_changes": sign_changes[j],
                }
                for j in chosen
            ),
            notes=(*self._said(both[:, 0], failed), *judged.notes("rrt"), *self.notes),
            filters=self.objectives.filters,
            stats={
                "planner": "rrt",
                "runs": len(self.finished),
                "reached": len(reached),
                "failed": dict(failed),
                "dropped": judged.dropped,
                "extensions": sum(one.extensions for one in self.finished.values()),
                "curvature_sign_changes": list(sign_changes.values()),
                "seconds": seconds,
            },
        )

    @property
    def _selecting(self) -> list[Criterion]:
        """Curvature sign changes, as the problem defines them if it asks for them, and the length."""
        return [
            next((c for c in self.problem.criteria if c.name == name), make_criterion(name))
            for name in ("curvature_sign_changes", "length")
        ]

    def _claim(self, count: int) -> str:
        """What is claimed, in words."""
        runs = f"{len(self.finished)} random runs (seed {self.planner.seed}), of which {count} reached the goal"
        if self.planner.keep == "all":
            return f"rrt: a baseline, no optimum of any cost: {runs}"
        return f"rrt: a baseline, no optimum of any cost: the fewest curvature sign changes of {runs}"

    def _said(self, sign_changes: FloatArray, failed: Counter[str]) -> tuple[str, ...]:
        """What became of the runs."""
        runs = len(self.finished)
        notes = [f"rrt: {count} of {runs} runs {failure}" for failure, count in sorted(failed.items())]
        if sign_changes.size:
            least, most = int(sign_changes.min()), int(sign_changes.max())
            times = f"{least}" if least == most else f"{least} to {most}"
            notes.append(f"rrt: curvature changes its sign {times} times on the {sign_changes.size} found")
        elif runs:
            notes.append("rrt found nothing, which does not mean that there is no path; take more runs or extensions")
        else:
            notes.append("rrt: the time was up before a run was finished; give it more")
        return tuple(notes)
