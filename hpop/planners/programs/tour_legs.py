"""Tours improved leg by leg: the motions between two stops of a known tour are a problem of their own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.text import counted
from hpop.criteria.base import Criterion
from hpop.criteria.costs import trajectory_costs
from hpop.criteria.visits import all_visits, missed_weights
from hpop.errors import OptionError
from hpop.goals.approach import split
from hpop.motions import HOLD, States
from hpop.motions.by_law import extras
from hpop.motions.laws import CLOCK
from hpop.planners.base import Candidates, motions_key
from hpop.planners.judgement import trusted
from hpop.planners.needs import refuse_moving
from hpop.planners.objectives import edge_objectives
from hpop.planners.programs.warm_starts import Starting, known_tours
from hpop.runtime.limits import ProgressCallback, Status, Watch
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

CLOCKED = 1e-6  # s by which the time of a visit may differ from that of a state


class TourLegs(NamedTuple):
    """Tour cut at the states where it visits a stop or holds.

    legs   motions between these states, without holds; empty ones are left out
    holds  (number of legs + 1,)  s, time for which the robot stands before the first leg, between legs, and at the end
    approaches  whether the last leg is a straight approach to the goal
    """

    legs: tuple[Trajectory, ...]
    holds: tuple[float, ...]
    approaches: bool = False

    @classmethod
    def of(cls, trajectory: Trajectory, visits: Sequence[float], approach: int | None = None) -> TourLegs:
        """Cut a trajectory at its holds, at the times of its visits, s, and where its straight approach begins.

        approach  index of the motion with which the approach begins, holds not counted; None for no approach
        """
        held = np.array([kind == HOLD.kind for kind in trajectory.kinds], dtype=bool)
        before = np.append(0, np.cumsum(~held))  # motions without holds before each state
        moving = trajectory.without_holds()
        seconds = np.zeros(len(moving) + 1)
        np.add.at(seconds, before[:-1][held], trajectory.durations[held])
        visited = np.searchsorted(trajectory.times, np.array(visits) - CLOCKED).clip(max=len(trajectory))
        last = len(moving) if approach is None else approach
        joints = sorted(
            {0, last, len(moving), *np.flatnonzero(seconds).tolist(), *before[visited.astype(int)].tolist()}
        )
        legs = tuple(_part(moving, begin, end) for begin, end in pairwise(joints))
        return cls(legs, tuple(seconds[joints].tolist()), last < len(moving))

    def joined(self, legs: Sequence[Trajectory]) -> Trajectory:
        """Return the tour with other legs, which must have the ends of its own legs; holds stay."""
        model, kinds, rows = legs[0].model, list[str](), list[dict[str, FloatArray]]()
        names = {name for leg in legs for name in leg.states.names} | {CLOCK}

        def add(states: States, seconds: FloatArray) -> None:
            """Append states (N,), with times since the last state so far; angles go on from there without a jump."""
            columns = {name: states.__dict__.get(name, np.zeros(states.size)) for name in names}
            columns[CLOCK] = seconds
            for name in (CLOCK, *model.space.turning) if rows else ():
                last = rows[-1][name][-1]
                whole = last if name == CLOCK else 2 * np.pi * np.rint((last - columns[name][0]) / (2 * np.pi))
                columns[name] = columns[name] + whole
            rows.append(columns)

        for number, seconds in enumerate(self.holds):
            leg = legs[min(number, len(legs) - 1)]
            clock = leg.states.__dict__.get(CLOCK, np.zeros(len(leg) + 1))
            if not rows:
                add(leg.states.take([0]), np.zeros(1))
            if seconds:
                add(leg.states.take([0 if number < len(legs) else -1]), np.array([seconds]))
                kinds.append(HOLD.kind)
            if number < len(legs):
                add(leg.states, clock - clock[0])
                rows[-1] = {name: column[1:] for name, column in rows[-1].items()}
                kinds += leg.kinds
        columns = {name: np.concatenate([row[name] for row in rows]) for name in names}
        needed = (*model.space.names, *extras(model, tuple(kinds)))
        return Trajectory(model, States(**{name: columns[name] for name in needed}), tuple(kinds))


def _part(trajectory: Trajectory, begin: int, end: int) -> Trajectory:
    """Return the motions of a trajectory from state ``begin`` to state ``end``, both given by index."""
    model, kinds = trajectory.model, trajectory.kinds[begin:end]
    rows: IntArray = np.arange(begin, end + 1)
    columns, names = trajectory.states.take(rows).__dict__, (*model.space.names, *extras(model, kinds))
    return Trajectory(model, States(**{name: columns[name] for name in names}), kinds)


def improved_tours(
    name: str,
    planner: Starting,
    problem: Problem,
    progress: ProgressCallback | None,
    executor: Executor | None,
    *,
    keeps: bool = False,
) -> Candidates:
    """Improve each leg of known tours by a planner of nonlinear programs, and return the tours with the new legs.

    A leg is the part of a tour between two stops or holds. The states at which stops are visited, their order, all
    holds and a straight approach to the goal stay. Known tours that do not complete their visits are left out. A leg
    that several tours share is improved once. A leg without a result, also because of a time limit or Ctrl-C, stays as
    it was, and a note says so. If the planner returns several results for legs, there is a tour with the first of each,
    one with the second (or last), and so on. All costs are evaluated along whole tours.

    keeps  whether the known tours are returned too
    """
    assert problem.tour is not None
    refuse_moving(problem, f"{name} on a tour")
    watch = Watch(name, planner.time_limit, progress)
    objectives = edge_objectives(problem.criteria, name)
    known = known_tours(planner, problem, progress, executor, watch.left)
    if known.interrupted is not None:
        return known.interrupted
    visits = all_visits(problem.tour, problem.world, known.trajectories, missed_weights(problem.criteria))
    whole = [tour for tour, found in zip(known.trajectories, visits, strict=True) if found.complete]
    approach = [split(problem.target, tour.without_holds(), problem.world) for tour in whole]
    tours = [
        TourLegs.of(tour, [visit.begin for visit in found.visits], last)
        for tour, found, last in zip(whole, (found for found in visits if found.complete), approach, strict=True)
    ]
    criteria = [criterion for criterion in problem.criteria if criterion.role != "stops_missed"]
    fixed = {motions_key(tour.legs[-1]) for tour in tours if tour.approaches}
    legs = {motions_key(leg): leg for tour in tours for leg in tour.legs}
    todo = [key for key, leg in legs.items() if _moves(leg) and key not in fixed]
    improved: dict[Any, list[Trajectory]] = {}
    notes, tried, status = Counter[str](), 0, known.status
    for key in todo:
        left = watch.left
        if watch.is_late():
            status = Status.TIME_LIMIT
            break
        found = _improved(planner, problem, criteria, legs[key], left, executor)
        if found.status in (Status.TIME_LIMIT, Status.INTERRUPTED):
            status = found.status
            break
        tried += 1
        if better := [each for each in found.trajectories if motions_key(each) != key]:
            improved[key] = better
        notes.update(found.notes)
        watch.report(tried, len(todo) - tried, 0)
    trajectories, origins = list[Trajectory](), list[dict[str, Any]]()
    for i, (known_tour, tour) in enumerate(zip(whole, tours, strict=True)):
        choices = [improved.get(motions_key(leg), [leg]) for leg in tour.legs]
        count = max(map(len, choices), default=0)
        trajectories += [tour.joined([each[min(k, len(each) - 1)] for each in choices]) for k in range(count)]
        trajectories += [known_tour] * keeps
        origins += [{"warm_start": i}] * count + [{"warm_start": i, "known": True}] * keeps
    costs = trajectory_costs(objectives.optimised, trajectories, problem.world)
    claim = "proved free of collisions, a local improvement" if keeps else "a local optimum near its warm start"
    failed, untried = tried - len(improved), len(todo) - tried
    accepted = trusted(
        Candidates(
            objectives=objectives.optimised,
            trajectories=tuple(trajectories),
            planned=costs,
            tolerance=np.zeros_like(costs),
            status=status,
            certificate=(
                f"{name}: tours improved leg by leg, {problem.tour.words}: each improved leg is {claim} with fixed ends"
                "; states at stops and their order are those of the warm starts, so better tours may exist"
                f"{objectives.certificate}"
            ),
            provenance=tuple(origins),
            notes=(
                *objectives.notes,
                *known.notes,
                *(f"{note} ({counted(count, 'leg')})" for note, count in notes.items()),
                *([f"{counted(failed, 'leg')} could not be improved and stayed as before"] if failed else []),
                *([f"{status}: {counted(untried, 'leg')} stayed as before"] if untried else []),
            ),
            filters=objectives.filters,
            stats={"planner": name, "warm_starts": len(tours), "legs": len(todo), "improved": len(improved)},
        ),
        problem,
        name,
    )
    return replace(accepted, stats={**accepted.stats, "seconds": watch.seconds})


def _moves(leg: Trajectory) -> bool:
    """Return whether a leg changes its position or, without a base, its joints, so that a program can improve it."""
    names = {"x", "y"} & {*leg.model.space.names} or leg.model.space.names
    return any(np.ptp(getattr(leg.states, name)) > 0.0 for name in names)


def _improved(
    planner: Any,
    problem: Problem,
    criteria: Sequence[Criterion],
    leg: Trajectory,
    left: float | None,
    executor: Executor | None,
) -> Candidates:
    """Solve the problem of one leg, from its first to its last state, with the leg as warm start.

    left  remaining seconds; None for no time limit
    """
    start, goal = (problem.model.space.values(leg.states.take([place])) for place in (0, -1))
    alone = type(problem)(problem.world, problem.model, start, goal, criteria)
    found: Candidates = replace(planner, warm_start=[leg], time_limit=left).solve(alone, None, executor)
    return found


def refuse_bounds(name: str, options: Mapping[str, Any]) -> None:
    """Raise OptionError for options that bound whole paths, which a tour improved leg by leg cannot keep."""
    if given := [option for option, value in options.items() if value]:
        raise OptionError(
            f"{name} improves a tour leg by leg, so bounds on whole paths cannot be set: leave out {', '.join(given)}, "
            "and select from the front instead"
        )
