"""Ways out of contact: short motions after which a robot that people touch is clear of them.

Motions of the planner's graph begin with turns and moves of fixed sizes, which may all press against a person. Here the
robot turns and drives by small steps that shrink the gap to no person, and reverses if its model does so. Ways with few
motions are found first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice, product
from typing import TYPE_CHECKING, cast

import numpy as np
import shapely

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.costs import trajectory_costs
from hpop.drive.closings import Closing, reach_of
from hpop.drive.drive_graph import DriveGraph
from hpop.drive.known_paths import of_remaining, rechecked
from hpop.drive.options import Commit
from hpop.drive.plan import closed_trajectories, joined
from hpop.drive.surroundings import DriveSurroundings
from hpop.errors import QueryError
from hpop.models.base import PlanarModel
from hpop.models.collision.leaving import SHRINKS, Leaving
from hpop.motions import Collision, Model, States
from hpop.planners.base import Candidates
from hpop.planners.objectives import Objectives
from hpop.trajectories.contacts import first_contact
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

TURN, STEP = np.radians(3.0), 0.03  # rad, m: of the search
MOST_MOTIONS = 8
MOST_STATES = 40  # that are continued after each number of motions
ENOUGH = 6000  # states, after which the search ends
FARTHEST = 1.2  # m, of one straight move
NEAR = 2.0  # m: areas that are farther from the robot's reach are not looked at
MOST_TRIED = 12  # trajectories that are tested as whole motions
BEST = 3  # states after each number of motions that are tried


@dataclass(frozen=True, eq=False)
class _Contacts:
    """Collision tests around a robot.

    fixed   tests with walls and closed areas, of which the robot must keep clear
    people  tests with people who stand; the robot may lead out of contact with them
    reach   m, largest distance from the robot's position to a point of its body
    """

    fixed: tuple[Collision, ...]
    people: tuple[Leaving, ...]
    reach: float

    def allowed(self, before: States, after: States) -> BoolArray:
        """Return whether each small step (N,) may be taken.

        Its end must be clear of walls and closed areas. With each person, it must be clear too, or the step begins in
        contact and does not shrink the gap.
        """
        free = np.ones(after.size, dtype=np.bool_)
        for collision in self.fixed:
            free &= collision.states_free(after)
        for leaving in self.people:
            clear = leaving.states_free(after)
            some = np.flatnonzero(~clear & free)
            then, now = before.take(some), after.take(some)
            clear[some] = ~leaving.states_free(then) & (leaving.gap(now) >= leaving.gap(then) - SHRINKS)
            free &= clear
        return free

    def room(self, states: States) -> FloatArray:
        """Return the least gap (N,), m, to a person; negative in contact."""
        return np.asarray(np.min([leaving.gap(states) - leaving.size for leaving in self.people], axis=0))

    def may_turn(self, states: States) -> BoolArray:
        """Return whether no person touches the robot in each state (N,), however it turns."""
        apart = [
            np.hypot(states.x - leaving.place[0], states.y - leaving.place[1]) - leaving.size for leaving in self.people
        ]
        return np.asarray(np.min(apart, axis=0) > self.reach)


@dataclass(eq=False)
class _Reached:
    """States (N,) that were reached, each by a motion from an earlier one.

    rows     (N, 3)  x m, y m, yaw rad
    parents  (N,)    index of the state in which the last motion began; -1 for the first state
    moves    (N,)    whether the last motion was straight
    """

    rows: FloatArray
    parents: IntArray
    moves: BoolArray

    def trajectory(self, model: PlanarModel, here: States, last: int) -> Trajectory:
        """Return the motions from the first state, which is ``here`` (1,), to another one."""
        places = [last]
        while self.parents[places[-1]] >= 0:
            places.append(int(self.parents[places[-1]]))
        places.reverse()
        own = dict(zip(("x", "y", "yaw"), self.rows[places].T, strict=True))
        columns = {name: own.get(name, np.repeat(getattr(here, name), len(places))) for name in model.space.names}
        kinds = tuple("move" if moves else "turn" for moves in self.moves[places[1:]])
        return Trajectory(model, States(**columns), kinds)


def led_out(
    graph: DriveGraph,
    problem: Problem,
    now: DriveSurroundings,
    commit: Commit,
    objectives: Objectives,
) -> Candidates | None:
    """Return remaining plans that first lead out of contact with people; None if none are found.

    graph       the drive's graph of states without times, in the surroundings ``now``
    problem     from the commit, the place where the plan may change
    objectives  criteria of the drive
    """
    model = cast("PlanarModel", problem.model)
    for way in chain([None], ways_out(model, now.bare, now.closed, commit.state)):
        there = commit.state if way is None else way.states.take([len(way)])
        try:
            beside = graph.from_beside(problem.at(model.space.values(there), 0.0), always=True)
        except QueryError:  # no motion leads from there to the graph
            continue
        start = beside.beginning(there)
        paths = beside.remaining_paths(beside.prepared(), start, [], None, None)
        found = of_remaining(beside.candidates(start, paths), problem)
        trajectories = [each if way is None else joined(way, each) for each in found.trajectories]
        if now.moving:
            trajectories = [each for each in trajectories if not _meets(each, now, commit)]
        if not trajectories:
            continue
        if now.moving:
            return rechecked(graph.name, problem, objectives, trajectories)
        if way is None:
            return found
        costs = trajectory_costs(found.objectives, trajectories, problem.world)
        words = f"all paths first get clear of people by {_words(way)}; other ways to get clear are not compared"
        return replace(
            found,
            trajectories=tuple(trajectories),
            planned=costs,
            tolerance=np.zeros(costs.shape),
            certificate=f"{found.certificate}; {words}",
            notes=(*found.notes, words),
        )
    return None


def _meets(trajectory: Trajectory, now: DriveSurroundings, commit: Commit) -> bool:
    """Return whether a trajectory from a commit on meets people who walk, as planned or as executed."""
    then = now.at(commit.state, commit.time).world.content.people
    people = [person for person, before in zip(then, now.people, strict=True) if before.moves]
    parts, begin, driven = trajectory.model.platform, commit.before.duration, joined(commit.before, trajectory)
    cases = product((driven, driven.execution()), {0.0, now.margin})
    return any(first_contact(parts, people, motion, least, begin=begin) is not None for motion, least in cases)


def held(found: Candidates, model: Model, now: DriveSurroundings, commit: Commit) -> Candidates:
    """Return the result ``found``, which is empty, with a note why people who touch the robot leave it no way out."""
    robot, words = cast("PlanarModel", model), "ahead free it, and its model does not reverse"
    if robot.reverses:
        words = "ahead or back free it"
    elif any(True for _ in ways_out(robot, now.bare, now.closed, commit.state, reverses=True)):
        words += ": moves back would (if the robot may, set reverses: true)"
    elif not robot.speed_classes:  # of which no ways out are searched
        words += ", but moves back would not free it either"
    note = f"people who touch the robot hold it: neither turns nor moves {words}"
    return replace(found, notes=(*found.notes, note))


def _words(way: Trajectory) -> str:
    """Return the motions of a way out in words."""
    x, y, yaw = (getattr(way.states, name) for name in ("x", "y", "yaw"))
    ahead = np.diff(x) * np.cos(yaw[:-1]) + np.diff(y) * np.sin(yaw[:-1])
    turned = np.degrees(np.diff(yaw))
    return ", ".join(
        (f"{abs(d):.2f} m {'ahead' if d > 0 else 'back'}" if kind == "move" else f"a turn by {angle:.0f} degrees")
        for kind, d, angle in zip(way.kinds, ahead.tolist(), turned.tolist(), strict=True)
    )


def ways_out(
    model: PlanarModel, world: World, closings: Sequence[Closing], here: States, *, reverses: bool = False
) -> Iterator[Trajectory]:
    """Yield a few trajectories from a state (1,) to states clear of people, by number of motions.

    They end where the robot may turn without touching a person; after these, one ends with the most room. At most 12
    are tried. There are none for a robot with several speeds.

    world     the bare world, without people
    closings  closed areas, among them the bodies of people
    reverses  whether the robot reverses even if its model does not
    """
    reach, place = reach_of(model), shapely.Point(float(here.x[0]), float(here.y[0]))
    near = [each for each in closings if each.area.distance(place) <= reach + NEAR]
    tests = [(each, each.collision(model)) for each in near]
    people = tuple(test for _, test in tests if isinstance(test, Leaving))
    if not people or model.speed_classes:  # plans with several speeds need changes of speed
        return
    walls = model.collision(world)
    contacts = _Contacts((walls, *(test for _, test in tests if not isinstance(test, Leaving))), people, reach)

    def is_free(way: Trajectory) -> bool:
        return not closed_trajectories([way], closings)[0] and all(
            walls.motions_free(motions).all() for _, motions in way.batches(world)
        )

    yield from filter(
        is_free, islice(_searched(model, contacts, here, reverses=reverses or model.reverses), MOST_TRIED)
    )


def _searched(model: PlanarModel, contacts: _Contacts, here: States, *, reverses: bool) -> Iterator[Trajectory]:
    """Yield trajectories out of contact: first those after which the robot may turn, then one with the most room."""
    own = np.stack([here.x, here.y, here.yaw], axis=1)
    reached = _Reached(own, np.array([-1]), np.array([False]))
    frontier, seen = np.zeros(1, np.int64), {_key(own[0])}
    for number in range(MOST_MOTIONS):
        begin = len(reached.rows)
        for moves in (True, False):
            rows = frontier if number == 0 else frontier[reached.moves[frontier] != moves]
            for sign in (1.0, -1.0) if reverses or not moves else (1.0,):
                _extend(contacts, reached, rows, sign, seen, moves=moves)
        fresh = np.arange(begin, len(reached.rows))
        if not fresh.size or len(reached.rows) > ENOUGH:
            break
        states = _states(reached.rows[fresh])
        for last in fresh[contacts.may_turn(states)][:BEST].tolist():  # the nearest
            yield reached.trajectory(model, here, last)
        frontier = fresh[np.argsort(-contacts.room(states), kind="stable")[:MOST_STATES]]
    room = contacts.room(_states(reached.rows))
    if room.max() > 0.0:
        yield reached.trajectory(model, here, int(np.argmax(room)))


def _extend(
    contacts: _Contacts, reached: _Reached, rows: IntArray, sign: float, seen: set[tuple[int, ...]], *, moves: bool
) -> None:
    """Add all states that one motion reaches from the states ``rows``, given by index.

    The motion is a straight move (``moves``) or a turn; it goes ahead or to the left if ``sign`` is 1, else back or to
    the right.
    """
    now, begins = reached.rows[rows], rows
    for _ in range(round(FARTHEST / STEP if moves else np.pi / TURN)):
        if not begins.size:
            return
        ahead = np.stack([np.cos(now[:, 2]), np.sin(now[:, 2]), np.zeros(len(now))], axis=1)
        then = now + sign * (STEP * ahead if moves else np.array([0.0, 0.0, TURN]))
        free = contacts.allowed(_states(now), _states(then))
        now, begins = then[free], begins[free]
        keys = [_key(row) for row in now]
        fresh = np.array([i for i, key in enumerate(keys) if key not in seen], np.int64)
        seen.update(keys)
        reached.rows = np.concatenate([reached.rows, now[fresh]])
        reached.parents = np.append(reached.parents, begins[fresh])
        reached.moves = np.append(reached.moves, np.full(fresh.size, moves))


def _key(row: FloatArray) -> tuple[int, ...]:
    """Return whole numbers that are equal for states that count as one."""
    x, y, yaw = row.tolist()
    return round(x / STEP), round(y / STEP), round(float(np.mod(yaw, 2.0 * np.pi)) / TURN) % round(2.0 * np.pi / TURN)


def _states(rows: FloatArray) -> States:
    """Return states (N,) of rows (N, 3)."""
    return States(x=rows[:, 0], y=rows[:, 1], yaw=rows[:, 2])
