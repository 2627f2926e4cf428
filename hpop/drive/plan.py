"""A plan that is driven: trajectories cut and joined without a jump, where it may be left, where the robot stands."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, IntArray
from hpop.drive.closings import Closing
from hpop.errors import DriveError
from hpop.models.laws import Turn
from hpop.motions import HOLD, Collision, States, is_curve, laws_of
from hpop.motions.by_law import batches, extras
from hpop.motions.laws import CLOCK, LONGEST
from hpop.trajectories.contacts import STEP, first_contact
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person, World

SAME = 1e-9  # s, m or rad: two moments, or two states, are the same
FARTHEST = 1.0  # m: a robot that is said to be farther from its plan has left it
SAMPLED = 0.02  # s between the moments of a plan at which a robot is looked for
AROUND = 10.0  # s of a plan in which a robot is looked for, before and after where it should be


def part(trajectory: Trajectory, begin: int, end: int) -> Trajectory:
    """The motions of a trajectory from one of its states (n+1,) to another."""
    kinds = trajectory.kinds[begin:end]
    names = (*trajectory.model.space.names, *extras(trajectory.model, kinds))
    states = trajectory.states.take(slice(begin, end + 1))
    of = States(**{name: getattr(states, name) for name in names})
    return Trajectory(trajectory.model, of, kinds, trajectory.punctual)


def until(trajectory: Trajectory, t: float) -> Trajectory:
    """The first ``t`` seconds of a trajectory; what was under way then ends there."""
    return between(trajectory, 0.0, t)


def between(trajectory: Trajectory, begin: float, end: float) -> Trajectory:
    """A trajectory from one time to another, s; motions that are under way then are cut."""
    times = trajectory.times
    first = int(np.searchsorted(times, begin + SAME, side="right")) - 1
    last = int(np.searchsorted(times, end - SAME, side="left"))
    first, last = max(first, 0), min(last, len(trajectory))
    if first >= last:
        at = trajectory.at(begin)
        return Trajectory(trajectory.model, _columns(at, trajectory.model.space.names), (), trajectory.punctual)
    some = part(trajectory, first, last)
    columns = {name: np.array(column) for name, column in some.states.__dict__.items()}
    for row, t, is_cut in ((0, begin, begin > times[first] + SAME), (-1, end, end < times[last] - SAME)):
        if is_cut:
            here = trajectory.at(t)
            for name, column in columns.items():
                column[row] = getattr(here, name)[0]
    return Trajectory(trajectory.model, States(**columns), some.kinds, trajectory.punctual)


def motion_ends(trajectory: Trajectory, t: float) -> float:
    """When the motion ends that is under way at a time, s."""
    return float(trajectory.times[min(int(np.searchsorted(trajectory.times, t - SAME)), len(trajectory))])


def joined(first: Trajectory, second: Trajectory) -> Trajectory:
    """A trajectory and another that begins where it ends, but for whole turns of what comes round.

    Raises DriveError where it does not: nothing that is driven jumps.
    """
    model, space = first.model, first.model.space
    end, begin = first.states.take(slice(-1, None)), second.states.take(slice(0, 1))
    for name, off in space.differences(end, begin).items():
        if abs(off[0]) > SAME:
            raise DriveError(f"a way that goes on must begin where the one before it ends, but {name} is off by {off}")
    kinds = first.kinds + second.kinds
    columns = {}
    for name in space.names:
        before, after = getattr(first.states, name), getattr(second.states, name)
        turns = round((before[-1] - after[0]) / (2 * np.pi)) if name in space.turning else 0
        columns[name] = np.concatenate([before, after[1:] + 2 * np.pi * turns])
    if CLOCK in extras(model, kinds):
        before, after = (getattr(t.states, CLOCK, np.zeros(len(t) + 1)) for t in (first, second))
        columns[CLOCK] = np.concatenate([before, before[-1] + after[1:] - after[0]])
    return Trajectory(model, States(**columns), kinds, first.punctual or second.punctual)


def held(trajectory: Trajectory, seconds: float) -> Trajectory:
    """A trajectory after which the robot stands for a while; one at whose end it stands already stands longer."""
    if seconds <= SAME:
        return trajectory
    kinds = (*trajectory.kinds, HOLD.kind)
    columns = {name: np.append(column, column[-1]) for name, column in trajectory.states.__dict__.items()}
    clock = columns.setdefault(CLOCK, np.zeros(len(kinds) + 1))
    clock[-1] += seconds
    stands = sum(np.diff(clock)[[kind == HOLD.kind for kind in kinds]])
    if stands > LONGEST:
        raise DriveError(f"the robot stands for {stands:,.0f} s in all, and a drive does for {LONGEST:,.0f} s at most")
    return Trajectory(trajectory.model, States(**columns), kinds, trajectory.punctual)


def _columns(states: States, names: tuple[str, ...]) -> States:
    return States(**{name: getattr(states, name) for name in names})


@dataclass(frozen=True, eq=False)
class Plan:
    """A trajectory that is being driven, and how far of it may be driven. Its times are planned ones, s.

    announced  from where the drive began to the goal
    stops      s, where the robot stands if nothing is chosen before, since the rest is closed; None: it arrives
    chosen     s, where the way begins that was chosen last: who is near then may be left, as where a plan begins
    """

    announced: Trajectory
    stops: float | None = None
    chosen: float = 0.0

    def __post_init__(self) -> None:
        laws = laws_of(self.announced.model)
        if curves := sorted({kind for kind in self.announced.kinds if is_curve(laws[kind])}):
            raise DriveError(
                f"a plan to follow is made of turns, straight moves and holds, after which another way may be taken; "
                f"this one has {', '.join(curves)}: follow the polyline that was smoothed"
            )

    @property
    def end(self) -> float:
        """When the robot stands, s: at the goal, or where its way is closed."""
        return self.announced.duration if self.stops is None else self.stops

    @cached_property
    def driven(self) -> Trajectory:
        """What is driven if nothing changes any more."""
        return self.announced if self.stops is None else until(self.announced, self.stops)

    @cached_property
    def arrivals(self) -> IntArray:
        """States (a,) of `driven`, by number, where a straight move or a hold arrives, and the first and the last.

        The robot may leave there for another way: it goes straight on, or stops to turn, as planned motions do.
        """
        kinds = self.driven.kinds
        after = [0] + [i + 1 for i, kind in enumerate(kinds) if "x" in laws_of(self.driven.model)[kind].varies]
        after += [i + 1 for i, kind in enumerate(kinds) if kind == HOLD.kind]
        return np.unique([*after, len(kinds)])

    @property
    def ramp(self) -> float:
        """How much longer a run takes that ends, s: v/2a, half of what stopping and starting lose."""
        turn = self.announced.model.laws.get("turn")
        return 0.5 * turn.loss if isinstance(turn, Turn) else 0.0

    @property
    def stops_for(self) -> float:
        """How long a robot stands at least, s, that has stopped: where the clock is kept, until it has really done."""
        return self.ramp if self.announced.punctual else 0.0

    def next_arrival(self, t: float) -> int:
        """The first of the arrivals later than ``t``; the last where none is."""
        times = self.driven.times[self.arrivals]
        return int(self.arrivals[min(int(np.searchsorted(times, t + SAME, side="right")), times.size - 1)])

    def braked(self, t: float) -> float:
        """When a robot stands that brakes at ``t``: v²/2a on in a straight run; a turn or a hold is done first."""
        motions, laws = self.announced, laws_of(self.announced.model)
        if t >= self.end - SAME or not len(motions):
            return self.end
        i = int(np.searchsorted(motions.times, t + SAME, side="right")) - 1
        if "x" not in laws[motions.kinds[i]].varies:
            return float(motions.times[i + 1])
        last = i
        while last + 1 < len(motions) and "x" in laws[motions.kinds[last + 1]].varies:
            last += 1
        return float(min(t + self.ramp, motions.times[last + 1]))  # v/2a at cruise speed is v²/2a of way

    def seen(self, state: States, t: float) -> float:
        """When the plan passes nearest to a state (1,) in which the robot is seen, about ``t``.

        Raises DriveError for a robot that has left its plan.
        """
        space = self.announced.model.space
        begin, end = max(0.0, t - AROUND), min(self.end, t + AROUND)
        at, apart = begin, np.inf
        low, high, count = begin, end, int((end - begin) / SAMPLED) + 2
        for _ in range(2):
            moments = np.linspace(low, high, count)
            off = space.apart(state.take(np.zeros(count, np.int64)), self.announced.at(moments))
            nearest = int(
                np.argmin(off + SAME * np.abs(moments - t))
            )  # of a robot that stands, as late as it should be
            at, apart = float(moments[nearest]), float(off[nearest])
            low, high, count = float(moments[max(nearest - 1, 0)]), float(moments[min(nearest + 1, count - 1)]), 101
        if apart > FARTHEST:
            raise DriveError(
                f"the robot is seen {apart:.2f} m from its plan, more than {FARTHEST:g} m: plan anew from where it "
                "is, with problem.at(state, t), and follow that"
            )
        return at

    def begins_with(self, way: Trajectory) -> bool:
        """Whether what is driven begins with all motions of a way."""
        same = self.driven.kinds[: len(way)] == way.kinds
        return same and all(
            np.array_equal(column, getattr(self.driven.states, name)[: len(way) + 1])
            for name, column in way.states.__dict__.items()
        )

    def then(self, i: int, stands: float, rest: Trajectory) -> Plan:
        """The plan up to a state of `driven`, a while of standing there, and the rest from there on."""
        before = held(part(self.driven, 0, i), stands)
        return Plan(joined(before, rest), chosen=before.duration)

    def closed_at(self, stops: float | None) -> Plan:
        """The same, driven only until then."""
        return replace(self, stops=stops)

    def among_others(self) -> Plan:
        """The same, among people who are told anew: of them none was near when its way was chosen."""
        return replace(self, chosen=0.0)


HALVINGS = 20  # of a motion in which a robot would touch what is closed


class Cut(NamedTuple):
    """What a closing leaves of a plan; its times are the plan's, s.

    safe   until when the plan may be driven, None for all the way
    stops  when the robot stands, None where it arrives
    """

    safe: float | None
    stops: float | None


def cut_of(
    plan: Plan, t: float, closings: Iterable[Closing], people: Sequence[Person] = (), margin: float = 0.0
) -> Cut:
    """What is left of a plan from a time on, at which the robot touches none of some closings.

    Nor may it come nearer than ``margin``, m, to ``people``, as they are predicted from then on: by the plan,
    and as it is executed where that keeps the plan's clock. Who stands is not safe from people who walk: then another
    way is to be taken in time.

    The robot stands at the last place before where it may leave its plan, so that it goes on driving while others are
    looked for. Where it cannot stop there any more it brakes, and where it would touch what is closed while it brakes
    it stops at once.
    """
    touches = [at for closing in closings if (at := _touches(plan.announced, t, closing)) is not None]
    if people:
        # By the plan's own times: of a turn that is under way the rest, as a turn of its own, would take longer.
        way, parts = plan.announced, plan.announced.model.platform
        ways = {way, way.execution()} if way.punctual else {way}
        for one, least in product(ways, {0.0, margin}):  # a margin may be left within a second, but nobody be touched
            met, begin = first_contact(parts, people, one, least, begin=t), t
            if met is not None and t < plan.chosen <= t + met[0]:
                begin, then = plan.chosen, [person.later(plan.chosen - t) for person in people]
                met = first_contact(parts, then, one, least, begin=begin)
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
    if safe >= end:  # as it stops at the goal, from which it can no more keep away
        return Cut(None, None)
    return Cut(safe, brakes if brakes <= safe else _at_once(plan.announced, t, safe))


def closed_ways(ways: Sequence[Trajectory], closings: Iterable[Closing]) -> BoolArray:
    """Which of some ways (n,) lead through any of some closings."""
    closed = np.zeros(len(ways), dtype=np.bool_)
    for closing in closings:
        for owner, motions in batches(ways, closing.alone):
            closed[owner[~closing.collision(motions.model).motions_free(motions)]] = True
    return closed


def _at_once(way: Trajectory, t: float, safe: float) -> float:
    """When a robot stands that stops as soon as it can: in a straight run just before what is closed, else now."""
    return safe if "x" in laws_of(way.model)[way.kinds[_motion(way, safe)]].varies else t


def _motion(way: Trajectory, t: float) -> int:
    """The motion that is under way just before a time."""
    return max(0, int(np.searchsorted(way.times, t, side="left")) - 1)


def _touches(way: Trajectory, t: float, closing: Closing) -> float | None:
    """Until when a way is free of a closing from a time on; None where it always is."""
    collision = closing.collision(way.model)
    rest = between(way, t, way.duration)
    free = _free(rest, collision, closing.alone)
    if free.all():
        return None
    # By the way's own times: of a turn that is under way the rest, as a turn of its own, would take longer.
    first = int(np.searchsorted(way.times, t + SAME, side="right")) - 1 + int(np.argmin(free))
    begin = low = max(t, float(way.times[first]))
    high = float(way.times[first + 1])
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        some = between(way, begin, middle)
        low, high = (middle, high) if _free(some, collision, closing.alone).all() else (low, middle)
    return low


def _free(way: Trajectory, collision: Collision, world: World) -> BoolArray:
    """Which motions (n,) of a way are free."""
    free = np.ones(len(way), dtype=np.bool_)
    for index, motions in way.batches(world):
        free[index] = collision.motions_free(motions)
    return free
