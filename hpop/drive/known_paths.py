"""Paths and trajectories to the goal of a drive that earlier searches found, the latter checked again among people."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.costs import trajectory_costs
from hpop.criteria.visits import all_visits, missed_weights
from hpop.drive.closings import Closing
from hpop.drive.options import Commit
from hpop.drive.plan import SAME, closed_trajectories, joined, part, speed_of
from hpop.frontier import is_nondominated
from hpop.motions import States
from hpop.planners.base import Candidates
from hpop.planners.graphs.timed.clock import GOLDEN
from hpop.planners.graphs.trajectory_graph import NO_MARKER
from hpop.planners.objectives import Objectives
from hpop.runtime.limits import Status
from hpop.search import Graph
from hpop.trajectories.contacts import first_contact
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.planners.graphs.trajectory_graph import TrajectoryGraph
    from hpop.problems.problem import Problem


@dataclass(frozen=True, eq=False)
class KnownRoutes:
    """Paths to the goal that are known from earlier searches, with the remaining cost from each of their nodes.

    The S arcs are listed path by path. If areas have only been closed since, open remaining parts of optimal paths are
    still optimal, as there are fewer alternatives.

    tails, arcs     (S,)    tail node and index of each arc
    ends            (S,)    index in this list after the last arc of the same path
    remaining_cost  (S, k)  in quanta (smallest cost steps), from the tail of each arc to the goal
    closed          (S,)    whether this arc or a later one of the path is closed
    """

    tails: IntArray
    arcs: IntArray
    ends: IntArray
    remaining_cost: IntArray
    closed: BoolArray

    @classmethod
    def of(cls, paths: Sequence[IntArray], tails: IntArray, graph: Graph, closed: BoolArray) -> KnownRoutes:
        """Build known paths from the indices of the arcs of each path.

        tails, closed  (m,) tail of each arc of the graph, and whether the arc is closed
        """
        arcs = np.concatenate([np.zeros(0, np.int64), *paths])
        sizes = [path.size for path in paths]
        last = np.cumsum(np.array(sizes, np.int64))
        remaining_cost = np.empty((arcs.size, graph.criteria), np.int64)
        is_closed = np.empty(arcs.size, dtype=np.bool_)
        worst = np.array(graph.aggregates) == "max"
        for end, size in zip(last.tolist(), sizes, strict=True):
            own = slice(end - size, end)
            costs = graph.costs[arcs[own]][::-1]
            remaining_cost[own] = np.where(worst, np.maximum.accumulate(costs), np.cumsum(costs, axis=0))[::-1]
            is_closed[own] = np.logical_or.accumulate(closed[arcs[own]][::-1])[::-1]
        return cls(tails[arcs], arcs, np.repeat(last, sizes), remaining_cost, is_closed)

    def remaining(self, node: int) -> list[IntArray]:
        """Return the arcs of each known path's part from a node to the goal, for parts that are open.

        Parts that another of them dominates are left out.
        """
        steps = np.flatnonzero((self.tails == node) & ~self.closed)
        steps = steps[is_nondominated(self.remaining_cost[steps])] if steps.size else steps
        return [self.arcs[step : self.ends[step]] for step in steps.tolist()]


RECHECK = 0.05  # s of processor time in which known paths are checked again, even if the deadline is shorter
ROUNDING = 1e-6  # m, rad or m/s: smaller differences between states of a trajectory and of a graph are rounding
CLAIM = (
    "incomplete: known paths, checked again with the present people and closed areas; points need not be optimal, "
    "and others, better by an unknown factor, may be missing until the graph is built: call options again"
)


def remaining_from(trajectories: Iterable[Trajectory], state: States) -> Iterator[Trajectory]:
    """Yield the part of each trajectory from its last visit to a state (1,) on, if it visits the state."""
    for trajectory in trajectories:
        at_state = np.abs(speed_of(trajectory.states) - speed_of(state)) <= SAME
        rows = np.zeros(len(trajectory) + 1, np.int64)
        for off in trajectory.model.space.differences(state.take(rows), trajectory.states).values():
            at_state &= np.abs(off) <= SAME
        last = np.flatnonzero(at_state)
        if last.size and last[-1] < len(trajectory):
            yield part(trajectory, int(last[-1]), len(trajectory))


def clear_trajectories(
    trajectories: Iterable[Trajectory],
    problem: Problem,
    before: Trajectory,
    closings: Sequence[Closing],
    margin: float,
    latest: float | None,
    enough: Callable[[], bool],
) -> Iterator[Trajectory]:
    """Yield the trajectories that are clear of closed areas and people, as planned and as executed.

    problem  with the people, as predicted from the time at which the trajectories begin
    before   trajectory that the robot drives before each of them; it need not end at rest
    margin   m, distance to keep from moving people
    latest   s, longest duration of a trajectory; None for any
    enough   function that returns True when checking must end
    """
    parts, people = problem.model.platform, problem.world.content.people
    for trajectory in trajectories:
        if enough():
            return
        if (latest is not None and trajectory.duration > latest) or closed_trajectories([trajectory], closings).any():
            continue
        driven = joined(before, trajectory)
        cases = product((driven, driven.execution()), {0.0, margin})
        if not any(first_contact(parts, people, motion, least, begin=before.duration) for motion, least in cases):
            yield trajectory


def clear_remaining(
    trajectories: Sequence[Trajectory],
    problem: Problem,
    commit: Commit,
    checks: tuple[Sequence[Closing], float, float | None],
    seconds: float,
) -> Iterator[Trajectory]:
    """Yield the trajectories' parts after a commit that are open and clear of people, checked for ``seconds`` s.

    checks  closed areas, margin and latest duration of :func:`clear_trajectories`

    Checking lasts at least `RECHECK` s of processor time. Plans that were not checked in time are left out.
    """
    until, least = time.perf_counter() + seconds, time.thread_time() + RECHECK

    def enough() -> bool:
        return time.perf_counter() >= until and time.thread_time() >= least

    spread = sorted(range(len(trajectories)), key=lambda i: i * GOLDEN % 1.0)  # neighbours in a front are similar
    remaining = remaining_from((trajectories[i] for i in spread), commit.state)
    yield from clear_trajectories(remaining, problem, commit.before, *checks, enough)


def rechecked(name: str, problem: Problem, objectives: Objectives, trajectories: Sequence[Trajectory]) -> Candidates:
    """Return trajectories as candidates of the planner ``name``, without a claim of optimality."""
    criteria = objectives.optimised
    costs = trajectory_costs(criteria, trajectories, problem.world) if trajectories else np.zeros((0, len(criteria)))
    origin: dict[str, Any] = {"planner": name, "known": True}
    return Candidates(
        objectives=criteria,
        trajectories=tuple(trajectories),
        planned=costs,
        tolerance=np.zeros(costs.shape),
        status=Status.TIME_LIMIT,
        certificate=f"{name}: {CLAIM}{objectives.certificate}",
        provenance=(origin,) * len(trajectories),
        notes=objectives.notes,
        filters=objectives.filters,
        stats={"planner": name, "labels_generated": 0, "gap": None},
    )


class ReplanResult(NamedTuple):
    """Result of a search from the place where a drive may change its plan.

    candidates  the remaining plans found, with their claim of optimality
    gap     for every missing cost vector, a returned one is at most a factor 1 + gap worse
    labels  number of partial paths that the search generated
    answer  if a deadline ended the search, its result as JSON, so that it can be repeated; else None
    unreachable  names of the stops of a tour that must still be visited but cannot be reached
    """

    candidates: Candidates
    gap: float
    labels: int
    answer: dict[str, Any] | None
    unreachable: tuple[str, ...] = ()


def described(trajectories: Sequence[Trajectory]) -> dict[str, Any]:
    """Return trajectories as a dict for the log of a drive, from which the drive can be repeated."""
    return {"ways": [trajectory.describe() for trajectory in trajectories]}


def known_result(
    name: str, problem: Problem, objectives: Objectives, trajectories: Sequence[Trajectory]
) -> ReplanResult:
    """Return known trajectories as the result of a query, while a graph is being built."""
    candidates = rechecked(name, problem, objectives, complete(problem, trajectories))
    return ReplanResult(of_remaining(candidates, problem), math.inf, 0, described(candidates.trajectories))


def complete(problem: Problem, trajectories: Sequence[Trajectory]) -> Sequence[Trajectory]:
    """Return the trajectories that visit all stops of the problem's tour that must be visited; all without a tour."""
    if problem.tour is None:
        return trajectories
    visits = all_visits(problem.tour, problem.world, trajectories, missed_weights(problem.criteria))
    return [trajectory for trajectory, each in zip(trajectories, visits, strict=True) if each.complete]


def of_remaining(candidates: Candidates, problem: Problem) -> Candidates:
    """Return candidates with the problem's criteria, which count missed stops among those that remain in its tour."""
    own = {criterion.name: criterion for criterion in problem.criteria if problem.tour is not None}
    return replace(candidates, objectives=tuple(own.get(c.name, c) for c in candidates.objectives))


def places_of_nodes(trajectory: Trajectory) -> tuple[IntArray, FloatArray]:
    """Return the states of a trajectory at its nodes (N,), by index, and the speeds (N,), m/s, of these nodes.

    The ends of a turn of a slower class have two nodes each: one at rest, and one with minus the number of the class.
    """
    number = {kind: -i for i, pace in enumerate(trajectory.model.paces[:-1], 1) for kind in pace.values()}
    classes = np.array([number.get(kind, 0) for kind in trajectory.kinds], np.float64)
    slow = np.flatnonzero(classes)
    before_end = np.repeat(slow + 1, 2)  # both further nodes lie between the two states of the turn
    places = np.insert(np.arange(len(trajectory) + 1), before_end, np.stack([slow, slow + 1], axis=1).ravel())
    return places, np.insert(speed_of(trajectory.states), before_end, np.repeat(classes[slow], 2))


def named_heads(graph: Graph, space: TrajectoryGraph) -> NDArray[np.int32]:
    """Return the node (m,) that follows the tail of each arc of a graph in a path: its head, or a marker before it.

    graph  arcs of ``space``
    """
    markers = space.markers
    return graph.heads if markers is None else np.where(markers == NO_MARKER, graph.heads, markers).astype(np.int32)


def arcs_between(graph: Graph, named: NDArray[np.int32], tails: IntArray, heads: IntArray) -> IntArray:
    """Return the arcs (N,) from nodes to the nodes that follow them in a path; -1 where there is none.

    named  (m,)  node that follows the tail of each arc (:func:`named_heads`)
    """
    between = np.full(tails.size, -1)
    here = np.flatnonzero((tails >= 0) & (heads >= 0))
    begins, ends = graph.indptr[tails[here]], graph.indptr[tails[here] + 1]
    for offset in range(int((ends - begins).max(initial=0))):
        arcs = np.minimum(begins + offset, ends - 1)
        hits = (begins + offset < ends) & (named[arcs] == heads[here])
        between[here[hits]] = arcs[hits]
    return between


@dataclass(frozen=True, eq=False)
class GoalJoin:
    """Arcs that connect a state of a graph to a goal beside it: a chain of motions, such as turn, move, turn.

    arcs    (1,) or (2,)  two if the join has a node of its own between its ends (:mod:`hpop.planners.graphs.speeds`)
    states  (p + 1,)  states in which its p motions begin and end, with their speeds if there are several
    kinds   kinds of the p motions
    """

    arcs: IntArray
    states: States
    kinds: tuple[str, ...]

    def is_end_of(self, trajectory: Trajectory, place: int) -> bool:
        """Return whether a trajectory consists of these motions from its state of index ``place`` on."""
        if trajectory.kinds[place:] != self.kinds:
            return False
        states, space = trajectory.states.take(np.arange(place, len(trajectory) + 1)), trajectory.model.space
        apart = [*space.differences(self.states, states).values(), speed_of(states) - speed_of(self.states)]
        return bool((np.abs(apart) <= ROUNDING).all())


def joins_to_goals(
    graph: Graph, space: TrajectoryGraph, tails: IntArray, named: NDArray[np.int32], goals: IntArray
) -> dict[int, list[GoalJoin]]:
    """Return all joins that lead to some goals, by the node at which they begin.

    graph         arcs of ``space``
    tails, named  (m,)  tail of each arc, and the node that follows it in a path (:func:`named_heads`)
    goals         goals that were added to the states of the graph
    """
    last = np.flatnonzero(np.isin(graph.heads, goals))
    middle = space.is_join(tails[last])
    into = {int(graph.heads[arc]): arc for arc in np.flatnonzero(np.isin(graph.heads, tails[last[middle]])).tolist()}
    chains, paths = list[list[int]](), list[list[int]]()
    for arc, is_second in zip(last.tolist(), middle.tolist(), strict=True):
        chains.append([into[int(tails[arc])], arc] if is_second else [arc])
        nodes = [int(tails[chains[-1][0]])]
        for each in chains[-1]:
            nodes += dict.fromkeys((int(named[each]), int(graph.heads[each])))
        paths.append(nodes)
    joins = dict[int, list[GoalJoin]]()
    if not paths:
        return joins
    sizes = np.array([len(path) for path in paths], np.int64)
    states, kinds, sizes = space.stretches(np.array([node for path in paths for node in path], np.int64), sizes)
    words, ends = tuple(space.kinds[kind] for kind in kinds.tolist()), np.cumsum(sizes).tolist()
    for chain, path, begin, end in zip(chains, paths, [0, *ends], ends, strict=False):
        join = GoalJoin(np.array(chain), states.take(np.arange(begin, end)), words[begin + 1 : end])
        joins.setdefault(path[0], []).append(join)
    return joins
