"""A drive: a plan of a front on its way, the world as it changes, and what may be chosen instead.

Time is told, never taken: ``now`` is seconds on any clock that the caller keeps. So a drive is the same each time that
it is told the same, and can be repeated from its record.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.options import MOST, real, whole
from hpop.drive import storage
from hpop.drive.closings import Closing, refuse_covered
from hpop.drive.moment import Moment, Stretch, front_of_rest, past, stopped
from hpop.drive.network import Found, Network
from hpop.drive.options import Commit, Compared, Later, Option, Options, same_side
from hpop.drive.plan import SAME, Cut, Plan, between, closed_ways, cut_of, held, joined, motion_ends, part, until
from hpop.drive.storage import Change, Telling, deadline_of, written
from hpop.drive.surroundings import Surroundings
from hpop.drive.wishes import NOTICE, PATIENCE, Wish, adapted, wished
from hpop.errors import DriveError
from hpop.frontier.choices import Preferring
from hpop.motions import States
from hpop.motions.states import StateSpec
from hpop.planners.base import Planner
from hpop.planners.graphs.timed.safety import LEAVING
from hpop.problems.front import Point
from hpop.runtime.status import Status
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

DEADLINE = 0.2
"""s, for options, where none is given."""
SHIFT = 0.01
"""s: by less a robot is not earlier or later than it was taken to be."""


@checked_arguments
class Execution(Telling):
    """A plan that is driven, and what may be chosen instead; :func:`hpop.follow` makes one.

    problem     as it was planned
    choice      the plan that was chosen first; ``ways`` are those that were known then
    patience    by how much, as a share, another way must be better for the robot to take it by itself
    notice      s before the first turn that nobody was told of, where it does
    preference  of the person aboard: what is better for the robot to take by itself; it is not saved, what was taken is
    record      what it was told, as JSON; see :meth:`save`

    Accepts: fronts of planners whose graph has turns and straight moves (lattice, roadmap of positions), or of others
    with such a planner beside; any criteria that these take.

    Guarantees: options are what an exact search finds from the same node in the world as it is, or, where a deadline
    ends it, at most a factor 1 + gap worse. The present plan is among them while it is open. What is driven has no jump
    in place, heading or, by the planning law, speed. Told the same it does the same.

    Cost: the graph is laid out once; then some milliseconds a question in rooms and offices.
    """

    def __init__(
        self,
        problem: Problem,
        ways: Sequence[Trajectory],
        choice: Trajectory,
        planner: Planner,
        *,
        begin: float = 0.0,
        patience: float = PATIENCE,
        notice: float = NOTICE,
        preference: Preferring | None = None,
    ) -> None:
        self.problem, self.planner, self.choice, self.ways = problem, planner, choice, tuple(ways)
        super().__init__(begin)
        self.patience = real("patience", patience, 0, 1, "a share", error=DriveError)
        self.notice = real("notice", notice, 0, MOST, "a time in s", error=DriveError)
        self.preference = preference
        self._network = Network(problem, planner, ways, self.begin)
        self._plan = Plan(choice)
        self._lag = float(self.begin)  # s of the drive at which the plan began, by where the robot was seen last
        self._stretches = [Stretch(Surroundings.of(problem, self._lag, planner.margin), 0.0, self._lag)]
        self._latest: Options | None = None
        self.ready(self.begin)  # ahead of the first question

    def __repr__(self) -> str:
        plan = self._plan
        ends = "to the goal" if plan.stops is None else "to where it is closed"
        return f"<Execution: {plan.driven.duration:.1f} s {ends}, {len(self.record)} events>"

    def _lay_out(self, now: float) -> None:
        """Make ready for questions from now on, in the world as it is now: among people who move, beside the drive."""
        if not self.surroundings.moving:
            self._network.ways(self.surroundings)
        elif not (commit := self.commit(now, 0.0)).arrives:
            self._network.begin(self.surroundings, commit)

    def ready(self, now: float | None = None) -> None:
        """Wait until all is laid out anew that a change of the world made necessary, however long that takes.

        Where nobody waits, options are those of :meth:`options` meanwhile. Wait where time is told and does not pass.
        """
        self._lay_out(now := self._now() if now is None else now)
        for deadline in (0.0, DEADLINE) if self.surroundings.moving else ():
            if not (commit := self.commit(now, deadline)).arrives:
                self._network.ready(self.surroundings, commit)

    # Where it is

    @property
    def plan(self) -> Trajectory:
        """What is driven from the beginning on, if nothing changes any more."""
        return self._plan.driven

    @property
    def announced(self) -> Trajectory:
        """The same to the goal, also where it is closed on the way."""
        return self._plan.announced

    @property
    def surroundings(self) -> Surroundings:
        """The world as it is now, and what is closed in it."""
        return self._stretches[-1].surroundings

    def at(self, now: float, state: StateSpec | None = None) -> Moment:
        """Where the robot is, what the drive has cost so far, and the rest of the plan.

        state  where it is seen, if it is: a robot is seldom where its plan has it, so feed places; times follow. It is
               then where the plan passes nearest to it. What is seen is told in order of time
        """
        if state is None:
            now = self._time(now)
        else:
            now = self._in_order(now)
            space = self.problem.model.space
            given = space.state(state, what="state that is seen")
            planned = self._plan.seen(given, self._planned(now))
            self._lag = self._told(now) - planned
            if abs(self._lag - self._stretches[-1].lag) > SHIFT:
                self._shift(now)
            self._note("seen", now, state=list(space.values(given)))
        planned = self._planned(now)
        return Moment(
            now,
            planned,
            self._plan.driven.at(planned),
            self._plan.stops is not None and planned >= self._plan.end - SAME,
            self._plan.stops is None and planned >= self._plan.end - SAME,
            self._plan,
            tuple(self._stretches),
            self._lag,
        )

    def commit(self, now: float, deadline: float = DEADLINE) -> Commit:
        """The first place later than ``deadline`` s from now at which the robot may take another way.

        That is where a straight move arrives, so that it goes straight on or stops to turn, as plans do; or where it
        stands, at the start, because the rest of its way is closed, or at the goal.
        """
        now = self._time(now)
        t = now + deadline_of(deadline) - self._lag
        driven = self._plan.driven
        place = self._plan.next_arrival(t)
        at_end = place == len(driven)
        arrives = at_end and self._plan.stops is None
        stands = t - float(driven.times[place]) if at_end and not arrives else 0.0
        stands = max(stands, self._plan.stops_for) if stands > 0.0 else 0.0
        time = self._lag + float(driven.times[place]) + stands
        states = States(**{name: getattr(driven.states, name) for name in self.problem.model.space.names})
        times = self._lag + driven.times[self._plan.arrivals]
        soon = (times > time + SAME) & (times <= time + LEAVING)
        later = Later(times[soon], states.take(self._plan.arrivals[soon]))
        before = held(part(driven, 0, place), stands)
        return Commit(time, states.take(np.array([place])), place, stands, arrives, before, later)

    # What may be chosen

    def options(self, now: float, deadline: float = DEADLINE) -> Options:
        """The front of the rest from the commit on, and the present plan among its points while it is open.

        deadline  s of this thread's processor time for the search. What is known of ways from there takes none, so that
                  a deadline of 0 is answered with that; whatever is missing is at most a factor 1 + gap better. Where
                  people have changed, so much time by the clock is given to what must be made anew; if that is not
                  enough, the known ways that are open and clear of people are the answer, and the gap is infinite
        """
        deadline, now = deadline_of(deadline), self._told(now)
        options, found = self._options(now, deadline, None)
        self._note("options", now, deadline=deadline, answer=found.answer)
        return options

    def options_again(self, now: float, deadline: float, answer: Mapping[str, Any] | None) -> Options:
        """Options as a record has them: ``answer`` is what was found where the deadline cut that short; else all is."""
        now = self._told(now)
        self._note("options", now, deadline=deadline, answer=answer)
        return self._options(now, deadline_of(deadline), answer, again=True)[0]

    def _options(self, now: float, deadline: float, answer: Any, *, again: bool = False) -> tuple[Options, Found]:
        """Options, and what was found for them; ``again`` as before, however long that takes.

        Where no path leads on, since people walk against the robot, they are taken to stop before it.
        """
        commit, seconds = self.commit(now, deadline), None if again else deadline
        if answer is not None and answer.get("stopping"):
            stopping = self.surroundings.with_people_who_stop(commit.places.states, commit.places.times)
        else:
            options, found = self._options_from(commit, now, seconds, answer)
            if found.candidates.status is not Status.NO_PATH:
                return options, found
            stopping = self._network.stopping(self.surroundings, commit)
        if stopping is not None:
            before = part(self._plan.driven, 0, commit.place)
            self._change(now, stopping, ())
            commit = commit if self._plan.begins_with(before) else self.commit(now, deadline)
            options, found = self._options_from(commit, now, seconds, answer)
            if found.answer is not None:
                found = found._replace(answer={**found.answer, "stopping": True})
        return options, found

    def _options_from(self, commit: Commit, now: float, deadline: float | None, answer: Any) -> tuple[Options, Found]:
        """Options from a commit on, and what was found for them."""
        surroundings = self.surroundings
        announced = self._plan.announced
        begins = float(self._plan.driven.times[commit.place])
        rest = between(announced, begins, announced.duration)
        kept = rest if self._plan.stops is None and not commit.stands else None
        found = self._network.found(surroundings, commit, kept, deadline, answer)
        problem = surroundings.at(commit.state, commit.time)
        before = Plan(commit.before)
        gone = partial(past, before, before.end, self._stretches, self.problem.criteria)
        candidates = replace(found.candidates, notes=(*found.candidates.notes, *surroundings.stopping))
        front, point, place = front_of_rest(problem, candidates, kept, gone)
        closings = () if kept is None else surroundings.closed
        compared = Compared(
            part(self._plan.driven, 0, commit.place),
            rest,
            self._planned(now),
            lambda way: same_side(way, rest, surroundings.problem.world, closings),
        )
        status = found.candidates.status
        options = Options(front, now, commit, place, point, status, found.gap, found.labels, compared=compared)
        self._latest = options
        return options, found

    # What changes

    def wish(self, wish: str | None = None, **shares: float) -> Wish:
        """The last options' answer to a wish, which is a choice: "fewer turns", "hurry", ``duration=-0.2``.

        See :func:`hpop.drive.wishes.wished`. Nothing is changed: take what it gives.
        """
        answer = wished(self._options_at_hand(), wish, shares)
        self._note("wish", self._last, wish=wish, shares=dict(shares), words=answer.words)
        return answer

    def take(self, option: Option | Point | int, now: float | None = None) -> Trajectory:
        """Drive one of the last options from their commit on; the plan that is driven then.

        A change that somebody asks for needs no margin and no notice. Raises DriveError where the commit is past, or
        where the option has been closed meanwhile.
        """
        options = self._options_at_hand()
        now = self._in_order(self._now() if now is None else now)
        place = options.place_of(option)
        chosen, commit = options[place], options.commit
        if now > commit.time + SAME and not commit.arrives:
            began = f"{commit.time:.2f} s, and it is {now:.2f} s"
            raise DriveError(f"these options began at {began}: ask for options again")
        if not self._plan.begins_with(options.compared.before):
            raise DriveError("the way to where these options begin has been cut since; ask for options again")
        if closed_ways([chosen.item], self.surroundings.closed).any():
            raise DriveError(f"option {place} has been closed since; ask for options again")
        self._drive(now, commit.place, commit.stands, None if chosen.keeps_on else chosen.item)
        self._note("take", self._told(now), place=commit.place, stands=commit.stands, keeps_on=chosen.keeps_on,
                   rest=None if chosen.keeps_on else chosen.item.describe(), costs=chosen.costs)  # fmt: skip
        return self.plan

    def take_again(self, event: Mapping[str, Any], way: Trajectory | None) -> None:
        """Drive on as a record has it: by a way, or as planned."""
        now, most = self._told(event["now"]), len(self._plan.driven)
        place = whole("place", event["place"], 0, most, "the number of a state of the plan", error=DriveError)
        stands = real("stands", event["stands"], 0, MOST, "a time in s", error=DriveError)
        self._drive(now, place, stands, way)
        self.record.append(dict(event))

    def _drive(self, now: float, place: int, stands: float, rest: Trajectory | None) -> None:
        """Go on by a way from a place of the plan, after standing there for a while; None: as planned."""
        if rest is not None:
            self._plan = self._plan.then(place, stands, rest)
            self._cut(now)
        self._latest = None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the drive and all that it was told to a JSON file; :func:`hpop.drive.load` makes the same drive of it.

        Raises OSError where it cannot be written.
        """
        storage.write(self, path)

    def adapt(self, options: Options) -> Option | None:
        """What the robot changes by itself: the option taken, None where it keeps its plan.

        Where the plan is closed, it takes the knee. Else the option with the least share of the plan's rest, on the
        mean over the costs, if that is better by ``patience``, and no turn that nobody was told of begins within
        ``notice``. Where the person's preference is known, that says which is the best, and by what share it is better.
        """
        if options is not self._options_at_hand():
            raise DriveError("these are not the last options; ask for options again")
        chosen = adapted(options, self.patience, self.notice)
        if chosen is not None:
            self.take(chosen)
        return chosen

    def world(
        self,
        now: float | None = None,
        *,
        close: Any = None,
        open: Any = None,
        people: Iterable[Person] | None = None,
        stop: Any = None,
        name: str = "",
        groups: Iterable[Iterable[int]] = (),
    ) -> Change:
        """Tell what changes in the world, one thing at a time, and hear what that makes of the plan.

        close   a zone of the map by its name, or a polygon, m, which ``name`` lets one open by name
        open    what is closed, by name or by the polygon: of the map's zones those with a name are doors, and keep-out
                ones among them are closed from the beginning
        people  all who are there now, as they are predicted now; ``groups`` of them talk with each other
        stop    one of them, by name or number, stands from now on
        now     s; when it was last told where left out

        Where the plan is cut, the robot drives on to the last place where it may take another way, or brakes.

        Who walks and is up to half a metre within an obstacle is shifted out of it, who is deeper is left out, and the
        change's notes say so. A person who stands in contact with the robot is no closing: the robot may leave, where
        the gap does not shrink. Where nothing is open because somebody walks against the robot, that person is taken
        to stop before it.

        Raises DriveError for a door that is not on the map, for what was never closed, and for a closing that covers
        the robot, MapError where all who walk are deep within obstacles; the drive is then as before.
        """
        given = {"close": close, "open": open, "people": people, "stop": stop}
        told = [key for key, value in given.items() if value is not None]
        if len(told) != 1:
            got = ", ".join(told) or "none"
            raise DriveError(f"tell one thing that changes: close, open, people or stop; got {got}")
        now = self._in_order(self._now() if now is None else now)
        before, what = self.surroundings, told[0]
        if isinstance(people, Iterable) and not isinstance(people, str):
            people = given["people"] = tuple(people)
        after = before.changed(now, what, given[what], name, groups)
        new = [closing for closing in after.closed if closing not in before.closed]
        refuse_covered(new, self.problem.model, self._plan.driven.at(self._planned(now)))
        talk = after.problem.world.content.groups
        self._note(what, self._told(now), **written(close, open, people, talk, stop, name))
        return self._change(now, after, new)

    def _change(self, now: float, after: Surroundings, new: Sequence[Closing]) -> Change:
        """Go on in other surroundings, in which some closings are new."""
        self._stand(now)
        if after.people != self.surroundings.people:
            self._plan = self._plan.among_others()
        self._stretches.append(Stretch(after, motion_ends(self._plan.announced, self._planned(now)), self._lag))
        cut = self._cut(now)
        self._lay_out(now)
        invalid = closed_ways([] if self._latest is None else self._latest.ways, new)
        invalid |= self._latest is not None and not self._plan.begins_with(self._latest.compared.before)
        whole = Plan(self._plan.announced)
        stops = None if cut.stops is None else self._lag + cut.stops
        brakes = cut.stops is not None and np.abs(whole.driven.times[whole.arrivals] - cut.stops).min() > SAME
        safe = None if cut.safe is None else self._lag + cut.safe
        here = after.at(self._plan.driven.at(self._planned(now)), now).notes
        notes = tuple(dict.fromkeys((*after.problem.notes, *here)))
        return Change(now, safe, stops, bool(brakes), tuple(np.flatnonzero(invalid).tolist()), notes)

    def _shift(self, now: float) -> None:
        """Note that the robot is earlier or later than it was taken to be: what is driven from now on is."""
        begins, last = motion_ends(self._plan.announced, self._planned(now)), self._stretches[-1]
        if last.begins >= begins - SAME:
            self._stretches.pop()
            begins = last.begins
        self._stretches.append(Stretch(last.surroundings, begins, self._lag))

    def _stand(self, now: float) -> None:
        """Note that the robot has stood until now, where it does because the rest of its way is closed."""
        plan = self._plan
        stood = now - self._lag - plan.end
        if plan.stops is not None and stood > SAME:
            before = held(until(plan.announced, plan.stops), max(stood, plan.stops_for))
            rest = between(plan.announced, plan.stops, plan.announced.duration)
            self._plan = Plan(joined(before, rest), before.duration)

    def _cut(self, now: float) -> Cut:
        """Look what is closed of the plan from now on, and let the robot stand before it."""
        t, surroundings = self._planned(now), self.surroundings
        then = max(now, self._lag)  # before it leaves people walk on
        everybody = surroundings.at(self._plan.announced.at(t), then).world.content.people
        told = surroundings.people  # who has stopped meanwhile is no closing
        people = [one for one, before in zip(everybody, told, strict=True) if before.moves]
        margin = self.planner.margin
        among = partial(cut_of, closings=surroundings.closed, people=people, margin=margin)
        cut, way = among(self._plan, t), self._plan.announced
        if cut.stops == t and t not in way.times:
            # A motion ends here; of a turn each part takes its own time.
            before = until(way, t)
            self._plan = Plan(joined(before, between(way, t, way.duration)))
            self._lag = now - before.duration
            self._stretches = stopped(self._stretches, t, before.duration, self._lag, way)
            cut = among(self._plan, before.duration)
        elif cut.stops is not None:
            self._stretches = stopped(self._stretches, cut.stops, cut.stops, self._lag)
        self._plan = self._plan.closed_at(cut.stops)
        return cut

    # Where on the plan

    def _planned(self, now: float) -> float:
        """Where on the plan the robot is, s."""
        return min(max(now - self._lag, 0.0), self._plan.end)

    def _options_at_hand(self) -> Options:
        if self._latest is None:
            raise DriveError("there are no options at hand since the plan was last changed: ask options(now) first")
        return self._latest
