"""Planner of a live session: checks destinations, offers ways, and changes the plan of the drive.

It holds no clock: each request carries the time ``now`` of the session, s, and the measured pose of the robot. Requests
are generators of messages for the page, and of the message "plan" for the robot. The first messages can be sent while
the later ones are computed.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from hpop.base.text import printable
from hpop.drive.script import follow
from hpop.errors import DriveError, HpopError, QueryError
from hpop.live.cards import Ways, line_of
from hpop.live.offered_drive import AHEAD, LEAD, PASSED, Message, OfferedDrive, Pose
from hpop.live.offers import HORIZON, Offer, apart, pose_of
from hpop.live.places import destination_of, on_graph, start_on_graph
from hpop.planners.graphs.state_graph import StateGraph
from hpop.problems.problem import Problem
from hpop.problems.why import why_not
from hpop.runtime.limits import no_path_note
from hpop.scenario import Scenario
from hpop.trajectories.trajectory import Trajectory
from hpop.view.explorer import payload as explorer_payload
from hpop.world import Person

TIMES_AHEAD, MOST_AHEAD = 3.0, 3.0
"""If this is longer than AHEAD: the time as a multiple of the duration of the last search; its largest value, s."""
LEAD_AMONG_PEOPLE = 2.0
"""Time, s, until a plan among moving people begins, so that it is found and chosen before then."""
KEPT_OFFERS = 8
"""Offers of which a way can still be taken."""
LIKE = 0.6
"""Largest mean distance, m, between a way that was chosen too late and the one that is taken in its place."""
WITHIN_PUSH = 0.03
"""Time, s, in which the ways of a drive must be found for a push that waits for them."""
STANDS = 0.05
"""Speed, m/s, below which a person counts as standing."""


class LivePlanner(OfferedDrive):
    """Planner of one session: one robot, one map whose graph is built once, and one drive at a time.

    Requests come one after the other, in one thread.
    """

    def __init__(self, scenario: Scenario) -> None:
        problem = scenario.problem
        names = problem.model.space.names
        if not {"x", "y", "yaw"} <= {*names} or "base" not in problem.model.provides:
            raise QueryError(
                f"a live session needs a robot that drives on a floor, got the states {', '.join(names)}; use "
                "differential_drive or pan_tilt"
            )
        super().__init__(problem, scenario.planners[0])
        self.preference = scenario.preference
        self._took_goal = 0.0  # s, from the last question for ways to a destination until they were offered
        self.offers = deque[tuple[float, Offer]](maxlen=KEPT_OFFERS)  # told last, each with the time of its question

    @property
    def graph(self) -> StateGraph | None:
        """Graph on which ways are searched, without starts and goals; None if the planner keeps none."""
        family = self.planning.planner.graph_of_drives
        return None if family is None else family.states(self.template)

    def prepare(self) -> None:
        """Build the graph, by planning once from the scenario's start."""
        problem = replace(self.surroundings.problem, goal=self.template.goal)
        try:
            front = self.planning.front(problem)
            if len(front):
                follow(problem, front, front.knee(), planner=self.planning.planner)
        except HpopError:
            pass  # the scenario's own goal need not be reachable

    # Destinations

    def destination(self, now: float, pose: Pose, goal: Mapping[str, Any]) -> Iterator[Message]:
        """Check a destination: a point, a landmark or the stops of a tour; then offer the ways to it."""
        now = self._see(now, pose)
        found = destination_of(goal, self.surroundings.problem, self.surroundings.closed)
        if isinstance(found.target, tuple):
            found = on_graph(found, self.graph, self.surroundings.problem)
        yield found.place
        if found.target is not None:
            with self.changing:
                self.goal = found
            yield from self._offer_goal(now, pose)

    def _offer_goal(self, now: float, pose: Pose, lead: float = LEAD) -> Iterator[Message]:
        """Offer the ways to the present destination, from where the robot may change its plan in ``lead`` s."""
        assert self.goal is not None
        before, state = None, start_on_graph(self._pose(pose), self.graph, self.template.model)
        time = now + (max(lead, LEAD_AMONG_PEOPLE) if self.surroundings.moving else lead)
        if self.drive is not None:
            with self.changing:
                commit = self.drive.commit(now, lead + self.brakes)
                before, state, time = self._whole(commit.before), commit.state, commit.time
        goal, words, front = self.goal, "", None
        try:
            problem = replace(self.surroundings.at(state, time), goal=goal.target, tour=goal.tour)
            front = self.planning.front(problem)
        except HpopError as error:
            words = str(error)
        if front is None or not len(front):
            self.goal = self.offer = None
            words = words or (no_path_note(front.notes) or front.status if front is not None else "")
            yield {**goal.place, "status": "blocked", "words": printable(words), "goal": None}
            return
        ways = Ways(front.trajectories, front.costs, front)
        gap = 0.0 if front.status == "complete" else math.inf
        self.offer = Offer(ways, time, pose_of(state), front.status, front.certificate, gap, before, problem)
        yield self._told(self.offer, now)
        self._took_goal = max(0.0, self.clock() - now)

    def _told(self, offer: Offer, now: float) -> Message:
        """Return the message that offers ways; it is remembered, so that one of them can be taken."""
        self.offers.append((now, offer))
        return offer.message(now, self.preference)

    def options(self, now: float, pose: Pose) -> Iterator[Message]:
        """Compute the ways anew from here: to the destination that was asked for last, or those of the drive.

        Ways to a destination are offered at once. Those of the drive are stored for :meth:`push`; :meth:`show` offers
        them to viewers, so that a push need not wait until they are described. The message "again" says that there
        were none yet among the people as they are predicted now: ask once more.
        """
        now = self._see(now, pose)
        if self.goal is not None:
            yield from self._offer_goal(now, pose)
            return
        is_rebuilt = self.surroundings.moving or (self.drive is not None and not self.drive.is_prepared)
        offer = self._offer_rest(now, max(AHEAD, min(TIMES_AHEAD * self.took, MOST_AHEAD)))
        is_found = offer is None or (offer.surroundings is self.surroundings and math.isfinite(offer.gap))
        if not is_found and is_rebuilt:
            yield {"type": "again"}

    def show(self, now: float, pose: Pose) -> Iterator[Message]:
        """Offer the ways of the drive that were computed last, unless they were offered already."""
        if self.offer is not None and not any(self.offer is offer for _, offer in self.offers):
            yield self._told(self.offer, now)

    # Choices

    def take(self, now: float, pose: Pose, option: int, asked: float | None = None) -> Iterator[Message]:
        """Take a way of an offer; if it begins too soon, or a newer offer was made, take a similar way of a new one.

        option  number of the way in the offer
        asked   the offer's value ``asked``, by which older offers are recognised; None for the last offer
        """
        offer = self.offer if asked is None else next((offer for at, offer in self.offers if at == asked), None)
        if offer is None or not 0 <= option < len(offer.ways.trajectories):
            many = 0 if offer is None else len(offer.ways.trajectories)
            words = f"there are {many} ways to take, got number {option}; ask for ways first"
            if offer is None and asked is not None:
                words = "these ways are not offered any more; choose again"
            yield {"type": "refused", "words": words}
            return
        now = self._see(now, pose)
        chosen = offer.ways.trajectories[option]
        with self.changing:
            is_takeable = offer is self.offer and not (self._is_late(offer, now) or self._is_behind(offer, now))
            is_takeable = is_takeable and self._is_open(offer, now, option)
        if not is_takeable:
            found = yield from self._anew(now, pose, chosen)
            if found is None:
                return
            offer, option = found
        yield from self._taken(now, offer, option, "choice")

    def _anew(self, now: float, pose: Pose, chosen: Trajectory) -> Generator[Message, None, tuple[Offer, int] | None]:
        """Offer the ways anew; return the offer and the number of its way nearest to the chosen one.

        None, with the message "refused", if their mean distance exceeds `LIKE`.
        """
        if self.goal is not None:
            yield from self._offer_goal(now, pose, max(LEAD, min(TIMES_AHEAD * self._took_goal, MOST_AHEAD)))
        else:
            yield from self.options(now, pose)
            yield from self.show(now, pose)
        took = self.clock() - now
        if took > 0.0 and self.goal is not None and self.offer is not None and self._is_late(self.offer, now):
            yield from self._offer_goal(now + took, pose, min(TIMES_AHEAD * took, MOST_AHEAD))
        offer = self.offer
        if offer is not None and offer.ways.trajectories:
            distances = [apart(chosen, other) for other in offer.ways.trajectories]
            row = int(np.argmin(distances))
            if distances[row] <= LIKE:
                return offer, row
        yield {"type": "refused", "words": PASSED}
        return None

    def push(self, now: float, pose: Pose, direction: float) -> Iterator[Message]:
        """Take the way whose next seconds lie nearest to a direction, rad in the robot's frame; 0 is ahead."""
        now = self._see(now, pose)
        if self.offer is None or self._is_late(self.offer, now):
            if self.goal is not None:
                yield from self._offer_goal(now, pose)
            else:  # among people, known ways: the graph may be built anew
                lead = max(LEAD, min(2.0 * self.took, MOST_AHEAD))
                self._offer_rest(now, lead, within=0.0 if self.surroundings.moving else WITHIN_PUSH)
        yield from self._answer(now, pose[2] + direction)

    def wish(self, now: float, pose: Pose, wish: str) -> Iterator[Message]:
        """Take the way that meets a wish, such as "fewer turns"; see :meth:`hpop.drive.Execution.wish`."""
        now = self._see(now, pose)
        if self.drive is None or self.goal is not None:
            yield {"type": "refused", "words": "a wish changes a drive; take a way first"}
            return
        with self.changing:
            self.offer = None  # a wish is met by the last options
        offer = self._offer_rest(now)
        assert offer is not None
        try:
            answer = self.drive.wish(wish)
        except DriveError as error:
            yield {"type": "refused", "words": printable(str(error))}
            return
        yield {"type": "note", "words": printable(answer.words)}
        if answer.option is not None and not answer.option.keeps_on:
            yield from self._taken(now, offer, answer.option.index, "choice")
        else:
            yield self._told(offer, now)

    def why(self, now: float, pose: Pose, through: Mapping[str, Any]) -> Iterator[Message]:
        """Explain why no way leads through a place.

        through  a point, {x, y}, or {region} in words: the name of a zone, "left of NAME", "between NAME and NAME"
        """
        now = self._see(now, pose)
        offer = self.offer
        if offer is None or not offer.ways.trajectories:
            yield {"type": "refused", "words": "there are no ways to explain; choose a destination first"}
            return
        region = through.get("region") or (through["x"], through["y"])
        problem, front = self._problem_of(offer), offer.ways.front
        if offer.problem is None:
            front = self.planning.front(problem)
        found = why_not(problem, front, region, planner=self.planning.planner)
        line = [] if found.best is None else line_of(found.best.trajectory)
        sentence = printable(found.sentence)
        yield {"type": "why", "sentence": sentence, "exact": found.exact, "costs": found.numbers, "line": line}

    def explore(self, now: float, pose: Pose) -> Iterator[Message]:
        """Yield the message "explorer": data of its page for the front of the ways that were offered last, or None."""
        offer, data = self.offers[-1][1] if self.offers else None, None
        if offer is not None and (offer.options is None or self.drive is not None):
            data = explorer_payload(self._problem_of(offer), offer.ways.front, preference=self.preference)
        yield {"type": "explorer", "payload": data}

    def _problem_of(self, offer: Offer) -> Problem:
        """Return the planning problem of an offer."""
        if offer.problem is not None:
            return offer.problem
        assert self.drive is not None
        assert offer.options is not None
        problem = self.drive.surroundings.at(offer.options.commit.state, offer.time)
        return replace(problem, tour=offer.options.commit.tour)

    # Changes of the world

    def close(self, now: float, pose: Pose, area: Any, name: str = "") -> Iterator[Message]:
        """Close an area: the name of a zone, or corners (x, y), m; ``name`` is the name by which it can be opened."""
        yield from self._change(now, pose, "close", area, name)

    def open(self, now: float, pose: Pose, area: Any) -> Iterator[Message]:
        """Open a closed area, given by name."""
        yield from self._change(now, pose, "open", area, "")

    def restore(self, now: float, pose: Pose, closed: Mapping[str, Any]) -> Iterator[Message]:
        """Restore the closed areas after a crash: close and open areas until those of ``closed`` are the closed ones.

        closed  corners by name
        """
        names = {closing.name for closing in self.surroundings.closings if closing.name}
        for name in names - closed.keys():
            yield from self._change(now, pose, "open", name, "")
        for name in closed.keys() - names:
            yield from self._change(now, pose, "close", closed[name], name)

    def people(
        self,
        now: float,
        pose: Pose,
        people: Sequence[Sequence[float]],
        radius: float | Sequence[float] = Person.radius,
    ) -> Iterator[Message]:
        """Replace the people by those who are seen: x, y, m, and their velocities, m/s.

        radius  m, of each person, or of all
        """
        horizon, radii = self.template.horizon or HORIZON, np.broadcast_to(radius, len(people))
        seen = tuple(
            Person(x, y, velocity=(vx, vy), until=horizon, radius=radius, name=f"person {i}")
            if math.hypot(vx, vy) > STANDS
            else Person(x, y, radius=radius, name=f"person {i}")
            for i, (x, y, vx, vy, radius) in enumerate(
                np.column_stack([np.reshape(people, (-1, 4)), radii]).tolist(), 1
            )
        )
        yield from self._change(now, pose, "people", seen, "")

    def _change(self, now: float, pose: Pose, what: str, value: Any, name: str) -> Iterator[Message]:
        """Change the world of the session and of the drive; if the plan is blocked now, take another way.

        what, value, name  "close", "open" or "people"; the area or the people; the name of a closed area
        """
        now, plan = self._see(now, pose), None
        with self.changing:
            try:
                if self.drive is not None:
                    self.drive.world(now, name=name, **{what: value})
                    self.surroundings = self.drive.surroundings
                    plan = self._plan(now)
                else:
                    self.surroundings = self.surroundings.changed(now, what, value, name, ())
            except HpopError as error:
                yield {"type": "refused", "words": printable(str(error))}
                return
            if plan is not None:
                yield plan
                if what != "people":
                    self.offer = None
                elif plan["arrives"] and self.offer is not None and self._stands(self.offer, now):
                    return  # pushes are answered from it until ways among these people are asked for
        if what != "people":
            self.planning = self.planning.updated(self.surroundings.problem.world)
            closings = {c.name: shapely.get_coordinates(c.area).tolist() for c in self.surroundings.closings if c.name}
            yield {"type": "changed", "closed": closings}
        if plan is None:
            if self.goal is not None:
                yield from self._offer_goal(now, pose)
            return
        yield from self._adapted(now, pose)

    def _adapted(self, now: float, pose: Pose) -> Iterator[Message]:
        """Take another way if the plan is blocked; offer the ways that there are now."""
        offer = self._offer_rest(now, anew=True)
        if offer is not None and self._is_late(offer, now):  # the search took longer than the robot to that place
            now = max(now, self.clock())
            offer = self._offer_rest(now, min(TIMES_AHEAD * self.took, MOST_AHEAD), anew=True)
        with self.changing:
            assert self.drive is not None
            is_blocked = offer is not None and offer is self.offer and offer.ways.present is None
            options = None if offer is None or not is_blocked or self._is_late(offer, now) else offer.options
            if options is not None and self.drive.adapt(options) is not None:
                self.offer = None
                yield self._plan(now)
                words = "the way was closed: another one is taken"
                yield {"type": "taken", "option": None, "by": "plan", "words": words}
        if self.goal is not None:
            yield from self._offer_goal(now, pose)
        elif (offer := self.offer or self._offer_rest(now)) is not None:
            yield from self.show(now, pose)

    def arrived(self, now: float, pose: Pose, there: bool = True) -> Iterator[Message]:
        """End the drive, and say so; not if ``there`` is False: the robot has another plan meanwhile."""
        if there:
            with self.changing:
                self.drive = self.prefix = None
                if self.goal is None:
                    self.offer = None
                yield {"type": "ended"}  # no plan of this drive comes after it
