"""Graph of the any-angle planner: the corners of lattice paths, linked wherever the robot can go straight."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.math import wrap
from hpop.base.options import LEAST, set_wholes
from hpop.base.text import set_python_values
from hpop.criteria.visits import Visits, all_visits, missed_weights
from hpop.goals import checked_goal
from hpop.motions import HOLD, Motions, States
from hpop.motions.laws import CHANGE
from hpop.planners.base import Candidates, Planner, joined, make_planner
from hpop.planners.graphs.family import BuiltGraph, GraphFamily, NotBuilt, graph_family
from hpop.planners.graphs.joined_ends import HEADING_TOLERANCE, UNMOVED, Ends
from hpop.planners.graphs.lattice import LatticeGraph
from hpop.planners.graphs.roadmap.headings import SAME, StateRoadmap, checked_ends, pairs
from hpop.planners.judgement import evaluable_in_time
from hpop.planners.needs import goals_of, in_plane, start_of
from hpop.planners.objectives import Objectives
from hpop.planners.spending import Exhausted, Spending, stopped
from hpop.runtime.limits import Budget, ProgressCallback, Status
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

CLOCKED = 1e-9  # s: rounding error of times


@graph_family("corners")
@dataclass(frozen=True)
class CornersGraph(GraphFamily):
    """Visibility roadmap: the corners of a lattice's non-dominated paths, linked where the robot can go straight.

    step           m  distance between neighbouring positions of the lattice
    headings       number of headings of the lattice: 4, 8 or 16
    max_positions  largest number of corners that are used, first those shared by most paths of the lattice; None: all

    First the lattice is searched exactly, within half of the time limit; among moving people with a clock of 1/20 s and
    no margin. The corners of its paths are the positions at which a path turns, holds, changes its speed or visits a
    stop, and those at which it still bends when it is shortened like a taut string.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move", "rigid"})
    is_remade: ClassVar[bool] = False  # the corners depend on the paths of the lattice

    step: float = 0.25
    headings: int = 8
    max_positions: int | None = 200

    def __post_init__(self) -> None:
        set_python_values(self)
        LatticeGraph(self.step, self.headings)
        set_wholes(self, "max_positions", least=0, optional=True)

    def has_clock(self, problem: Problem) -> bool:
        """Return True: the graph can be searched in time steps, since the robot can wait at its positions."""
        return True

    def build(self, problem: Problem, objectives: Objectives, spending: Spending) -> BuiltGraph:
        """Search the lattice, then build the roadmap of the corners of its paths.

        Raises NotBuilt, with the lattice paths, if the lattice has no path, or if Ctrl-C or a limit stops building.
        """
        begun = time.perf_counter()
        budget, limit, progress = spending.limits, spending.limits.time_limit, spending.limits.progress
        half = None if limit is None else max(LEAST, 0.5 * limit)  # the other half is for the roadmap
        lattice_paths, until = _lattice_paths(self._lattice(budget, half), problem, progress), spending.until_limit()
        if (
            not lattice_paths.trajectories
            and lattice_paths.status is Status.TIME_LIMIT
            and until is not None
            and until > 0.0
        ):
            all_left = problem.read_seconds + until
            lattice_paths = _lattice_paths(self._lattice(budget, all_left), problem, progress)
        if lattice_paths.status is Status.INTERRUPTED or not lattice_paths.trajectories:
            raise NotBuilt(_without_roadmap(lattice_paths))
        seconds = time.perf_counter() - begun
        try:
            affordable = _affordable_paths(problem, lattice_paths, spending)
            problem = _with_lattice_headings(problem, affordable.trajectories)
            roadmap, notes = self.roadmap(problem, affordable, spending)
            ends = Ends(roadmap, roadmap.start, roadmap.goals)
        except KeyboardInterrupt:
            raise NotBuilt(_without_roadmap(replace(lattice_paths, status=Status.INTERRUPTED))) from None
        except Exhausted as stop:
            ended = stopped("any-angle", objectives, stop, spending)
            notes = tuple(dict.fromkeys((*lattice_paths.notes, *ended.notes)))
            raise NotBuilt(_without_roadmap(replace(lattice_paths, status=stop.status, notes=notes))) from None
        if affordable is not lattice_paths:
            notes += (_few_paths_note(len(affordable.trajectories), len(lattice_paths.trajectories)),)
        stats = {"lattice_points": len(affordable.trajectories), "lattice_seconds": seconds}
        return BuiltGraph(
            ends, problem, notes, status=affordable.status, stats=stats, first=_without_roadmap(lattice_paths)
        )

    def _lattice(self, budget: Budget, time_limit: float | None) -> Planner:
        """Return the lattice planner that finds the paths for the corners, with a time limit in s.

        budget  limits on labels and memory
        """
        options = {"time_limit": time_limit, "max_labels": budget.max_labels, "max_memory": budget.max_memory}
        return make_planner({"lattice": {"step": self.step, "headings": self.headings, **options}})

    def roadmap(
        self, problem: Problem, lattice_paths: Candidates, spending: Spending | None = None
    ) -> tuple[StateRoadmap, tuple[str, ...]]:
        """Return the roadmap of the corners of some lattice paths, and notes: one if some corners are left out."""
        ends = checked_ends(problem)
        corners = _corners(problem, lattice_paths.trajectories, ends.positions)
        positions = np.concatenate([ends.positions, corners[: self.max_positions]])
        count = len(positions) - len(ends.positions)
        incomplete = "" if lattice_paths.status.is_final else f"incomplete ({lattice_paths.status}) "
        roadmap = StateRoadmap(
            in_plane(problem.model),
            problem.world,
            positions,
            pairs(len(positions)),
            start_of(problem)[2],
            ends.goals,
            name=f"the visibility roadmap of {count} corners of the {incomplete}front of "
            f"{LatticeGraph(self.step, self.headings).lattice(problem).words}",
            chosen={"step": self.step, "headings": self.headings, "corners": count},
            remedy="take a smaller step, or a larger max_positions",
            spending=spending or Spending(),
        )
        few = (
            f"any-angle: only {count} of {len(corners)} corners are used (max_positions), those that most of the "
            "lattice's paths share"
        )
        return roadmap, (few,) if count < len(corners) else ()


def _lattice_paths(lattice: Planner, problem: Problem, progress: ProgressCallback | None) -> Candidates:
    """Run the lattice planner and return its paths: the exact result, or the paths of all stages before a limit."""
    result: Candidates | None = None
    for stage in lattice.stages(problem, progress):
        result = stage if stage.status.is_final else joined(result, stage)
    assert result is not None  # there is at least one stage
    return result


def _without_roadmap(lattice_paths: Candidates) -> Candidates:
    """Return the lattice paths as the result of the planner, with a note that the roadmap was not searched."""
    words = (
        "so these are the paths of the lattice"
        if lattice_paths.trajectories
        else "since there is no lattice path from which to build it"
    )
    return replace(lattice_paths, notes=(*lattice_paths.notes, f"any-angle: the roadmap was not searched, {words}"))


def _affordable_paths(problem: Problem, lattice_paths: Candidates, spending: Spending) -> Candidates:
    """Return so many of the lattice paths that computing their corners takes at most a fifth of the remaining time.

    A few paths are returned even if that takes longer.
    """

    def left() -> float | None:
        return None if (until := spending.until_limit()) is None else until / 5

    ends = checked_ends(problem).positions
    return evaluable_in_time(lattice_paths, left, lambda paths: _corners(problem, paths.trajectories, ends))


def _few_paths_note(some: int, all_: int) -> str:
    """Return a note for the user that only ``some`` of the ``all_`` lattice paths were used, for lack of time."""
    return (
        f"any-angle: the corners of only {some:,} of the {all_:,} lattice paths were used, as the time limit was near; "
        "raise time_limit to use all"
    )


def _with_lattice_headings(problem: Problem, trajectories: Sequence[Trajectory]) -> Problem:
    """Return the problem with the yaws of its start and goals replaced by those of the lattice's paths.

    A yaw written with few decimals may differ slightly from the heading of the lattice that it stands for. A free yaw
    of a goal stays free, and one of several goals stays as it is if no path ends there.
    """
    (x, y, _), goals = start_of(problem), list(goals_of(problem))
    for i, (goal_x, goal_y, yaw) in enumerate(goals):
        for states in (trajectory.states for trajectory in trajectories):
            off = math.hypot(states.x[-1] - goal_x, states.y[-1] - goal_y)
            if yaw is not None and (
                len(goals) == 1 or (off <= UNMOVED and abs(wrap(states.yaw[-1] - yaw)) <= HEADING_TOLERANCE)
            ):
                goals[i] = (goal_x, goal_y, float(states.yaw[-1]))
                break
    return replace(
        problem, start=(x, y, float(trajectories[0].states.yaw[0])), goal=checked_goal(goals, problem.model.space)
    )


def _corners(problem: Problem, trajectories: Sequence[Trajectory], ends: FloatArray) -> FloatArray:
    """Return the corners (n, 2), m, of lattice paths.

    Corners are the positions at which a path turns, holds, changes its speed, visits a stop or ends, and those at which
    it bends when it is shortened like a taut string. Corners that most paths share come first. Positions in ``ends``
    (E, 2), m, are left out.
    """
    points, marked = [], []
    tour, visits = problem.tour, [Visits()] * len(trajectories)
    if tour is not None:
        visits = all_visits(tour, problem.world, trajectories, missed_weights(problem.criteria))
    for t, visited in zip(trajectories, visits, strict=True):
        stops = [int(np.searchsorted(t.times, visit.begin - CLOCKED)) for visit in visited.visits]
        at = [*(i for i, kind in enumerate(t.kinds) if kind == "move"), len(t)]
        points.append(np.stack([t.states.x, t.states.y], axis=1)[at])
        turned = ("turn", HOLD.kind, CHANGE, *(pace.get("turn") for pace in problem.model.paces))
        marked.append([i in stops or i == len(t) or (i > 0 and t.kinds[i - 1] in turned) for i in at])
    path = np.repeat(np.arange(len(points)), [len(p) for p in points])
    along = np.concatenate(points)
    corner = np.concatenate(marked) | _bends(problem, along, path)
    once_a_path = np.unique(np.column_stack([path, along])[corner], axis=0)
    corners, shared = np.unique(once_a_path[:, 1:], axis=0, return_counts=True)
    corners = corners[np.argsort(-shared, kind="stable")]
    apart: FloatArray = np.hypot(*(corners[:, None] - ends).transpose(2, 0, 1)).min(axis=1)
    return np.asarray(corners[apart > SAME])


def _bends(problem: Problem, along: FloatArray, path: IntArray) -> BoolArray:
    """Return at which positions (N,) paths still bend when they are shortened like a taut string.

    The next bend is the last position to which the robot can go straight from the bend before, or from the start. All
    paths are followed together, one position in each round.

    along  (N, 2)  positions of all paths, one path after another, m
    path   (N,)    number of the path to which each position belongs
    """
    collision, law = problem.model.collision(problem.world), problem.model.laws["move"]

    def in_sight(tails: IntArray, heads: IntArray) -> BoolArray:
        """Return whether the robot can go straight from each position in ``tails`` to that in ``heads``."""
        (x, y), (to_x, to_y) = along[tails].T, along[heads].T
        yaw = np.arctan2(to_y - y, to_x - x)
        start, end = States(x=x, y=y, yaw=yaw), States(x=to_x, y=to_y, yaw=yaw)
        return collision.motions_free(Motions(problem.world, problem.model, law, start, end))

    bends = np.zeros(path.size, dtype=bool)
    last = np.flatnonzero(np.diff(path, prepend=-1))
    onward = last + 1
    while True:
        going = np.append(path, -1)[onward] == path[last]
        last, onward = last[going], onward[going]
        if not last.size:
            return bends
        seen = (onward == last + 1) | in_sight(last, onward)
        last = np.where(seen, last, onward - 1)
        bends[last[~seen]] = True
        onward = onward + seen
