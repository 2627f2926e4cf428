"""A plan that is driven: cutting and joining trajectories, places where the plan may change, stops before obstacles.

Times of a plan begin at 0 at its beginning, s.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.drive.closings import Closing
from hpop.errors import DriveError
from hpop.models.laws import Turn
from hpop.motions import HOLD, Collision, States, is_curve, laws_of
from hpop.motions.by_law import batches, extras
from hpop.motions.laws import CHANGE, CLOCK, LONGEST, SPEED
from hpop.trajectories.contacts import STEP, first_contact
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person, World

SAME = 1e-9  # s, m or rad: smaller differences of times or states count as none
FARTHEST = 1.0  # m: a robot measured farther from its plan has left it
SAMPLED = 0.02  # s between the times of a plan that are compared with a measured state
AROUND = 10.0  # s of a plan, before and after the expected time, that are compared with a measured state


def part(trajectory: Trajectory, begin: int, end: int) -> Trajectory:
    """Return, as a trajectory, the motions between the states with the indices 0 <= begin <= end <= len(trajectory)."""
    kinds = trajectory.kinds[begin:end]
    names = (*trajectory.model.space.names, *extras(trajectory.model, kinds))
    states = trajectory.states.take(slice(begin, end + 1))
    of = States(**{name: getattr(states, name) for name in names})
    return Trajectory(trajectory.model, of, kinds, trajectory.punctual)


def until(trajectory: Trajectory, t: float) -> Trajectory:
    """Return the first ``t`` seconds of a trajectory; a motion under way at ``t`` is cut."""
    return between(trajectory, 0.0, t)


def between(trajectory: Trajectory, begin: float, end: float) -> Trajectory:
    """Return the part of a trajectory between two times, s; motions under way are cut.

    A part of a turn becomes a turn of its own, from rest to rest, which takes longer than that part took. Between equal
    times, the part is a single state.
    """
    times = trajectory.times
    first = int(np.searchsorted(times, begin + SAME, side="right")) - 1
    last = int(np.searchsorted(times, end - SAME, side="left"))
    first, last = max(first, 0), min(last, len(trajectory))
    if first >= last:
        at = trajectory.at(begin)
        return Trajectory(trajectory.model, _columns(at, trajectory.model.space.names), (), trajectory.punctual)
    whole_motions = part(trajectory, first, last)
    columns = {name: np.array(column) for name, column in whole_motions.states.__dict__.items()}
    for row, t, is_cut in ((0, begin, begin > times[first] + SAME), (-1, end, end < times[last] - SAME)):
        if is_cut:
            state = trajectory.at(t)
            for name, column in columns.items():
                column[row] = getattr(state, name)[0]
    return Trajectory(trajectory.model, States(**columns), whole_motions.kinds, trajectory.punctual)


def motion_ends(trajectory: Trajectory, t: float) -> float:
    """Return the time, s, at which the motion under way at time ``t``, s, ends; ``t`` if a motion ends then."""
    return float(trajectory.times[min(int(np.searchsorted(trajectory.times, t - SAME)), len(trajectory))])


def speed_of(states: States) -> FloatArray:
    """Return the speed (N,), m/s, at states of a plan; N zeros if its model does not have several speeds."""
    speeds: FloatArray = getattr(states, SPEED, np.zeros(states.size))
    return speeds


def at_speed(trajectory: Trajectory, speed: float) -> Trajectory:
    """Return a trajectory followed by a change to a speed, m/s, if it ends at another and the model has several."""
    speeds = speed_of(trajectory.states)
    if abs(speeds[-1] - speed) <= SAME or CHANGE not in laws_of(trajectory.model):
        return trajectory
    kinds = (*trajectory.kinds, CHANGE)
    columns = {name: np.append(column, column[-1]) for name, column in trajectory.states.__dict__.items()}
    columns[SPEED] = np.append(speeds, speed)
    names = (*trajectory.model.space.names, *extras(trajectory.model, kinds))
    return Trajectory(trajectory.model, States(**{name: columns[name] for name in names}), kinds, trajectory.punctual)


def joined(first: Trajectory, second: Trajectory) -> Trajectory:
    """Join two trajectories; the second begins where the first ends, up to whole turns of angles.

    If the second begins at another speed, a change of speed is inserted. Raises DriveError if it begins at another
    position, heading or joint value.
    """
    model, space = first.model, first.model.space
    end, begin = first.states.take(slice(-1, None)), second.states.take(slice(0, 1))
    for name, off in space.differences(end, begin).items():
        if abs(off[0]) > SAME:
            raise DriveError(
                f"a plan must begin where the plan before it ends, but {name} differs by {off[0]:g}; give a trajectory "
                "that begins there"
            )
    first = at_speed(first, float(speed_of(second.states)[0]))
    kinds = first.kinds + second.kinds
    columns = {}
    for name in space.names:
        before, after = getattr(first.states, name), getattr(second.states, name)
        turns = round((before[-1] - after[0]) / (2 * np.pi)) if name in space.turning else 0
        columns[name] = np.concatenate([before, after[1:] + 2 * np.pi * turns])
    if SPEED in extras(model, kinds):
        columns[SPEED] = np.concatenate([speed_of(first.states), speed_of(second.states)[1:]])
    if CLOCK in extras(model, kinds):
        before, after = (getattr(t.states, CLOCK, np.zeros(len(t) + 1)) for t in (first, second))
        columns[CLOCK] = np.concatenate([before, before[-1] + after[1:] - after[0]])
    return Trajectory(model, States(**columns), kinds, first.punctual or second.punctual)


def held(trajectory: Trajectory, seconds: float) -> Trajectory:
    """Return a trajectory followed by a hold of ``seconds``; DriveError if its holds become too long in all."""
    if seconds <= SAME:
        return trajectory
    kinds = (*trajectory.kinds, HOLD.kind)
    columns = {name: np.append(column, column[-1]) for name, column in trajectory.states.__dict__.items()}
    clock = columns.setdefault(CLOCK, np.zeros(len(kinds) + 1))
    clock[-1] += seconds
    stands = sum(np.diff(clock)[[kind == HOLD.kind for kind in kinds]])
    if stands > LONGEST:
        raise DriveError(
            f"the robot would stand for {stands:,.0f} s in all, but a drive may hold for at most {LONGEST:,.0f} s; "
            "plan again from where it is, with problem.at(state, t)"
        )
    return Trajectory(trajectory.model, States(**columns), kinds, trajectory.punctual)


def _columns(states: States, names: tuple[str, ...]) -> States:
    return States(**{name: getattr(states, name) for name in names})


@dataclass(frozen=True, eq=False)
class Plan:
    """A trajectory that is being driven, and the time at which the robot must stop. Times are planned times, s.

    announced  the trajectory from the beginning of the drive to the goal
    stops      s, time at which the robot stops because an area or a person is in the way beyond; None if it arrives
    chosen     s, time at which the last chosen part begins; as at a start, the robot may then leave people near it
    """

    announced: Trajectory
    stops: float | None = None
    chosen: float = 0.0

    def __post_init__(self) -> None:
        laws = laws_of(self.announced.model)
        if curves := sorted({kind for kind in self.announced.kinds if is_curve(laws[kind])}):
            raise DriveError(
                "a drive needs a plan of turns, straight moves and holds, after each of which it may change; this plan "
                f"has {', '.join(curves)}: follow the polyline from which it was smoothed"
            )

    @cached_property
    def end(self) -> float:
        """The planned time, s, from which the robot stands: at the goal, or before a closed area or a person."""
        return self.announced.duration if self.stops is None else self.stops + self.ramp_at(self.stops)

    @cached_property
    def driven(self) -> Trajectory:
        """The trajectory that the robot follows: up to the goal, or up to the stop before a closed area or a person.

        A model with several speeds changes to rest there.
        """
        return self.announced if self.stops is None else at_speed(until(self.announced, self.stops), 0.0)

    def waiting(self, seconds: float) -> tuple[Trajectory, float]:
        """Return the announced trajectory with a hold of ``seconds`` where the plan stops, and the time when it ends.

        The robot stops before a closed area or a person. The hold ends at the returned planned time, s.
        """
        assert self.stops is not None
        before = held(self.driven, seconds)
        return joined(before, between(self.announced, self.stops, self.announced.duration)), before.duration

    def motion_ends(self, t: float) -> float:
        """Return the time, s, at which the motion under way at time ``t``, s, ends."""
        return motion_ends(self.announced if self.stops is None or t <= self.stops else self.driven, t)

    def ramp_at(self, t: float) -> float:
        """Return how long slowing down to rest takes, s, if it begins at the plan's time ``t``, s; 0 for one speed."""
        law = laws_of(self.announced.model).get(CHANGE)
        if law is None or SPEED not in self.announced.states.names:
            return 0.0
        state = self.announced.at(t)
        return float(law.phases(state, States(**state.__dict__ | {SPEED: np.zeros(1)}))[0].duration[0])

    @cached_property
    def arrivals(self) -> IntArray:
        """Indices (a,) of the states of `driven` at which the robot may change its plan.

        These are the first and the last state, and all states at which a straight move or hold ends: there all plans
        go straight on or stop to turn.
        """
        kinds, laws = self.driven.kinds, laws_of(self.driven.model)
        after = [i + 1 for i, kind in enumerate(kinds) if "x" in laws[kind].varies or kind == HOLD.kind]
        return np.unique([0, *after, len(kinds)])

    @property
    def states(self) -> States:
        """The states of `driven`, with their speeds if the model has several."""
        states, model = self.driven.states, self.driven.model
        columns = {name: getattr(states, name) for name in model.space.names}
        return States(**columns | ({SPEED: speed_of(states)} if CHANGE in model.laws else {}))

    @property
    def ramp(self) -> float:
        """Extra time, s, that braking adds to a straight run: v/2a, half of the loss by stopping and starting."""
        turn = self.announced.model.laws.get("turn")
        return 0.5 * turn.loss if isinstance(turn, Turn) else 0.0

    @property
    def stops_for(self) -> float:
        """Least time, s, for which a robot stands after a stop.

        It is 0 unless the plan is punctual (made among moving people). The execution of a punctual plan brakes, so it
        comes to rest later than planned, by this time: a shorter hold would end before the robot stands.
        """
        return self.ramp if self.announced.punctual else 0.0

    def next_arrival(self, t: float) -> int:
        """Return the index of the next state after ``t`` s where the plan may change (`arrivals`), else the last."""
        times = self.driven.times[self.arrivals]
        return int(self.arrivals[min(int(np.searchsorted(times, t + SAME, side="right")), times.size - 1)])

    def braked(self, t: float) -> float:
        """Return the planned time, s, at the place where a robot comes to rest if it begins to stop at ``t``, s.

        In a straight run it brakes over v²/2a m, at most up to the end of the run; motions in place are completed.
        """
        motions, laws, speeds = self.announced, laws_of(self.announced.model), speed_of(self.announced.states)
        last_time = motions.duration if self.stops is None else self.stops
        if t >= last_time - SAME or not len(motions):
            return last_time
        i = int(np.searchsorted(motions.times, t + SAME, side="right")) - 1
        if "x" not in laws[motions.kinds[i]].varies:
            if speeds[i + 1] == 0.0:
                return float(motions.times[i + 1])
            t, i = float(motions.times[i + 1]), i + 1  # a change to a speed; it cannot stand before it moves
        last = i
        while last + 1 < len(motions) and ("x" in laws[motions.kinds[last + 1]].varies or speeds[last + 2] > 0.0):
            last += 1
        if SPEED not in motions.states.names:
            return float(min(t + self.ramp, motions.times[last + 1]))  # v/2a at cruise speed makes v²/2a
        x, y, times = (column[i : last + 2] for column in (motions.states.x, motions.states.y, motions.times))
        way = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
        stop = float(speeds[i]) * (t - float(times[0]) + self.ramp_at(t))
        j = max(1, int(np.searchsorted(way, stop)))  # of changes in place, the time before them
        if j == way.size:
            return float(times[-1])
        return float(times[j - 1] + (stop - way[j - 1]) / (way[j] - way[j - 1]) * (times[j] - times[j - 1]))

    def nearest_time(self, state: States, t: float) -> float:
        """Return the planned time, s, near ``t``, at which the plan passes nearest to a measured state (1,).

        Raises DriveError if the robot has left its plan.
        """
        space = self.announced.model.space
        begin, end = max(0.0, t - AROUND), min(self.end, t + AROUND)
        at, apart = begin, np.inf
        low, high, count = begin, end, int((end - begin) / SAMPLED) + 2
        for _ in range(2):
            moments = np.linspace(low, high, count)
            off = space.apart(state.take(np.zeros(count, np.int64)), self.announced.at(moments))
            nearest = int(np.argmin(off + SAME * np.abs(moments - t)))  # while it stands, the time nearest to t
            at, apart = float(moments[nearest]), float(off[nearest])
            low, high, count = float(moments[max(nearest - 1, 0)]), float(moments[min(nearest + 1, count - 1)]), 101
        if apart > FARTHEST:
            raise DriveError(
                f"the robot is {apart:.2f} m from its plan, more than {FARTHEST:g} m: plan again from where it is, "
                "with problem.at(state, t), and follow that plan"
            )
        return at

    def begins_with(self, trajectory: Trajectory) -> bool:
        """Return whether the planned trajectory `driven` begins with all motions of another trajectory."""
        same = self.driven.kinds[: len(trajectory)] == trajectory.kinds
        return same and all(
            np.array_equal(column, getattr(self.driven.states, name)[: len(trajectory) + 1])
            for name, column in trajectory.states.__dict__.items()
        )

    def then(self, i: int, stands: float, remaining: Trajectory) -> Plan:
        """Return the plan up to state ``i`` of `driven`, then a stop of ``stands`` s, then another trajectory."""
        before = held(part(self.driven, 0, i), stands)
        return Plan(joined(before, remaining), chosen=before.duration)

    def closed_at(self, stops: float | None) -> Plan:
        """Return the plan cut short by a final stop at a time ``stops`` of the plan, s; None: it goes to the goal."""
        return replace(self, stops=stops)

    def among_others(self) -> Plan:
        """Return the plan among other people: the robot may no longer begin near people, as it may at ``chosen``."""
        return replace(self, chosen=0.0)


HALVINGS = 20  # bisection steps to find the moment of contact in a motion that touches a closed area


class Cut(NamedTuple):
    """The part of a plan that is free of closed areas and people, in times of the plan, s.

    safe   time up to which the plan is free, None if it is free to its end
    stops  time at which the robot comes to rest before a closed area or a person, None if it arrives
    """

    safe: float | None
    stops: float | None


def cut_of(
    plan: Plan, t: float, closings: Iterable[Closing], people: Sequence[Person] = (), margin: float = 0.0
) -> Cut:
    """Return the part of a plan, from time ``t`` on, that is free of closed areas and people.

    The robot must not come nearer than ``margin``, m, to ``people`` as predicted from then on. This holds for the plan
    and, if the plan is punctual, also for its execution. Standing does not protect the robot from people who walk
    towards it; then another plan must be taken in time.

    The robot stops at the last free place where it may change its plan, so that it drives on during a search for other
    plans. If it is too late to stop there, it brakes; if braking would touch a closed area, it stops at once.
    """
    touches = [at for closing in closings if (at := _touches(plan.announced, t, closing)) is not None]
    if people:
        # In times of the whole plan: the rest of a turn under way would take longer as a turn of its own.
        announced, parts = plan.announced, plan.announced.model.platform
        trajectories = {announced, announced.execution()} if announced.punctual else {announced}
        for trajectory, least in product(trajectories, {0.0, margin}):  # a margin may be left soon, a touch never be
            met, begin = first_contact(parts, people, trajectory, least, begin=t), t
            if met is not None and t < plan.chosen <= t + met[0]:
                begin, then = plan.chosen, [person.later(plan.chosen - t) for person in people]
                met = first_contact(parts, then, trajectory, least, begin=begin)
            touches += [] if met is None else [begin + max(0.0, met[0] - STEP)]
    if not touches:
        return Cut(None, None)
    safe, end = min(touches), plan.announced.duration
    brakes = plan.braked(t)
    whole = Plan(plan.announced)
    times = whole.driven.times[whole.arrivals]
    able = times[(times >= brakes) & (times <= safe) & ((times < end) | (safe < end))]
    if able.size:
        return Cut(safe, float(able[-1]))
    if safe >= end:  # as it stops at the goal, which it cannot avoid any more
        return Cut(None, None)
    return Cut(safe, brakes if brakes <= safe else _at_once(plan.announced, t, safe))


def closed_trajectories(trajectories: Sequence[Trajectory], closings: Iterable[Closing]) -> BoolArray:
    """Return which trajectories (n,) lead through a closed area."""
    closed = np.zeros(len(trajectories), dtype=np.bool_)
    for closing in closings:
        for owner, motions in batches(trajectories, closing.world_of_area):
            closed[owner[~closing.collision(motions.model).motions_free(motions)]] = True
    return closed


def _at_once(trajectory: Trajectory, t: float, safe: float) -> float:
    """Return the time, s, of an emergency stop: ``safe`` if the robot then moves straight ahead, otherwise ``t``."""
    return safe if "x" in laws_of(trajectory.model)[trajectory.kinds[_motion(trajectory, safe)]].varies else t


def _motion(trajectory: Trajectory, t: float) -> int:
    """Return the index of the motion under way just before a time, s."""
    return max(0, int(np.searchsorted(trajectory.times, t, side="left")) - 1)


def _touches(trajectory: Trajectory, t: float, closing: Closing) -> float | None:
    """Return the first time after ``t``, s, at which a trajectory touches a closed area; None if it stays free."""
    collision = closing.collision(trajectory.model)
    free = _free(between(trajectory, t, trajectory.duration), collision, closing.world_of_area)
    if free.all():
        return None
    # In times of the whole trajectory: the rest of a turn under way would take longer as a turn of its own.
    first = int(np.searchsorted(trajectory.times, t + SAME, side="right")) - 1 + int(np.argmin(free))
    begin = low = max(t, float(trajectory.times[first]))
    high = float(trajectory.times[first + 1])
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        tried = between(trajectory, begin, middle)
        low, high = (middle, high) if _free(tried, collision, closing.world_of_area).all() else (low, middle)
    return low


def _free(trajectory: Trajectory, collision: Collision, world: World) -> BoolArray:
    """Return the mask (n,) of the motions of a trajectory that do not collide."""
    free = np.ones(len(trajectory), dtype=np.bool_)
    for index, motions in trajectory.batches(world):
        free[index] = collision.motions_free(motions)
    return free
