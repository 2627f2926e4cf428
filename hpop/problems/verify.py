"""Verification of a front, independent of the planner: costs, start and goal, collisions, contacts and visits."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.options import MOST
from hpop.criteria.base import Criterion
from hpop.criteria.costs import trajectory_costs
from hpop.criteria.visits import Visit, in_stop
from hpop.goals import Tour
from hpop.goals.approach import misses_line, reached_in
from hpop.models.execution import clearance_radius
from hpop.motions import Motions, States, collision_of, free_along
from hpop.motions.states import Values
from hpop.planners.judgement import on_map
from hpop.problems.evaluation import claimable, criteria_of
from hpop.problems.front import Front
from hpop.problems.named_rows import executed_times
from hpop.problems.problem import Problem
from hpop.trajectories.contacts import contact
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory
from hpop.world.content.predictions import with_stops

SAME = 1e-9  # relative: equal costs differ by less if only the order of a sum differs
CLOSE = 1e-5  # m or rad: tolerance for states that were written in decimals
HEADING_CLOSE = 5e-3  # rad: tolerance between a goal's yaw with three decimals and the planner's heading
PROGRESS_EVERY = 100  # number of trajectories between two progress reports
TOGETHER = 2**10  # number of motions that are checked between two progress reports
NUMBER = re.compile(r"^trajectory (\d+)")
SAMPLED, MOST_SAMPLED = 0.1, 3600.0  # s between samples of a visit; s, longest part of a visit that is sampled
DRIVEN = ", as it is executed,"
MOST_TURNED = 1e4  # rad: larger yaws are invalid, and would take too long to check


def verify(
    problem: Problem,
    front: Front,
    *,
    rows: IntArray | None = None,
    library: str = "fcl",
    say: Callable[[str], None] | None = None,
) -> list[str]:
    """Return a text for each fault of a front of this problem; [] if all that it claims is right.

    The check is independent of the planner, except for straight approaches to goals, which are tested by the code that
    planners use. Costs are computed again by the criteria. Collisions are tested by ``library`` at states at most 5 cm
    or 3 degrees apart, those of arms every millimetre. Start and goal are compared with those of the problem, and
    visits of stops with samples of the trajectory and, if it is punctual, of its execution. Contacts with moving people
    are tested every hundredth of a second (:mod:`.contacts`), for the plan and for its execution. A motion that several
    trajectories share is checked once. In fronts of earlier versions the lattice ended at the grid position nearest to
    the goal, with a "goal_offset" in the provenance; an offset of up to half the diagonal of a grid cell is accepted.
    If trajectories leave the map, only these are reported, since their costs cannot be evaluated.

    Parameters
    ----------
    rows : (m,) rows of the trajectories to be checked, ascending; by default all
    library : tests collisions: "fcl" (python-fcl), or for arms "coal" (``pip install 'hpop[coal]'``)
    say : called from time to time with a sentence on the current check and its progress
    """
    if rows is not None:
        return _numbered(verify(problem, _part(front, rows), library=library, say=say), rows)
    if not len(front):
        return [*_declared_faults(problem, front)]
    table = MotionTable.of(front.trajectories)
    if lost := _lost(problem, table):
        return lost
    faults = [*_declared_faults(problem, front), *_cost_faults(problem, front, table, say)]
    for i in np.flatnonzero(_suspects(problem, table)).tolist():
        trajectory = front.trajectories[i]
        faults += [
            f"trajectory {i} {fault}"
            for fault in (
                *_end_faults(problem, trajectory, _offset(front.provenance[i])),
                *problem.model.faults(trajectory),
            )
        ]
    faults += [
        f"trajectory {i} does not end with its straight approach"
        for i, trajectory in enumerate(front.trajectories)
        if misses_line(problem.target, trajectory, problem.world)
    ]
    faults += _visit_faults(problem, front)
    kept = collision_of(problem.model, problem.world).constraint
    wrong = "collides, or does not keep its orientation" if kept else "collides"
    faults += [f"trajectory {i} {wrong}" for i in np.flatnonzero(~_free(problem, table, library, say))]
    return [*faults, *_contacts(problem, front, say)]


def _contacts(problem: Problem, front: Front, say: Callable[[str], None] | None) -> Iterator[str]:
    """Yield a text for each trajectory that touches moving people, or comes nearer than its provenance promises."""
    people = problem.world.content.people
    left = problem.world.content.left
    if not left and not any(person.moves for person in people):
        return
    for i, trajectory in enumerate(front.trajectories):
        if say is not None and i % PROGRESS_EVERY == 0:
            say(f"contacts with moving people in {i:,} of {len(front):,} trajectories")
        margin = front.provenance[i].get("margin")
        kept = min(max(float(margin), 0.0), MOST) if isinstance(margin, int | float) else 0.0
        parts = problem.model.platform
        people = with_stops(
            problem.world.content.people,
            _numbers(front.provenance[i].get("people_who_stop")),
            (float(trajectory.states.x[0]), float(trajectory.states.y[0])),
            clearance_radius(problem.model, kept),
        )
        if fault := contact(parts, people, trajectory, kept, left):
            yield f"trajectory {i} {fault}"
        done = trajectory.execution()
        if done is not trajectory and (fault := contact(parts, people, done, kept, left)):
            yield f"trajectory {i}{DRIVEN} {fault}"


def _visit_faults(problem: Problem, front: Front) -> Iterator[str]:
    """Yield a text for each fault of the visits of a tour's stops that a front records.

    Each visit is checked on samples of its trajectory. In a punctual trajectory, planned among people who move, the
    robot brakes and starts within the planned time of a stand, so it stands for less time than planned. Only there,
    visits with a dwell time are checked on samples of the execution as well.
    """
    tour = problem.tour
    if tour is None:
        return
    sampled: list[list[States]] = [[] for _ in tour.stops]
    owners: list[list[IntArray]] = [[] for _ in tour.stops]
    executed: list[int] = []  # trajectories whose executions are checked, numbered after all trajectories
    for i, (trajectory, origin) in enumerate(zip(front.trajectories, front.provenance, strict=True)):
        visits = _recorded_visits(tour, origin.get("visits"))
        if visits is None:
            yield f"trajectory {i} has no record of its visits"
            continue
        for fault in _order_faults(tour, visits, trajectory.duration):
            yield f"trajectory {i} {fault}"
        made = [(i, "", trajectory, visit) for visit in visits]
        if trajectory.punctual and any(tour.stops[visit.stop].dwell for visit in visits):
            number, (done, passed) = len(front) + len(executed), problem.model.execution(trajectory)
            executed.append(i)
            for visit in visits:
                if dwell := tour.stops[visit.stop].dwell:
                    begin, end = executed_times(visit.begin, visit.end, trajectory, passed)
                    lasts, name = end - begin, tour.names[visit.stop]
                    if lasts < dwell - CLOSE:
                        yield f"trajectory {i}{DRIVEN} stands at stop {name!r} for {lasts:.6g} s"
                    made.append((number, DRIVEN, done, Visit(visit.stop, begin, end)))
        for number, words, way, visit in made:
            lasts = visit.end - visit.begin
            times = np.linspace(visit.begin, visit.end, 2 + int(min(max(lasts, 0.0), MOST_SAMPLED) / SAMPLED))
            states = way.at(times)
            moved = problem.model.space.differences(states.take(np.zeros(times.size, np.int64)), states)
            if any((np.abs(off) > CLOSE).any() for off in moved.values()):
                yield f"trajectory {i}{words} moves while it visits stop {tour.names[visit.stop]!r}"
            sampled[visit.stop].append(states)
            owners[visit.stop].append(np.full(times.size, number))
    for stop, parts, own in zip(tour.stops, sampled, owners, strict=True):
        if not parts:
            continue
        names = problem.model.space.names
        rows = np.stack([np.concatenate([getattr(states, name) for states in parts]) for name in names], axis=1)
        distinct, which = np.unique(rows, axis=0, return_inverse=True)
        inside = in_stop(stop, problem.world, problem.model, States(**dict(zip(names, distinct.T, strict=True))))
        for i in np.unique(np.concatenate(own)[~inside[which.ravel()]]).tolist():
            which_one = f"{i}" if i < len(front) else f"{executed[i - len(front)]}{DRIVEN}"
            yield f"trajectory {which_one} is not at stop {stop.name!r} at the time of the recorded visit"


def _recorded_visits(tour: Tour, recorded: Any) -> list[Visit] | None:
    """Return the visits in the provenance of a trajectory; None if the entry is invalid."""
    try:
        visits = [Visit(tour.names.index(v["stop"]), float(v["begin"]), float(v["end"])) for v in recorded]
    except (TypeError, KeyError, ValueError, OverflowError):
        return None
    return visits if all(math.isfinite(visit.begin + visit.end) for visit in visits) else None


def _order_faults(tour: Tour, visits: Sequence[Visit], duration: float) -> Iterator[str]:
    """Yield a text for each fault in the order and times of visits, such as missing, repeated or too short ones."""
    at = {visit.stop: number for number, visit in enumerate(visits)}
    for j, stop in enumerate(tour.stops):
        if j in tour.done:
            if j in at:
                yield f"visits stop {stop.name!r}, which was done before"
            continue
        if j not in at and not stop.optional:
            yield f"does not visit stop {stop.name!r}"
        for i in tour.before[j]:
            if i not in tour.done and at.get(i, -1) > at.get(j, len(visits)):
                yield f"visits stop {tour.names[i]!r} after {stop.name!r}, against the order"
    if len(at) < len(visits):
        yield "visits a stop twice"
    now = -CLOSE
    for visit in visits:
        if visit.end - visit.begin < tour.stops[visit.stop].dwell - CLOSE:
            yield f"stands at stop {tour.names[visit.stop]!r} for {visit.end - visit.begin:.6g} s only"
        if visit.begin < now - CLOSE or visit.end > duration + CLOSE:
            yield f"visits stop {tour.names[visit.stop]!r} during another visit, or before its start or after its end"
        now = visit.end


def _numbers(given: Any) -> list[int]:
    """Return the indices of people that an entry of a provenance lists; [] if the entry is no list."""
    return [number for number in given if isinstance(number, int)] if isinstance(given, list) else []


def _part(front: Front, rows: IntArray) -> Front:
    """Return the front of the trajectories in some rows (m,)."""
    chosen = np.zeros(len(front), dtype=bool)
    chosen[rows] = True
    return front[chosen]


def _numbered(faults: Sequence[str], rows: IntArray) -> list[str]:
    """Return faults of selected trajectories, numbered by their rows (m,) in the whole front."""
    return [NUMBER.sub(lambda found: f"trajectory {rows[int(found[1])]}", fault) for fault in faults]


def lost_trajectories(problem: Problem, front: Front, rows: IntArray | None = None) -> list[str]:
    """Return a text for each trajectory that leaves the map, or whose angles are too large to be checked.

    Costs of such a trajectory cannot be evaluated.

    rows  (m,) rows of the trajectories to be checked, ascending; by default all
    """
    if rows is not None:
        return _numbered(lost_trajectories(problem, _part(front, rows)), rows)
    return _lost(problem, MotionTable.of(front.trajectories)) if len(front) else []


def _lost(problem: Problem, table: MotionTable) -> list[str]:
    """Return a text for each trajectory of :func:`lost_trajectories`; states that several share are checked once."""
    lost = ~on_map(problem, table.states)
    for name in problem.model.space.turning:
        lost |= ~(np.abs(getattr(table.states, name)) <= MOST_TURNED)
    return [f"trajectory {i} leaves the map" for i in np.flatnonzero(table.through(lost)).tolist()]


def _known(problem: Problem, front: Front) -> dict[str, Criterion]:
    """Return, by name, the criteria that may have columns in a front: those of its problem, and those evaluated."""
    return {criterion.name: criterion for criterion in criteria_of(front)} | claimable(problem)


def _declared_faults(problem: Problem, front: Front) -> Iterator[str]:
    """Yield a text for each fault of a front's columns: unknown or missing criteria, a wrong unit, quantum or group."""
    every = _known(problem, front)
    names = [*front.names, *front.reported_names]
    unknown = [name for name in names if name not in every]
    if unknown:
        yield f"costs of {', '.join(unknown)} are saved, but are not among the problem's criteria"
    lacking = [c.name for c in problem.criteria if c.name not in names]
    if lacking:
        yield f"costs of {', '.join(lacking)} are not saved, although they are among the problem's criteria"
    for name, unit in zip(names, [*front.units, *front.reported_units], strict=True):
        if name in every and unit != every[name].unit:
            yield f"{name} is saved in {unit!r}, but its unit is {every[name].unit!r}"
    for name, group, quantum in zip(front.names, front.groups, front.quanta.tolist(), strict=True):
        if name in every and (group, quantum) != (every[name].group, every[name].quantum):
            yield (
                f"{name} is saved with group {group!r} and quantum {quantum}, but has {every[name].group!r} and "
                f"{every[name].quantum}"
            )


def _cost_faults(
    problem: Problem, front: Front, table: MotionTable, say: Callable[[str], None] | None
) -> Iterator[str]:
    """Yield a text for each saved cost that differs from the cost that its criterion computes again."""
    every = _known(problem, front)
    names = [*front.names, *front.reported_names]
    known = [j for j, name in enumerate(names) if name in every]
    criteria = [every[names[j]] for j in known]
    again = trajectory_costs(criteria, front.trajectories, problem.world, table=table, say=say)
    saved: FloatArray = np.hstack([front.costs, front.reported])[:, known]
    wrong = np.abs(again - saved) > SAME * np.maximum(1.0, np.abs(saved))
    for i, j in np.argwhere(wrong):
        yield f"trajectory {i}: {names[known[j]]} is saved as {saved[i, j]:.9g}, re-evaluated {again[i, j]:.9g}"


def _suspects(problem: Problem, table: MotionTable) -> BoolArray:
    """Return a mask (n,) of the trajectories to be checked one by one.

    They miss the start or the goal, or have motions that the model must check more closely (``doubtful``).
    """
    first, last = table.states.take(table.first), table.states.take(table.last)
    suspects = ~_Miss.of(problem, problem.start, first).none
    if problem.target.listed:
        suspects |= ~np.any([_Miss.of(problem, goal, last).none for goal in problem.goals], axis=0)
    else:
        suspects |= ~reached_in(problem.world, problem.target, problem.model, last)
    doubtful = np.zeros(len(table), dtype=bool)
    for index, law, start, end in table.by_law():
        doubtful[index] = problem.model.doubtful(law, start, end)
    found: BoolArray = suspects | table.having(doubtful)
    return found


class _Miss(NamedTuple):
    """Difference between states (M,) and the problem's start or goal.

    distance  m    Euclidean distance over the columns that are lengths
    others    rad  absolute difference in each of the other columns; 0 if the goal leaves it open
    """

    distance: FloatArray
    others: dict[str, FloatArray]

    @classmethod
    def of(cls, problem: Problem, end: Values, states: States) -> _Miss:
        """Return the difference between states (M,) and ``end``, the start or a goal of the problem."""
        space = problem.model.space
        differences = space.differences(space.state(end, free=space.angles), states)
        off = {name: np.nan_to_num(np.abs(change)) for name, change in differences.items()}
        lengths = [off.pop(name) for name, unit in zip(space.names, space.units, strict=True) if unit == "m"]
        return cls(np.sqrt(sum((length**2 for length in lengths), np.zeros(states.size))), off)

    @property
    def most(self) -> float:
        """Largest difference of an angle, rad."""
        return max((float(off.max(initial=0.0)) for off in self.others.values()), default=0.0)

    @property
    def none(self) -> BoolArray:
        """True for each state (M,) that is at the start or goal, within tolerances."""
        close = self.distance <= CLOSE
        for off in self.others.values():
            close &= off <= HEADING_CLOSE
        return close


def _offset(provenance: Mapping[str, Any]) -> float:
    """Return the distance from the goal, m, that a provenance declares, at most half the diagonal of a grid cell.

    It is 0 if the provenance declares none.
    """
    offset, step = (provenance.get(key) for key in ("goal_offset", "step"))
    if not (isinstance(offset, int | float) and isinstance(step, int | float) and max(abs(offset), abs(step)) <= MOST):
        return 0.0
    return min(float(offset), abs(step) / math.sqrt(2.0))


def _end_faults(problem: Problem, trajectory: Trajectory, offset: float) -> Iterator[str]:
    """Yield a text for each fault of a trajectory's first and last state: not at the start, or not at a goal.

    The position may be off from a goal by ``offset`` m if the goal is given by states.
    """
    first, last = (trajectory.states.take([row]) for row in (0, -1))
    if not _Miss.of(problem, problem.start, first).none.all():
        yield "does not begin at the start"
    if not problem.target.listed:
        if not reached_in(problem.world, problem.target, problem.model, last).all():
            yield "does not end at the goal"
        return
    misses = (_Miss.of(problem, goal, last) for goal in problem.goals)
    nearest = min(misses, key=lambda miss: (bool(miss.distance[0] > offset + CLOSE), miss.most, miss.distance[0]))
    if nearest.distance[0] > offset + CLOSE:
        yield f"ends {nearest.distance[0]:.3f} m from the goal"
    for name, off in nearest.others.items():
        if off[0] > HEADING_CLOSE:
            yield f"does not end with the goal's {'heading' if name == 'yaw' else name}"


def collision_free(problem: Problem, trajectories: Sequence[Trajectory]) -> BoolArray:
    """Return whether each trajectory (n,) is free of collisions, by the model's test for verification.

    States are sampled densely. A motion that several trajectories share is checked once.
    """
    return _free(problem, MotionTable.of(trajectories)) if trajectories else np.ones(0, dtype=bool)


def _free(
    problem: Problem, table: MotionTable, library: str = "fcl", say: Callable[[str], None] | None = None
) -> BoolArray:
    """Return a mask (n,) of the trajectories of a table of motions that are free of collisions, by a library."""
    judge = problem.model.judge_by(library, problem.world)
    colliding = np.zeros(len(table), dtype=bool)
    done = 0
    for block, law, start, end in table.by_law():
        for part in (slice(i, i + TOGETHER) for i in range(0, block.size, TOGETHER)):
            if say is not None:
                say(f"collisions of {done:,} of {len(table):,} motions")
            motions = Motions(problem.world, problem.model, law, start.take(part), end.take(part))
            colliding[block[part]] = ~free_along(judge, motions)
            done += len(motions)
    begins, which = np.unique(table.first, return_inverse=True)  # start states, since some have no motions
    free = judge.states_free(table.states.take(begins))
    result: BoolArray = free[which] & ~table.having(colliding)
    return result
