"""A drive: a plan that a robot follows, changes of the world on the way, and options to change the plan.

The caller passes the time, ``now``, in seconds on its own clock. So the same events always give the same drive, and a
drive can be repeated from its event log.
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
from hpop.drive.known_paths import ReplanResult
from hpop.drive.moment import DriveProgress, Moment, past
from hpop.drive.options import Commit, Option, Options, PlanComparison, same_side
from hpop.drive.plan import SAME, Cut, Plan, closed_trajectories, joined, part
from hpop.drive.replanning import Replanner
from hpop.drive.storage import Change, StopLog, deadline_of, written
from hpop.drive.surroundings import DriveSurroundings
from hpop.drive.wishes import NOTICE, PATIENCE, Wish, adapted, front_of_rest, wished
from hpop.errors import DriveError
from hpop.frontier.choices import Preferring
from hpop.motions.states import StateSpec
from hpop.planners.base import Planner
from hpop.problems.front import Point
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

SHIFT = 0.01
"""Least delay or lead of the robot, s, that shifts the plan in time."""


@checked_arguments
class Execution(StopLog):
    """A drive along a plan, with options to change the plan; :func:`hpop.follow` creates one.

    problem     the problem for which the plan was made
    choice      the plan that was chosen first; ``ways`` are all plans of the front
    patience    share by which another plan must be better before the robot changes to it by itself
    notice      s, least time between such a change and the first turn that was not announced
    preference  of the person aboard, by which the robot chooses; it is not saved, but the choices are
    waits       whether to wait until the graph is built; else another thread builds it, and options are known plans
                until then
    record      the event log, as JSON; see :meth:`save`

    Accepts: fronts of planners on graphs with turns and straight moves (lattice, roadmap of positions), or of other
    planners if such a planner is given as well; any criteria that the planner takes.

    Guarantees: options are the result of an exact search from the same node in the world as it is now. If a deadline
    ends the search, they are at most a factor 1 + gap worse. The present plan is among them while nothing is in its
    way. The driven trajectory has no jump in position, heading or planned speed. The same events give the same drive.
    The graph is built once; a query then takes some milliseconds in rooms and offices.
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
        waits: bool = True,
    ) -> None:
        self.problem, self.planner, self.choice, self.ways = problem, planner, choice, tuple(ways)
        super().__init__(begin)
        self.patience = real("patience", patience, 0, 1, "a share", error=DriveError)
        self.notice = real("notice", notice, 0, MOST, "a time in s", error=DriveError)
        self.preference = preference
        self._replanner = Replanner(problem, planner, ways, self.begin)
        surroundings = DriveSurroundings.of(problem, float(self.begin), planner.margin)
        self._progress = DriveProgress(Plan(choice), surroundings, float(self.begin), planner.margin)
        self._latest: Options | None = None
        if waits:  # ahead of the first query
            self.ready(self.begin)
        elif surroundings.moving:
            self._lay_out(self.begin)

    def __repr__(self) -> str:
        ends = "to the goal" if self._progress.plan.stops is None else "to where the plan is closed"
        return f"<Execution: {self.plan.duration:.1f} s {ends}, {len(self.record)} events>"

    def _lay_out(self, now: float) -> None:
        """Prepare the graph for queries from a time on; among moving people, only begin to, in another thread."""
        if not self.surroundings.moving:
            self._replanner.graph(self.surroundings)
        elif not (commit := self.commit(now, 0.0)).arrives:
            self._replanner.begin(self.surroundings, commit)

    @property
    def is_prepared(self) -> bool:
        """True once the graph for a world without moving people is built."""
        return self._replanner.is_built(self.surroundings, 0.0)

    def ready(self, now: float | None = None) -> None:
        """Wait until the graph is rebuilt after a change of the world, however long this takes.

        Call it if time is simulated. Otherwise, among moving people, :meth:`options` returns known plans until then.
        """
        self._lay_out(now := self._now() if now is None else now)
        for deadline in (0.0, None) if self.surroundings.moving else ():
            if not (commit := self.commit(now, deadline)).arrives:
                self._replanner.ready(self.surroundings, commit)

    # Where the robot is

    @property
    def plan(self) -> Trajectory:
        """The trajectory from the beginning of the drive on, as the robot follows it if nothing changes."""
        return self._progress.plan.driven

    @property
    def announced(self) -> Trajectory:
        """The trajectory from the beginning of the drive to the goal, even if a part of it is now closed."""
        return self._progress.plan.announced

    @property
    def surroundings(self) -> DriveSurroundings:
        """The present world of the drive, with its closed areas."""
        return self._progress.surroundings

    def at(self, now: float, state: StateSpec | None = None) -> Moment:
        """Return the position of the robot, the costs of the drive so far, and the remaining plan.

        state  measured state of the robot, if any. The robot is then assumed to be where the plan passes nearest to
               it, and the plan is shifted in time accordingly. Measured states must come in order of time
        """
        progress = self._progress
        if state is None:
            return progress.moment(self._time(now))
        now = self._in_order(now)
        space = self.problem.model.space
        measured = space.state(state, what="state that is seen")
        planned = progress.plan.nearest_time(measured, progress.planned(now))
        progress.lag = self._told(now) - planned
        self._note_visits(now)
        if abs(progress.lag - progress.stretches[-1].lag) > SHIFT:
            progress.shift(now)
        self._note("seen", now, state=list(space.values(measured)))
        return progress.moment(now)

    def commit(self, now: float, deadline: float | None = None) -> Commit:
        """Return the first place of the plan, at least ``deadline`` s from now, where the robot may change its plan.

        This is the end of a straight move or hold, where all plans go straight on or stop to turn. If the robot stands
        (at the start, at the goal, or before a closed area), it is the place where it stands.
        """
        return self._progress.commit(self._time(now), deadline_of(deadline, self.problem))

    # Options

    def options(self, now: float, deadline: float | None = None, within: float | None = None) -> Options:
        """Return the front of remaining plans from the next place where the plan may change (:meth:`commit`).

        It includes the present plan if that is open.

        deadline  s of processor time of this thread for the search, by default 0.2, and 2 along a tour. Known plans
                  need no search, so a deadline of 0 returns them; a missing plan is at most a factor 1 + gap better.
                  After a change of people, waiting for the graph to be rebuilt counts too, in real time. If it is not
                  rebuilt in time, the options are known plans that are open and clear of people; the gap is infinite
        within    s, a shorter deadline for the search only; ``deadline`` still sets how soon the plan may change
        """
        deadline, now = deadline_of(deadline, self.problem), self._told(now)
        self._note_visits(now)
        options, result = self._options(now, deadline, None, within=deadline if within is None else within)
        self._note("options", now, deadline=deadline, answer=result.answer)
        return options

    def options_again(self, now: float, deadline: float, answer: Mapping[str, Any] | None) -> Options:
        """Repeat a call of :meth:`options` from an event log.

        answer  the logged result if the deadline cut the search short; None repeats the search to its end
        """
        now = self._told(now)
        self._note_visits(now)
        self._note("options", now, deadline=deadline, answer=answer)
        return self._options(now, deadline_of(deadline, self.problem), answer)[0]

    def _options(
        self, now: float, deadline: float, answer: Any, *, within: float | None = None
    ) -> tuple[Options, ReplanResult]:
        """Return options, and the search result behind them.

        If no path leads on because people walk towards the robot, the drive continues with people who are predicted to
        stop before it.

        answer  a logged result, as for :meth:`options_again`
        within  s, deadline of the search; None for none, as when an event log is repeated. ``deadline`` only decides
                where options begin (the commit)
        """
        commit = self.commit(now, deadline)
        if answer is not None and answer.get("stopping"):
            stopping = self.surroundings.with_people_who_stop(commit.places.states, commit.places.times)
        else:
            options, result = self._options_from(commit, now, within, answer)
            if len(options) or not result.candidates.status.is_final:
                return options, result
            stopping = self._replanner.stopping(self.surroundings, commit)
        if stopping is not None:
            before = part(self._progress.plan.driven, 0, commit.place)
            self._change(now, stopping, ())
            commit = commit if self._progress.plan.begins_with(before) else self.commit(now, deadline)
            options, result = self._options_from(commit, now, within, answer)
            if result.answer is not None:
                result = result._replace(answer={**result.answer, "stopping": True})
        return options, result

    def _options_from(
        self, commit: Commit, now: float, deadline: float | None, answer: Any
    ) -> tuple[Options, ReplanResult]:
        """Return options from a commit (place where the plan may change) on, and the search result behind them."""
        surroundings, plan = self.surroundings, self._progress.plan
        remaining, t, visits = commit.remaining, commit.before.duration, None
        present = remaining if plan.stops is None and not commit.stands else None
        problem = replace(surroundings.at(commit.state, commit.time), tour=commit.tour)
        if self._progress.tour is not None and commit.tour is not None:
            visits = self._progress.tour.coming(joined(commit.before, remaining), t, commit.tour, problem)
        result = self._replanner.result(surroundings, problem, commit, present, deadline, answer)
        costs_so_far = partial(past, Plan(commit.before), t, self._progress.stretches, self.problem.criteria)
        candidates = replace(result.candidates, notes=(*result.candidates.notes, *surroundings.stopping))
        front, point, place = front_of_rest(problem, candidates, present, costs_so_far, visits)
        closings = () if present is None else surroundings.closed
        compared = PlanComparison(
            part(plan.driven, 0, commit.place),
            remaining,
            self._progress.planned(now),
            lambda trajectory: same_side(trajectory, remaining, surroundings.problem.world, closings),
        )
        search = (result.candidates.status, result.gap, result.labels, result.unreachable)
        self._latest = options = Options(front, now, commit, place, point, *search, compared=compared)
        return options, result

    # Changes

    def wish(self, wish: str | None = None, **shares: float) -> Wish:
        """Return the option, among the last options, that meets a wish: "fewer turns", "hurry", ``duration=-0.2``.

        See :func:`hpop.drive.wishes.wished`. The plan does not change until the option is taken.
        """
        answer = wished(self._options_at_hand(), wish, shares)
        self._note("wish", self._last, wish=wish, shares=dict(shares), words=answer.words)
        return answer

    def take(
        self, option: Option | Point | int, now: float | None = None, options: Options | None = None
    ) -> Trajectory:
        """Let the robot follow an option from the place where the options begin, their commit; return the new plan.

        The option is one of the last options, or of the earlier ``options``. ``patience`` and ``notice`` do not count
        here. Raise DriveError if the robot has passed the commit, or if the option has been closed since.
        """
        options = self._options_at_hand() if options is None else options
        now, place = self._in_order(self._now() if now is None else now), options.place_of(option)
        chosen, commit, keeps_on = options.ways[place], options.commit, place == options.keep_on
        if now > commit.time + SAME and not (commit.arrives and keeps_on):
            again = "plan again from the goal" if commit.arrives else "call options(now) again"
            raise DriveError(f"these options begin at {commit.time:.2f} s, but it is {now:.2f} s already: {again}")
        if not self._progress.plan.begins_with(options.compared.before):
            raise DriveError("the plan was cut before the place where these options begin; call options(now) again")
        changed = self._progress.with_option(options, place, now)
        if changed.cut.safe is not None and closed_trajectories([chosen], self.surroundings.closed).any():
            raise DriveError(f"option {place} has been closed since; call options(now) again")
        self._note_visits(now)
        self._drive(now, None if keeps_on else changed.plan, changed.cut)
        self._note("take", self._told(now), place=commit.place, stands=commit.stands, keeps_on=keeps_on,
                   rest=None if keeps_on else chosen.describe(), costs=options.costs_of(place))  # fmt: skip
        return self.plan

    def blocked_by(self, option: Option | Point | int, now: float, options: Options) -> int | None:
        """Return the number of an option's first motions that lead into a closed area or a person; None if it is clear.

        People are taken as they are predicted now. All options that begin with these motions are blocked too. It is 0
        if the present plan does not lead to the place where the options begin.
        """
        if not self._progress.plan.begins_with(options.compared.before):
            return 0
        return self._progress.with_option(options, options.place_of(option), now).blocked_by

    def take_again(self, event: Mapping[str, Any], trajectory: Trajectory | None) -> None:
        """Repeat the choice of an option from an event log; with ``trajectory`` None the robot keeps its plan."""
        now, most = self._told(event["now"]), len(self._progress.plan.driven)
        place = whole("place", event["place"], 0, most, "the number of a state of the plan", error=DriveError)
        stands = real("stands", event["stands"], 0, MOST, "a time in s", error=DriveError)
        self._note_visits(now)
        self._drive(now, None if trajectory is None else self._progress.plan.then(place, stands, trajectory))
        self.record.append(dict(event))

    def _drive(self, now: float, plan: Plan | None, cut: Cut | None = None) -> None:
        """Follow a changed plan, up to its ``cut`` if that was found already; None keeps the present plan."""
        if plan is not None:
            self._progress.plan = plan
            self._progress.cut(now, cut)
        self._latest = None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the drive and its event log to a JSON file, from which :func:`hpop.drive.load` repeats the drive.

        Raises OSError if it cannot be written.
        """
        storage.write(self, path)

    def adapt(self, options: Options) -> Option | None:
        """Let the robot change its plan by itself; return the option that it takes, None if it keeps its plan.

        If the remaining plan cannot be driven to its end (a closed area or a person is in its way), the robot takes the
        knee of the front (the best compromise). Otherwise it compares each option with the remaining plan by the ratio
        of their costs, averaged over the criteria. It takes the option with the least ratio in which no unannounced
        turn begins within ``notice``, if this ratio is at most 1 - ``patience``. With the ``preference`` of a person,
        it takes the preferred option instead of the knee, and compares the costs that the person is expected to feel.
        """
        if options is not self._options_at_hand():
            raise DriveError("adapt takes only the options of the last call; call options(now) again")
        chosen = adapted(options, self.patience, self.notice, self.preference)
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
        """Change the world of the drive by exactly one of close, open, people and stop; return the effect on the plan.

        close   a zone of the map by its name, or a polygon, m; ``name`` names the polygon, to open it later
        open    a closed area by name, or the polygon that was closed. Zones of the map with a name are doors; keep-out
                zones among them are closed at first
        people  all people present now, as predicted from now on; ``groups`` has the indices of people in each group
                that talks together
        stop    one person, by name or index, who stands from now on
        now     s; by default the time of the last event

        If the plan is closed ahead, the robot drives on to the last place where it may change its plan, or brakes.

        A walking person up to half a metre within an obstacle is shifted out of it; one deeper within it is left out.
        Notes of the change say so. A standing person may touch the robot. The robot may then drive away, but not closer
        to this person. A person may walk towards the robot and leave it no open path. Then hpop assumes that this
        person stops in front of the robot.

        Raises DriveError if not exactly one change is given, for a door that is not on the map, for opening an area
        that is not closed, and for a closed area that covers the robot; MapError if all walking people are deep within
        obstacles. Then the drive does not change.
        """
        given = {"close": close, "open": open, "people": people, "stop": stop}
        changes = [key for key, value in given.items() if value is not None]
        if len(changes) != 1:
            got = ", ".join(changes) or "none"
            raise DriveError(f"give exactly one of close, open, people and stop; got {got}")
        now = self._in_order(self._now() if now is None else now)
        before, what = self.surroundings, changes[0]
        if isinstance(people, Iterable) and not isinstance(people, str):
            people = given["people"] = tuple(people)
        after = before.changed(now, what, given[what], name, groups)
        new = [closing for closing in after.closed if closing not in before.closed]
        refuse_covered(new, self.problem.model, self._progress.state(now))
        talk = after.problem.world.content.groups
        self._note_visits(now)
        self._note(what, self._told(now), **written(close, open, people, talk, stop, name))
        return self._change(now, after, new)

    def _change(self, now: float, after: DriveSurroundings, new: Sequence[Closing]) -> Change:
        """Continue the drive in changed surroundings; ``new`` are newly closed areas. Return the effect on the plan."""
        progress = self._progress
        cut = progress.enter(after, now)
        self._lay_out(now)
        invalid = closed_trajectories([] if self._latest is None else self._latest.ways, new)
        invalid |= self._latest is not None and not progress.plan.begins_with(self._latest.compared.before)
        announced = Plan(progress.plan.announced)
        stops = None if cut.stops is None else progress.lag + progress.plan.end
        times = announced.driven.times[announced.arrivals]
        brakes = cut.stops is not None and np.abs(times - cut.stops).min() > SAME
        safe = None if cut.safe is None else progress.lag + cut.safe
        notes = tuple(dict.fromkeys((*after.problem.notes, *after.at(progress.state(now), now).notes)))
        return Change(now, safe, stops, bool(brakes), tuple(np.flatnonzero(invalid).tolist()), notes)

    def _options_at_hand(self) -> Options:
        if self._latest is None:
            raise DriveError("there are no options, or the plan has changed since: call options(now) first")
        return self._latest
